"""What every update rule has: a network, a discount, and answers to what the rest of the system asks of it."""

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from railctl.common.strict import Strict

Mode = Literal["greedy", "sample"]  # how a network is scored
START_FILE, DEMONSTRATIONS_FILE = "start.safetensors", "start.demonstrations"  # a run's own copies
Widths = Annotated[tuple[Annotated[int, Field(ge=1, le=4096)], ...], Field(min_length=1, max_length=8)]


class NetworkConfig(Strict):
    """Layers of the network that all trains share; rules narrow its kinds down.

    A rule with a torch module of its own has a section of its own here.
    """

    kind: Literal["plain", "dueling", "dueling-apart", "recurrent", "actor-critic", "exits"] = "plain"
    hidden: Widths = (128, 128)


class StartFrom(Strict):
    """A checkpoint whose network a run begins with.

    Attributes:
        checkpoint: its file; relative paths start from the run file. In that of a run it is the run's own copy.
        digest: that of the file, noted when the run is made; this, not the path, is what a curve depends on.
    """

    checkpoint: str = Field(default=START_FILE, min_length=1)
    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")] | None = None


class Demonstrations(Strict):
    """A file of `railctl demonstrate` whose episodes a replay holds from the start.

    Attributes:
        file: relative paths start from the run file. In that of a run it is the run's own copy.
        digest: that of the file, noted when the run is made; this, not the path, is what a curve depends on.
    """

    file: str = Field(default=DEMONSTRATIONS_FILE, min_length=1)
    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")] | None = None


class RuleSettings(Strict):
    """The settings of an update rule. Each rule adds its sections, and checks how they go together."""

    network: NetworkConfig
    discount: float = Field(default=0.99, gt=0, le=1)  # a step

    has_probabilities: ClassVar[bool] = False  # whether the network says how likely an action is
    learns_from_own_actions: ClassVar[bool] = False  # whether those of older weights would mislead it

    @property
    def steps_a_fragment(self) -> int | None:
        """Environment steps that are acted with the same weights; None: whole episodes."""
        return None

    def epsilon(self, episode: int, episodes: int) -> float:  # noqa: ARG002  (policies explore by what they are)
        """The share of random actions in `episode` (0-based) of a run of `episodes`."""
        return 0.0

    @property
    def teaching(self) -> tuple[int, int, int] | None:
        """Orders, margin and patience of the teacher of all decisions (`common.rail.planning.judging`), if any."""
        return None

    @property
    def standardises_returns(self) -> bool:
        """Whether returns are standardised over the episode, instead of scaled."""
        return False

    @property
    def learns_from_following(self) -> bool:
        """Whether decisions are noted with what their trains see one step later."""
        return False

    @property
    def begins_with(self) -> StartFrom | None:
        """The checkpoint whose network is the first; None: that of the seed."""
        return None

    @property
    def demonstrated(self) -> Demonstrations | None:
        """The demonstrations that the replay begins with, if any."""
        return None

    @property
    def room_for_demonstrations(self) -> int:
        """The decisions that a replay of demonstrations has room for."""
        return 0

    def module(self, n_features: int, n_actions: int, seed: int) -> Any:  # noqa: ARG002
        """A `torch.nn.Module` of the rule's own to train and to act with; None: that of `network.kind`."""
        return None

    @property
    def brings_module(self) -> bool:
        """Whether the network is the rule's own, which torch computes, and not compiled code."""
        return type(self).module is not RuleSettings.module

    @property
    def learns_with_torch(self) -> bool:
        """Whether torch computes updates, so that exactness holds on one kind of processor and one version of torch."""
        return self.brings_module

    @classmethod
    def adapted(cls, preset: Mapping[str, Any], lag: int | str) -> dict[str, Any]:  # noqa: ARG003
        """A preset as it is with a lag: without what only serial runs can have."""
        return dict(preset)
