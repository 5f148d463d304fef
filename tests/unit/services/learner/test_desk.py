"""The desk: who gets which lease, who waits and for how long, and what is refused."""

import numpy as np
import pytest
from made_episodes import answer_to, edited

from railctl.common.records.acting import LeaseRequest
from railctl.services.learner.desk import LEASE_S, LONG_POLL_S, OPEN_S, STORY_EVENTS, Desk, Reply, Start
from railctl.services.learner.schedule import Schedule

NOW = 100.0


def schedule(levels=("easy",) * 4, **changes):
    fields = {"level_seed": lambda episode: 1000 + episode, "epsilon": lambda episode: 1 / (1 + episode)}
    return Schedule(**{"levels": levels, "trains": dict.fromkeys(levels, 1)} | fields | changes)


def desk(*actors, start=None, **changes):
    made = Desk(schedule(**changes), n_features=1, start=start)
    for actor in actors:
        made.actor_came(actor, f"{actor}-1")
    return made


def request(actor, kept=(), serves="any"):
    units = np.array(kept, np.int64).reshape(-1, 2)
    return LeaseRequest(actor=actor, incarnation=f"{actor}-1", serves=serves, kept=units)


def lease(made, actor, kept=()):
    """What an actor that asks is leased at once; a question of its that is open ends."""
    assert made.ask(f"{actor} asks", request(actor, kept), NOW) in ([], [Reply(f"{actor} asks", None)])
    replies = [reply for reply in made.give(NOW) if reply.question == f"{actor} asks"]
    return replies[0].answer.lease if replies else None


def train(made):
    assert made.next_ready() is not None
    return made.mark_trained()


def test_a_lease_says_all_that_an_episode_depends_on():
    made = desk("a", "b", lag=1)
    first, second = lease(made, "a"), lease(made, "b")
    assert (first.episode, first.level, first.level_seed, first.epsilon) == (0, "easy", 1000, 1.0)
    assert (second.episode, second.level_seed, second.epsilon, second.weights_version) == (1, 1001, 0.5, 0)
    assert (first.steps, first.progressed) == (None, None)


def test_who_cannot_be_served_waits_until_there_is_work():
    made = desk("a", "b")
    first = lease(made, "a")
    assert lease(made, "b") is None
    assert made.give(NOW + LONG_POLL_S - 0.1) == []
    assert made.arrive(answer_to(first, actor="a")) is None
    assert train(made).steps == 2
    [(question, answer, last)] = made.give(NOW + LONG_POLL_S - 0.1)
    assert (question, answer.lease.episode, answer.lease.weights_version, last) == ("b asks", 1, 1, False)


def test_who_has_waited_long_enough_is_answered_without_work():
    made = desk("a", "b")
    lease(made, "a")
    lease(made, "b")
    [(question, answer, last)] = made.give(NOW + LONG_POLL_S)
    assert (question, answer.lease, answer.finished, answer.safe_before, last) == ("b asks", None, False, 0, True)
    assert made.give(NOW + 9 * LONG_POLL_S) == []


def test_what_an_actor_brings_asks_for_the_next_lease_until_the_question_has_been_open_for_long():
    made = desk("a", lag=1)
    first = lease(made, "a")
    assert made.give(NOW) == []  # it acts
    assert made.arrive(answer_to(first, actor="a")) is None
    [(question, answer, last)] = made.give(NOW + OPEN_S - 0.1)
    assert (question, answer.lease.episode, last) == ("a asks", 1, False)
    assert made.arrive(answer_to(answer.lease, actor="a")) is None
    assert made.give(NOW + OPEN_S) == []  # nothing is left to act before something is trained
    train(made)
    [(question, answer, last)] = made.give(NOW + OPEN_S)
    assert (question, answer.lease.episode, last) == ("a asks", 2, True)
    assert made.arrive(answer_to(answer.lease, actor="a")) is None
    train(made)
    assert made.give(NOW + OPEN_S) == []
    assert made.ask("a asks again", request("a"), NOW) == []


