"""Runs that go on from the network of another, or begin with demonstrations, in real clusters."""

import shutil

import pytest

FAST = ("--algorithm", "ppo", "--set", "evaluation.mode=greedy")


@pytest.mark.slow
def test_whoever_acts_a_run_that_begins_with_a_checkpoint_has_its_curve(clusters):
    clusters.up_any("before", *FAST, "--episodes", "4")
    checkpoint = clusters.root / "before" / "checkpoints" / "00000004.safetensors"
    start = ("--set", f"start_from={checkpoint}")
    clusters.up_any("alone", *FAST, *start, "--episodes", "6")
    clusters.up_any("acted", *FAST, *start, "--episodes", "6", "--actors", "easy=1", "--detach")
    shutil.rmtree(clusters.root / "before")
    clusters.railctl("tail", "acted")
    assert len(clusters.curve("alone")) == 7
    assert clusters.curve("acted") == clusters.curve("alone")


def test_whoever_acts_a_run_that_begins_with_demonstrations_has_its_curve(clusters, tmp_path):
    demonstrations = tmp_path / "some.demos"
    clusters.railctl("demonstrate", "planner", "--level", "easy", "--episodes", "20", "--out", str(demonstrations))
    start = ("--algorithm", "sil", "--set", f"demonstrations={demonstrations}", "--episodes", "6")
    clusters.up_any("shown", *start)
    clusters.up_any("shown-acted", *start, "--actors", "easy=1", "--detach")
    demonstrations.unlink()
    clusters.railctl("tail", "shown-acted")
    assert clusters.curve("shown-acted") == clusters.curve("shown")
    clusters.up_any("not-shown", *start[:2], *start[4:])
    assert clusters.curve("not-shown") != clusters.curve("shown")
