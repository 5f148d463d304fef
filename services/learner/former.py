"""Fragments of an open episode as snapshots held them before schema 3: flat, without the lease that they answer."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from common.records.acting import Circumstances, Fragment, Lease, Progressed
from common.records.course import Course, Decisions

RECORDS = (Circumstances, Course, Decisions)


def fragment_of_flat(flat: dict[str, Any], before: Sequence[Fragment]) -> Fragment:
    """The fragment, which follows on those `before` in its episode.

    Its epsilon is lost and given as 0; an episode's row takes that of the last fragment, which is acted anew.

    Raises:
        ValueError, KeyError: this is no such fragment.
    """
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
