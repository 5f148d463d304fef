"""Keyed, counter-based randomness: a draw is a function of (seed, index, purpose, counter), never of a process.

The generator is SplitMix64 (Steele, Lea & Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014)
read at a counter: draw `n` of a stream is `mix(key + (n + 1) * GAMMA)`. Any draw can be had without the ones before
it, so what an episode does never depends on who else acts, in which order, or in which batch.
"""

import hashlib
from collections.abc import Mapping

GAMMA = 0x9E3779B97F4A7C15
MASK_64 = (1 << 64) - 1
MASK_32 = (1 << 32) - 1
EVALUATION_BIT = 1 << 31


def stream_key(seed: int, index: int, purpose: str) -> int:
    """The 64-bit key of the stream for `purpose` of item `index` (an episode, an update) under `seed`."""
    digest = hashlib.blake2b(f"{seed}/{index}/{purpose}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little")


def bits(key: int, counter: int) -> int:
    """Draw `counter` of stream `key`: 64 random bits."""
    z = (key + (counter + 1) * GAMMA) & MASK_64
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK_64
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK_64
    return z ^ (z >> 31)


def uniform(key: int, counter: int) -> float:
    """Draw `counter` of stream `key` as a float64 in [0, 1)."""
    return (bits(key, counter) >> 11) * 2.0**-53


def training_distribution(mix: Mapping[str, float], run_seed: int, episode: int) -> str:
    """The level distribution of a training episode, drawn with the shares of a mix."""
    if len(mix) > 1:
        draw = uniform(stream_key(run_seed, 0, "difficulty"), episode)
        for name in sorted(mix):
            draw -= mix[name]
            if draw < 0:
                return name
    return max(mix)


def training_level_seed(run_seed: int, episode: int) -> int:
    """The generator seed of a training episode's level: 31 bits, so never an evaluation seed."""
    return stream_key(run_seed, episode, "level") & (EVALUATION_BIT - 1)


def training_malfunction_seed(run_seed: int, episode: int) -> int:
    """The seed of what breaks trains down in a training episode: 32 bits, what flatland's generator takes."""
    return stream_key(run_seed, episode, "malfunctions") & MASK_32


def evaluation_malfunction_seed(index: int) -> int:
    """As `training_malfunction_seed`, of evaluation level `index`: the same for every policy."""
    return stream_key(0, index, "evaluation-malfunctions") & MASK_32


def evaluation_level_seed(index: int, sequence: int = 0) -> int:
    """The generator seed of evaluation level `index` of a sequence: bit 31 is set, as in no training seed.

    Sequence 0 is the one that all runs are evaluated on (see `common.levels.held_out`).
    """
    return (stream_key(sequence, index, "evaluation-level") & (EVALUATION_BIT - 1)) | EVALUATION_BIT
