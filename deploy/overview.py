"""What `railctl status` shows, put together from the supervisor's wards and the last heartbeats. Pure."""

import os
from collections.abc import Mapping, Sequence

from railctl.common.config import RunConfig
from railctl.common.folder import RunFolder
from railctl.common.records.control import ProcessStatus, Progress, RunState, Status
from railctl.common.records.heartbeats import EvaluatorReport, Heartbeat, LearnerReport
from railctl.deploy.supervisor import Supervisor

Beats = Mapping[str, tuple[Heartbeat, float]]  # process -> last heartbeat, unix time of its arrival


def run_is_complete(config: RunConfig, beats: Beats) -> bool:
    """Whether every episode is trained and every checkpoint evaluated."""
    progress = progress_of(config, beats)
    return (
        progress is not None and progress.done == config.episodes and progress.evaluations >= progress.evaluations_due
    )


def progress_of(config: RunConfig, beats: Beats) -> Progress | None:
    """How far the run is; None before the learner's first report."""
    learner = _learner(beats)
    if learner is None:
        return None
    evaluator = beats["evaluator"][0].report if "evaluator" in beats else None
    return Progress(
        **learner.model_dump(exclude={"checkpoints", "exact_until"}),
        evaluations=evaluator.evaluations if isinstance(evaluator, EvaluatorReport) else 0,
        evaluations_due=learner.checkpoints * len(config.mix),
    )


def _learner(beats: Beats) -> LearnerReport | None:
    report = beats["learner"][0].report if "learner" in beats else None
    return report if isinstance(report, LearnerReport) else None


def overview(  # noqa: PLR0913  (all that is known)
    folder: RunFolder,
    config: RunConfig,
    mind: Supervisor,
    pids: Mapping[str, int],
    beats: Beats,
    joined: Sequence[ProcessStatus] = (),
) -> Status:
    """The state of a run and of all its processes; those that have `joined` are on other machines."""
    progress = progress_of(config, beats)
    left = None
    if progress is not None and progress.episodes_per_s > 0:
        left = max(0, config.episodes - progress.done) / progress.episodes_per_s
    return Status(
        run=folder.path.name,
        path=str(folder.path),
        state=_state(config, mind, progress, beats),
        algorithm=config.algorithm,
        episodes=config.episodes,
        supervisor_pid=os.getpid(),
        progress=progress,
        time_left_s=left,
        problems=[text[:4000] for text in [*mind.problems[-90:], *_concerns(mind, progress, beats, joined)]],
        processes=[*_processes(mind, pids, beats), *joined],
    )


def _state(config: RunConfig, mind: Supervisor, progress: Progress | None, beats: Beats) -> RunState:
    if mind.stopping is not None:
        return "stopping"
    if progress is None:
        return "starting"
    if progress.done == config.episodes:
        return "finishing"
    return "paused" if beats["learner"][0].state == "paused" else "running"


def _concerns(mind: Supervisor, progress: Progress | None, beats: Beats, joined: Sequence[ProcessStatus]) -> list[str]:
    concerns = []
    served = {ward.spec.serves for ward in mind.wards.values() if ward.spec.role == "actor"}
    served |= {process.serves for process in joined}
    for level, count in (progress.waiting if progress else {}).items():
        if count and level not in served and "any" not in served:
            concerns.append(f"{count} {level} episodes wait and no actor serves {level}: railctl scale RUN {level}=1")
    if progress is not None and progress.refused:
        concerns.append(f"{progress.refused} messages were refused: railctl logs RUN learner says why")
    learner = _learner(beats)
    if learner is not None and learner.exact_until is not None:
        concerns.append(f"resumed at episode {learner.exact_until} on another machine or torch: exactness ends there")
    return concerns


def _processes(mind: Supervisor, pids: Mapping[str, int], beats: Beats) -> list[ProcessStatus]:
    statuses = []
    for name, ward in mind.wards.items():
        beat = beats.get(name)
        state: str = ward.state
        if state == "running" and beat is not None:
            state = beat[0].state
        statuses.append(
            ProcessStatus(
                process=name,
                role=ward.spec.role,
                serves=ward.spec.serves,
                pid=pids.get(name),
                state="waiting to restart" if state == "waiting" and ward.restarts else state,
                restarts=ward.restarts,
                last_heartbeat_unix_s=None if beat is None else round(beat[1], 3),
            )
        )
    return statuses
