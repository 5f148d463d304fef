"""The curve is drawn of what there is when its drawing is finished, not when it is begun."""

import pytest

from railctl.common.folder import RunFolder
from railctl.common.interpreter import PYTHON
from railctl.deploy import curve
from railctl.deploy.curve import CurveDrawing
from railctl.deploy.runs import Failed


@pytest.fixture
def begin(tmp_path, monkeypatch):
    """Begins a drawing that a process with this code carries out."""

    def begin(code):
        monkeypatch.setattr(curve, "run_worker", lambda *_: [*PYTHON, "-c", code])
        return CurveDrawing(RunFolder(tmp_path))

    return begin


def test_it_draws_what_came_after_it_was_begun(begin, tmp_path):
    file = tmp_path / "episodes"
    drawing = begin(f"import sys; sys.stdin.read(); print(open({str(file)!r}).read())")
    file.write_text("curve.png")
    assert drawing.finish().name == "curve.png"


@pytest.mark.parametrize(
    ("code", "reason"), [("raise ValueError('no rows')", "ValueError: no rows"), ("exit(1)", "no reason given")]
)
def test_a_curve_that_cannot_be_drawn_says_why(begin, code, reason):
    with pytest.raises(Failed, match=f"^the curve could not be drawn: {reason}$"):
        begin(code).finish()
