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

from railctl.common.kernel import bare_kernel

DRAWS: Final = 1_000_000
KEY_WORDS: Final = 624
SHIFT_WORDS: Final = 397
AT_A_TIME: Final = 4  # words that are found together; they divide the key
UPPER, LOWER, TWIST = np.uint32(0x80000000), np.uint32(0x7FFFFFFF), np.uint32(0x9908B0DF)
ONE, NONE = np.uint32(1), np.uint32(0)
WHOLE: Final = float(1 << 53)  # a uniform is a multiple of its inverse


def _jump() -> NDArray[np.uint32]:
    packed = np.frombuffer((Path(__file__).parent / "twister_jump.bin").read_bytes(), np.uint8)
    return np.flatnonzero(np.unpackbits(packed, bitorder="little")).astype(np.uint32)


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
def twisted(word: np.uint32, following: np.uint32, shifted: np.uint32) -> np.uint32:
    """The word that comes `KEY_WORDS` after `word`, given the one after it and the one `SHIFT_WORDS` after it."""
    bits = (word & UPPER) | (following & LOWER)
    return shifted ^ (bits >> ONE) ^ (TWIST if bits & ONE else NONE)


@bare_kernel
def tempered(word: Any) -> int:
    """What the generator gives for a word of its key."""
    y = word ^ (word >> 11)
    y ^= (y << 7) & 0x9D2C5680
    y ^= (y << 15) & 0xEFC60000
    return int(y ^ (y >> 18))


@bare_kernel
def refill(words: NDArray[np.uint32]) -> None:
    """Make the next key of a generator."""
    turn = KEY_WORDS - SHIFT_WORDS
    shifted, following = words[SHIFT_WORDS:], words[1:]
    for at in range(turn):
        words[at] = twisted(words[at], following[at], shifted[at])
    rest, following = words[turn:], words[turn + 1 :]
    for at in range(SHIFT_WORDS - 1):
        rest[at] = twisted(rest[at], following[at], words[at])
    last = KEY_WORDS - 1
    words[last] = twisted(words[last], words[0], words[last - turn])


@bare_kernel
def next_word(words: NDArray[np.uint32]) -> int:
    """The next 32 bits of MT19937."""
    position: Any = np.int64(words[KEY_WORDS])  # numba would mix unsigned with signed to floats
    if position >= KEY_WORDS:
        refill(words)
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
    if found == 0:  # the words after those of the key; some at a time, which do not depend on each other
        turn = KEY_WORDS - SHIFT_WORDS
        for begin in range(0, len(known) - KEY_WORDS, turn):
            before, shifted, after = known[begin:], known[begin + SHIFT_WORDS :], known[begin + KEY_WORDS :]
            for at in range(min(turn, len(after))):
                after[at] = twisted(before[at], before[at + 1], shifted[at])
    for number in range(found, found + AT_A_TIME):
        ahead = known[int(world["position"]) + number :]
        word = np.uint32(0)
        for jump in JUMP:
            word ^= ahead[jump]
        later[number] = word
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
