"""What a snapshot holds besides the trainer's state, as named arrays: all that the learner itself must not forget."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from msgpack._cmsgpack import Packer  # as in `common.wire.codec`

from railctl.common.checkpoint import Tensors
from railctl.common.policy.flat import Arrays
from railctl.common.records.acting import Fragment
from railctl.common.wire.arrays import pack_array
from railctl.common.wire.codec import decode, encode, encoding_of, unpack
from railctl.services.learner.former import blocks_of_now, fragment_of_flat, fragment_of_mapping

# What the names of its arrays begin with:
OLDER, SETTLED, OPEN, NOTED = "weights/", "settled/", "open/", "noted/"


@dataclass(frozen=True)
class Memory:
    """What the learner goes on with.

    Attributes:
        older: earlier weights, by version, that episodes to come still act with.
        settled: the weights after the last whole episode, which is what checkpoints are of.
        opened: the fragments, trained on already, of the open episode.
        noted: what telemetry has noted of that.
    """

    older: dict[int, Arrays]
    settled: Arrays
    opened: list[Fragment]
    noted: Mapping[str, Sequence[float]] = field(default_factory=dict)

    def tensors(self) -> Tensors:
        """As named arrays."""
        arrays: Tensors = {f"{SETTLED}{name}": array for name, array in self.settled.items()}
        for version, weights in self.older.items():
            arrays |= {f"{OLDER}{version}/{name}": array for name, array in weights.items()}
        for number, fragment in enumerate(self.opened):
            arrays[f"{OPEN}{number:06d}"] = np.frombuffer(encode(fragment), np.uint8)
        return arrays | {f"{NOTED}{name}": np.array(values, np.float64) for name, values in self.noted.items()}


def take_memory(snapshot: Tensors) -> Memory:
    """Undo `Memory.tensors`: takes its arrays out of a snapshot and leaves the others there.

    Raises:
        ValueError: a fragment cannot be read.
    """
    older: dict[int, Tensors] = {}
    settled: Tensors = {}
    opened: list[Fragment] = []
    noted: dict[str, list[float]] = {}
    for name in sorted(snapshot):
        if name.startswith(OLDER):
            version, _, parameter = name.removeprefix(OLDER).partition("/")
            older.setdefault(int(version), {})[parameter] = snapshot.pop(name)
        elif name.startswith(SETTLED):
            settled[name.removeprefix(SETTLED)] = snapshot.pop(name)
        elif name.startswith(OPEN):
            opened.append(_fragment(snapshot.pop(name).tobytes(), opened))
        elif name.startswith(NOTED):
            noted[name.removeprefix(NOTED)] = snapshot.pop(name).tolist()
    return Memory(dict(older), settled, opened, noted)


def _fragment(body: bytes, before: list[Fragment]) -> Fragment:
    plain = unpack(body)
    if isinstance(plain, dict):
        return fragment_of_mapping(plain) if "lease" in plain else fragment_of_flat(plain, before)
    if "G" not in plain[1]:  # before schema 6
        body = Packer(default=pack_array).pack(blocks_of_now(plain))
    return decode(Fragment, encoding_of(Fragment), body)
