"""What rules share that learn a policy: an actor and a critic, and the clipped updates of both."""

from typing import ClassVar, Literal, Self

from pydantic import Field, model_validator

from railctl.common.rules.settings import NetworkConfig, RuleSettings, StartFrom
from railctl.common.strict import Positive, Strict


class ActorCriticConfig(NetworkConfig):
    """An actor and a critic.

    Attributes:
        kind: `actor-critic`: they share nothing but their input; `exits`: see `common.policy.exits`.
    """

    kind: Literal["actor-critic", "exits"] = "actor-critic"


class PpoConfig(Strict):
    """Proximal policy optimisation (Schulman et al. 2017), its critic clipped as well.

    Attributes:
        returns: `scaled` by 1 - discount, ours; `standardised` over the episode, another reading of the study's
            "normalizing the returns" (section 4.3).
        advantages: `plain`: returns less values, as in the study's Algorithm 3; `standardised`: over the batch, ours.
    """

    learning_rate: Positive
    epochs: int = Field(ge=1, le=1000)  # updates an episode
    returns: Literal["scaled", "standardised"] = "scaled"
    advantages: Literal["standardised", "plain"] = "standardised"
    clip: Positive = 0.2  # of the ratio of probabilities, and of the change of a value
    value_weight: float = Field(default=0.5, ge=0, allow_inf_nan=False)
    entropy_weight: float = Field(default=0.01, ge=0, allow_inf_nan=False)
    anchor_weight: float = Field(default=0.0, ge=0, le=1e6, allow_inf_nan=False)  # of the divergence from `start_from`
    max_gradient_norm: Positive = 0.5


class ActorCriticSettings(RuleSettings):
    """The settings of a rule that learns a policy from whole episodes."""

    network: NetworkConfig = ActorCriticConfig()
    discount: float = Field(default=0.99, gt=0, lt=1)  # a step; returns are scaled by 1 - discount

    has_probabilities: ClassVar[bool] = True

    @property
    def learns_with_torch(self) -> bool:
        return self.brings_module or self.network.kind == "exits"


class PolicySettings(ActorCriticSettings):
    """The settings of a rule that makes clipped updates."""

    ppo: PpoConfig
    start_from: StartFrom | None = None

    learns_from_own_actions: ClassVar[bool] = True

    @model_validator(mode="after")
    def _anchor_has_ground(self) -> Self:
        if self.ppo.anchor_weight and self.start_from is None:
            raise ValueError(
                f"ppo.anchor_weight {self.ppo.anchor_weight:g}: it holds to the policy of start_from, give that as well"
            )
        return self

    @property
    def begins_with(self) -> StartFrom | None:
        return self.start_from

    @property
    def standardises_returns(self) -> bool:
        return self.ppo.returns == "standardised"
