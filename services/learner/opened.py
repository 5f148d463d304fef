"""The episode that is being trained, put together from its fragments."""

import hashlib
from dataclasses import dataclass, field

import numpy as np

from railctl.common.records.acting import Fragment, Progressed


@dataclass(frozen=True)
class OpenEpisode:
    """The fragments so far, in order, and what they add up to."""

    fragments: list[Fragment] = field(default_factory=list)

    @property
    def steps(self) -> int:
        return sum(len(fragment.course.rewards) for fragment in self.fragments)

    @property
    def decisions(self) -> int:
        return sum(len(fragment.course.decisions) for fragment in self.fragments)

    @property
    def reward(self) -> float:
        """The sum of all rewards of all trains."""
        return sum(float(fragment.course.rewards.sum(dtype=np.float64)) for fragment in self.fragments)

    @property
    def acting_s(self) -> float:
        return sum(fragment.circumstances.acting_s for fragment in self.fragments)

    @property
    def waited_s(self) -> float:
        return sum(fragment.circumstances.waited_s for fragment in self.fragments)

    def staleness(self, version: int) -> int:
        """How many versions of the weights there were from those that it began with to those that it was trained into.

        `version` is that of the weights after it.
        """
        return version - len(self.fragments) - self.fragments[0].lease.weights_version

    @property
    def progressed(self) -> Progressed | None:
        """What an actor needs to go on; None before the first fragment."""
        if not self.fragments:
            return None
        actions = np.concatenate([fragment.course.decisions.actions for fragment in self.fragments])
        states = self.fragments[-1].course.states
        return Progressed.made(fragment=len(self.fragments), first_step=self.steps, actions=actions, states=states)

    @property
    def digest(self) -> str:
        """Hash of the digests of all fragments so far, in order."""
        digest = b""
        for fragment in self.fragments:
            digest = hashlib.blake2b(digest + bytes.fromhex(fragment.digest), digest_size=16).digest()
        return digest.hex()