def test_who_brings_something_and_finds_no_work_waits_as_long_as_who_asks():
    made = desk("a", "b")
    assert made.arrive(answer_to(lease(made, "a"), actor="a")) is None
    assert made.give(NOW + 1, paused=True) == []
    assert made.give(NOW + 0.9 + LONG_POLL_S, paused=True) == []
    [(question, answer, last)] = made.give(NOW + 1 + LONG_POLL_S, paused=True)
    assert (question, answer.lease, last) == ("a asks", None, True)


def test_who_has_waited_longest_gets_the_next_lease():
    made = desk("a", "b")
    first = lease(made, "a")
    assert lease(made, "b") is None
    made.arrive(answer_to(first, actor="a"))
    train(made)
    [(question, answer, _)] = made.give(NOW)
    assert question == "b asks"
    made.arrive(answer_to(answer.lease, actor="b"))
    train(made)
    assert [reply.question for reply in made.give(NOW)] == ["a asks"]


def idle(made, actor, now, serves="any"):
    """What an actor that has nothing to do is leased then."""
    made.ask(f"{actor} asks", request(actor, serves=serves), now)
    return next((reply.answer.lease for reply in made.give(now) if reply.question == f"{actor} asks"), None)


def test_who_has_nothing_to_do_acts_what_its_actor_does_not_bring():
    made = desk("a", "b", "c")
    first = lease(made, "a")
    assert idle(made, "b", NOW) is None
    assert idle(made, "b", NOW + LEASE_S) is None
    assert idle(made, "b", NOW + LEASE_S + 1) == first
    assert made.ledger.reissued == 1
    assert idle(made, "c", NOW + LEASE_S + 2) is None
    assert idle(made, "c", NOW + 3 * LEASE_S) is None  # the second has twice the time
    assert "leased to b" in made.arrive(answer_to(first, actor="a"))
    assert made.arrive(answer_to(first, actor="b")) is None
    assert train(made).steps == 2
    assert made.arrive(answer_to(first, actor="a")) is None  # too late, and the same
    assert made.ledger.duplicates == 1


def test_nobody_loses_a_lease_to_who_could_not_act_it_or_while_the_run_is_paused():
    made = desk("a", "b")
    first = lease(made, "a")
    for now in (NOW, NOW + LEASE_S + 1, NOW + 9 * LEASE_S):
        assert idle(made, "b", now, serves="hard") is None
    made.ask("b asks", request("b"), NOW)
    for now in (NOW, NOW + LEASE_S + 1):
        assert [reply.answer.lease for reply in made.give(now, paused=True)] in ([], [None])
    made.arrive(answer_to(first, actor="a"))
    assert train(made).steps == 2


def test_an_open_episode_does_not_wait_for_ever_for_the_actor_whose_world_stands_there():
    made = desk("a", "b", fragment_steps=4)
    made.ask("a asks", request("a"), NOW - OPEN_S)
    [(_, answer, last)] = made.give(NOW)
    made.arrive(answer_to(answer.lease, actor="a", over=False))
    train(made)
    assert last  # a never asks again
    assert idle(made, "b", NOW) is None
    assert idle(made, "b", NOW + LEASE_S) is None
    assert idle(made, "b", NOW + LEASE_S + 1).unit == (0, 1)


def test_who_is_refused_gets_the_next_lease():
    made = desk("a")
    fragment = answer_to(lease(made, "a"), actor="a")
    made.arrive(edited(fragment, weights_version=3))
    [(question, answer, last)] = made.give(NOW)
    assert (question, answer.lease.unit, last) == ("a asks", (0, 0), False)


def test_nothing_is_leased_while_the_run_is_paused():
    made = desk("a")
    made.ask("a asks", request("a"), NOW)
    assert made.give(NOW, paused=True) == []
    assert made.give(NOW + LONG_POLL_S, paused=True)[0].answer.lease is None


def test_a_question_asked_again_or_by_a_dead_actor_is_dropped():
    made = desk("a", "b")
    lease(made, "a")
    made.ask("first", request("b"), NOW)
    assert made.ask("second", request("b"), NOW) == [Reply("first", None)]
    assert made.actor_gone("b-1") == [Reply("second", None)]
    assert made.actor_gone("b-1") == []


