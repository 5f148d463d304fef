"""What the documents say about the command line exists, and the command line's own help shows all that it says."""

import re
import shlex
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from railctl.deploy.cli import app
from railctl.deploy.resolve import algorithms, parse_sets, resolve

ROOT = Path(__file__).parents[3]
DOCUMENTS = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
BLOCK = re.compile(r"^```.*?^```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"`([^`]+)`")
MAIN = typer.main.get_command(app)


def commands(command=MAIN, path=()):
    """Every command by its words: (), ("up",), ("levels",), ("levels", "build"), ..."""
    yield path, command
    for name in getattr(command, "commands", {}):
        yield from commands(command.imported(name), (*path, name))


COMMANDS = dict(commands())


def spoken(text):
    """The words of every command that a document writes out, in blocks and between backticks."""
    lines = [
        line.removeprefix("$ ") for block in BLOCK.findall(text) for line in block.replace("\\\n", " ").splitlines()
    ]
    lines += [" ".join(inline.split()) for inline in INLINE.findall(BLOCK.sub("", text))]
    for line in lines:
        words = shlex.split(line.replace("[", "").replace("]", ""), comments=True) if "railctl " in line else []
        if words and words[0].endswith("railctl"):
            yield words[1:]


def unknown(words):
    """What is wrong with a command's words, if anything."""
    if words[0].startswith("-"):  # of the whole command line
        return [word for word in words if word not in {name for parameter in MAIN.params for name in parameter.opts}]
    path = tuple(words[:2]) if words[:1] in (["keys"], ["levels"], ["study"]) else tuple(words[:1])
    wrong = []
    for verb in path[-1].split("|"):
        command = COMMANDS.get((*path[:-1], verb))
        if command is None:
            if verb.islower():  # COMMAND stands for any
                wrong.append(verb)
            continue
        options = {name for parameter in command.params for name in parameter.opts} | {"-h", "--help"}
        wrong += [word for word in words if re.match("--?[a-z]", word) and word.partition("=")[0] not in options]
    return wrong


@pytest.mark.parametrize("group", [command for command in COMMANDS.values() if hasattr(command, "commands")])
def test_a_groups_help_says_of_its_commands_what_they_say_of_themselves(group):
    for name, named in group.commands.items():
        assert named.help == group.imported(name).help.split("\n\n")[0].replace("\n", " ")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_command_and_option_of_a_document_exists(document):
    found = {" ".join(words): unknown(words) for words in spoken(document.read_text()) if words}
    assert {line: wrong for line, wrong in found.items() if wrong} == {}


def test_what_the_readme_does_not_know_is_noticed():
    assert unknown(["up", "--levels", "easy"]) == ["--levels"]
    assert unknown(["pause|retsart", "RUN"]) == ["retsart"]
    assert unknown(["levels", "build", "--seeds", "1-2", "--seed=3"]) == ["--seed=3"]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_setting_of_a_document_is_one(document):
    text = re.sub(r"\$ railctl .*\nrailctl: .*", "", document.read_text())  # what is shown to be refused
    for setting in re.findall(r"--set[ \n]+(?!key=value)([a-z_.]+=[^\s`]+)", text):
        refused = []
        for algorithm in algorithms():
            try:
                resolve({"algorithm": algorithm} | parse_sets([setting]))
            except ValueError as error:
                refused.append(str(error))
        assert len(refused) < len(algorithms()), (setting, refused[0])


@pytest.mark.parametrize("path", COMMANDS, ids=lambda path: "-".join(path) or "railctl")
def test_help_shows_all_that_is_written(path):
    shown = CliRunner().invoke(app, [*path, "--help"], env={"COLUMNS": "300", "TERMINAL_WIDTH": "300"})
    assert shown.exit_code == 0
    words = " ".join(re.sub("[│╭╮╰╯─]", " ", shown.stdout).split())
    for parameter in COMMANDS[path].params:
        assert (getattr(parameter, "help", None) or "") in words  # brackets are taken for markup, and swallowed
