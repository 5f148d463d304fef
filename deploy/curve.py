"""Drawing a run's learning curve in a process of its own, which gets ready while the run still goes on."""

import subprocess
from pathlib import Path

from railctl.common.folder import RunFolder
from railctl.common.interpreter import run_worker
from railctl.deploy.runs import Failed


class CurveDrawing:
    """A drawing that has begun: what it needs is being imported, which takes longer than the drawing itself."""

    def __init__(self, folder: RunFolder) -> None:
        self._process = subprocess.Popen(
            run_worker("railctl.analysis.curve", "--run", str(folder.path)),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def finish(self) -> Path:
        """Draw what there is of the run by now; returns the picture's path.

        Raises:
            Failed: it could not be drawn.
        """
        said, complained = self._process.communicate()  # which ends its input: it draws
        if self._process.returncode:
            raise Failed(f"the curve could not be drawn: {(complained.splitlines() or ['no reason given'])[-1]}")
        return Path(said.strip())
