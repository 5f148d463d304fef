"""Worlds of one's own: stock rules with speeds, malfunctions and timetables, and level files, in real clusters."""

import json

import pytest

RUN_FILE = """
levels:
  tidal: {rules: stock, size: [22, 22], trains: 4, cities: 2, speeds: {1: 0.5, 0.5: 0.5}, held_out: 3,
          malfunctions: {rate: 0.02, min_steps: 3, max_steps: 9}, timetable: true}
  given: {files: files/*.pkl}
mix: {tidal: 1}
episodes: 16
seed: 3
observation: {kind: tree, depth: 1, features: plain}
decisions: always
reward: {kind: shaped, deadlock: -5, arrival: 1}
dqn: {batch_size: 32, learn_every_steps: 8}
fragment_steps: 60
evaluation: {every_episodes: 8, levels: 2}
cluster: {snapshot_every_episodes: 4}
"""
SHADOWS = ("random.py", "queue.py", "numpy.py", "common/__init__.py", "deploy/__init__.py", "services/__init__.py")


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """The folder of a user whose files are named like ours and the standard library's."""
    home = tmp_path_factory.mktemp("home")
    for shadow in SHADOWS:
        (home / shadow).parent.mkdir(exist_ok=True)
        (home / shadow).write_text("raise SystemExit('a file of the user was imported')")
    (home / "tidal.yaml").write_text(RUN_FILE.replace("  given: {files: files/*.pkl}\n", ""))
    (home / "run.yaml").write_text(RUN_FILE)
    return home


@pytest.fixture(scope="module")
def alone(clusters, home):
    """The curve of a run that its learner acts, started in that folder."""
    clusters.railctl("up", "-f", "tidal.yaml", "--name", "tidal", cwd=home)
    curve = clusters.curve("tidal")
    assert [row["episode"] for row in curve] == [*range(16), 8, 16]
    assert all(row["score"] is not None for row in curve)
    return curve


def test_three_actors_of_flatland_itself_some_killed_give_the_same_curve(clusters, home, alone, tail):
    disturb(clusters, home, tail, "tidal-three", "--engine", "flatland")
    assert clusters.curve("tidal-three") == alone


@pytest.mark.slow
@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.parametrize("engine", ["compiled", "flatland"])
def test_each_alone_gives_the_same_curve(clusters, home, alone, tail, engine, killed):
    name, options = f"tidal-{engine}-{killed}", ("--engine", engine)
    if killed:
        disturb(clusters, home, tail, name, *options)
    else:
        clusters.railctl("up", "-f", "tidal.yaml", "--name", name, *options, cwd=home)
    assert clusters.curve(name) == alone


def disturb(clusters, home, tail, name, *options):
    """Run three actors, of which one is killed, and then the learner."""
    three = ("--name", name, "--actors", "tidal=3")
    clusters.railctl("up", "-f", "tidal.yaml", *three, "--detach", *options, cwd=home)
    rows = tail(name)
    for episodes, process in ((3, "actor-tidal-0"), (6, "learner")):
        rows.until(episodes)
        clusters.kill(name, process)
    rows.rest()


def test_levels_go_out_to_files_and_a_run_trains_on_them_and_keeps_them(clusters, home):
    clusters.railctl(
        "levels",
        "export",
        "--level",
        "tidal",
        "-f",
        "tidal.yaml",
        "--count",
        "6",
        "--seed",
        "1",
        "--output",
        "files",
        cwd=home,
    )
    clusters.railctl(
        "up",
        "-f",
        "run.yaml",
        "--level",
        "given",
        "--name",
        "given",
        "--episodes",
        "4",
        "--set",
        "evaluation.levels=1",
        cwd=home,
    )
    for file in (home / "files").iterdir():
        file.unlink()
    found = json.loads(clusters.railctl("evaluate", "given", "--json").stdout)  # from the run's own copy
    assert [row["level"] for row in found["rows"]] == ["given"]
    assert found["rows"][0]["score"] is not None
