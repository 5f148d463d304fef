"""The command line as a user meets it, in this process."""

from typer.testing import CliRunner

from railctl.deploy.cli import app


def railctl(*arguments):
    """What a command says and how it ends, which is never an error of Python's."""
    result = CliRunner().invoke(app, [*map(str, arguments)])
    assert result.exception is None or isinstance(result.exception, SystemExit), repr(result.exception)
    return result


def complaint(code, *arguments):
    """The one line that a command ends with."""
    result = railctl(*arguments)
    assert (result.exit_code, result.stdout) == (code, "")
    [line] = result.stderr.splitlines()
    return line
