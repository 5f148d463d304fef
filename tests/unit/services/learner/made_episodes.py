"""Episodes for tests of the learner: made up at random, by hand, and cut into fragments."""

import numpy as np

from railctl.common.records.acting import Circumstances, Fragment, Lease, Progressed
from railctl.common.records.course import Course, Decisions

STEPS, TRAINS = 40, 3


def at_offset(array, offset):
    """A copy of an array, `offset` bytes into its memory."""
    raw = np.zeros(array.nbytes + offset, np.uint8)[offset:].view(array.dtype).reshape(array.shape)
    raw[...] = array
    return raw


def some_allowed(rng, n_actions, size, action_tm1=None):
    """[B], actions by chance, a bit each; at least one, and those that were taken, if given."""
    if action_tm1 is None:
        return rng.integers(1, 1 << n_actions, size)
    return rng.integers(0, 1 << n_actions, size) | 1 << action_tm1


def decisions_of(decided, n_features, log_probabilities=None, values=None, allowed=None):
    """Of (time, train, action, what it saw)."""
    times, trains, actions, seen = zip(*decided, strict=True) if (decided := list(decided)) else ((), (), (), ())
    count = len(times)
    return Decisions(
        observations=np.array(seen, np.float32).reshape(count, n_features),
        times=np.array(times, np.int32),
        trains=np.array(trains, np.int32),
        actions=np.array(actions, np.int8),
        allowed=np.full(count, 31, np.uint8) if allowed is None else np.array(allowed, np.uint8),
        log_probabilities=np.zeros(count, np.float32) if log_probabilities is None else log_probabilities,
        values=np.zeros(count, np.float32) if values is None else values,
        labels=np.full(count, -1, np.int8),
        following=np.zeros((count, 0), np.float32),
    )


def course_of(rewards, arrived_at, decisions, final=None, **changes):
    """A course from its start to its end, unless `changes` say otherwise."""
    n_trains, n_features = len(arrived_at), decisions.observations.shape[1]
    final = np.zeros((n_trains, n_features)) if final is None else final
    fields = {
        "level_hash": "0" * 32,
        "max_steps": max(1, len(rewards)),
        "first_step": 0,
        "over": True,
        "decisions": decisions,
        "rewards": np.asarray(rewards, np.float32),
        "arrived_at": np.array(arrived_at, np.int32),
        "final_observations": np.asarray(final, np.float32).reshape(n_trains, n_features),
        "final_allowed": np.full(n_trains, 31, np.uint8),
        "states": np.zeros((n_trains, 0), np.float32),
    }
    return Course(**fields | changes)


def lease_of(episode, **changes):
    """A lease of a whole episode, unless `changes` say otherwise."""
    fields = {"level": "easy", "level_seed": 1, "weights_version": episode, "epsilon": 0.0}
    return Lease(**{"episode": episode, "steps": None, "progressed": None} | fields | changes)


def fragment_of(lease, course, actor="a"):
    """What an actor publishes."""
    circumstances = Circumstances(actor=actor, acting_s=0.0, waited_s=0.0)
    return Fragment(lease=lease, course=course, circumstances=circumstances)


def decided(number, decisions, rewards, arrived_at, final):
    """An episode of `decisions`: (time, train, action, what it saw)."""
    final = np.asarray(final, np.float32).reshape(len(arrived_at), -1)
    course = course_of(rewards, arrived_at, decisions_of(decisions, final.shape[1]), final)
    return fragment_of(lease_of(number), course)


