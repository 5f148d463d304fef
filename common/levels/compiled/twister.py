"""numpy's `RandomState` in compiled code: the Mersenne Twister and the draws that flatland's generators make.

Source: "Mersenne Twister" (Matsumoto & Nishimura 1998), and numpy's legacy seeding, bounded integers, shuffling and
uniform numbers, which numpy promises never to change. A state is an array that its owner passes on: nothing is global.
"""

import hashlib

import numpy as np
from numpy.typing import NDArray

from railctl.common.kernel import bare_kernel

State = NDArray[np.int64]  # [WORDS + 1]: 32 bits each, and the next one's place

WORDS, _AHEAD = 624, 397
_ALL = 0xFFFFFFFF
_WORD_BITS = 32
_SEED_BITS = 64  # more of a seed do not count


def seeded(seed: int) -> State:
    """The state of `flatland.utils.seeding.np_random(seed)`.

    Raises:
        ValueError: the seed is negative.
    """
    if seed < 0:
        raise ValueError(f"seed {seed} is negative")
    digest = hashlib.sha512(str(seed % (1 << _SEED_BITS)).encode()).digest()
    number = int.from_bytes(digest[:8], "little")
    state = np.empty(WORDS + 1, np.int64)
    seed_by_words(state, number & _ALL, number >> _WORD_BITS)
    return state


def plainly_seeded(seed: int) -> State:
    """The state of `RandomState(seed)`."""
    state = np.empty(WORDS + 1, np.int64)
    seed_by_number(state, seed)
    return state


@bare_kernel
def seed_by_number(state: State, number: int) -> None:
    """As `RandomState(number)`."""
    state[0] = number & _ALL
    for at in range(1, WORDS):
        state[at] = (1812433253 * (state[at - 1] ^ (state[at - 1] >> 30)) + at) & _ALL
    state[WORDS] = WORDS


@bare_kernel
def seed_by_words(state: State, low: int, high: int) -> None:
    """As `RandomState([low, high])`, or `RandomState([low])` if `high` is 0."""
    seed_by_number(state, 19650218)
    words = 2 if high else 1
    at, word = 1, 0
    for _ in range(WORDS):
        mixed = state[at] ^ ((state[at - 1] ^ (state[at - 1] >> 30)) * 1664525)
        state[at] = (mixed + (high if word else low) + word) & _ALL
        at, word = at + 1, (word + 1) % words
        if at == WORDS:
            state[0], at = state[WORDS - 1], 1
    for _ in range(WORDS - 1):
        mixed = state[at] ^ ((state[at - 1] ^ (state[at - 1] >> 30)) * 1566083941)
        state[at] = (mixed - at) & _ALL
        at += 1
        if at == WORDS:
            state[0], at = state[WORDS - 1], 1
    state[0] = 0x80000000


@bare_kernel
def _twist(state: State) -> None:
    for at in range(WORDS):
        ahead = state[(at + 1) % WORDS]
        mixed = (state[at] & 0x80000000) | (ahead & 0x7FFFFFFF)
        state[at] = state[(at + _AHEAD) % WORDS] ^ (mixed >> 1) ^ (0x9908B0DF if ahead & 1 else 0)
    state[WORDS] = 0


@bare_kernel
def draw_word(state: State) -> int:
    """The next 32 bits."""
    if state[WORDS] == WORDS:
        _twist(state)
    word = state[state[WORDS]]
    state[WORDS] += 1
    word ^= word >> 11
    word ^= (word << 7) & 0x9D2C5680
    word ^= (word << 15) & 0xEFC60000
    return int(word ^ (word >> 18))


@bare_kernel
def draw_below(state: State, end: int) -> int:
    """`randint(end)`, for 1 to 2**32; from a range of one nothing is drawn."""
    last = end - 1
    if last == 0:
        return 0
    mask = 1
    while mask < last:
        mask = 2 * mask + 1
    number = draw_word(state) & mask
    while number > last:
        number = draw_word(state) & mask
    return number


@bare_kernel
def draw_uniform(state: State) -> float:
    """`random_sample()`: in [0, 1)."""
    high = draw_word(state) >> 5
    return float((high * 67108864.0 + (draw_word(state) >> 6)) / 9007199254740992.0)


@bare_kernel
def draw_pair(state: State, shuffled: NDArray[np.int64]) -> None:
    """`choice(n, 2, replace=False)`: what comes first and second in `shuffled` [n], which is overwritten."""
    for at in range(len(shuffled)):
        shuffled[at] = at
    for at in range(len(shuffled) - 1, 0, -1):
        other = draw_below(state, at + 1)
        shuffled[at], shuffled[other] = shuffled[other], shuffled[at]
