"""The functions of `import railctl`; each imports what it needs when it is called.

What goes wrong comes as `railctl.ConfigError` (a ValueError: something was asked for that cannot be) or as
`railctl.Failed` (it was asked correctly, and could not be done); either is one line that says what to do.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from railctl.adapters.pettingzoo_env import TrainsEnv
    from railctl.common.records.rows import EpisodeRow, EvaluationRow
    from railctl.policies import Policy
    from railctl.results import Evaluation
    from railctl.trained import Run

EPISODES = 100


def load_policy(name: str | Path) -> "Policy":
    """A trained policy, ready to act in this process.

    Args:
        name: a checkpoint's file, one that ships (`pretrained/dispatch-hard`), or a run: its newest checkpoint.

    Raises:
        ConfigError: there is none of this name, or the file cannot be used.
        Failed: the run has no checkpoint yet.

    >>> load_policy("pretrained/dispatch-hard")
    Policy('pretrained/dispatch-hard': dispatch after 1500 episodes, 391 features)
    """
    from railctl.policies import Policy

    return Policy(name)


def evaluate(  # noqa: PLR0913
    policy: "Policy | Run | str | Path",
    level: str | None = None,
    episodes: int | None = None,
    *,
    mode: Literal["greedy", "sample"] | None = None,
    seed: int = 0,
    levels: Path | str | None = None,
    run_file: Path | str | None = None,
    progress: bool = False,
) -> "Evaluation":
    """Play levels that training never sees, in a process of its own, as `railctl evaluate` does.

    Args:
        policy: one that was loaded, a run, whatever `load_policy` takes, or a reference policy, as `planner`, `random`
            or `shortest-path`.
        level: the levels, `easy`, `medium`, `hard`, or a name of the run file or of the group of a file; if not given
            the first that the policy was trained on, for reference policies `easy`.
        episodes: how many levels; if not given 100, or all that are held out.
        mode: take the best action, or draw as the network's probabilities say; if not given as its run scores it.
        seed: of the levels; all runs are evaluated on those of 0, which no run trains on.
        levels: a file of levels to play instead, .npz or flatland-rl's .pkl; then `episodes`, `seed` and `run_file`
            stay out.
        run_file: a run file with levels of your own.
        progress: say on stderr how far it is.

    Raises:
        ConfigError: there are no such levels, or not so many, or no such policy.
        Failed: a level cannot be played.

    >>> evaluate("shortest-path", level="easy", episodes=10)
    Evaluation('shortest-path' on 10 levels of easy: return -0.342, 70.0% of the trains arrived)
    """
    from railctl.results import scored

    return scored(policy, level, episodes, mode=mode, seed=seed, levels=levels, run_file=run_file, progress=progress)


def make_env(
    where: "str | Path | Policy | Run" = "easy",
    *,
    level: str | None = None,
    render_mode: Literal["rgb_array", "human"] | None = None,
    **settings: Any,
) -> "TrainsEnv":
    """A world as a PettingZoo `ParallelEnv`, an agent a train; see docs/adapters.md for all that it does.

    Args:
        where: levels that ship (`easy`, `medium`, `hard`), a run file, or a policy or run: the world that it knows.
        level: of a run file, policy or run only the levels of this name.
        render_mode: `rgb_array`: `env.render()` gives a picture [H, W, 3] of uint8; `human`: a window.
        settings: keys of a run file that say what the world is, on top of that: `observation`, `decisions`, `reward`,
            `interlocking`, `patience`.

    Returns:
        Observations are float32 [F], actions 0 to 4: do nothing, left, forward, right, stop.

    Raises:
        ConfigError: there are no such levels, or a setting is none.

    >>> env = make_env("medium", observation="traffic")
    >>> observations, infos = env.reset(seed=1)
    >>> len(env.agents), observations["train_0"].shape, infos["train_0"]["action_mask"].tolist()
    (5, (391,), [1, 1, 1, 1, 1])
    """
    from railctl.worlds import environment

    env: TrainsEnv = environment(where, level, render_mode, settings)
    return env


def train(  # noqa: PLR0913
    algorithm: str | None = None,
    level: str | None = None,
    episodes: int | None = None,
    *,
    name: str | None = None,
    seed: int | None = None,
    run_file: Path | str | None = None,
    wait: bool = True,
    on_row: "Callable[[EpisodeRow | EvaluationRow], None] | None" = None,
    **settings: Any,
) -> "Run":
    """Start a run as `railctl up` does, or go on with one, and wait until it ends.

    Its processes are apart from this one; so it survives this one if it is killed, and `open_run` finds it again.
    Ctrl-C stops it cleanly, with everything in a snapshot, and comes through as KeyboardInterrupt; `train` with the
    same name goes on with it.

    Args:
        algorithm: a preset, `dddqn` if not given; `railctl up --help` names all.
        level: the levels, `easy` if not given.
        episodes: of training, 1500 if not given.
        name: of the run; a new one if not given.
        seed: of everything random, 1 if not given.
        run_file: as `railctl up -f` takes it.
        wait: for the end; else return as soon as the run has started.
        on_row: hears every row of the run while this waits, each once.
        settings: any keys of a run file, as `lag=3`, `dqn={"batch_size": 64}`, `evaluation={"every_episodes": 50}`,
            `cluster={"actors": {"easy": 2}}`.

    Raises:
        ConfigError: something was asked for that cannot be; nothing was started.
        Failed: the run could not start, or failed.

    >>> run = train("dddqn", "easy", episodes=40, name="doctest", evaluation={"every_episodes": 20, "levels": 5})
    >>> run.state, len(run.rows()), [row.episode for row in run.evaluations()], run.checkpoint.name
    ('finished', 40, [20, 40], '00000040.safetensors')
    """
    from railctl.trained import start

    given = {"algorithm": algorithm, "level": level, "episodes": episodes, "seed": seed}
    run = start(name, run_file, given, settings)
    return run.wait(on_row) if wait else run


def runs() -> "list[Run]":
    """All runs in `runs/`, or where RAILCTL_RUNS says, the newest last."""
    from railctl.deploy.runs import all_runs
    from railctl.trained import Run

    return [Run(folder) for folder in all_runs()]


def open_run(name: str | Path | None = None) -> "Run":
    """The run of a name or a folder; without one the newest that is running, or else the newest.

    Raises:
        ConfigError: there is no such run.
    """
    from railctl.deploy.runs import find_run
    from railctl.trained import Run

    return Run(find_run(None if name is None else str(name)))
