"""What docs/adapters.md shows works as it stands there."""

import re

from terminal import ROOT, run_command

from railctl.common.interpreter import PYTHON

TEXT = (ROOT / "docs" / "adapters.md").read_text()


def examples(language):
    return re.findall(rf"```{language}\n(.*?)```", TEXT, flags=re.DOTALL)


def test_the_pettingzoo_example_plays_an_episode(tmp_path):
    played = run_command(tmp_path, *PYTHON, "-c", examples("python")[0])
    assert played.returncode == 0, played.stderr
    assert re.fullmatch(r"3 trains, 412 steps, -\d\.\d{3}\n", played.stdout)


def test_the_example_of_a_world_of_your_own_draws_it(tmp_path):
    drawn = run_command(tmp_path, *PYTHON, "-c", examples("python")[1])
    assert drawn.returncode == 0, drawn.stderr
    assert drawn.stdout == "(1127,) (672, 672, 3)\n"


def test_the_command_that_trains_stable_baselines_is_there():
    [command] = examples("sh")
    assert command == "make sb3\n"
    assert "\nsb3: install\n" in (ROOT / "Makefile").read_text()


def test_the_example_of_the_console_commands_generates_and_evaluates(write_checkpoint, tmp_path):
    [script] = examples("bash")
    [checkpoint] = re.findall(r"RAILCTL_CHECKPOINT=(\S+)", script)
    (tmp_path / checkpoint).parent.mkdir(parents=True)
    write_checkpoint(tmp_path / checkpoint)
    done = run_command(tmp_path, "bash", "-e", "-c", script)
    assert done.returncode == 0, done.stderr
    assert "trains arrived. Expected" in done.stdout
    assert done.stdout.splitlines()[-1].startswith("first\t")
