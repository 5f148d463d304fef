"""Rows for tests that care for one or two of their values."""

from railctl.common.records.rows import EpisodeRow, EvaluationRow


def episode_row(number, **changes):
    """The row of an episode, with some values of its own."""
    values = {
        "episode": number,
        "level": "easy",
        "seed": 1,
        "normalised_return": -0.5,
        "arrived": 1,
        "trains": 2,
        "steps": 30,
        "decisions": 4,
        "epsilon": 0.1,
        "weights_version": number,
        "digest": "0" * 32,
        "actor": "actor-easy-0",
        "acting_s": 0.25,
        "trained_unix_s": 1000.0,
    }
    return EpisodeRow(**values | changes)


def evaluation_row(episode=10, level="easy", **changes):
    """The row of an evaluation, likewise."""
    values = {
        "mode": "greedy",
        "levels": 50,
        "normalised_return": -0.25,
        "arrived_share": 0.75,
        "all_arrived_share": 0.5,
        "mean_steps": 41.5,
        "weights_digest": "0" * 32,
        "evaluated_unix_s": 1000.0,
        "evaluating_s": 1.0,
    }
    return EvaluationRow(episode=episode, level=level, **values | changes)
