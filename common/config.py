"""The configuration of a run: frozen models, checked before any process starts.

A run's learning curve is a function of `RunConfig` without `cluster` and `engine`, which say only how the work is
carried out. Every part of the system receives its own section, never the tree.
"""

from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from common.strict import ConfigError, Positive, Share, Strict, describe

Difficulty = Literal["easy", "medium", "hard"]
Serves = Literal["easy", "medium", "hard", "any"]  # what an actor acts
DIFFICULTIES: tuple[Difficulty, ...] = ("easy", "medium", "hard")

Mode = Literal["greedy", "sample"]  # how a network is scored

MAX_ACTORS = 256  # of one difficulty


class NetworkConfig(Strict):
    """Layers of the network that all trains share."""

    kind: Literal["plain", "dueling", "recurrent", "actor-critic"] = "plain"
    hidden: tuple[Annotated[int, Field(ge=1, le=4096)], ...] = Field(default=(128, 128), min_length=1, max_length=8)


class ReplayConfig(Strict):
    """What is kept to learn from again; `alpha` and `beta` belong to `prioritized` (Schaul et al. 2016)."""

    kind: Literal["uniform", "prioritized"] = "uniform"
    capacity: int = Field(ge=1, le=10_000_000)  # transitions
    alpha: float = Field(default=0.6, ge=0, le=1)  # exponent of the priorities; 0 is uniform
    beta: float = Field(default=0.4, ge=0, le=1)  # of importance weights, growing to 1 over the run; sil wants none: 0


class DqnConfig(Strict):
    """Deep Q-learning and its variants (Mnih et al. 2015), recurrent ones too (Hausknecht & Stone 2015)."""

    learning_rate: Positive
    batch_size: int = Field(ge=1, le=65536)
    learn_every_steps: int = Field(ge=1)  # environment steps between two updates
    target_tau: Share | None = None  # share of the online network that the target takes per update; none: no target
    double: bool = False  # the online network picks, the target network scores (van Hasselt et al. 2016)
    sequence_decisions: int = Field(default=8, ge=1, le=1000)  # a train's last, for recurrent networks only

    @model_validator(mode="after")
    def _double_has_a_target(self) -> Self:
        if self.double and self.target_tau is None:
            raise ValueError("double needs a target network: set target_tau")
        return self


class PpoConfig(Strict):
    """Proximal policy optimisation (Schulman et al. 2017), its critic clipped as well."""

    learning_rate: Positive
    epochs: int = Field(ge=1, le=1000)  # updates an episode
    batch_size: int | None = Field(default=None, ge=1, le=65536)  # drawn from the replay; none: the whole episode
    clip: Positive = 0.2  # of the ratio of probabilities, and of the change of a value
    value_weight: float = Field(default=0.5, ge=0, allow_inf_nan=False)
    entropy_weight: float = Field(default=0.01, ge=0, allow_inf_nan=False)
    max_gradient_norm: Positive = 0.5


class SilConfig(Strict):
    """Self-imitation learning (Oh et al. 2018), after the updates of `PpoConfig` and with its learning rate."""

    epochs: int = Field(ge=1, le=1000)  # updates an episode
    batch_size: int = Field(ge=1, le=65536)
    value_weight: float = Field(default=0.01, ge=0, allow_inf_nan=False)


class ExplorationConfig(Strict):
    """Epsilon-greedy, for action values: epsilon falls geometrically over `decay_share` of the episodes."""

    epsilon_start: float = Field(default=0.9, ge=0, le=1)
    epsilon_end: float = Field(default=0.01, gt=0, le=1)
    decay_share: Share = 0.5

    def epsilon(self, episode: int, episodes: int) -> float:
        """The share of random actions in `episode` (0-based) of a run of `episodes`."""
        if self.epsilon_start <= self.epsilon_end:
            return self.epsilon_start
        progress = min(1.0, episode / max(1.0, episodes * self.decay_share))
        return float(self.epsilon_start * (self.epsilon_end / self.epsilon_start) ** progress)


class EvaluationConfig(Strict):
    """How often a checkpoint is written, and on how many fixed levels it is scored."""

    mode: Mode = "greedy"  # the best action, or for policies one as probable as the network says
    every_episodes: int = Field(default=100, ge=1)
    levels: int = Field(default=50, ge=1, le=1000)  # no more are kept from training


class ClusterConfig(Strict):
    """How the work is carried out; nothing here changes a learning curve."""

    actors: dict[Serves, Annotated[int, Field(ge=0, le=MAX_ACTORS)]]
    cores: int = Field(default=2, ge=1)
    port: int = Field(default=0, ge=0, le=65535)  # 0: any free one
    snapshot_every_episodes: int = Field(default=50, ge=1)
    hang_timeout_s: float = Field(default=60.0, ge=5, allow_inf_nan=False)  # silent for longer: killed, started anew
    max_restarts: int = Field(default=5, ge=0)  # of one process within `restart_window_s`
    restart_window_s: Positive = 120.0