def test_actors_get_only_what_they_serve():
    made = desk("a", "b", levels=("easy", "rush"), lag=1)
    made.ask("a asks", request("a", serves="rush"), NOW)
    made.ask("b asks", request("b", serves="hard"), NOW)
    assert [(reply.question, reply.answer.lease.episode) for reply in made.give(NOW)] == [("a asks", 1)]
    assert made.ledger.waiting() == {"easy": 1}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"weights_version": 3}, "weights_version is 3, its lease says 0"),
        ({"level": "hard"}, "level is hard, its lease says easy"),
        ({"level_seed": 5}, "level_seed is 5, its lease says 1000"),
        ({"epsilon": 0.5}, "epsilon is 0.5, its lease says 1.0"),
        ({"observations": np.zeros((2, 3), np.float32)}, "observations have 3 features, the network takes 1"),
        ({"following": np.zeros((2, 1), np.float32)}, "observations a step later have 1 features, this run notes 0"),
        ({"states": np.zeros((2, 0), np.float32)}, "there are 2 trains, its level has 1 at most"),
        ({"states": np.zeros((1, 6), np.float32)}, "trains carry 6 numbers along, in this run 0"),
        ({"times": np.zeros(2, np.int32)}, "episode 0: decisions are not in the order of (time, train)"),
        ({"arrived_at": np.zeros(1, np.int32)}, "episode 0: a train decides after its arrival"),
    ],
)
def test_what_is_not_as_leased_is_refused_and_leased_anew(change, reason):
    made = desk("a")
    fragment = answer_to(lease(made, "a"), actor="a")
    refusal = made.arrive(edited(fragment, **change))
    assert refusal == f"refused episode 0, fragment 0 of a: {reason}"
    assert (made.refused, made.story[-1]) == (1, refusal)
    assert lease(made, "a", kept=[(0, 0)]).episode == 0  # it is not asked for, though the actor keeps it
    assert made.arrive(fragment) is None
    train(made)


def test_what_trains_carry_along_is_refused_where_it_is_missing():
    made = desk("a", n_state=4)
    fragment = answer_to(lease(made, "a"), actor="a")
    assert made.arrive(fragment).endswith("trains carry 0 numbers along, in this run 4")
    lease(made, "a")
    assert made.arrive(edited(fragment, states=np.zeros((1, 4), np.float32))) is None


def test_what_followed_decisions_is_refused_where_it_is_missing():
    made = desk("a", following=True)
    fragment = answer_to(lease(made, "a"), actor="a")
    assert made.arrive(fragment).endswith("observations a step later have 0 features, this run notes 1")
    lease(made, "a")
    assert made.arrive(edited(fragment, following=np.zeros((2, 1), np.float32))) is None


def test_what_nobody_has_leased_is_refused():
    made, other = desk("a"), desk("a")
    fragment = answer_to(lease(other, "a"), actor="a")
    assert made.arrive(fragment) == "refused episode 0, fragment 0 of a: nobody has leased it"
    assert made.arrive(edited(fragment, episode=4)).endswith("this run has 4 episodes")
    assert (made.refused, made.next_ready()) == (2, None)


def test_what_is_leased_to_somebody_else_is_refused_and_stays_leased():
    made = desk("a", "b")
    first = lease(made, "a")
    assert made.arrive(answer_to(first, actor="b")).endswith("it is leased to a")
    assert made.ledger.lessee((0, 0)) == "a-1"
    assert made.arrive(answer_to(first, actor="a")) is None
    train(made)


def test_the_last_words_of_a_dead_actor_are_refused_and_its_heir_delivers():
    made = desk("a", "b")
    first = lease(made, "a")
    made.actor_gone("a-1")
    assert made.arrive(answer_to(first, actor="a")).endswith("nobody has leased it")
    second = lease(made, "b")
    assert made.arrive(answer_to(first, actor="a")).endswith("it is leased to b")
    assert made.arrive(answer_to(second, actor="b")) is None


