"""Malfunctions: the numbers of numpy's own generator, without drawing a million of them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import made_rails
import numpy as np
import pytest
from flatland.envs.malfunction_generators import MalfunctionParameters, ParamMalfunctionGen
from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common.levels.level import Malfunctions
from railctl.common.rail.compiled import malfunctions
from railctl.common.rail.compiled.malfunctions import (
    DRAWS,
    KEY_WORDS,
    SHIFT_WORDS,
    MalfunctionGenerators,
    duration,
    is_struck,
    seed_words,
    twisted,
    words_of,
)
from railctl.common.rail.compiled.world import CompiledWorld

DEGREE = 19937  # of the generator's characteristic polynomial


class Ours:
    """Draws as a world makes them."""

    def __init__(
        self, parameters: Malfunctions, seed: int = 0, generators: MalfunctionGenerators | None = None
    ) -> None:
        world = CompiledWorld(1, 1, rules="stock")
        level = made_rails.scheduled(made_rails.line((1, 1, 5)), malfunctions=parameters)
        world.load(0, level, seed, generators)
        self._world, batch = world.batch.worlds[0], world.batch
        self._arrays = batch.uniforms[0], batch.later[0], batch.known[0]

    def draw(self) -> int:
        """Steps of a malfunction, 0 for none."""
        uniforms, later, known = self._arrays
        return duration(self._world, later, known) if is_struck(self._world, uniforms, known) else 0


def theirs(parameters: Malfunctions, rng: np.random.RandomState) -> Iterator[int]:
    """What the library draws."""
    generator: Any = ParamMalfunctionGen(MalfunctionParameters(*parameters))
    while True:
        malfunction = generator.generate(rng)
        yield 0 if malfunction is None else malfunction.num_broken_steps


@settings(deadline=None)
@given(st.integers(0, (1 << 32) - 1))
def test_seeds_are_numpys(seed: int):
    words = np.empty(KEY_WORDS + 1, np.uint32)
    seed_words(words, seed)
    np.testing.assert_array_equal(words, words_of(np.random.RandomState(seed)))


@pytest.mark.parametrize("seed", [0, 1, 3_000_000_000])
@pytest.mark.parametrize("steps", [(2, 6), (1, 1), (0, 31), (20, 50), (5, 1000)])
def test_draws_are_flatlands(seed: int, steps: tuple[int, int]):
    parameters = Malfunctions(0.6, *steps)  # often enough to use up a key of the generator, and to go on after it
    expected, ours = theirs(parameters, np.random.RandomState(seed)), Ours(parameters, seed)
    assert [ours.draw() for _ in range(3000)] == [next(expected) for _ in range(3000)]


@pytest.mark.parametrize("drawn", [1, 5, 311, 312, 313, 700])
def test_a_generator_may_stand_anywhere(drawn: int):
    parameters, rng = Malfunctions(0.3, 2, 6), np.random.RandomState(7)
    rng.rand(drawn)
    ours = Ours(parameters, generators=MalfunctionGenerators(words_of(rng)))
    expected = theirs(parameters, rng)
    assert [ours.draw() for _ in range(2500)] == [next(expected) for _ in range(2500)]


def test_the_uniforms_are_read_in_a_circle():
    parameters, rng = Malfunctions(0.3, 2, 6), np.random.RandomState(7)
    origin = words_of(rng)
    broken = rng.rand(DRAWS) < 1 - np.exp(-parameters.rate)
    ours = Ours(parameters, generators=MalfunctionGenerators(origin, draw=DRAWS - 5, later=words_of(rng)))
    for draw in [*range(DRAWS - 4, DRAWS), *range(50)]:
        assert ours.draw() == (rng.randint(2, 7) + 1 if broken[draw] else 0)


def test_the_jump_is_the_power_of_x_that_it_should_be():
    """x^2000000 modulo the characteristic polynomial, found from the generator's own bits (Berlekamp-Massey)."""
    key = list(words_of(np.random.RandomState(1))[:KEY_WORDS])
    for at in range(2 * DEGREE):
        key.append(twisted.py_func(key[at], key[at + 1], key[at + SHIFT_WORDS]))
    polynomial = _characteristic([int(word) & 1 for word in key[KEY_WORDS:]])
    assert polynomial.bit_length() == DEGREE + 1
    power = 1
    for bit in f"{2 * DRAWS:b}":
        power = _modulo(_square(power), polynomial)
        power = _modulo(power << 1, polynomial) if bit == "1" else power
    packed = Path(malfunctions.__file__).with_name("twister_jump.bin").read_bytes()
    assert packed == power.to_bytes((DEGREE + 7) // 8, "little")


def _characteristic(bits: list[int]) -> int:
    """The polynomial over GF(2), a bit a coefficient, of the shortest recurrence that gives the bits."""
    shortest, before, length, since, window = 1, 1, 0, 1, 0
    for at, bit in enumerate(bits):
        window = (window << 1 | bit) & ((1 << DEGREE + 2) - 1)
        if not (shortest & window).bit_count() & 1:
            since += 1
            continue
        changed = shortest ^ before << since
        if 2 * length <= at:
            before, length, since = shortest, at + 1 - length, 0
        shortest, since = changed, since + 1
    return int(f"{shortest:0{length + 1}b}"[::-1], 2)


def _square(polynomial: int) -> int:
    spread = [int(f"{byte:b}", 4) for byte in range(256)]
    squares = (spread[byte].to_bytes(2, "little") for byte in polynomial.to_bytes((DEGREE + 7) // 8, "little"))
    return int.from_bytes(b"".join(squares), "little")


def _modulo(value: int, polynomial: int) -> int:
    while value.bit_length() > DEGREE:
        value ^= polynomial << (value.bit_length() - DEGREE - 1)
    return value
