"""What earlier versions left in snapshots, as this one has it.

Before schema 6 no decision said what its train saw one step later: nobody learned from it. Before 5 none said what was
allowed: everything was; nor was there a teacher. Before 4 arrays stood where their fields are, before 3 a fragment was
flat, without the lease that it answers.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from railctl.common.rail.interlocking.signals import ALL_ACTIONS
from railctl.common.records.acting import Circumstances, Fragment, Lease, Progressed
from railctl.common.records.course import NONE, Course, Decisions

RECORDS = (Circumstances, Course, Decisions)
BLOCKS_OF_4 = 3


def fragment_of_flat(flat: dict[str, Any], before: Sequence[Fragment]) -> Fragment:
    """The fragment, which follows on those `before` in its episode.

    Its epsilon is lost and given as 0; an episode's row takes that of the last fragment, which is acted anew.

    Raises:
        ValueError, KeyError: this is no such fragment.
    """
    flat = flat | _unsaid(flat, flat)
    parts = {record: {name: flat[name] for name in record.model_fields if name in flat} for record in RECORDS}
    decisions = Decisions(**parts[Decisions])
    course = Course(**parts[Course], decisions=decisions)
    progressed = None
    if before:
        actions = np.concatenate([fragment.course.decisions.actions for fragment in before])
        states = before[-1].course.states
        progressed = Progressed(fragment=len(before), first_step=course.first_step, actions=actions, states=states)
    lease = Lease(
        episode=flat["episode"],
        level=flat["level"],
        level_seed=flat["level_seed"],
        weights_version=flat["weights_version"],
        epsilon=0.0,
        steps=len(course.rewards),
        progressed=progressed,
    )
    return Fragment(lease=lease, course=course, circumstances=Circumstances(**parts[Circumstances]))


def fragment_of_mapping(plain: dict[str, Any]) -> Fragment:
    """The fragment of schema 3, in which arrays stand where their fields are.

    Raises:
        ValueError, KeyError: this is no such fragment.
    """
    course, decisions = plain["course"], plain["course"]["decisions"]
    found = _unsaid(course, decisions)
    decisions = decisions | {name: found.pop(name) for name in ("allowed", "labels", "following")}
    return Fragment.model_validate(plain | {"course": course | found | {"decisions": decisions}})


def blocks_of_now(plain: list[Any]) -> list[Any]:
    """The fields, lengths and blocks of a fragment of schema 4 or 5 with what came after."""
    whole, lengths, *blocks = plain
    if len(blocks) == BLOCKS_OF_4:
        floats, long, short = blocks
        labels = np.full(lengths["D"], NONE, np.int8).tobytes()
        blocks = [floats, long, short + labels, bytes([ALL_ACTIONS]) * (lengths["N"] + lengths["D"])]
    return [whole, lengths | {"G": 0}, *blocks]


def with_all_allowed(state: Mapping[str, NDArray[Any]], column: str) -> Mapping[str, NDArray[Any]]:
    """The state of a replay; before schema 5 it had no `column` that says what was allowed."""
    if column in state or "action_tm1" not in state:
        return state
    return {**state, column: np.full(len(state["action_tm1"]), ALL_ACTIONS, np.uint8)}


def _unsaid(course: dict[str, Any], decisions: dict[str, Any]) -> dict[str, Any]:
    counts = {"final_allowed": len(course["arrived_at"]), "allowed": len(decisions["times"])}
    allowed = {name: np.full(count, ALL_ACTIONS, np.uint8) for name, count in counts.items()}
    count = counts["allowed"]
    return allowed | {"labels": np.full(count, NONE, np.int8), "following": np.zeros((count, 0), np.float32)}