def make_episode(number, n_features=6, steps=STEPS, offset=0, density=1.0):
    """A random episode: a train decides on half of its steps until it arrives, if it does."""
    rng = np.random.default_rng(number)
    arrived_at = np.where(rng.random(TRAINS) < 0.5, rng.integers(0, steps, TRAINS), -1).astype(np.int32)
    until = np.where(arrived_at >= 0, arrived_at + 1, steps)
    deciding = (rng.random((steps, TRAINS)) < 0.5) & (np.arange(steps)[:, None] < until)
    times, trains = np.nonzero(deciding)
    seen = -rng.random((len(times), n_features), np.float32) * (rng.random((len(times), n_features)) < density)
    final = -rng.random((TRAINS, n_features), np.float32)
    episode = decided(
        number,
        zip(times, trains, rng.integers(0, 5, len(times)), seen, strict=True),
        -(np.arange(steps)[:, None] < until).astype(np.float32),
        arrived_at,
        final * (arrived_at < 0)[:, None],
    )
    course = episode.course
    return edited(
        episode,
        observations=at_offset(course.decisions.observations, offset),
        rewards=at_offset(course.rewards, offset),
        final_observations=at_offset(course.final_observations, offset),
        allowed=some_allowed(rng, 5, len(times), course.decisions.actions).astype(np.uint8),
        final_allowed=np.where(arrived_at < 0, some_allowed(rng, 5, TRAINS), 31).astype(np.uint8),
    )


def with_following(episode):
    """An episode in whose record decisions say what their trains saw one step later.

    By chance, but where they decide again it is what they see, and at the step limit what they saw last.
    """
    course, decisions = episode.course, episode.course.decisions
    following = -np.random.default_rng(episode.lease.episode).random(decisions.observations.shape, np.float32)
    rows = {when: row for row, when in enumerate(zip(decisions.times, decisions.trains, strict=True))}
    for (time, train), row in rows.items():
        if course.arrived_at[train] == time:
            following[row] = 0
        elif (time + 1, train) in rows:
            following[row] = decisions.observations[rows[time + 1, train]]
        elif time + 1 == course.last_step:
            following[row] = course.final_observations[train]
    return edited(episode, following=following)


def edited(record, **changes):
    """A copy of a record in which these fields, wherever in it they are, have other values; nothing is checked."""
    update = {name: value for name, value in changes.items() if name in type(record).model_fields}
    for name in type(record).model_fields:
        part = getattr(record, name)
        if isinstance(part, (Lease, Course, Decisions, Circumstances)) and name not in update:
            update[name] = edited(part, **changes)
    return record.model_copy(update=update)


def cut(episode, places):
    """The fragments of an episode cut after these steps, as an actor would have published them."""
    course, decisions = episode.course, episode.course.decisions
    ends = sorted({place for place in places if 0 < place < len(course.rewards)})
    fragments = []
    for number, (first, end) in enumerate(zip([0, *ends], [*ends, len(course.rewards)], strict=True)):
        over = end == len(course.rewards)
        before = Progressed(
            fragment=max(1, number),
            first_step=max(1, first),
            actions=decisions.actions[decisions.times < first],
            states=course.states,
        )
        lease = lease_of(episode.lease.episode, steps=end - first, progressed=before if number else None)
        part = course_of(
            course.rewards[first:end],
            np.where(course.arrived_at < end, course.arrived_at, -1),
            decisions.chosen((first <= decisions.times) & (decisions.times < end)),
            course.final_observations * np.float32(over),
            first_step=first,
            over=over,
            max_steps=course.max_steps,
            final_allowed=course.final_allowed if over else np.full(len(course.arrived_at), 31, np.uint8),
        )
        fragments.append(fragment_of(lease, part, episode.circumstances.actor))
    return fragments


def answer_to(lease, *, actor="a", steps=None, over=None, n_features=1, n_trains=1, seen=None, max_steps=100):
    """What an actor makes of a lease: its first train decides on every step and arrives on the last if all is over."""
    steps = (2 if lease.steps is None else lease.steps) if steps is None else steps
    over = lease.steps is None if over is None else over
    first = lease.first_step
    seen = lease.weights_version / 100 if seen is None else seen
    vector = np.full(n_features, seen, np.float32)
    decisions = decisions_of([(first + step, 0, lease.fragment % 5, vector) for step in range(steps)], n_features)
    course = course_of(
        np.full((steps, n_trains), -1),
        [first + steps - 1 if over else -1, *[-1] * (n_trains - 1)],
        decisions,
        first_step=first,
        over=over,
        max_steps=max_steps,
    )
    return fragment_of(lease, course, actor)
