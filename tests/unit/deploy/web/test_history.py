"""Curves and metrics of rows."""

import pytest
from made_rows import episode_row, evaluation_row

from railctl.common.records.rows import MetricRow
from railctl.deploy.web.history import DOTS, History, Metrics, evaluation_document


def test_levels_of_a_mix_have_curves_of_their_own():
    history = History(planned=100)
    history.extend(
        episode_row(number, level="easy" if number % 2 else "hard", normalised_return=-0.1 * (1 + number % 2))
        for number in range(40)
    )
    curves = history.curves()["measures"]["return"]
    assert curves["hard"]["points"][-1] == (39, -0.1, -0.1, -0.1, -0.1)
    assert curves["easy"]["points"][-1] == (40, -0.2, -0.2, -0.2, -0.2)
    assert curves["easy"]["dots"][0] == (2, -0.2)


def test_what_no_episode_has_is_not_drawn():
    history = History(planned=100)
    history.extend(episode_row(number) for number in range(20))
    assert set(history.curves()["measures"]) == {"return", "arrived"}


def test_staleness_and_scores_are_drawn_where_they_are():
    history = History(planned=100)
    history.extend(episode_row(number, staleness=2, score=0.5) for number in range(20))
    measures = history.curves()["measures"]
    assert measures["staleness"]["easy"]["points"][-1][1] == 2
    assert measures["score"]["easy"]["points"][-1][1] == 0.5


def test_a_long_run_is_thinned():
    history = History(planned=20_000)
    history.extend(episode_row(number) for number in range(3 * DOTS))
    curve = history.curves()["measures"]["return"]["easy"]
    assert (len(curve["dots"]), curve["every"]) == (DOTS, 3)


def test_evaluations_are_kept_with_the_interval_of_a_share():
    history = History(planned=100)
    assert history.extend([evaluation_row(all_arrived_share=0.5, levels=50)])
    assert not history.extend([])
    document = evaluation_document(history.evaluations[0])
    assert document["return"] == -0.25
    assert document["all_arrived_low"] == pytest.approx(0.3664, abs=1e-3)  # Wilson's, of 25 in 50
    assert document["all_arrived_high"] == pytest.approx(0.6336, abs=1e-3)


def test_metrics_may_come_and_go():
    metrics = Metrics()
    metrics.add(MetricRow(episode=0, metrics={"loss": 1.0, "learning_s": 0.5}))
    metrics.add(MetricRow(episode=1, metrics={"learning_s": 0.25}))
    metrics.add(MetricRow(episode=2, metrics={"loss": 3.0, "entropy": 0.5, "learning_s": 0.25}))
    document = metrics.document()
    assert document["curves"] == {"loss": [(1, 1.0), (3, 3.0)], "entropy": [(3, 0.5)]}
    assert document["seconds"] == {"learning_s": 1.0}
    assert (document["episodes"], document["recent"]) == (3, 3)
