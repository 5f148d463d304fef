"""Malfunctions as flatland-rl 4.3.0 draws them, number for number, without drawing what nobody uses.

Source: `ParamMalfunctionGen` and `MalfunctionHandler` of flatland-rl 4.3.0. At the first step an environment draws a
million uniforms from its generator, and reads them in a circle, one a train a step; how long a malfunction takes is
drawn from what the generator gives after them. The generator is numpy's legacy MT19937.

Here a world has the generator twice: one copy gives the uniforms as they are needed; the other is a million uniforms
ahead, but is not taken there before something breaks down. MT19937 is linear over GF(2), so any of its words is a sum
of others: 2,000,000 words ahead, of those among the next 19,937 that `twister_jump.bin` names (a bit each; the file is
x^2000000 modulo the characteristic polynomial). Words are found so a few at a time, and in the usual way once there
are as many as the generator's key has.

Sources: "Mersenne Twister: A 623-Dimensionally Equidistributed Uniform Pseudo-Random Number Generator", Matsumoto &
Nishimura (1998); "Efficient Jump Ahead for F2-Linear Random Number Generators", Haramoto et al. (2008).
"""

from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.kernel import bare_kernel

DRAWS: Final = 1_000_000
KEY_WORDS: Final = 624
SHIFT_WORDS: Final = 397
AT_A_TIME: Final = 16  # words that are found together; they divide the key
WHOLE: Final = float(1 << 53)  # a uniform is a multiple of its inverse


def _jump() -> NDArray[np.int32]:
    packed = np.frombuffer((Path(__file__).parent / "twister_jump.bin").read_bytes(), np.uint8)
    return np.flatnonzero(np.unpackbits(packed, bitorder="little")).astype(np.int32)


JUMP: Final = _jump()  # which words add up to the one that is 2 * DRAWS ahead of the first
KNOWN_WORDS: Final = 2 * KEY_WORDS + int(JUMP[-1]) + 1  # what takes a whole key there


class MalfunctionGenerators(NamedTuple):
    """Where an environment of flatland-rl stands with its malfunctions.

    Attributes:
        origin: [625] uint32, the generator's state before the million uniforms: key, position.
        draw: the index of the last uniform that was used.
        later: [625] uint32, the generator's state now; None: nothing was drawn since the uniforms.
    """

    origin: NDArray[np.uint32]
    draw: int = 0
    later: NDArray[np.uint32] | None = None


def words_of(rng: np.random.RandomState) -> NDArray[np.uint32]:
    """[625]: the state of a generator."""
    state: Any = rng.get_state(legacy=False)
    return np.append(state["state"]["key"], np.uint32(state["state"]["pos"])).astype(np.uint32)


def seeded(seed: int) -> MalfunctionGenerators:
    """Those of a fresh environment whose generator is `numpy.random.RandomState(seed)`; seed has 32 bits."""
    words = np.empty(KEY_WORDS + 1, np.uint32)
    seed_words(words, seed)
    return MalfunctionGenerators(words)


@bare_kernel
def seed_words(words: NDArray[np.uint32], seed: int) -> None:
    """Fill `words` [625] with the state of `numpy.random.RandomState(seed)`."""
    word: Any = np.int64(seed)
    for at in range(KEY_WORDS):
        words[at] = word
        word = (1812433253 * (word ^ (word >> 30)) + at + 1) & 0xFFFFFFFF
    words[KEY_WORDS] = KEY_WORDS


@bare_kernel
def twisted(word: Any, following: Any, shifted: Any) -> Any:
    """The word that comes `KEY_WORDS` after `word`, given the one after it and the one `SHIFT_WORDS` after it."""
    bits = (word & 0x80000000) | (following & 0x7FFFFFFF)
    return shifted ^ (bits >> 1) ^ (0x9908B0DF * (bits & 1))


@bare_kernel
def tempered(word: Any) -> int:
    """What the generator gives for a word of its key."""
    y = word ^ (word >> 11)
    y ^= (y << 7) & 0x9D2C5680
    y ^= (y << 15) & 0xEFC60000
    return int(y ^ (y >> 18))


