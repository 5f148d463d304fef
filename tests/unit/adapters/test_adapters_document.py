"""What docs/adapters.md shows works as it stands there."""

import re

from terminal import ROOT, run_command

from common.interpreter import PYTHON

TEXT = (ROOT / "docs" / "adapters.md").read_text()


def example(language):
    [code] = re.findall(rf"```{language}\n(.*?)```", TEXT, flags=re.DOTALL)
    return code


def test_the_pettingzoo_example_plays_an_episode(tmp_path):
    played = run_command(tmp_path, *PYTHON, "-c", example("python"))
    assert played.returncode == 0, played.stderr
    assert re.fullmatch(r"3 trains, 412 steps, -\d\.\d{3}\n", played.stdout)


def test_the_example_of_the_console_commands_generates_and_evaluates(write_checkpoint, tmp_path):
    script = example("sh")
    [checkpoint] = re.findall(r"RAILCTL_CHECKPOINT=(\S+)", script)
    (tmp_path / checkpoint).parent.mkdir(parents=True)
    write_checkpoint(tmp_path / checkpoint)
    done = run_command(tmp_path, "bash", "-e", "-c", script)
    assert done.returncode == 0, done.stderr
    assert "trains arrived. Expected" in done.stdout
    assert done.stdout.splitlines()[-1].startswith("first\t")
