"""What a check finds: how it is, or what is wrong and what to do about it."""

from collections.abc import Callable
from typing import Literal, NamedTuple

from railctl.deploy.runs import Failed

Grade = Literal["ok", "note", "bad"]


class Finding(NamedTuple):
    """One line of what `railctl doctor` says.

    Attributes:
        code: of the check; docs/troubleshooting.md says more under it.
        check: its name.
        grade: `bad` keeps runs from working, or from being exact; with a `note` they work, but not at their best.
        found: how it is.
        remedy: what to do; empty if it is ok.
    """

    code: str
    check: str
    grade: Grade
    found: str
    remedy: str = ""


class Wrong(Failed):
    """What a check finds to be wrong, and what to do about it."""

    grade: Grade = "bad"

    def __init__(self, found: str, remedy: str) -> None:
        super().__init__(f"{found}: {remedy}")
        self.found, self.remedy = found, remedy


class Noted(Wrong):
    """What works, but not at its best."""

    grade = "note"


class Check(NamedTuple):
    """A check: its code, its name, and what looks; that returns how it is or raises `Wrong`."""

    code: str
    name: str
    look: Callable[[], str]

    def run(self) -> Finding:
        """Look; what goes wrong in looking is found, too."""
        try:
            return Finding(self.code, self.name, "ok", self.look())
        except Wrong as wrong:
            return Finding(self.code, self.name, wrong.grade, wrong.found, wrong.remedy)
        except Failed as error:
            return Finding(self.code, self.name, "bad", str(error), "see the line before")
        except Exception as error:  # noqa: BLE001  (what is broken here breaks checks in ways of its own)
            found = f"{type(error).__name__}: {error}"
            return Finding(self.code, self.name, "bad", found, "undo what you set for it, and look again")
