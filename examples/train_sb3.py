"""Trains stable-baselines3's PPO on railctl's PettingZoo environment: one policy that all trains share.

SuperSuit's `black_death_v3` keeps trains that have arrived as agents that see zeros, so that each train is one row of a
vector environment. `make sb3` runs this; `pip install '.[sb3]'` brings what it needs.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecNormalize
from supersuit import black_death_v3, pettingzoo_env_to_vec_env_v1
from supersuit.vector import ConcatVecEnv
from supersuit.vector.sb3_vector_wrapper import SB3VecEnvWrapper

from railctl.adapters.pettingzoo_env import TrainsEnv
from railctl.common.levels.supply import LevelSupply

GAMMA = 0.995


def training_environment(name: str, copies: int) -> SB3VecEnvWrapper:
    """Several copies of the environment side by side, each with levels of its own; a row is a train."""

    def copy(seed: int) -> Callable[[], object]:
        def make() -> object:
            env = TrainsEnv(name)
            env.reset(seed=seed)  # every reset that follows goes on to the next level of this seed
            return pettingzoo_env_to_vec_env_v1(black_death_v3(env))

        return make

    return SB3VecEnvWrapper(ConcatVecEnv([copy(seed) for seed in range(1, copies + 1)]))


def mean_return(model: PPO, name: str, episodes: int, *, greedy: bool) -> float:
    """The mean normalised return of a policy on evaluation levels, on whose rails nobody trains."""
    env, levels = TrainsEnv(name), LevelSupply()
    returns = []
    for index in range(episodes):
        seen, infos = env.reset(seed=0, options={"level": levels.evaluation(name, index)})
        while env.agents:
            deciding = [agent for agent in env.agents if infos[agent]["deciding"]]
            actions = {}
            if deciding:
                chosen, _ = model.predict(np.stack([seen[agent] for agent in deciding]), deterministic=greedy)
                actions = dict(zip(deciding, chosen, strict=True))
            seen, _, _, _, infos = env.step(actions)
        returns.append(next(iter(infos.values()))["normalised_return"])
    return float(np.mean(returns))


def main() -> None:
    """Train, and say how much better trains became."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--levels", default="easy", help="name of the level distribution")
    parser.add_argument("--steps", type=int, default=150_000, help="of all trains together")
    parser.add_argument("--copies", type=int, default=8, help="of the environment")
    parser.add_argument("--episodes", type=int, default=50, help="evaluation levels")
    options = parser.parse_args()
    set_random_seed(1)
    env = training_environment(options.levels, options.copies)
    model = PPO(
        "MlpPolicy",
        VecNormalize(env, norm_obs=False, gamma=GAMMA),  # rewards add up to hundreds
        n_steps=256,
        batch_size=512,
        n_epochs=6,
        learning_rate=1e-3,
        gamma=GAMMA,
        policy_kwargs={"net_arch": [128, 128]},
        device="cpu",
    )

    def tell(who: str) -> None:
        sampled, greedy = (
            mean_return(model, options.levels, options.episodes, greedy=greedy) for greedy in (False, True)
        )
        print(f"{who}: mean normalised return {sampled:.3f} sampled, {greedy:.3f} greedy, {options.episodes} levels")

    tell("untrained")
    start = time.perf_counter()
    model.learn(options.steps)
    wall_s = time.perf_counter() - start
    print(f"{model.num_timesteps} steps in {wall_s:.0f} s")
    tell("trained")


if __name__ == "__main__":
    main()
