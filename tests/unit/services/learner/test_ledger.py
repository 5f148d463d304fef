"""The ledger: every episode is trained once and in order, whoever dies and whatever gets lost."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from made_episodes import answer_to, lease_of

from railctl.common.records.acting import Progressed
from railctl.services.learner import ledger as ledger_module
from railctl.services.learner.ledger import Ledger

LEVELS = ("easy", "medium", "hard", "rush")
NAMES = {level[0]: level for level in LEVELS}


def acted(number, level="easy", fragment=0, over=True):
    """An episode, or a fragment of one, as small as one can be."""
    nothing = {"actions": np.zeros(0, np.int8), "states": np.zeros((1, 0), np.float32)}
    progressed = Progressed(fragment=fragment, first_step=fragment, **nothing) if fragment else None
    return answer_to(lease_of(number, level=level, steps=1, progressed=progressed), over=over)


def ledger(levels="eeee", lag=0, trained=0, actors=("a", "b")):
    made = Ledger([NAMES[letter] for letter in levels], lag, trained)
    for incarnation in actors:
        made.actor_came(incarnation)
    return made


def train_one(made):
    assert made.next_ready() is not None
    made.mark_trained()


def test_without_lag_one_episode_at_a_time_is_leased():
    made = ledger(lag=0)
    assert made.grant("a", "any") == (0, 0)
    assert made.grant("b", "any") is None
    assert made.next_ready() is None
    assert made.receive(acted(0))
    assert made.grant("b", "any") is None  # episode 1 needs the weights after episode 0
    train_one(made)
    assert made.grant("b", "any") == (1, 0)


def test_lag_leases_as_many_episodes_more_at_a_time():
    made = ledger("eeeeee", lag=2, actors="abcd")
    assert [made.grant(actor, "any") for actor in "abcd"] == [(0, 0), (1, 0), (2, 0), None]
    assert made.receive(acted(1))
    assert made.grant("b", "any") is None
    assert made.next_ready() is None  # training is strictly in order
    assert made.receive(acted(0))
    assert made.next_ready().lease.episode == 0
    train_one(made)
    assert made.next_ready().lease.episode == 1
    train_one(made)
    assert [made.grant(actor, "any") for actor in "abd"] == [(3, 0), (4, 0), None]


@pytest.mark.parametrize(("lag", "versions"), [(0, [0, 1, 2, 3]), (1, [0, 0, 1, 2]), (3, [0, 0, 0, 0])])
def test_an_episode_acts_with_the_weights_after_the_one_lag_and_one_before_it(lag, versions):
    assert [ledger(lag=lag).weights_version(episode) for episode in range(4)] == versions


def test_actors_get_only_the_difficulties_that_they_serve():
    made = ledger("ehme", lag=3, actors="abcd")
    assert made.waiting() == {"easy": 2, "hard": 1, "medium": 1}
    assert made.grant("a", "hard") == (1, 0)
    assert made.grant("b", "hard") is None
    assert made.grant("b", "easy") == (0, 0)
    assert made.waiting() == {"easy": 1, "medium": 1}
    assert made.grant("c", "any") == (2, 0)
    assert made.grant("d", "easy") == (3, 0)
    assert made.waiting() == {}
    assert made.leased == 4


def test_who_is_not_known_to_live_gets_no_lease():
    made = ledger(actors=())
    assert made.grant("a", "any") is None
    made.actor_came("a")
    made.actor_gone("a")
    assert made.grant("a", "any") is None
    assert made.leased == 0


def test_what_a_dead_actor_had_leased_is_leased_anew():
    made = ledger(lag=1, actors="abc")
    assert [made.grant(actor, "any") for actor in "ab"] == [(0, 0), (1, 0)]
    made.actor_gone("a")
    assert made.reissued == 1
    assert made.waiting() == {"easy": 1}
    assert made.grant("c", "any") == (0, 0)
    made.actor_gone("a")  # told twice
    assert made.reissued == 1


def test_a_lease_that_never_reached_its_actor_ends_when_the_actor_asks_again():
    made = ledger()
    assert made.grant("a", "any") == (0, 0)
    assert made.missing("a", []) == []
    assert made.reissued == 1
    assert made.grant("b", "any") == (0, 0)


def test_a_kept_episode_that_got_lost_is_missing_and_stays_with_its_actor():
    made = ledger()
    assert made.grant("a", "any") == (0, 0)
    assert made.missing("a", [(0, 0)]) == [(0, 0)]
    assert made.reissued == 0
    assert made.grant("b", "any") is None
    assert made.receive(acted(0))
    assert made.missing("a", [(0, 0)]) == []
    assert made.reissued == made.leased == 0


def test_an_actor_that_is_not_known_to_live_is_not_asked_for_anything():
    made = ledger(actors="b")
    assert made.missing("a", [(0, 0)]) == []
    assert made.leased == 0
    assert made.grant("b", "any") == (0, 0)


def test_a_kept_episode_that_somebody_else_acts_is_not_asked_for_unless_that_one_dies():
    made = ledger()
    assert made.grant("a", "any") == (0, 0)
    assert made.missing("b", [(0, 0)]) == []
    assert made.lessee((0, 0)) == "a"
    made.actor_gone("a")
    assert made.missing("b", [(0, 0)]) == [(0, 0)]
    assert made.lessee((0, 0)) == "b"


def test_only_untrained_episodes_of_this_run_that_are_not_here_are_missing():
    made = ledger("eeee", lag=3, trained=1)
    assert made.receive(acted(2))
    assert made.missing("a", [(e, 0) for e in (0, 1, 2, 3, 4, 99)]) == [(1, 0), (3, 0)]


def test_what_is_kept_counts_once_and_no_further_than_there_is_room_for_it_to_wait(monkeypatch):
    monkeypatch.setattr(ledger_module, "MOST_KEPT", 3)
    made = ledger("ee")
    kept = [(0, 2), (0, 0), (0, 0), (0, 3), (0, 1)]
    assert made.missing("a", kept) == [(0, 0), (0, 1), (0, 2)]
    for fragment in (1, 2):
        assert made.receive(acted(0, fragment=fragment, over=False))
    assert made.missing("a", kept) == [(0, 0)]
    assert made.receive(acted(0, over=False))
    assert made.missing("a", kept) == []
    train_one(made)
    assert made.missing("a", kept) == [(0, 3)]


def test_fragments_that_their_episode_does_not_have_are_forgotten_with_it():
    made = ledger("ee")
    assert made.missing("a", [(0, 0), (0, 1), (0, 2), (0, 3), (1, 2)]) == [(0, 0), (0, 1), (0, 2), (0, 3), (1, 2)]
    for fragment in (0, 1, 2):
        assert made.receive(acted(0, fragment=fragment, over=fragment == 1))
    train_one(made)
    assert (made.leased, len(made._received)) == (2, 2)
    train_one(made)
    assert (made.lessee((0, 3)), made.lessee((1, 2))) == (None, "a")
    assert (made._received, made._brought_by) == ({}, {})


def test_duplicates_are_dropped_and_counted():
    made = ledger(lag=1)
    assert made.grant("a", "any") == (0, 0)
    assert made.receive(acted(0))
    assert not made.receive(acted(0))
    train_one(made)
    assert not made.receive(acted(0))
    assert made.duplicates == 2
    assert made.next_ready() is None


def test_an_episode_counts_whoever_brings_it():
    made = ledger()
    assert made.grant("a", "any") == (0, 0)
    made.actor_gone("a")
    assert made.grant("b", "any") == (0, 0)
    assert made.receive(acted(0))  # what the dead actor published last
    assert made.leased == 0
    train_one(made)
    assert made.grant("b", "any") == (1, 0)


def test_a_ledger_goes_on_from_a_snapshot():
    made = ledger(lag=1, trained=2)
    assert made.trained == 2
    assert [made.grant(actor, "any") for actor in "ab"] == [(2, 0), (3, 0)]
    assert not made.receive(acted(1))


def test_a_run_is_finished_when_all_is_trained():
    made = ledger("ee")
    assert made.total == 2
    for number in range(2):
        assert not made.finished
        assert made.grant("a", "any") == (number, 0)
        assert made.receive(acted(number))
        train_one(made)
    assert made.finished
    assert made.grant("a", "any") is None
    assert made.waiting() == {}
    assert ledger("ee", trained=2).finished


def test_the_fragments_of_an_episode_are_leased_one_after_the_other():
    made = ledger("ee", actors="a")
    for fragment in range(3):
        assert made.grant("a", "any") == (0, fragment)
        assert made.weights_version(0) == fragment  # the weights after the one before
        assert made.receive(acted(0, fragment=fragment, over=fragment == 2))
        assert made.grant("a", "any") is None
        train_one(made)
    assert (made.trained, made.fragment, made.version) == (1, 0, 3)
    assert made.grant("a", "any") == (1, 0)
    assert made.weights_version(1) == 3


def test_an_episode_goes_on_where_its_world_stands_unless_that_actor_is_gone():
    made = ledger("ee", actors="ab")
    assert made.grant("a", "any") == (0, 0)
    assert made.receive(acted(0, over=False))
    train_one(made)
    assert made.grant("b", "any") is None
    assert made.grant("a", "any") == (0, 1)
    made.actor_gone("a")
    assert made.grant("b", "any") == (0, 1)


def test_what_is_not_as_it_must_be_waits_again():
    made = ledger(actors="a")
    assert made.grant("a", "any") == (0, 0)
    assert made.receive(acted(0))
    assert made.discard() == "a"
    assert made.next_ready() is None
    assert made.grant("a", "any") == (0, 0)


def test_a_ledger_goes_on_with_the_version_of_its_snapshot():
    made = Ledger(["easy"] * 4, lag=0, trained=2, version=7)
    assert made.weights_version(2) == 7


@dataclass
class Actor:
    """An actor as the world sees it: what it acts, and what it keeps."""

    incarnation: str
    serves: str
    acting: tuple[int, int] | None = None
    kept: set[tuple[int, int]] = field(default_factory=set)


WHICH = st.integers(0, 5)  # which of the living, counted round
LOST = st.sampled_from([False, False, False, True])


class Run(RuleBasedStateMachine):
    """A learner's ledger among actors that come and die, messages that get lost, and restarts of the learner."""

    @initialize(levels=st.text("emhr", min_size=4, max_size=12), lag=st.integers(0, 3))
    def begin(self, levels, lag):
        self.levels = [NAMES[letter] for letter in levels]
        self.lag = lag
        self.snapshot = 0
        self.living = {}
        self.dead = []
        self.doubtful = set()  # units whose leases a restart made the ledger forget
        self.born = 0
        self.open_ledger()
        self.comes("any", known=True)

    def open_ledger(self):
        self.ledger = Ledger(self.levels, self.lag, self.snapshot, version=self.version_of(self.snapshot))
        self.trained = [unit for episode in range(self.snapshot) for unit in self.units(episode)]

    def units(self, episode):
        """An episode has one fragment, or without lag up to three."""
        return [(episode, fragment) for fragment in range(1 if self.lag else 1 + episode % 3)]

    def version_of(self, episode):
        return sum(len(self.units(before)) for before in range(episode))

    def pick(self, which):
        return list(self.living.values())[which % len(self.living)]

    # What happens

    @rule(serves=st.sampled_from([*LEVELS, "any", "any"]), known=st.booleans())
    def comes(self, serves, known):
        self.born += 1
        actor = Actor(f"incarnation-{self.born}", serves)
        self.living[actor.incarnation] = actor
        if known:  # or its token is seen later
            self.ledger.actor_came(actor.incarnation)

    @rule(which=WHICH)
    def token_is_seen(self, which):
        self.ledger.actor_came(self.pick(which).incarnation)

    @rule(which=WHICH)
    def token_is_lost_for_a_moment(self, which):
        actor = self.pick(which)
        self.doubt([actor])
        self.ledger.actor_gone(actor.incarnation)

    @precondition(lambda self: len(self.living) > 1)
    @rule(which=WHICH, at_work=st.booleans())
    def dies(self, which, at_work):
        actor = self.pick(which)
        if at_work and actor.acting is None:
            self.ask(actor)
        del self.living[actor.incarnation]
        self.dead.append(actor)
        self.ledger.actor_gone(actor.incarnation)

    @rule(which=WHICH, lost=LOST, steps=st.integers(1, 6))
    def goes_on(self, which, lost, steps):
        """Asks and acts in turn; if something gets lost, then the last."""
        actor = self.pick(which)
        for step in range(steps):
            lost_now = lost and step == steps - 1
            if actor.acting is None:
                self.ask(actor, answer_lost=lost_now)
            else:
                self.finish(actor, lost=lost_now)

    @rule(which=WHICH, lost=LOST)
    def all_go_on_and_the_learner_trains(self, which, lost):
        for index, actor in enumerate(list(self.living.values())):
            self.goes_on(index, lost and actor is self.pick(which), steps=2)
        self.train()

    @precondition(lambda self: self.dead)
    @rule(which=WHICH, published=st.booleans())
    def a_dead_one_is_heard_late(self, which, published):
        actor = self.dead[which % len(self.dead)]
        for unit in actor.kept if published else ():
            self.arrives(unit)
        self.ledger.missing(actor.incarnation, sorted(actor.kept))
        assert self.ledger.grant(actor.incarnation, actor.serves) is None

    @precondition(lambda self: any(actor.kept for actor in self.living.values()))
    @rule(which=WHICH)
    def publishes_all_it_keeps_again(self, which):
        for unit in self.pick(which).kept:
            self.arrives(unit)

    @rule()
    def trains(self):
        self.train()

    @precondition(lambda self: self.ledger.trained > self.snapshot)
    @rule()
    def snapshots(self):
        self.snapshot = self.ledger.trained

    @precondition(lambda self: self.ledger.trained > self.snapshot)
    @rule()
    def learner_restarts(self):
        self.doubt(self.living.values())
        self.open_ledger()
        for incarnation in self.living:
            self.ledger.actor_came(incarnation)

    # How actors and the learner behave

    def ask(self, actor, *, answer_lost=False):
        missing = self.ledger.missing(actor.incarnation, sorted(actor.kept))
        granted = None
        if not missing:
            granted = self.ledger.grant(actor.incarnation, actor.serves)
            if granted is not None:
                self.check_grant(granted, actor)
        if answer_lost:
            return
        actor.kept = {unit for unit in actor.kept if unit[0] >= self.snapshot}
        for unit in missing:
            assert unit in actor.kept
            self.arrives(unit)
        actor.acting = granted

    def check_grant(self, unit, actor):
        (episode, fragment), trained = unit, self.ledger.trained
        assert fragment == (self.ledger.fragment if episode == trained else 0)
        assert trained <= episode <= trained + self.lag
        assert self.levels[episode] == actor.serves or actor.serves == "any"
        version = self.ledger.weights_version(episode)
        assert version == (max(0, episode - self.lag) if self.lag else len(self.trained)) <= self.ledger.version
        assert version >= self.ledger.version - self.lag  # the learner keeps no older ones
        if unit not in self.doubtful:
            assert all(other.acting != unit for other in self.living.values())

    def finish(self, actor, *, lost=False):
        unit, actor.acting = actor.acting, None
        actor.kept.add(unit)
        if not lost:
            self.arrives(unit)

    def arrives(self, unit):
        known = unit in self.trained or unit in self.ledger._received
        duplicates = self.ledger.duplicates
        number, fragment = unit
        over = unit == self.units(number)[-1]
        assert self.ledger.receive(acted(number, self.levels[number], fragment, over)) is not known
        assert self.ledger.duplicates == duplicates + known

    def train(self):
        while (fragment := self.ledger.next_ready()) is not None:
            self.trained.append(fragment.lease.unit)
            self.ledger.mark_trained()

    def doubt(self, actors):
        for actor in actors:
            self.doubtful |= actor.kept | {actor.acting}

    # What always holds

    @precondition(lambda self: hasattr(self, "ledger"))
    @invariant()
    def every_episode_is_trained_once_and_in_order(self):
        due = [unit for episode in range(len(self.levels)) for unit in self.units(episode)]
        assert self.trained == due[: len(self.trained)]
        assert len(self.trained) == self.ledger.version == self.version_of(self.ledger.trained) + self.ledger.fragment
        assert self.snapshot <= self.ledger.trained <= self.ledger.total

    @precondition(lambda self: hasattr(self, "ledger"))
    @invariant()
    def only_the_living_hold_leases(self):
        assert set(self.ledger._leases.values()) <= set(self.living)

    @precondition(lambda self: hasattr(self, "ledger"))
    @invariant()
    def every_episode_of_the_window_is_waiting_leased_or_here(self):
        trained, fragment = self.ledger.trained, self.ledger.fragment
        episodes = range(trained, min(trained + self.lag + 1, self.ledger.total))
        window = [(episode, fragment if episode == trained else 0) for episode in episodes]
        here = sum(unit in self.ledger._received for unit in window)
        leased = sum(unit in self.ledger._leases for unit in window)
        assert sum(self.ledger.waiting().values()) + leased + here == len(window)

    def teardown(self):
        """With an actor that serves everything, and nothing lost any more, the run ends."""
        if not hasattr(self, "ledger"):
            return
        self.living["last"] = Actor("last", "any")
        for incarnation in self.living:
            self.ledger.actor_came(incarnation)
        for _ in range(9 * len(self.levels) + 3):
            for actor in self.living.values():
                if actor.acting is not None:
                    self.finish(actor)
                self.ask(actor)
            self.train()
        assert self.ledger.finished
        assert self.ledger.version == self.version_of(len(self.levels))


TestRun = Run.TestCase
TestRun.settings = settings(
    max_examples=250, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck)
)
