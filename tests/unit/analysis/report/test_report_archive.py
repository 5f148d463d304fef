"""Results in one file: nothing is lost of them, and the report on them is the same."""

import lzma
from dataclasses import replace

import numpy as np
import pytest

from railctl.analysis.report import archive
from railctl.analysis.report.__main__ import parsed, report
from railctl.analysis.report.loading import load_results, load_study
from railctl.common.strict import ConfigError


def test_nothing_is_lost(made, tmp_path):
    results, path = load_study(made), tmp_path / "results.json.xz"
    archive.save(path, results)
    found = load_results(path)
    assert list(found.runs) == list(results.runs)
    for run, trained in results.runs.items():
        assert found.runs[run].returns.tobytes() == trained.returns.tobytes()
        nothing = np.empty(0)
        assert repr(replace(found.runs[run], returns=nothing)) == repr(replace(trained, returns=nothing))
    assert replace(found, runs={}) == replace(results, runs={})


def test_what_is_published_is_the_report_of_the_study_and_can_be_made_anew(made, tmp_path):
    published, again = tmp_path / "results", tmp_path / "again"
    report(parsed(["--study", str(made.path), "--publish", str(published)]))
    report(parsed(["--results", str(published / "results.json.xz"), "--output", str(again)]))
    files = sorted(path.name for path in published.iterdir())
    assert files == sorted(["results.json.xz", *(path.name for path in made.report.iterdir() if path.suffix != ".png")])
    for name in files:
        if name != "results.json.xz":
            assert (published / name).read_bytes() == (again / name).read_bytes() == (made.report / name).read_bytes()


def test_how_stale_weights_were_is_kept(made, tmp_path):
    results, path = load_study(made), tmp_path / "results.json.xz"
    run = next(run for run, trained in results.runs.items() if trained.state == "done")
    free = replace(results, runs=results.runs | {run: replace(results.runs[run], staleness=2.25)})
    archive.save(path, free)
    assert load_results(path).runs[run].staleness == 2.25


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (None, "No such file or directory: give a file that railctl study publish wrote"),
        (b"", "damaged, or no results: give a file that railctl study publish wrote"),
        (b"{}", "damaged, or no results: give a file that railctl study publish wrote"),
        (lzma.compress(b"[1"), "damaged, or no results: give a file that railctl study publish wrote"),
        (lzma.compress(b"[" * 100_000), "damaged, or no results: give a file that railctl study publish wrote"),
        (lzma.compress(b"{}")[:-1], "damaged, or no results: give a file that railctl study publish wrote"),
        (lzma.compress(b"{}"), "study is missing: give it a value"),
        (lzma.compress(b'{"format": "other"}'), "format: input should be 'railctl results', not 'other'"),
    ],
)
def test_what_is_no_file_of_results_is_refused(tmp_path, content, text):
    path = tmp_path / "results.json.xz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError) as refusal:
        archive.load(path)
    assert str(refusal.value) == f"{path}: {text}"


def test_a_small_file_of_something_enormous_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(archive, "MOST_BYTES", 100_000_000)  # memory, and what may come out
    path = tmp_path / "results.json.xz"
    with lzma.open(path, "wb") as file:
        for _ in range(101):
            file.write(b" " * 1_000_000)
    assert path.stat().st_size < 100_000
    with pytest.raises(ConfigError, match="damaged, or no results"):
        archive.load(path)
