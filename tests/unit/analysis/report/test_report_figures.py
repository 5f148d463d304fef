"""What drawing rests on: looks that differ, labels and lines that do not lie on each other, equal bytes."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib import rc_context

from railctl.analysis.report.figures.lines import Line, panels
from railctl.analysis.report.figures.rankings import Ranking, lanes, rankings
from railctl.analysis.report.figures.style import SETTINGS, below, image, inches, looks, spread

NAMES = ["dqn", "ddqn", "dddqn", "ppo", "ppor", "sil"]


def test_contenders_differ_without_colour():
    of = list(looks(NAMES).values())
    for aspect in ("colour", "dash", "marker", "hatch"):
        assert len({repr(getattr(look, aspect)) for look in of}) == len(NAMES)
    many = list(looks([str(number) for number in range(42)]).values())
    assert len(set(map(repr, many))) == 42


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_labels_keep_their_order_and_their_distance(heights):
    places = spread(heights, 0.05, 0.0, 1.0)
    order = np.lexsort((range(len(heights)), heights))
    placed = [places[number] for number in order]
    assert all(after - before > 0.05 - 1e-9 for before, after in pairwise(placed))
    assert min(placed) > -1e-9
    assert max(placed) < 1 + 1e-9


@given(st.sets(st.tuples(st.integers(0, 7), st.integers(0, 7)).filter(lambda pair: pair[0] < pair[1])))
def test_lines_in_a_lane_never_touch(pairs):
    found = lanes(dict.fromkeys(pairs, "both"))
    assert set(found) == pairs
    for one, other in combinations(pairs, 2):
        if found[one] == found[other]:
            assert one[1] < other[0] or other[1] < one[0]
    assert set(found.values()) == set(range(len(set(found.values()))))


def test_long_names_are_turned_where_there_is_no_room():
    assert inches(["dddqn", "dqn a=1 bc=10"]) == inches(["dddqn"]) == pytest.approx(0.375)  # settings stand below
    turned = [below([name], width=0.4)["rotation"] for name in ("dddqn", "dddqn-per", "dqn dqn.batch_size=64")]
    assert turned == [0, 30, 90]


def drawing():
    x = np.arange(3.0)
    lines = {name: Line(x, -0.5 + 0.1 * x * number, x * np.nan, x * np.nan) for number, name in enumerate(NAMES)}
    return panels({"easy": lines}, looks(NAMES), {"ylim": (-1, 0)})


@pytest.mark.parametrize("kind", ["svg", "png"])
def test_equal_figures_have_equal_bytes_and_no_date(kind):
    with rc_context(SETTINGS):
        first, second = image(drawing(), kind), image(drawing(), kind)
    assert first == second
    assert b"Date" not in first
    assert b"Matplotlib" not in first


def drawn_lines(axes):
    """Horizontal lines above the bars: their ends and dashes."""
    found = {}
    for line in axes.get_lines():
        (x0, x1), (y0, y1) = line.get_xdata(), line.get_ydata()
        if y0 == y1 and x0 != x1 and line.get_linestyle() != "None":
            found[x0, x1] = line.get_linestyle()
    return found


def test_bars_lines_and_intervals_are_where_the_numbers_are():
    pairs = {(0, 1): "both", (1, 2): "textbook", (0, 2): "tool"}
    panel = Ranking("Middle", [3.0, 1.5, 1.75], [(2.5, 3.25), (1.0, 2.0), (np.nan, np.nan)], pairs)
    figure = rankings([[panel]], looks(["a", "b", "a name that is long"]))
    [axes] = figure.axes
    assert [bar.get_height() for bar in axes.patches[::2]] == [3.0, 1.5, 1.75]
    assert [list(line.get_ydata()) for line in axes.get_lines()[:2]] == [[2.5, 3.25], [1.0, 2.0]]
    assert drawn_lines(axes) == {(0, 1): "-", (1, 2): "--", (0, 2): ":"}
    [legend] = figure.legends
    assert len(legend.get_texts()) == 3
