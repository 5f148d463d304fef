"""The study's levels are those of flatland-rl 2.2.2: the same ones for the same random numbers.

The recording holds, a difficulty, the content hashes of what 2.2.2's own sparse rail and schedule generators made with
`RandomState(0)`, `RandomState(1)` and so on. Levels recorded from whole 2.2.2 environments, whose random numbers are
not known, are compared as samples; what they are like in numbers was taken down with `tools.levels.routes`.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from railctl.common.levels import files, legacy
from railctl.common.levels.compiled.twister import plainly_seeded
from railctl.common.levels.distributions import shipped
from railctl.common.seeding import training_level_seed
from railctl.tools.levels.routes import Numbers, numbers

HERE = Path(__file__).parent
HASHES = json.loads((HERE / "data" / "flatland222_generator.json").read_text())
NUMBERS = HERE / "data" / "flatland222_numbers.npz"
FULL = HERE.parents[2] / "shared" / "data" / "flatland222_levels.npz"  # what the numbers were taken from, if there
SHUFFLES = 4000


@pytest.mark.parametrize("difficulty", shipped())
def test_the_same_random_numbers_give_the_same_levels(difficulty: str):
    for seed, expected in enumerate(HASHES[difficulty]):
        level = legacy._draw(shipped()[difficulty], plainly_seeded(seed))
        assert level.content_hash == expected, f"RandomState({seed})"


def columns(found: list[Numbers]) -> dict[str, np.ndarray]:
    """A number a level; trains of one level are not independent, so their distances count as one."""
    return {
        "rail_cells": np.array([one.rail_cells for one in found]),
        "switches": np.array([one.switches for one in found]),
        "distances": np.array([np.mean(one.distances) for one in found]),
    }


def kolmogorov_smirnov(ours: np.ndarray, theirs: np.ndarray) -> float:
    """The p-value of the two-sample statistic by shuffling, which ties do not disturb."""
    rng = np.random.default_rng(0)
    both = np.concatenate([ours, theirs])
    values, ranks = np.unique(both, return_inverse=True)
    labels = np.arange(len(both)) < len(ours)

    def statistic(first: np.ndarray) -> float:
        shares = [np.bincount(ranks[part], minlength=len(values)).cumsum() / part.sum() for part in (first, ~first)]
        return float(np.abs(shares[0] - shares[1]).max())

    observed = statistic(labels)
    return float(np.mean([statistic(rng.permutation(labels)) >= observed - 1e-12 for _ in range(SHUFFLES)]))


@pytest.mark.parametrize("difficulty", shipped())
def test_levels_are_like_the_recorded_ones(difficulty: str):
    with np.load(NUMBERS) as recorded:
        theirs = {name: recorded[f"{difficulty}_{name}"] for name in Numbers._fields}
    assert (theirs["distances"] > 0).all()
    theirs["distances"] = theirs["distances"].mean(axis=1)
    seeds = [training_level_seed(1, episode) for episode in range(len(theirs["switches"]))]
    ours = columns([numbers(legacy.generate(shipped()[difficulty], seed)) for seed in seeds])
    for name, values in ours.items():
        assert kolmogorov_smirnov(values, theirs[name]) > 0.01, name


if FULL.exists():

    @pytest.mark.parametrize("difficulty", shipped())
    def test_the_numbers_are_those_of_the_recorded_levels(difficulty: str):
        found = [numbers(level) for level in files.load(FULL)[difficulty]]
        with np.load(NUMBERS) as recorded:
            for name in Numbers._fields:
                np.testing.assert_array_equal(recorded[f"{difficulty}_{name}"], [getattr(one, name) for one in found])
