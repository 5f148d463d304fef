"""Malfunctions as flatland-rl 4.3.0 draws them, number for number.

Source: `ParamMalfunctionGen` and `MalfunctionHandler` of flatland-rl 4.3.0. A million uniforms are drawn at the first
step of an environment, and read in a circle, one a train a step, for as long as it lives; how long a malfunction
takes is drawn from the environment's generator as it goes. The generator is numpy's legacy MT19937 (Matsumoto &
Nishimura, 1998), whose state a world takes over and gives back.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel

DRAWS = 1_000_000
KEY_WORDS = 624
SHIFT_WORDS = 397


@dataclass(frozen=True)
class Malfunctions:
    """What an environment's trains suffer, from the coming step on.

    Attributes:
        broken: [DRAWS / 8] uint8, whether a draw breaks a train, a bit each.
        shortest, longest: the parameters `min_duration` and `max_duration`; a malfunction takes one step more.
        draw: the index of the last draw that was used.
        twister: [625] uint32, the state of the generator: key, position.
    """

    broken: NDArray[np.uint8] = field(repr=False)
    shortest: int
    longest: int
    draw: int
    twister: NDArray[np.uint32] = field(repr=False)

    @classmethod
    def drawn(cls, rate: float, shortest: int, longest: int, rng: np.random.RandomState) -> "Malfunctions":
        """For the first step of an environment whose generator is `rng`, which this advances as flatland would.

        Args:
            rate: flatland's `malfunction_rate`.
            shortest: flatland's `min_duration`.
            longest: flatland's `max_duration`.
            rng: the environment's `np_random`.
        """
        probability = 1 - np.exp(-rate) if rate > 0 else 0.0
        broken = np.packbits(rng.rand(DRAWS) < probability)
        return cls(broken, shortest, longest, 0, words_of(rng))

    def continued(self, draw: int, rng: np.random.RandomState) -> "Malfunctions":
        """For the next episode of an environment that used `draw` last and was given a new generator."""
        return Malfunctions(self.broken, self.shortest, self.longest, draw, words_of(rng))


def words_of(rng: np.random.RandomState) -> NDArray[np.uint32]:
    """[625]: the state of a generator."""
    state: Any = rng.get_state(legacy=False)
    return np.append(state["state"]["key"], np.uint32(state["state"]["pos"])).astype(np.uint32)


def generator_of(words: NDArray[np.uint32]) -> np.random.RandomState:
    """The generator with that state."""
    rng = np.random.RandomState()
    rng.set_state(("MT19937", words[:KEY_WORDS], int(words[KEY_WORDS]), 0, 0.0))
    return rng


@bare_kernel
def next_word(words: NDArray[np.uint32]) -> int:
    """The next 32 bits of MT19937."""
    position: Any = np.int64(words[KEY_WORDS])  # numba would mix unsigned with signed to floats
    if position >= KEY_WORDS:
        for at in range(KEY_WORDS):
            bits = (np.int64(words[at]) & 0x80000000) | (np.int64(words[(at + 1) % KEY_WORDS]) & 0x7FFFFFFF)
            twisted = np.int64(words[(at + SHIFT_WORDS) % KEY_WORDS]) ^ (bits >> 1)
            words[at] = twisted ^ 0x9908B0DF if bits & 1 else twisted
        position = 0
    y: Any = np.int64(words[position])
    words[KEY_WORDS] = position + 1
    y ^= y >> 11
    y ^= (y << 7) & 0x9D2C5680
    y ^= (y << 15) & 0xEFC60000
    return int(y ^ (y >> 18))


@bare_kernel
def duration(words: NDArray[np.uint32], shortest: int, longest: int) -> int:
    """`RandomState.randint(shortest, longest + 1) + 1`: numpy masks and rejects."""
    span = longest - shortest
    if span <= 0:
        return shortest + 1
    mask = span
    for shift in (1, 2, 4, 8, 16):
        mask |= mask >> shift
    value = next_word(words) & mask
    while value > span:
        value = next_word(words) & mask
    return shortest + value + 1
