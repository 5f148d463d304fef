"""Metric rows: sums and means over the fragments of an episode, forgotten where a snapshot goes on before them."""

import json
from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.summary.writer import event_file_writer

from railctl.common.bus import Traffic
from railctl.common.folder import RunFolder
from railctl.common.process import Fatal
from railctl.services.learner.telemetry import Telemetry


def tell(telemetry, fragment):
    with telemetry.learning():
        pass
    with telemetry.publishing():
        pass
    telemetry.note(fragment)


def told(telemetry, episode, *fragments):
    for fragment in fragments:
        tell(telemetry, fragment)
    telemetry.end_episode(episode, acting_s=0.5, waited_s=0.25, staleness=2)


def rows(folder):
    return [json.loads(line) for line in folder.metrics_file.read_text().splitlines()]


def test_counts_are_summed_and_all_else_is_averaged_over_the_fragments_that_tell_it(tmp_path):
    folder = RunFolder(tmp_path)
    traffic = Traffic()
    traffic.counted(b"before")
    telemetry = Telemetry(folder, 0, traffic)
    traffic.counted(b"four")
    traffic.counted(b"")
    told(telemetry, 0, {"updates": 1.0, "loss": 2.0}, {"updates": 0.0}, {"updates": 3.0, "loss": 4.0})
    traffic.counted(b"six...")
    told(telemetry, 1, {"updates": 0.0})
    telemetry.close()
    first, second = rows(folder)
    assert first["episode"] == 0
    metrics = first["metrics"]
    assert (metrics["updates"], metrics["loss"], metrics["fragments"]) == (4.0, 3.0, 3.0)
    assert (metrics["acting_s"], metrics["actor_waited_s"], metrics["staleness"]) == (0.5, 0.25, 2.0)
    assert min(metrics["learning_s"], metrics["publishing_s"], metrics["learner_waited_s"]) >= 0
    assert (metrics["messages"], metrics["message_bytes"]) == (2.0, 4.0)
    assert (second["metrics"]["messages"], second["metrics"]["message_bytes"]) == (1.0, 6.0)
    assert "loss" not in second["metrics"]
    assert second["metrics"]["fragments"] == 1.0


def test_what_is_trained_again_is_told_again_and_only_once(tmp_path):
    folder = RunFolder(tmp_path)
    before = Telemetry(folder, 0, Traffic())
    for episode in range(5):
        told(before, episode, {"loss": float(episode)})
    before.close()
    after = Telemetry(folder, 3, Traffic())
    told(after, 3, {"loss": 33.0})
    after.close()
    assert [(row["episode"], row["metrics"]["loss"]) for row in rows(folder)] == [
        (0, 0.0),
        (1, 1.0),
        (2, 2.0),
        (3, 33.0),
    ]


def test_what_an_open_episode_has_noted_is_told_with_the_rest_of_it(tmp_path):
    fragments = [{"updates": 1.0, "loss": 2.0}, {"updates": 0.0}, {"updates": 3.0, "loss": 0.1}]
    before = Telemetry(RunFolder(tmp_path), 0, traffic := Traffic())
    assert before.noted() == {}
    tell(before, fragments[0])
    traffic.counted(b"four")
    noted = {name: list(values) for name, values in before.noted().items()}
    before.close()
    after = Telemetry(RunFolder(tmp_path), 0, traffic := Traffic(), noted)
    traffic.counted(b"six...")
    told(after, 0, *fragments[1:])
    after.close()
    [row] = rows(RunFolder(tmp_path))
    assert (row["metrics"]["messages"], row["metrics"]["message_bytes"]) == (2.0, 10.0)
    assert {name: row["metrics"][name] for name in ("updates", "loss", "fragments")} == {
        "updates": 4.0,
        "loss": 1.05,
        "fragments": 3.0,
    }


def test_a_damaged_file_is_fatal_and_named(tmp_path):
    folder = RunFolder(tmp_path)
    folder.metrics_file.write_text("nonsense\n")
    with pytest.raises(Fatal, match=r"metrics\.jsonl line 1"):
        Telemetry(folder, 0, Traffic())


def test_event_files_hold_the_metrics_for_tensorboard(tmp_path, monkeypatch):
    # Files are read in the order of their names, which within a second is that of their numbers only below ten.
    monkeypatch.setattr(event_file_writer, "_global_uid", event_file_writer.AtomicCounter(0))
    folder = RunFolder(tmp_path)
    telemetry = Telemetry(folder, 0, Traffic())
    for episode in range(3):
        told(telemetry, episode, {"loss": episode / 2})
    telemetry.close()
    assert [path.name.startswith("events.out.tfevents") for path in Path(folder.tensorboard).iterdir()] == [True]
    assert losses(folder) == [(0, 0.0), (1, 0.5), (2, 1.0)]
    again = Telemetry(folder, 1, Traffic())
    told(again, 1, {"loss": 4.0})
    again.close()
    assert losses(folder) == [(0, 0.0), (1, 4.0)]


def losses(folder):
    events = EventAccumulator(str(folder.tensorboard)).Reload()
    return [(event.step, event.value) for event in events.Scalars("loss")]
