"""The page of all commands is what they say of themselves."""

from pathlib import Path

from railctl.tools.documents.commands import page

WRITTEN = Path(__file__).parents[4] / "docs" / "commands.md"


def test_the_page_is_up_to_date():
    assert page() == WRITTEN.read_text(), "run python -m railctl.tools.documents.commands > docs/commands.md"
