"""The page and the files beside it, of a whole study, of a part of one, and of runs."""

import base64
import csv
import json
import shutil
from html.parser import HTMLParser

import made_study
import numpy as np
import pytest

from railctl.analysis.report import files as report_files
from railctl.analysis.report.__main__ import parsed, report
from railctl.analysis.report.page import page
from railctl.analysis.report.parts import Figure, Listing, Section
from railctl.analysis.report.tables import Column, Table
from railctl.analysis.study import PlannedRun, StudyFolder


class Page(HTMLParser):
    """Elements, identifiers, references and text of a page."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.ids, self.references, self.styles, self.text = [], [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name in {"href", "src", "srcset", "action", "data", "poster"}:
                self.references.append(value)

    def handle_data(self, data):
        if self.tags and self.tags[-1] == "style" and "{" in data:
            self.styles.append(data)
        else:
            self.text += data


@pytest.fixture(scope="module")
def found(made):
    return Page((made.report / "report.html").read_text())


def test_the_page_needs_nothing_from_elsewhere(made, found):
    beside = {path.name for path in made.report.iterdir()}
    for reference in found.references:
        assert reference.startswith(("#", "data:image/svg+xml;base64,")) or reference in beside
    assert not {"script", "link", "iframe", "object", "embed", "base"} & set(found.tags)
    assert "@import" not in "".join(found.styles)
    assert "url(" not in "".join(found.styles)
    assert "http" not in (made.report / "report.html").read_text().replace("http-equiv", "")


def test_images_hold_no_references_either(found):
    sources = [text.partition(",")[2] for text in found.references if text.startswith("data:")]
    images = [base64.b64decode(source).decode() for source in sources]
    assert len(images) == 14
    for image in images:
        references = [text.split('"')[0] for part in ('href="', "url(") for text in image.split(part)[1:]]
        assert references
        assert all(text.startswith(("#", "data:image/png;base64,")) for text in references)


def test_the_table_of_contents_leads_everywhere(found):
    links = [text.removeprefix("#") for text in found.references if text.startswith("#")]
    assert len(found.ids) == len(set(found.ids))
    assert links == found.ids  # in the order of the page


def test_the_order_is_the_studys(found):
    assert [name for name in found.ids if name.startswith(("figure", "table-5", "table-paired", "table-sens"))] == [
        *(f"figure-5.{number}" for number in range(2, 7)),
        *(f"figure-appendix-{number}" for number in range(1, 5)),
        *("table-5.2", "table-5.3"),
        *("figure-iqm", "figure-improvement", "figure-profiles", "figure-iqm-curves", "figure-ranks"),
        *("table-paired", "table-sensitivity"),
    ]


def test_every_figure_and_table_lies_beside_the_page(made, found, numbers):
    for name in numbers["figures"]:
        assert (made.report / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (made.report / f"{name}.svg").read_text().startswith("<?xml")
    for name, table in numbers["tables"].items():
        rows = list(csv.DictReader((made.report / f"{name}.csv").read_text().splitlines()))
        assert len(rows) == len(table["rows"])
    assert {*numbers["figures"], *numbers["tables"]} <= set(found.ids)


def test_numbers_agree_with_the_runs(made, numbers):
    for run in numbers["runs"]:
        rows = (made.run(PlannedRun(run["contender"], run["level"], run["seed"])) / "episodes.jsonl").read_text()
        returns = [json.loads(line)["return"] for line in rows.splitlines()]
        assert run["block_means"] == pytest.approx(np.reshape(returns, (9, 5)).mean(axis=1))
        assert run["score"] == pytest.approx(np.mean(returns[-20:]))
    rows = numbers["tables"]["table-5.2"]["rows"]
    [better] = [row for row in rows if (row["level"], row["contender"]) == ("easy", "dddqn")]
    [worse] = [row for row in rows if (row["level"], row["contender"]) == ("easy", "ppo")]
    assert (better["runs"], better["study's return"], better["study's return std"]) == (3, -0.27, 0.022)
    assert better["return"] > worse["return"]


def test_rankings_are_those_of_the_judge(numbers):
    judged = numbers["reliability"]["metrics"]
    assert list(judged) == ["DT", "DR", "SRT", "LRT"]
    assert numbers["figures"]["figure-5.3"]["numbers"] == judged["DT"]["stats"]["all"]
    [hard] = [zones for level, zones in numbers["figures"]["figure-appendix-4"]["numbers"].items() if level == "hard"]
    assert hard == judged["LRT"]["stats"]["task1"]
    assert len(numbers["tables"]["table-pairs"]["rows"]) == 3 * (3 + 3 + 1 + 1)


@pytest.fixture
def part(made, tmp_path):
    """The study with a run missing, one half done, and one that failed with a reason that is no HTML."""
    path = tmp_path / "made"
    shutil.copytree(made.path, path, ignore=shutil.ignore_patterns("report"))
    folder = StudyFolder(path)
    shutil.rmtree(folder.run(PlannedRun("ppo", "easy", 3)))
    half = folder.run(PlannedRun("dddqn", "hard", 3)) / "episodes.jsonl"
    half.write_text("".join(half.read_text().splitlines(keepends=True)[:20]))
    failed = folder.run(PlannedRun("ppo", "hard", 3))
    (failed / "episodes.jsonl").unlink()
    (failed / "outcome.json").write_text(json.dumps({"outcome": "failed", "reason": "<script>alert('&')</script>"}))
    return folder


def test_a_part_of_a_study_is_reported_as_far_as_it_goes(part, capsys, monkeypatch):
    # As PNG everything is drawn a second time; the fixture `made` has done that for a whole study.
    draw = report_files.image
    monkeypatch.setattr(report_files, "image", lambda drawing, kind: b"" if kind == "png" else draw(drawing, kind))
    report(parsed(["--study", str(part.path)]))
    *_, answer = capsys.readouterr().out.splitlines()
    assert json.loads(answer)["runs"] == {"done": 15, "missing": 1, "unfinished": 1, "failed": 1}
    assert json.loads(answer)["report"] == str(part.report / "report.html")
    found = Page((part.report / "report.html").read_text())
    assert "Missing: ppo-easy-3." in found.text
    assert "Unfinished: dddqn-hard-3." in found.text
    assert "Failed: ppo-hard-3: <script>alert('&')</script>." in found.text
    assert "script" not in found.tags
    assert "seeds 1, 2 (n = 2 runs each). 6 runs are not whole or stand alone" in found.text


def test_the_same_data_has_the_same_bytes(tmp_path, capsys):
    runs = [
        made_study.make_run(tmp_path / name, np.linspace(-1, -0.2, 12), algorithm=name, seed=2, scored=-0.25)
        for name in ("dqn", "sil")
    ]
    asked = [part for run in runs for part in ("--run", str(run))]
    contents = []
    for name in ("a", "b"):
        report(parsed([*asked, "--output", str(tmp_path / name)]))
        contents.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    assert contents[0] == contents[1]
    text = Page(contents[0]["report.html"].decode()).text
    assert "Report on dqn, sil" in text
    assert "each run's own last evaluation while it trained" in text
    assert "Rankings need two seeds" in text


def test_names_are_never_taken_for_html():
    bad = "<img src='https://x.org/a.png'>&amp;\"--><style>*{}</style>"
    parts = (bad, Listing((bad,)), Table("t", bad, bad, (Column(bad),), [[bad]]), Figure("f", bad, bad, None, None))
    found = Page(page(bad, [Section(bad, parts)], {"f": b"<svg/>"}))
    assert found.text.count(bad) == 14
    assert found.tags.count("img") == found.tags.count("style") == 1
    assert not any("x.org" in reference for reference in found.references)
