"""What is installed: the system, Python, packages, torch, and whether each start has to compile what never changes."""

import importlib.metadata
import importlib.util
import os
import platform
import re
import sys
from pathlib import Path

from packaging.requirements import Requirement

from railctl.deploy.diagnosis.findings import Noted, Wrong

ARCHITECTURE = "x86_64"
CUDA = re.compile(r"^cuda[^=]*= *'([^']+)'", re.MULTILINE)
INSTALL = "run make install, or pip install railctl's wheel into a fresh environment"


def system() -> str:
    """The operating system and the kind of processor."""
    if platform.system() != "Linux":
        raise Wrong(platform.system(), "runs need Linux: use a virtual machine, or the image that the Dockerfile makes")
    if platform.machine() != ARCHITECTURE:
        remedy = "runs work here, and repeat on processors of this kind; for the same bits elsewhere use x86-64"
        raise Noted(f"Linux on {platform.machine()}", remedy)
    return f"Linux {platform.release()} on x86-64"


def python() -> str:
    """Python's version."""
    if sys.version_info[:2] != (3, 11):
        raise Wrong(platform.python_version(), f"install Python 3.11 and {INSTALL}")
    return platform.python_version()


def packages() -> str:
    """Whether every package is there in a version that railctl can use."""
    found = []
    for requirement in map(Requirement, importlib.metadata.requires("railctl") or []):
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            version = importlib.metadata.version(requirement.name)
        except importlib.metadata.PackageNotFoundError:
            raise Wrong(f"{requirement.name} is missing", INSTALL) from None
        if not requirement.specifier.contains(version, prereleases=True):
            raise Wrong(f"{requirement.name} {version} is not {requirement.specifier}", INSTALL)
        found.append(f"{requirement.name} {version}")
    return ", ".join(found)


def torch_build() -> str:
    """What torch is built for; nothing here imports it, which takes seconds."""
    version = importlib.metadata.version("torch")
    cuda = CUDA.search((_folder_of("torch") / "version.py").read_text())
    if cuda is not None:
        remedy = "it works and is not used: the build for processors alone is gigabytes smaller"
        raise Noted(f"{version}, built for CUDA {cuda[1]}", remedy)
    return f"{version}, for processors"


def bytecode() -> str:
    """Whether Python keeps what it compiles: torch alone takes ten seconds a start without."""
    if sys.dont_write_bytecode or os.environ.get("PYTHONDONTWRITEBYTECODE"):
        raise Noted("PYTHONDONTWRITEBYTECODE is set: processes may compile torch at every start", "unset it")
    kept = Path(importlib.util.cache_from_source(str(_folder_of("torch") / "__init__.py")))
    if not kept.exists() and not os.access(_folder_of("torch"), os.W_OK):
        remedy = "have who owns the folder run python -m compileall on it once"
        raise Noted(f"torch is not compiled, and {kept.parent} cannot be written", remedy)
    return "kept"


def _folder_of(package: str) -> Path:
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise Wrong(f"{package} is missing", INSTALL)
    return Path(spec.origin).parent


def compiled() -> str:
    """Whether our own functions are compiled and kept."""
    from railctl.common.rail.compiled.step import step  # noqa: PLC0415  (numba takes a second)

    folder = Path(step.stats.cache_path)  # type: ignore[attr-defined]  # a dispatcher of numba, whatever its type says
    if not os.access(folder if folder.exists() else folder.parent, os.W_OK):
        raise Wrong(f"{folder} cannot be written", "set NUMBA_CACHE_DIR to a folder that can, or every start compiles")
    if not any(folder.glob("*.nbi")):
        remedy = "the first start does it, which takes two minutes: railctl doctor --compile does it now"
        raise Noted(f"nothing is compiled yet in {folder}", remedy)
    return f"kept, in {folder}"
