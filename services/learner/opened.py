"""The episode that is being trained, put together from its fragments."""

import hashlib
from dataclasses import dataclass, field

import numpy as np

from common.records import Episode, Progressed


@dataclass
class OpenEpisode:
    """Sums over the fragments so far; nothing before the first."""

    steps: int = 0
    decisions: int = 0
    reward: float = 0.0  # of all trains; their rewards are whole numbers, so that no sum rounds
    acting_s: float = 0.0
    waited_s: float = 0.0
    weights_version: int = 0  # that the first fragment acted with
    fragments: list[Episode] = field(default_factory=list)
    _digest: bytes = b""

    def add(self, fragment: Episode) -> None:
        """Count in the next fragment."""
        self.steps += len(fragment.rewards)
        self.decisions += len(fragment.actions)
        self.reward += float(fragment.rewards.sum(dtype=np.float64))
        self.acting_s += fragment.acting_s
        self.waited_s += fragment.waited_s
        if fragment.fragment == 0:
            self.weights_version = fragment.weights_version
        self.fragments.append(fragment)
        self._digest = hashlib.blake2b(self._digest + bytes.fromhex(fragment.digest), digest_size=16).digest()

    @property
    def progressed(self) -> Progressed | None:
        """What an actor needs to go on; none before the first fragment."""
        if not self.fragments:
            return None
        actions = np.concatenate([fragment.actions for fragment in self.fragments])
        states = self.fragments[-1].states
        return Progressed(fragment=len(self.fragments), first_step=self.steps, actions=actions, states=states)

    @property
    def digest(self) -> str:
        """Hash of the digests of all fragments so far, in order."""
        return self._digest.hex()
