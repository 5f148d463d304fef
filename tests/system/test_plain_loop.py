"""`railctl bench loop` starts a run as a user does, and trains on the same levels in a plain loop."""

import json

import pytest

from railctl.tools.bench import loop


def test_a_real_run_gives_rows(monkeypatch: pytest.MonkeyPatch, capsys):
    ours = loop.train_ours("easy", 4)
    asked = []
    monkeypatch.setattr(loop, "train_ours", lambda *told: asked.append(told) or ours)
    monkeypatch.setattr("gc.freeze", lambda: None)
    monkeypatch.setattr("signal.signal", lambda *_: None)
    monkeypatch.setattr("sys.argv", ["loop", "--episodes", "4", "--repeats", "1", "--json"])
    loop.main()
    said = capsys.readouterr()
    rows = json.loads(said.out)["rows"]
    assert asked == [("easy", 2), ("easy", 4)]
    assert [row["unit"] for row in rows] == ["steps/s", "decisions/s", "episodes/s", "ms/update", "s"]
    assert all(row["name"].startswith("dddqn easy, ") and row["ours"] > 0 and row["theirs"] > 0 for row in rows)
    assert "0 of 1 repeats: dddqn easy" in said.err