def test_a_copy_is_dropped_without_a_word():
    made = desk("a")
    fragment = answer_to(lease(made, "a"), actor="a")
    assert made.arrive(fragment) is None
    assert made.arrive(fragment) is None
    train(made)
    assert made.arrive(fragment) is None
    assert (made.ledger.duplicates, made.refused) == (2, 0)


def test_a_kept_fragment_that_got_lost_is_asked_for():
    made = desk("a")
    fragment = answer_to(lease(made, "a"), actor="a")
    [dropped, (question, answer, last)] = made.ask("again", request("a", [(0, 0)]), NOW)
    assert dropped == Reply("a asks", None)
    assert (question, answer.lease, answer.missing.tolist(), last) == ("again", None, [[0, 0]], True)
    assert made.arrive(fragment) is None
    train(made)


def missing(made, actor, kept):
    """What an actor must publish again of what it says it keeps."""
    replies = made.ask(f"{actor} asks", request(actor, kept), NOW)
    return [tuple(unit) for _, answer, _ in replies if answer is not None for unit in answer.missing.tolist()]


def test_no_more_of_what_is_kept_is_believed_than_an_earlier_learner_can_have_leased():
    levels = ("easy",) * 99
    all_of_it = [(episode, fragment) for episode in range(99) for fragment in (0, 1)]
    made = desk("a", "b", levels=levels, lag=3, unsaved=5, start=Start(trained=10, version=10))
    assert missing(made, "a", all_of_it) == [(episode, 0) for episode in range(10, 19)]  # 14 may have been trained
    assert made.ledger.leased == 9
    made.actor_gone("a-1")
    for _ in range(9):
        made.arrive(answer_to(lease(made, "b"), actor="b"))
        train(made)
    made.actor_came("a", "a-1")
    assert missing(made, "a", all_of_it) == [(episode, 0) for episode in range(19, 23)]  # of this learner


def test_where_episodes_come_in_fragments_any_of_those_may_be_kept():
    made = desk("a", fragment_steps=4, unsaved=1)
    assert missing(made, "a", [(0, 0), (0, 7), (1, 2), (2, 0)]) == [(0, 0), (0, 7), (1, 2)]


def test_what_was_taken_back_cannot_be_held_again_by_who_says_that_it_keeps_it():
    made = desk("a", "b", lag=1)
    assert missing(made, "a", [(0, 0), (1, 0)]) == [(0, 0), (1, 0)]
    assert idle(made, "b", NOW) is None
    first = idle(made, "b", NOW + LEASE_S + 1)
    assert first.unit == (0, 0)
    assert missing(made, "a", [(0, 0), (1, 0)]) == []
    assert made.ledger.lessee((1, 0)) is None


def test_nobody_loses_a_lease_to_who_does_not_live():
    made = desk("a")
    first = lease(made, "a")
    assert idle(made, "b", NOW) is None
    assert idle(made, "b", NOW + LEASE_S + 1) is None
    assert made.arrive(answer_to(first, actor="a")) is None


def test_what_is_trained_is_forgotten():
    made = desk("a", "b", fragment_steps=4)
    assert missing(made, "a", [(0, 0), (0, 9)]) == [(0, 0), (0, 9)]
    idle(made, "b", NOW)
    first = idle(made, "b", NOW + LEASE_S + 1)
    assert len(made._late) == len(made._spoiled) == 2
    assert made.arrive(answer_to(first, actor="b", over=True)) is None
    train(made)
    assert (made._given, made._since, made._late, made._spoiled) == ({}, {}, {}, set())


def test_leases_of_an_earlier_learner_are_taken_on_trust_until_their_turn():
    before = desk("a", "b", lag=1)
    zero, one = answer_to(lease(before, "a"), actor="a"), answer_to(lease(before, "b"), actor="b")
    made = desk("a", "b", lag=1)
    made.ask("b asks", request("b", [(1, 0)]), NOW)
    assert made.arrive(edited(one, weights_version=1)) is None
    made.ask("a asks", request("a", [(0, 0)]), NOW)
    assert made.arrive(zero) is None
    train(made)
    assert made.next_ready() is None
    assert made.story[-1] == "refused episode 1, fragment 0 of b: weights_version is 1, its lease says 0"
    assert lease(made, "b", kept=[(1, 0)]).episode == 1
    assert made.arrive(one) is None
    train(made)


