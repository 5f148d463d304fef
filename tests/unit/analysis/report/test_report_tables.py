"""Cells as they are read, and as they are kept."""

import doctest
from dataclasses import replace

import numpy as np

from railctl.analysis.report import tables
from railctl.analysis.report.figures import style
from railctl.analysis.report.loading import load_study
from railctl.analysis.report.markdown import effects
from railctl.analysis.report.sections import reliability
from railctl.analysis.report.tables import Beside, Column, Interval, Spread, Table

ROWS = [
    ["easy", 3, Spread(-0.26, 0.0163), Interval(0.5, 0.25, 0.75), Beside("64", "128"), None, 0.125],
    ["hard", 1, Spread(-0.5, None), Interval(0.5, np.nan, np.nan), Beside("64", "64"), Beside(None, None), np.nan],
]
COLUMNS = (
    Column("level"),
    Column("runs"),
    Column("return", ".2f", ".3g"),
    Column("iqm", ".1f"),
    Column("batch"),
    Column("epochs"),
    Column("arrived", ".1%"),
)
TABLE = Table("table-x", "X", "What one sees.", COLUMNS, ROWS)


def test_cells_are_read_in_one_piece():
    assert TABLE.shown() == [
        ["easy", "3", "-0.26 ± 0.0163", "0.5 [0.2, 0.8]", "64 (128)", "-", "12.5%"],
        ["hard", "1", "-0.50", "0.5", "64", "-", "-"],
    ]


def test_numbers_are_kept_apart_and_in_full():
    first, second = TABLE.records()
    assert (first["return"], first["return std"]) == (-0.26, 0.0163)
    assert (first["iqm low"], first["iqm high"], first["batch of the study"]) == (0.25, 0.75, "128")
    assert (second["return std"], second["iqm low"], second["arrived"]) == (None, None, None)


def test_csv_has_a_column_for_each_number_of_any_row():
    heading, easy, hard = TABLE.csv().splitlines()
    assert heading == (
        "level,runs,return,return std,iqm,iqm low,iqm high,batch,batch of the study,epochs,arrived,epochs of the study"
    )
    assert easy == "easy,3,-0.26,0.0163,0.5,0.25,0.75,64,128,,0.125,"
    assert hard == "hard,1,-0.5,,0.5,,,64,64,,,"


def test_examples_in_docstrings_are_true():
    tried = [doctest.testmod(module) for module in (tables, style, reliability)]
    assert [(each.failed, each.attempted) for each in tried] == [(0, 1), (0, 2), (0, 1)]


def test_effects_compare_each_change_with_its_plain_algorithm_seed_by_seed(made):
    results = load_study(made)
    scores = results.scores(results.rectangle(lambda trained: trained.scored is not None))
    difference = (scores["dddqn-per"] - scores["dddqn"]).mean()
    [heading, _, row] = effects(results).split("\n")
    assert heading == "|  | easy | hard | all | p |"
    assert row.startswith("| `dddqn-per` | ")  # ppo has no change beside it
    assert row.split(" | ")[3].startswith(f"{difference:+.3f} [")
    assert effects(replace(results, contenders=("ppo",))) == ""
