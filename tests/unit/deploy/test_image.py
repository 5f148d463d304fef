"""The Dockerfile says what the Makefile and the manifests say; nothing is built here."""

import re
from pathlib import Path

import pytest

from railctl.deploy.backends import kubernetes

ROOT = Path(__file__).parents[3]
DOCKERFILE = (ROOT / "Dockerfile").read_text()
MAKEFILE = (ROOT / "Makefile").read_text()
COPIED = [source for line in re.findall(r"^COPY (.+) \S+$", DOCKERFILE, re.MULTILINE) for source in line.split()]


def of_makefile(name):
    [value] = re.findall(rf"^{name} := (.+)$", MAKEFILE, re.MULTILINE)
    return value.split()


@pytest.mark.parametrize("source", COPIED)
def test_what_is_copied_is_there_and_not_ignored(source):
    assert (ROOT / source).exists()
    assert f"!{source}" in (ROOT / ".dockerignore").read_text().splitlines()


def test_all_packages_are_copied_and_compiled():
    packages = of_makefile("PACKAGES")
    assert set(packages) <= set(COPIED)
    assert f"python -m compileall -q {' '.join(packages)}" in DOCKERFILE


def test_it_is_installed_as_the_makefile_installs():
    [torch] = re.findall(r"torch==\S+", MAKEFILE)
    assert f"pip install --no-cache-dir --constraint constraints.txt {torch}\n" in DOCKERFILE
    assert "pip install --no-cache-dir --constraint constraints.txt --editable . " in DOCKERFILE


def test_all_that_runs_need_is_compiled_for_the_processor_that_is_named():
    compiled = re.findall(r"python -m (\S+\.compile)\b", DOCKERFILE)
    assert compiled == of_makefile("COMPILERS")
    assert DOCKERFILE.index("NUMBA_CPU_NAME=$CPU") < DOCKERFILE.index(compiled[0])


def test_it_is_what_the_manifests_rely_on():
    assert f"useradd --uid {kubernetes.USER} " in DOCKERFILE
    assert f"NUMBA_CACHE_DIR={kubernetes.COMPILED}\n" in DOCKERFILE
    assert f"RAILCTL_RUNS={kubernetes.RUNS} " in DOCKERFILE
    assert DOCKERFILE.index("USER railctl") < DOCKERFILE.index('ENTRYPOINT ["railctl"]')
