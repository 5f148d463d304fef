"""Episodes in compiled code equal those that Python steps through flatland-rl, to the bit, whole or in fragments."""

import numpy as np
import pytest
from stock_levels import MIXED, stock_level

from railctl.common.levels.level import Malfunctions
from railctl.common.levels.supply import LevelSupply
from railctl.common.policy.actor_critic import build_actor_critic
from railctl.common.policy.compiled import Twin
from railctl.common.policy.networks import build_network, export_parameters
from railctl.common.policy.player import Acting, compiled_world, network_layout, play, player
from railctl.common.policy.recurrent import build_recurrent_network
from railctl.common.policy.rollout import Rollouts
from railctl.common.rail.planning.judging import Teacher
from railctl.common.records.acting import digest_of
from railctl.common.records.course import Course, Decisions
from railctl.common.rules.settings import NetworkConfig
from railctl.common.world import study_world

ENGINES = ("compiled", "flatland")
BUILDS = {
    "plain": build_network,
    "dueling": build_network,
    "dueling-apart": build_network,
    "recurrent": build_recurrent_network,
    "actor-critic": build_actor_critic,
}


def study_player(engine, trains=7, interlocking="off", **options):
    """What plays the study's levels."""
    world = study_world().model_copy(update={"interlocking": interlocking})
    return player(engine, world, "legacy", trains, **options)


def twin_of(kind, seed):
    config = NetworkConfig(kind=kind)
    twin = Twin(network_layout(config, 252))
    twin.load(export_parameters(BUILDS[kind](config, 252, 5, seed)))
    return twin


def same(ours, theirs):
    return digest_of(ours) == digest_of(theirs)


@pytest.mark.parametrize("kind", BUILDS)
@pytest.mark.parametrize("difficulty", ["easy", "medium", "hard"])
def test_both_engines_play_the_same_episode(difficulty, kind):
    acting = Acting(twin_of(kind, seed=3), epsilon=0.3, key=77)
    for seed in range(2):
        level = LevelSupply().training(difficulty, seed)
        compiled, flatland = (play(study_player(engine), level, acting) for engine in ENGINES)
        assert same(compiled, flatland)
        assert (
            (kind == "actor-critic")
            == bool(compiled.decisions.values.any())
            == bool(compiled.decisions.log_probabilities.any())
        )
        assert (kind == "recurrent") == (compiled.states.shape[1] > 0)


@pytest.mark.parametrize("difficulty", ["easy", "medium", "hard"])
def test_both_engines_note_what_is_seen_one_step_later(difficulty):
    acting = Acting(twin_of("plain", seed=3), epsilon=0.3, key=77)
    again = 0
    for seed in range(3):
        level = LevelSupply().training(difficulty, seed)
        compiled, flatland = (play(study_player(engine), level, acting._replace(following=True)) for engine in ENGINES)
        assert same(compiled, flatland)
        plain = play(study_player("compiled"), level, acting)
        assert plain.decisions.following.shape == (len(plain.decisions), 0)
        nothing = compiled.decisions.model_copy(update={"following": plain.decisions.following})
        assert same(compiled.model_copy(update={"decisions": nothing}), plain)
        found = list(zip(*(compiled.decisions.__dict__[name] for name in ("times", "trains")), strict=True))
        for (time, train), following in zip(found, compiled.decisions.following, strict=True):
            if compiled.arrived_at[train] == time:
                expected = np.zeros_like(following)
            elif time + 1 == compiled.last_step:
                expected = compiled.final_observations[train]
            elif (time + 1, train) in found:
                expected = compiled.decisions.observations[found.index((time + 1, train))]
                again += 1
            else:
                continue
            np.testing.assert_array_equal(following, expected)
    assert again


def test_who_arrives_on_the_step_of_its_decision_sees_nothing_after_it():
    world = study_world().model_copy(update={"decisions": "always"})
    level = stock_level(3, 25, 5, 2, speeds=MIXED, malfunctions=Malfunctions(1 / 40, 3, 12))
    teacher = Teacher(orders=3, margin=1, patience=16, key=np.uint64(5))  # obeyed, so that trains arrive
    acting = Acting(twin_of("actor-critic", seed=3), 1.0, key=77, teacher=teacher, following=True)
    compiled, flatland = (play(player(engine, world, "stock", 5), level, acting, 9) for engine in ENGINES)
    assert same(compiled, flatland)
    decisions = compiled.decisions
    last = compiled.arrived_at[decisions.trains] == decisions.times
    assert last.any()
    assert (decisions.following.any(axis=1) == ~last).all()


@pytest.mark.parametrize("kind", ["recurrent", "actor-critic"])
@pytest.mark.parametrize("interlocking", ["valid", "safe", "planned"])
def test_both_engines_grant_the_same_actions(interlocking, kind):
    acting = Acting(twin_of(kind, seed=3), epsilon=0.6, key=77)
    level = LevelSupply().training("hard", 1)
    compiled, flatland = (play(study_player(engine, interlocking=interlocking), level, acting) for engine in ENGINES)
    assert same(compiled, flatland)
    assert (compiled.decisions.allowed < 31).all()
    assert ((compiled.final_allowed < 31) == (compiled.arrived_at < 0)).all()
    free = play(study_player("compiled"), level, acting)
    assert (free.decisions.allowed == 31).all()
    assert (free.final_allowed == 31).all()


