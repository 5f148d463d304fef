"""What is written down of a run: in order, whatever the clock does, and only what has changed."""

from datetime import datetime as real
from pathlib import Path

import pytest
from learner_report import LEARNER

from railctl.common.folder import RunFolder
from railctl.common.process import STARTING, Fatal
from railctl.common.records.heartbeats import Heartbeat
from railctl.deploy import events
from railctl.deploy.events import DamagedSnapshots, EventLog, changes, last_events
from railctl.deploy.supervisor import Happening

REPORT = LEARNER.model_copy(update={"reissued": 0})


@pytest.fixture
def clock(monkeypatch):
    """The times that the log sees, one after another, as somebody sets the clock."""

    def at(*minutes):
        left = list(minutes)

        class Clock:
            @staticmethod
            def now(zone):
                return real(2030, 1, 2, 3, left.pop(0), 5, 678_901, tzinfo=zone)

        monkeypatch.setattr(events, "datetime", Clock)

    return at


def write(folder, *texts):
    log = EventLog(folder)
    for text in texts:
        log.write(Happening("died", "learner", text))
    log.close()


def test_an_event_is_a_line_with_its_time_in_utc(tmp_path, clock):
    clock(4)
    write(RunFolder(tmp_path), "learner died")
    expected = '{"time":"2030-01-02T03:04:05.678Z","kind":"died","process":"learner","text":"learner died"}\n'
    assert (tmp_path / "events.jsonl").read_text() == expected


def test_times_never_go_back_also_not_after_a_restart(tmp_path, clock):
    folder = RunFolder(tmp_path)
    clock(10, 9, 11, 4)
    write(folder, "a", "b", "c")
    write(folder, "d")
    minutes = [(event.text, event.time[14:16]) for event in last_events(folder, 10)]
    assert minutes == [("a", "10"), ("b", "10"), ("c", "11"), ("d", "11")]
    assert [event.text for event in last_events(folder, 2)] == ["c", "d"]


def test_a_line_that_a_kill_cut_off_is_overwritten(tmp_path):
    folder = RunFolder(tmp_path)
    write(folder, "a", "b")
    folder.events_file.write_bytes(folder.events_file.read_bytes()[:-5])
    write(folder, "c" * 10_000)
    assert [event.text for event in last_events(folder, 10)] == ["a", "c" * events.LONGEST_CHARACTERS]


def test_a_damaged_file_is_fatal_and_named(tmp_path):
    folder = RunFolder(tmp_path)
    folder.events_file.write_text("nonsense\n")
    with pytest.raises(Fatal, match=r"events\.jsonl line 1"):
        EventLog(folder)


def test_a_disk_without_room_loses_an_event_and_no_more(tmp_path, caplog):
    log = EventLog(RunFolder(tmp_path))
    log._file._file.close()
    log._file._file = Path("/dev/full").open("ab", buffering=0)  # noqa: SIM115
    log.write(Happening("died", "learner", "learner died"))
    log.close()
    assert "No space left on device" in caplog.text


def beat(state="training", pid=1, **counts):
    report = None if state == STARTING else REPORT.model_copy(update=counts)
    return Heartbeat(process="learner", role="learner", pid=pid, state=state, report=report)


@pytest.mark.parametrize(
    ("before", "now", "texts"),
    [
        (beat(), beat(), []),
        (None, beat(), []),
        (beat(), beat("paused"), ["paused after episode 40"]),
        (None, beat("paused"), ["paused after episode 40"]),
        (beat("paused"), beat("paused"), []),
        (beat("paused"), beat(), ["resumed after episode 40"]),
        (beat("paused"), beat(STARTING, pid=2), []),
        (beat(refused=3), beat(refused=5), ["messages refused: 2 (since it started: 5)"]),
        (beat(refused=5), beat(refused=5, pid=2), ["messages refused: 5 (since it started: 5)"]),
        (beat(), beat(reissued=2), ["leases reissued: 2 (since it started: 2)"]),
    ],
)
def test_what_a_sign_of_life_says_has_happened(before, now, texts):
    assert [happening.text for happening in changes(before, now)] == texts


def test_a_snapshot_that_is_set_aside_is_told_of_once(tmp_path):
    folder = RunFolder(tmp_path)
    folder.snapshots.mkdir()
    (folder.snapshots / "00000001.damaged").touch()  # of an earlier time
    damaged = DamagedSnapshots(folder)
    assert list(damaged.new()) == []
    (folder.snapshots / "00000005.damaged").touch()
    [told] = damaged.new()
    assert (told.kind, told.process) == ("skipped", "learner")
    assert told.text == "snapshot 00000005.damaged set aside, the run goes on from one before"
    assert list(damaged.new()) == []
