"""The first run on a machine, where nothing is compiled yet."""

import pytest

from railctl.common.compile_signs import COMPILING


@pytest.mark.slow
def test_compiling_is_said_and_never_taken_for_hanging(clusters, undisturbed, tmp_path, monkeypatch):
    monkeypatch.setitem(clusters.environment, "NUMBA_CACHE_DIR", str(tmp_path))
    # Processes that compile are silent for longer than this, but for the beats of compiling.
    clusters.up("first", "--actors", "easy=2", "--set", "cluster.hang_timeout_s=5", "--detach")
    seen = set()

    def finished() -> bool:
        status = clusters.status("first")
        if status["state"] == "unsupervised":  # yet: the machine is busy
            return False
        seen.update(process["state"] for process in status["processes"])
        assert status["problems"] == []
        return status["state"] == "finished"

    clusters.wait(finished)
    assert COMPILING in seen
    assert clusters.curve("first") == undisturbed
    compiled = [path.name for path in tmp_path.rglob("*.nbc")]
    assert any("train" in name or "learn" in name for name in compiled)
    clusters.up("second")
    assert [path.name for path in tmp_path.rglob("*.nbc")] == compiled