@pytest.mark.parametrize("interlocking", ["off", "safe", "planned"])
def test_both_engines_hear_the_same_from_a_teacher(interlocking):
    acting = Acting(
        twin_of("actor-critic", seed=3),
        epsilon=0.6,
        key=77,
        teacher=Teacher(orders=3, margin=1, patience=16, key=np.uint64(2**64 - 5)),
    )
    level = LevelSupply().training("hard", 1)
    compiled, flatland = (play(study_player(engine, interlocking=interlocking), level, acting) for engine in ENGINES)
    assert same(compiled, flatland)
    labels, actions = compiled.decisions.labels, compiled.decisions.actions
    assert set(labels.tolist()) <= {-1, 1, 2, 3, 4}
    assert 0.5 < (labels == actions)[labels >= 0].mean() < 0.95
    untaught = play(study_player("compiled"), level, acting._replace(teacher=None))
    assert (untaught.decisions.labels == -1).all()
    obedient = play(study_player("compiled", interlocking="planned"), level, acting._replace(epsilon=1.0))
    chosen = obedient.decisions.labels >= 0
    assert (obedient.decisions.labels == obedient.decisions.actions)[chosen].all()
    assert (obedient.arrived_at >= 0).all()


@pytest.mark.parametrize("greedy", [False, True])
def test_greedy_episodes_look_at_no_draw(greedy):
    twin, level = twin_of("actor-critic", seed=5), LevelSupply().training("easy", 1)
    one, other = (
        play(Rollouts(compiled_world(study_world(), "legacy", 7)), level, Acting(twin, key=key, greedy=greedy))
        for key in (1, 2)
    )
    assert same(one, other) == greedy


def test_an_episode_does_not_depend_on_those_before_it():
    acting = Acting(twin_of("dueling", seed=4), epsilon=0.5, key=9)
    levels = [LevelSupply().training(name, 5) for name in ("hard", "easy", "medium")]
    one = Rollouts(compiled_world(study_world(), "legacy", 7))
    in_turn = [play(one, level, acting) for level in levels]
    for level, recording in zip(levels, in_turn, strict=True):
        assert same(recording, play(Rollouts(compiled_world(study_world(), "legacy", 7)), level, acting))


@pytest.mark.parametrize("kind", ["recurrent", "actor-critic"])
@pytest.mark.parametrize("following", [False, True])
@pytest.mark.parametrize("room", [{"room_bytes": 0}, {"room_steps": 7}, {"room_bytes": 9_000, "room_steps": 1}])
def test_an_episode_noted_piece_by_piece_is_the_same(kind, following, room):
    acting = Acting(twin_of(kind, seed=6), epsilon=0.4, key=3, following=following)
    level = LevelSupply().training("medium", 2)
    begun = []
    pieces = play(
        Rollouts(compiled_world(study_world(), "legacy", 7), lambda: begun.append(None), **room), level, acting
    )
    assert len(begun) > 10
    assert same(pieces, play(Rollouts(compiled_world(study_world(), "legacy", 7)), level, acting))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("kind", "interlocking", "following"),
    [("dueling", "off", False), ("dueling", "off", True), ("recurrent", "off", False), ("recurrent", "planned", False)],
)
def test_fragments_joined_are_the_whole_episode_even_if_each_has_another_player(kind, interlocking, following, engine):
    acting = Acting(twin_of(kind, seed=6), epsilon=0.4, key=3, following=following)
    level = LevelSupply().training("medium", 2)
    whole = play(study_player(engine, interlocking=interlocking), level, acting)
    one = study_player(engine, interlocking=interlocking)
    one.begin(level)
    states = acting.twin.zero_state(level.n_trains)
    parts: list[Course] = []
    while not (parts and parts[-1].over):
        if len(parts) % 2:  # another player takes over
            one = study_player(engine, interlocking=interlocking)
            one.begin(level, 0, np.concatenate([part.decisions.actions for part in parts]), parts[-1].last_step)
            states = parts[-1].states.copy()
        parts.append(one.advance(acting, states, steps=17))
    assert len(parts) > 2
    assert [part.first_step for part in parts] == list(range(0, whole.last_step, 17))
    assert same(Decisions.joined([part.decisions for part in parts]), whole.decisions)
    assert np.concatenate([part.rewards for part in parts]).tobytes() == whole.rewards.tobytes()
    for name in ("arrived_at", "final_observations", "final_allowed", "states"):
        assert getattr(parts[-1], name).tobytes() == getattr(whole, name).tobytes()
    assert not any(part.final_observations.any() for part in parts[:-1])
    assert all((part.final_allowed == 31).all() for part in parts[:-1])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("change", [-1, 1])
def test_actions_that_do_not_fit_are_refused(engine, change):
    level = LevelSupply().training("easy", 3)
    first = play(study_player(engine), level, Acting(twin_of("plain", seed=1)))
    count = int((first.decisions.times < 20).sum()) + change
    with pytest.raises(ValueError, match=f"{count} actions do not fit the first 20 steps"):
        study_player(engine).begin(level, 0, first.decisions.actions[:count], 20)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("shape", [(1, 256), (3, 4), (3, 512), (3, 0)])
def test_states_that_do_not_fit_are_refused(engine, shape):
    made = study_player(engine)
    made.begin(LevelSupply().training("easy", 3))
    acting = Acting(twin_of("recurrent", seed=1))
    assert acting.twin.zero_state(3).shape == (3, 256)
    with pytest.raises(ValueError, match=r"states? ha(s|ve) shape"):
        made.advance(acting, np.zeros(shape, np.float32))