class RunConfig(Strict):
    """Everything that a run is."""

    algorithm: str
    rule: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]  # the update rule: a file of the learner's algorithms
    mix: dict[Difficulty, Share]
    episodes: int = Field(ge=1, le=10_000_000)
    seed: int = Field(default=1, ge=0, lt=2**31)
    lag: int = Field(default=0, ge=0, le=1024)
    engine: Literal["compiled", "flatland"] = "compiled"  # both give the same curve
    discount: float = Field(default=0.99, gt=0, le=1)
    fragment_steps: int | None = Field(default=None, ge=1)  # steps acted with the same weights; none: whole episodes
    network: NetworkConfig
    dqn: DqnConfig | None = None
    ppo: PpoConfig | None = None
    sil: SilConfig | None = None
    replay: ReplayConfig | None = None
    exploration: ExplorationConfig = ExplorationConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    cluster: ClusterConfig

    @model_validator(mode="after")
    def _mix_is_whole(self) -> Self:
        if not self.mix or abs(sum(self.mix.values()) - 1) > 1e-9:
            raise ValueError(f"the shares of mix add up to {sum(self.mix.values()):g}: make it 1")
        return self

    @model_validator(mode="after")
    def _every_difficulty_has_actors(self) -> Self:
        actors = {name: count for name, count in self.cluster.actors.items() if count > 0}
        if "any" not in actors:
            for difficulty in self.mix:
                if difficulty not in actors:
                    raise ValueError(f"no actors for difficulty {difficulty}: add --actors {difficulty}=1")
        for name in actors:
            if name != "any" and name not in self.mix:
                known = ", ".join(self.mix)
                raise ValueError(f"actors for difficulty {name}, which this run does not have: it has {known}")
        return self

    @model_validator(mode="after")
    def _network_fits_the_rule(self) -> Self:
        if (self.dqn is None) == (self.ppo is None):
            raise ValueError("a run learns either action values or a policy: give dqn or ppo, and not both")
        if (self.network.kind == "actor-critic") != (self.ppo is not None):
            wanted = "actor-critic" if self.ppo else "plain, dueling or recurrent"
            raise ValueError(f"network.kind is {self.network.kind}, which {self.rule} cannot train: make it {wanted}")
        if self.evaluation.mode == "sample" and self.ppo is None:
            raise ValueError("evaluation.mode sample: action values give no probabilities to sample, make it greedy")
        return self

    @model_validator(mode="after")
    def _batches_fit_in_replay(self) -> Self:
        for name, section in (("dqn", self.dqn), ("ppo", self.ppo), ("sil", self.sil)):
            field, size = f"{name}.batch_size", None if section is None else section.batch_size
            if size is not None and self.replay is None:
                raise ValueError(f"{field} is drawn from a replay: give replay.capacity")
            if size is not None and self.replay is not None and size > self.replay.capacity:
                raise ValueError(
                    f"{field} {size} exceeds replay.capacity {self.replay.capacity}: make one fit the other"
                )
        return self

    @model_validator(mode="after")
    def _replay_fits_the_policy(self) -> Self:
        """What is learned from again decides what has to be kept, and how it is drawn."""
        if self.ppo is None:
            return self
        if self.sil is not None:
            if self.replay is not None and (self.replay.kind != "prioritized" or self.replay.beta != 0):
                raise ValueError(
                    "self-imitation draws what turned out well: make replay.kind prioritized, replay.beta 0"
                )
        elif self.ppo.batch_size is None and self.replay is not None:
            raise ValueError("without ppo.batch_size nothing is drawn from a replay: leave replay out")
        elif self.replay is not None and self.replay.kind != "uniform":
            raise ValueError(f"{self.rule} draws all alike: make replay.kind uniform")
        return self

    @model_validator(mode="after")
    def _fragments_are_serial(self) -> Self:
        if self.fragment_steps is None:
            return self
        if self.lag > 0:
            raise ValueError(f"lag {self.lag} needs whole episodes: add --set fragment_steps=null")
        if self.ppo is not None:
            raise ValueError(
                f"fragment_steps {self.fragment_steps}: {self.rule} learns from whole episodes, leave it out"
            )
        return self

    @property
    def science(self) -> dict[str, Any]:
        """What determines the learning curve, as plain data: everything but how it is computed."""
        return self.model_dump(mode="json", exclude={"cluster", "engine"})


def parse_config(data: dict[str, Any]) -> RunConfig:
    """Check plain data against `RunConfig`.

    Raises:
        ConfigError: one line that names the first wrong field, its value and the remedy.
    """
    try:
        return RunConfig.model_validate(data)
    except ValidationError as error:
        raise ConfigError(describe(error, RunConfig)) from None
