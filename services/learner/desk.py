"""The desk: who gets which lease, who waits, and which fragments are taken.

Pure: events and times come in, answers go out; no clock, no bus, no disk. The desk believes only what it leased, and
only from whom it leased it. Living actors may keep fragments that an earlier learner process leased, of which the desk
remembers nothing: it takes these, as far as a learner can have come without a snapshot, and compares their leases with
its own once all that comes before is trained.

In a free run it takes an episode with any weights that are not too old, whatever version it leased last: what an
earlier lease of the same episode has brought is as good, for it says how probable its actions were.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from railctl.common.levels.distributions import ANY
from railctl.common.records.acting import Fragment, Lease, LeaseAnswer, LeaseRequest, Progressed
from railctl.services.learner.free_ledger import FreeLedger
from railctl.services.learner.ledger import Ledger, Unit, drop_before
from railctl.services.learner.opened import OpenEpisode
from railctl.services.learner.replay.transitions import check_order
from railctl.services.learner.schedule import Schedule

Q = TypeVar("Q")

LONG_POLL_S = 2.0  # an answer without work goes out after this
OPEN_S = 30.0  # of a question: the next answer is its last, and the actor asks again and says what it keeps
LEASE_S = 120.0  # an actor that takes longer, while another one has nothing to do, loses its lease to that one
STORY_EVENTS = 200


class Reply(NamedTuple, Generic[Q]):
    """What becomes of a question; without an answer nobody waits for it any more.

    A lease leaves it open, but for the `last` one: the fragment that comes back asks for the next.
    """

    question: Q
    answer: LeaseAnswer | None
    last: bool = True


@dataclass(frozen=True)
class Start:
    """Where a run goes on.

    Attributes:
        trained: how many episodes.
        version: of the weights.
        steps: environment steps of all trained episodes.
        fragments: of the open episode, trained already.
    """

    trained: int = 0
    version: int = 0
    steps: int = 0
    fragments: Sequence[Fragment] = ()


@dataclass
class _Open(Generic[Q]):
    """A question for work.

    Attributes:
        question: what answers it.
        serves: the level or any.
        ends: when an answer is its last.
        waits: for a lease; otherwise it has one.
        deadline: when it has waited long enough; None: since now.
    """

    question: Q
    serves: str
    ends: float
    waits: bool = True
    deadline: float | None = None


class Desk(Generic[Q]):
    """Leases of a run. `Q` is whatever the caller answers questions by.

    Attributes:
        ledger: the account of all episodes.
        opened: the episode that is being trained, as far as it is.
        refused: fragments that were not taken.
        safe_before: episodes below this number are in a snapshot.
        story: what happened last, for post-mortems.
    """

    def __init__(self, schedule: Schedule, n_features: int, start: Start | None = None) -> None:
        """`n_features` is what the network takes."""
        start = start or Start()
        self._schedule = schedule
        self._n_features = n_features
        self._steps = start.steps
        self.opened = OpenEpisode(list(start.fragments))
        kind = FreeLedger if schedule.free else Ledger
        self.ledger = kind(schedule.levels, schedule.lag, start.trained, len(start.fragments), start.version)
        self.refused = 0
        self.safe_before = start.trained
        self.story: deque[str] = deque(maxlen=STORY_EVENTS)
        self._names: dict[str, str] = {}  # of living actors, by incarnation
        self._given: dict[Unit, Lease] = {}
        self._since: dict[Unit, float] = {}  # when somebody who has nothing to do was first seen to wait for it
        self._late: dict[Unit, int] = {}  # how often its lease was taken back
        self._spoiled: set[tuple[str, Unit]] = set()  # who keeps what was refused, or comes too late
        self._reach = start.trained + schedule.unsaved + schedule.lag  # of leases of an earlier learner, in episodes
        self._open: dict[str, _Open[Q]] = {}  # by incarnation

    def actor_came(self, name: str, incarnation: str) -> None:
        """An actor lives."""
        self._note(f"{name} {incarnation} came")
        self._names[incarnation] = name
        self.ledger.actor_came(incarnation)

    def actor_gone(self, incarnation: str) -> list[Reply[Q]]:
        """An actor died; what it had leased waits again, and nobody waits for its answer."""
        self._note(f"{self._names.pop(incarnation, '?')} {incarnation} is gone")
        self._spoiled = {(who, unit) for who, unit in self._spoiled if who != incarnation}
        self.ledger.actor_gone(incarnation)
        return self._end(incarnation)

    def ask(self, question: Q, request: LeaseRequest, now: float) -> list[Reply[Q]]:
        """An actor asks for work: it is answered at once if it must publish something again, else from `give`."""
        who = request.incarnation
        replies = self._end(who)
        kept = [(episode, fragment) for episode, fragment in request.kept.tolist()]
        missing = self.ledger.missing(who, [unit for unit in kept if self._may_keep(who, unit)])
        if missing:
            self._note(f"{request.actor} must publish {len(missing)} again, the first is {missing[0]}")
            return [*replies, Reply(question, self._answer(None, missing))]
        self._open[who] = _Open(question, request.serves, now + OPEN_S)
        return replies

    def give(self, now: float, *, paused: bool = False) -> list[Reply[Q]]:
        """Answers for those who wait: leases, or nothing for those who have waited long enough."""
        replies = []
        if not paused:
            self._take_back(now)
        for who, asked in list(self._open.items()):
            if not asked.waits:
                continue
            if asked.deadline is None:
                asked.deadline = now + LONG_POLL_S
            unit = None if paused else self.ledger.grant(who, asked.serves)
            if unit is None and now < asked.deadline:
                continue
            last = unit is None or now >= asked.ends
            replies.append(Reply(asked.question, self._answer(None if unit is None else self._give(who, unit)), last))
            asked.waits, asked.deadline = False, None
            if last:
                del self._open[who]
        return replies

    def arrive(self, fragment: Fragment) -> str | None:
        """Take a fragment in; returns why not, or None also for one that is here already.

        Who has brought it waits for the next lease, if its question is open.
        """
        lease, unit = fragment.lease, fragment.lease.unit
        if lease.episode >= self.ledger.total:
            return self._refuse(fragment, f"this run has {self.ledger.total} episodes")
        if not self.ledger.is_to_come(unit):
            self.ledger.receive(fragment)
            self._note(f"{_named(fragment)} came once more")
            return None
        who = self.ledger.lessee(unit)
        if who is None:
            return self._refuse(fragment, "nobody has leased it")
        if (name := self._names.get(who)) != fragment.circumstances.actor:
            return self._refuse(fragment, f"it is leased to {name}")
        if (asked := self._open.pop(who, None)) is not None:
            asked.waits = True
            self._open[who] = asked  # behind those who have waited longer
        if (reason := self._wrong(fragment)) is not None:
            self._spoil(who, unit)
            self.ledger.end_lease(unit)
            return self._refuse(fragment, reason)
        self.ledger.receive(fragment)
        self._note(f"{_named(fragment)} came")
        return None

    def next_ready(self) -> Fragment | None:
        """What is to be trained now, if it is here and as it must be."""
        fragment = self.ledger.next_ready()
        if fragment is None or fragment.lease.unit in self._given:
            return fragment
        if (reason := self._difference(fragment.lease, self._lease(fragment.lease.unit))) is None:
            return fragment
        if (who := self.ledger.discard()) is not None:
            self._spoil(who, fragment.lease.unit)
        self._refuse(fragment, reason)
        return None

    def mark_trained(self) -> OpenEpisode | None:
        """What `next_ready` gave is trained; returns its episode if that is over."""
        fragment = self.ledger.next_ready()
        if fragment is None:
            raise ValueError("nothing was ready to be trained")
        self.ledger.mark_trained()
        to_come = (self.ledger.trained, self.ledger.fragment)
        for of_units in (self._given, self._since, self._late):
            drop_before(to_come, of_units)
        self._spoiled = {(who, unit) for who, unit in self._spoiled if unit >= to_come}
        self.opened.fragments.append(fragment)
        if not fragment.course.over:
            return None
        episode, self.opened = self.opened, OpenEpisode()
        self._steps += episode.steps
        return episode

    def _may_keep(self, who: str, unit: Unit) -> bool:
        """Whether this learner or an earlier one can have leased it, and it is not as good as lost."""
        (episode, fragment), reach = unit, max(self._reach, self.ledger.trained + self._schedule.lag)
        is_leased = episode <= reach and (fragment == 0 or self._schedule.fragment_steps is not None)
        return is_leased and (who, unit) not in self._spoiled

    def _take_back(self, now: float) -> None:
        """Let who has nothing to do act what its actor does not bring, each time after twice as long."""
        idle = {asked.serves for who, asked in self._open.items() if asked.waits and who in self._names}
        for unit, who in self.ledger.held().items() if idle else ():
            if not idle & {ANY, self.ledger.levels[unit[0]]}:
                continue
            late = self._late.get(unit, 0)
            if now - self._since.setdefault(unit, now) > LEASE_S * 2**late:
                self._note(f"{self._names.get(who)} {who} does not bring episode {unit[0]}, fragment {unit[1]}")
                self._late[unit] = late + 1
                del self._since[unit]
                self.ledger.take_back(unit)
                self._spoil(who, unit)  # or it would come to hold it again by saying that it keeps it

    def _wrong(self, fragment: Fragment) -> str | None:
        lease = fragment.lease
        given = self._given.get(lease.unit)
        reason = None if given is None else self._difference(lease, given)
        if (reason := reason or self._misshapen(fragment)) is not None:
            return reason
        try:
            check_order(fragment)
        except ValueError as error:
            return str(error)
        return None

    def _misshapen(self, fragment: Fragment) -> str | None:
        """Nobody could learn from it, or act what follows."""
        course, schedule = fragment.course, self._schedule
        features, following = course.decisions.observations.shape[1], course.decisions.following.shape[1]
        if features != self._n_features:
            return f"observations have {features} features, the network takes {self._n_features}"
        if following != (wanted := self._n_features if schedule.following else 0):
            return f"observations a step later have {following} features, this run notes {wanted}"
        trains, carried = course.states.shape
        if trains > (most := schedule.trains[schedule.levels[fragment.lease.episode]]):
            return f"there are {trains} trains, its level has {most} at most"
        if carried != schedule.n_state:
            return f"trains carry {carried} numbers along, in this run {schedule.n_state}"
        return None

    def _difference(self, got: Lease, leased: Lease) -> str | None:
        version = got.weights_version
        if version != leased.weights_version and version in self.ledger.versions(got.episode):
            leased = leased.model_copy(update={"weights_version": version})
        return difference(got, leased)

    def _refuse(self, fragment: Fragment, reason: str) -> str:
        self.refused += 1
        text = f"refused {_named(fragment)}: {reason}"
        self._note(text)
        return text

    def _spoil(self, who: str, unit: Unit) -> None:
        """Who brought this, or did not, is not asked for it again; it is acted anew."""
        self._given.pop(unit, None)
        self._spoiled.add((who, unit))

    def _give(self, who: str, unit: Unit) -> Lease:
        self._spoiled.discard((who, unit))
        self._since.pop(unit, None)
        lease = self._given[unit] = self._lease(unit)
        self._note(f"episode {unit[0]}, fragment {unit[1]} is leased to {self._names.get(who)}")
        return lease

    def _lease(self, unit: Unit) -> Lease:
        episode, fragment = unit
        opened = self.opened if fragment > 0 and episode == self.ledger.trained else OpenEpisode()
        every = self._schedule.fragment_steps  # cut where the run's steps are its multiples: there updates fall due
        return Lease.made(
            episode=episode,
            level=self._schedule.levels[episode],
            level_seed=self._schedule.level_seed(episode),
            weights_version=self.ledger.weights_version(episode),
            epsilon=self._schedule.epsilon(episode),
            steps=None if every is None else every - (self._steps + opened.steps) % every,
            progressed=opened.progressed,
        )

    def _answer(self, lease: Lease | None, missing: Sequence[Unit] = ()) -> LeaseAnswer:
        return LeaseAnswer.made(
            lease=lease,
            safe_before=self.safe_before,
            missing=np.array(missing, np.int64).reshape(-1, 2),
            finished=self.ledger.finished,
        )

    def _end(self, incarnation: str) -> list[Reply[Q]]:
        asked = self._open.pop(incarnation, None)
        return [] if asked is None else [Reply(asked.question, None)]

    def _note(self, event: str) -> None:
        self.story.append(event)


def difference(got: Lease, leased: Lease) -> str | None:
    """The first field in which a lease that came back differs from what was leased."""
    theirs = got.__dict__
    for field, ours in leased.__dict__.items():
        if field == "progressed":
            if not _same(ours, theirs[field]):
                return f"{field} is not what its lease says"
        elif ours != theirs[field]:
            return f"{field} is {theirs[field]}, its lease says {ours}"
    return None


def _same(ours: Progressed | None, theirs: Progressed | None) -> bool:
    """To the bit."""
    if ours is None or theirs is None:
        return ours is theirs
    return (
        (ours.fragment, ours.first_step) == (theirs.fragment, theirs.first_step)
        and ours.states.shape == theirs.states.shape
        and ours.states.tobytes() == theirs.states.tobytes()
        and ours.actions.tobytes() == theirs.actions.tobytes()
    )


def _named(fragment: Fragment) -> str:
    lease = fragment.lease
    return f"episode {lease.episode}, fragment {lease.fragment} of {fragment.circumstances.actor}"