def test_a_free_run_takes_what_an_earlier_learner_leased_if_its_weights_are_not_too_old():
    made = desk("a", free=True, lag=3, levels=("easy",) * 9, start=Start(trained=5, version=5))
    too_old, old = (answer_to(edited(made._lease((5, 0)), weights_version=version), actor="a") for version in (1, 2))
    made.ask("a asks", request("a", [(5, 0)]), NOW)
    assert made.arrive(too_old) is None
    assert made.next_ready() is None
    assert made.story[-1] == "refused episode 5, fragment 0 of a: weights_version is 1, its lease says 5"
    assert lease(made, "a", kept=[(5, 0)]).unit == (5, 0)  # and has it acted again
    assert made.arrive(old) is None
    assert train(made).staleness(made.ledger.version) == 3


def test_a_free_run_takes_what_comes_late_of_an_earlier_lease_of_the_same_actor():
    """An actor that was started anew is leased what the one before had published: either is as good."""
    made = desk("a", "b", free=True, lag=3, levels=("easy",) * 9)
    first, second = lease(made, "a"), lease(made, "b")
    made.arrive(answer_to(first, actor="a"))
    train(made)
    made.actor_gone("b-1")
    made.actor_gone("a-1")
    made.actor_came("b", "b-2")
    made.ask("b asks", LeaseRequest(actor="b", incarnation="b-2", serves="easy", kept=np.zeros((0, 2), np.int64)), NOW)
    [(_, answer, _)] = made.give(NOW)
    assert (answer.lease.episode, answer.lease.weights_version, second.weights_version) == (1, 1, 0)
    assert made.arrive(answer_to(second, actor="b")) is None
    assert made.next_ready().lease.weights_version == 0
    assert made.refused == 0


def test_fragments_end_where_the_steps_of_the_run_are_multiples_and_carry_what_is_before():
    made = desk("a", fragment_steps=4, start=Start(trained=1, version=3, steps=10))
    assert made.ledger.trained == made.safe_before == 1
    first = lease(made, "a")
    assert (first.unit, first.steps, first.weights_version) == ((1, 0), 2, 3)
    assert made.arrive(answer_to(first, actor="a", over=False)) is None
    assert train(made) is None
    second = lease(made, "a")
    assert (second.unit, second.steps, second.first_step, second.weights_version) == ((1, 1), 4, 2, 4)
    assert second.progressed.actions.tolist() == [0, 0]
    assert made.arrive(answer_to(second, actor="a", steps=3, over=True)) is None
    episode = train(made)
    assert (episode.steps, [fragment.lease.unit for fragment in episode.fragments]) == (5, [(1, 0), (1, 1)])
    third = lease(made, "a")
    assert (third.unit, third.steps) == ((2, 0), 1)  # 15 steps are over


def test_a_desk_goes_on_within_an_episode():
    before = desk("a", fragment_steps=4)
    fragment = answer_to(lease(before, "a"), actor="a", over=False)
    before.arrive(fragment)
    train(before)
    made = desk("b", fragment_steps=4, start=Start(version=1, fragments=[fragment]))
    again = lease(made, "b")
    assert (again.unit, again.first_step, again.weights_version) == ((0, 1), 4, 1)
    assert again.progressed.actions.tolist() == [0] * 4


def test_nothing_can_be_trained_before_it_is_there():
    with pytest.raises(ValueError, match="nothing was ready"):
        desk("a").mark_trained()


def test_the_story_is_short():
    made = desk()
    for number in range(STORY_EVENTS):
        made.actor_came(f"actor-{number}", f"incarnation-{number}")
        made.actor_gone(f"incarnation-{number}")
    assert len(made.story) == STORY_EVENTS
    assert made.story[-1] == f"actor-{STORY_EVENTS - 1} incarnation-{STORY_EVENTS - 1} is gone"
