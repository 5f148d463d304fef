"""Settings of the rule `ppo`."""

from railctl.common.rules.policies import ActorCriticConfig, PolicySettings


class Settings(PolicySettings):
    """Proximal policy optimisation on whole episodes."""

    network: ActorCriticConfig = ActorCriticConfig()