@bare_kernel
def next_word(words: NDArray[np.uint32]) -> int:
    """The next 32 bits of MT19937."""
    position: Any = np.int64(words[KEY_WORDS])  # numba would mix unsigned with signed to floats
    if position >= KEY_WORDS:
        turn = KEY_WORDS - SHIFT_WORDS
        for at in range(turn):
            words[at] = twisted(np.int64(words[at]), np.int64(words[at + 1]), np.int64(words[at + SHIFT_WORDS]))
        for at in range(turn, KEY_WORDS - 1):
            words[at] = twisted(np.int64(words[at]), np.int64(words[at + 1]), np.int64(words[at - turn]))
        last = KEY_WORDS - 1
        words[last] = twisted(np.int64(words[last]), np.int64(words[0]), np.int64(words[last - turn]))
        position = 0
    words[KEY_WORDS] = position + 1
    return tempered(np.int64(words[position]))


@bare_kernel
def begin(
    world: np.void, uniforms: NDArray[np.uint32], later: NDArray[np.uint32], known: NDArray[np.uint32], goes_on: bool
) -> None:
    """Make the generators of a world, whose `draw` is known, ready for its next step.

    Args:
        world: of which they are.
        uniforms: [625], the state before the million uniforms; overwritten with where they go on.
        later: [625], the state after them, if it `goes_on`; else overwritten: nothing of it is known yet.
        known: [KNOWN_WORDS], overwritten with the words before the uniforms.
        goes_on: see `later`.
    """
    for at in range(KEY_WORDS):
        known[at] = uniforms[at]
    world["position"] = uniforms[KEY_WORDS]
    world["found"] = KEY_WORDS if goes_on else 0
    if not goes_on:
        later[KEY_WORDS] = 0
    for _ in range(2 * (world["draw"] + 1)):
        next_word(uniforms)


@bare_kernel
def is_struck(world: np.void, uniforms: NDArray[np.uint32], known: NDArray[np.uint32]) -> bool:
    """Whether the next uniform of a world says that a train breaks down."""
    world["draw"] += 1
    if world["draw"] == DRAWS:
        world["draw"] = 0
        for at in range(KEY_WORDS):
            uniforms[at] = known[at]
        uniforms[KEY_WORDS] = world["position"]
    high = next_word(uniforms) >> 5
    low = next_word(uniforms) >> 6
    return high * 67108864.0 + low < float(world["chance"])


@bare_kernel
def find_words(world: np.void, later: NDArray[np.uint32], known: NDArray[np.uint32]) -> None:
    """Find the next words of the key that the generator has after a million uniforms."""
    found = int(world["found"])
    if found == 0:  # the words after those of the key, one after the other
        for at in range(KEY_WORDS, len(known)):
            before = at - KEY_WORDS
            word, following = np.int64(known[before]), np.int64(known[before + 1])
            known[at] = twisted(word, following, np.int64(known[before + SHIFT_WORDS]))
    later[found : found + AT_A_TIME] = 0
    first = int(world["position"]) + found
    for jump in JUMP:
        for number in range(AT_A_TIME):
            later[found + number] ^= known[first + jump + number]
    world["found"] = found + AT_A_TIME


@bare_kernel
def later_word(world: np.void, later: NDArray[np.uint32], known: NDArray[np.uint32]) -> int:
    """The next 32 bits of a world's generator after a million uniforms."""
    if world["found"] < KEY_WORDS and later[KEY_WORDS] == world["found"]:
        find_words(world, later, known)
    return next_word(later)


@bare_kernel
def duration(world: np.void, later: NDArray[np.uint32], known: NDArray[np.uint32]) -> int:
    """`RandomState.randint(shortest, longest + 1) + 1`: numpy masks and rejects."""
    shortest, span = int(world["shortest"]), int(world["longest"]) - int(world["shortest"])
    if span <= 0:
        return shortest + 1
    mask = span
    for shift in (1, 2, 4, 8, 16):
        mask |= mask >> shift
    value = later_word(world, later, known) & mask
    while value > span:
        value = later_word(world, later, known) & mask
    return shortest + value + 1
