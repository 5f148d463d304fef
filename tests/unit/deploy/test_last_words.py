"""What the last words of a process are; what is decided about it is tested with the mind."""

import pytest

from railctl.common.folder import RunFolder
from railctl.common.process import EXIT_FATAL
from railctl.deploy.processes import LAST_WORDS_CHARACTERS, last_words

INFO = "2020-01-02 12:00:00,000 INFO services.learner: goes on"
ERROR = "2020-01-02 12:00:00,000 ERROR common.process: snapshots/5: damaged"


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], ""),
        ([INFO, "ValueError: no room"], "ValueError: no room"),
        ([INFO, ERROR, INFO], "snapshots/5: damaged"),
        ([ERROR.replace("damaged", "old"), ERROR], "snapshots/5: damaged"),
        ([ERROR, *[INFO] * 50], INFO),  # too long ago
        (["x" * 1000], "x" * LAST_WORDS_CHARACTERS),
    ],
)
def test_the_last_words_of_a_process(tmp_path, lines, words):
    folder = RunFolder(tmp_path)
    folder.logs.mkdir()
    (folder.logs / "learner.log").write_text("".join(f"{line}\n" for line in lines))
    assert last_words(folder, "learner", 1) == words


def test_a_process_without_a_log_has_no_last_words(tmp_path):
    assert last_words(RunFolder(tmp_path), "learner", 1) == ""


@pytest.mark.parametrize(("lines", "words"), [([INFO], "could not even write its log"), ([ERROR], "damaged")])
def test_who_cannot_go_on_and_does_not_say_why_had_no_room_for_it(tmp_path, lines, words):
    folder = RunFolder(tmp_path)
    folder.logs.mkdir()
    (folder.logs / "learner.log").write_text("".join(f"{line}\n" for line in lines))
    assert words in last_words(folder, "learner", EXIT_FATAL)


def test_last_words_may_be_no_text(tmp_path):
    folder = RunFolder(tmp_path)
    folder.logs.mkdir()
    (folder.logs / "learner.log").write_bytes(b"killed \xff\xfe\n")
    assert last_words(folder, "learner", -9).startswith("killed ")
