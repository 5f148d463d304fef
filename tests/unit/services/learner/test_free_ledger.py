"""A free ledger: the newest weights for every lease, none too old, and no acting for a queue."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize, invariant, precondition
from made_episodes import answer_to, lease_of
from test_ledger import Run, TestRun

from railctl.services.learner.free_ledger import FreeLedger


def ledger(total=9, bound=3, actors="ab", trained=0):
    made = FreeLedger(["easy"] * total, bound, trained, version=trained)
    for actor in actors:
        made.actor_came(actor)
    return made


def acted(episode, version=0):
    return answer_to(lease_of(episode, weights_version=version))


def test_a_lease_has_the_newest_weights():
    made = ledger(actors="abc")
    versions = []
    for actor in "abc":
        unit = made.grant(actor, "any")
        versions.append(made.weights_version(unit[0]))
        if actor == "a":
            made.receive(acted(unit[0]))
            made.mark_trained()
    assert versions == [0, 1, 1]


def test_episodes_may_run_ahead_as_far_as_the_bound():
    made = ledger(actors="abcdef")
    assert [made.grant(actor, "any") for actor in "abcdef"] == [(0, 0), (1, 0), (2, 0), (3, 0), None, None]


def test_an_episode_may_come_of_any_weights_within_the_bound():
    made = ledger(bound=3, trained=5)
    assert list(made.versions(5)) == [2, 3, 4, 5]
    assert list(made.versions(7)) == [4, 5, 6, 7]  # as it can be trained only later
    assert list(ledger(bound=3).versions(1)) == [0, 1]


def test_while_training_has_more_at_hand_than_two_for_each_actor_nothing_is_leased():
    made = ledger(bound=8, actors="ab")
    for episode in range(5):
        assert made.grant("a", "any") == (episode, 0)
        made.receive(acted(episode))
    assert made.grant("a", "any") is None
    assert made.waiting() == {}
    made.mark_trained()
    assert made.grant("a", "any") == (5, 0)


def test_while_training_waits_for_one_episode_others_are_acted_up_to_the_bound():
    made = ledger(bound=6, actors="ab")
    assert made.grant("a", "any") == (0, 0)  # and takes its time
    for episode in range(1, 7):
        assert made.grant("b", "any") == (episode, 0)
        made.receive(acted(episode))
    assert made.grant("b", "any") is None
    made.receive(acted(0))
    for _ in range(7):
        made.mark_trained()
    assert made.grant("b", "any") == (7, 0)


def test_what_a_dead_actor_had_is_leased_anew_with_the_newest_weights():
    made = ledger(bound=4)
    assert (made.grant("a", "any"), made.grant("b", "any")) == ((0, 0), (1, 0))
    made.receive(acted(0))
    made.mark_trained()
    made.actor_gone("b")
    assert made.grant("a", "any") == (1, 0)
    assert made.weights_version(1) == 1
    assert made.reissued == 1


class FreeRun(Run):
    """The same among actors that come and die, lost messages and restarts, whose leases have other weights."""

    @initialize(levels=st.text("emhr", min_size=4, max_size=12), lag=st.integers(1, 3))
    def begin(self, levels, lag):
        self.leased = {}  # the versions that were ever leased of a unit
        super().begin(levels, lag)

    def open_ledger(self):
        self.ledger = FreeLedger(self.levels, self.lag, self.snapshot, version=self.snapshot)
        self.trained = [(episode, 0) for episode in range(self.snapshot)]

    def check_grant(self, unit, actor):
        assert self.ledger.trained <= unit[0] <= self.ledger.trained + self.lag
        assert self.levels[unit[0]] == actor.serves or actor.serves == "any"
        assert self.ledger.weights_version(unit[0]) == self.ledger.version
        self.leased.setdefault(unit, set()).add(self.ledger.version)

    def train(self):
        while (fragment := self.ledger.next_ready()) is not None:
            unit = fragment.lease.unit
            assert self.leased[unit] <= set(self.ledger.versions(unit[0]))
            assert all(0 <= self.ledger.version - version <= self.lag for version in self.leased[unit])
            self.trained.append(unit)
            self.ledger.mark_trained()

    @precondition(lambda self: hasattr(self, "ledger"))
    @invariant()
    def every_episode_of_the_window_is_waiting_leased_or_here(self):
        """Unless there is enough, and then the next one can be trained."""
        if not self.ledger._has_enough:
            super().every_episode_of_the_window_is_waiting_leased_or_here()


TestFreeRun = FreeRun.TestCase
TestFreeRun.settings = settings(TestRun.settings, max_examples=100)
del TestRun  # it is run where it belongs
