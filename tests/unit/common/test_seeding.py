"""The random streams are SplitMix64, keyed by what they are for, and never meet where they must not."""

from hypothesis import given, settings
from hypothesis import strategies as st

from railctl.common.seeding import EVALUATION_BIT, bits, evaluation_level_seed, stream_key, training_level_seed, uniform

KEYS = st.integers(0, 2**64 - 1)
COUNTERS = st.integers(0, 2**63)
RUN_SEEDS = st.integers(0, 2**31 - 1)
NUMBERS = st.integers(0, 10_000_000)


def test_draws_are_those_of_the_published_generator():
    assert [bits(1234567, counter) for counter in range(5)] == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]
    assert bits(0, 0) == 0xE220A8397B1DCDAF


def test_keys_and_seeds_are_pinned():
    assert stream_key(1, 0, "explore") == 382660948904662088
    assert [training_level_seed(1, episode) for episode in range(3)] == [1215753501, 688204923, 669015751]
    assert [evaluation_level_seed(index) for index in range(3)] == [3700983107, 2185241600, 3188182274]
    assert [evaluation_level_seed(index, 1) for index in range(3)] == [2922089266, 4166710735, 3596344816]


@settings(deadline=None)
@given(key=KEYS, counter=COUNTERS)
def test_a_draw_is_one_of_64_bits_and_its_uniform_lies_below_one(key, counter):
    assert 0 <= bits(key, counter) < 2**64
    assert 0 <= uniform(key, counter) < 1
    assert uniform(key, counter) == (bits(key, counter) // 2**11) / 2**53


def test_uniform_reaches_almost_one_but_not_one(monkeypatch):
    monkeypatch.setattr("railctl.common.seeding.bits", lambda _key, _counter: 2**64 - 1)
    assert uniform(0, 0) == 1 - 2**-53


def test_uniform_draws_are_spread_evenly():
    draws = [uniform(stream_key(1, 0, "explore"), counter) for counter in range(10_000)]
    assert abs(sum(draws) / len(draws) - 0.5) < 0.015  # five standard deviations
    tenths = [sum(int(10 * draw) == tenth for draw in draws) for tenth in range(10)]
    assert all(850 < count < 1150 for count in tenths)


@settings(deadline=None)
@given(seed=RUN_SEEDS, episode=NUMBERS, index=NUMBERS)
def test_no_training_level_is_ever_an_evaluation_level(seed, episode, index):
    assert 0 <= training_level_seed(seed, episode) < EVALUATION_BIT <= evaluation_level_seed(index) < 2**32


@settings(deadline=None)
@given(st.tuples(RUN_SEEDS, NUMBERS, st.sampled_from(["explore", "level", "replay"])), st.data())
def test_streams_of_other_seeds_items_or_purposes_differ(one, data):
    other = data.draw(
        st.tuples(RUN_SEEDS, NUMBERS, st.sampled_from(["explore", "level", "replay"])).filter(lambda it: it != one)
    )
    assert stream_key(*one) != stream_key(*other)


def test_the_parts_of_a_key_do_not_run_into_each_other():
    assert stream_key(1, 12, "x") != stream_key(11, 2, "x")


def test_the_levels_of_a_run_and_the_evaluation_levels_are_all_different():
    assert len({training_level_seed(1, episode) for episode in range(2000)}) == 2000
    assert len({evaluation_level_seed(index) for index in range(2000)}) == 2000
