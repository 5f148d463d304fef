"""One cluster of Slurm for all tests of this folder."""

import getpass
import os
import shutil
import tempfile
from contextlib import ExitStack
from pathlib import Path

import pytest
from slurm_site import Site

from railctl.deploy.follow import wait_until

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "scancel", "scontrol", "squeue", "srun")


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    path = f"{os.environ['PATH']}:/usr/sbin"
    if missing := [name for name in PROGRAMS if shutil.which(name, path=path) is None]:
        pytest.skip(f"there is no {', '.join(missing)} here (Debian: apt-get install slurm-wlm munge)")
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="railctl-slurm-")))
        folder.chmod(0o755)  # munge asks for it
        site = Site(folder, tmp_path_factory.mktemp("runs"))
        stack.enter_context(pytest.MonkeyPatch.context()).setenv("PATH", path)
        site.begin(stack)
        yield site
        site.run("scancel", f"--user={getpass.getuser()}", code=None)
        wait_until(lambda: not site.said("squeue", "--noheader"), 60.0)
