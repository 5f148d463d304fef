"""Files of demonstrations: what is written is read, and nothing else is."""

import json

import numpy as np
import pytest
from demonstrated import WORLD, course
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from railctl.common.demonstrations import DemonstrationsError, digest_of, read_demonstrations, write_demonstrations
from railctl.common.world import WorldSpec, study_world


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "some.demos"
    write_demonstrations(path, WORLD, "somebody", 2, map(course, range(2)))
    return path


def problem(path):
    with pytest.raises(DemonstrationsError) as caught:
        list(read_demonstrations(path)[1])
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text.removeprefix(f"{path}: ")


def test_what_was_written_is_read(path):
    heading, courses = read_demonstrations(path)
    assert (heading.policy, heading.episodes, heading.world) == ("somebody", 2, digest_of(WORLD))
    for number, found in enumerate(courses):
        assert found.level_hash == course(number).level_hash
        for name, array in course(number).decisions.__dict__.items():
            np.testing.assert_array_equal(getattr(found.decisions, name), array)
    assert number == 1
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_the_first_line_is_read_by_anybody(path):
    assert json.loads(path.read_bytes().partition(b"\n")[0])["format"] == "railctl demonstrations"


@pytest.mark.parametrize(
    ("world", "same"),
    [
        (WORLD, True),
        (WORLD.model_copy(update={"interlocking": "safe"}), False),
        (WORLD.model_copy(update={"decisions": "always"}), False),
        (study_world(), False),
    ],
)
def test_a_world_is_known_by_its_digest(world, same):
    assert (digest_of(world) == digest_of(WorldSpec.model_validate(WORLD.model_dump()))) == same


def test_a_file_that_ends_early_is_refused_at_whatever_byte(path):
    whole = path.read_bytes()
    first = whole.index(b"\n") + 1
    for size in (0, first - 1, first, first + 5, first + 9, len(whole) - 17, len(whole) - 1):
        path.write_bytes(whole[:size])
        assert any(text in problem(path) for text in ("no demonstrations", "the file ends in it", "damaged, or"))


def test_more_than_was_announced_is_refused(path):
    path.write_bytes(path.read_bytes() + b"\0")
    assert problem(path) == "damaged, or holds more episodes than it says: make the file anew"


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_flipped_bit_goes_unnoticed(path, data):
    whole = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, 8 * len(whole) - 1))
    whole[place // 8] ^= 1 << place % 8
    path.with_name("flipped").write_bytes(whole)
    with pytest.raises(DemonstrationsError):
        list(read_demonstrations(path.with_name("flipped"))[1])


def test_a_first_line_that_is_nested_too_deeply_is_none(path):
    path.write_bytes(b"[" * 60_000 + b"\n")
    assert "no demonstrations" in problem(path)


def test_a_file_that_is_there_by_now_is_left_alone(path):
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match=r"some\.demos"):
        write_demonstrations(path, WORLD, "another", 1, [course()])
    assert path.read_bytes() == before
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_another_schema_is_refused_by_its_number(path):
    heading, _, rest = path.read_bytes().partition(b"\n")
    path.write_bytes(json.dumps(json.loads(heading) | {"schema_version": 99}).encode() + b"\n" + rest)
    assert problem(path).startswith("its schema is 99, this version's ")


def test_an_unknown_key_of_the_first_line_is_refused(path):
    heading, _, rest = path.read_bytes().partition(b"\n")
    path.write_bytes(json.dumps(json.loads(heading) | {"polcy": ""}).encode() + b"\n" + rest)
    assert problem(path).startswith("first line: unknown key polcy: did you mean policy?")


@pytest.mark.parametrize(
    ("odd", "text"),
    [
        (course(first_step=1), "is not whole"),
        (course().model_copy(update={"over": False}), "is not whole"),
    ],
)
def test_what_is_no_demonstration_is_refused(tmp_path, odd, text):
    path = tmp_path / "odd.demos"
    write_demonstrations(path, WORLD, "somebody", 2, [course(), odd])
    assert problem(path) == f"episode 1: {text}: make the file anew with railctl demonstrate"


def test_a_file_that_is_not_there_is_named(tmp_path):
    assert problem(tmp_path / "none") == "No such file or directory: give a file of railctl demonstrate"


def test_nothing_is_left_of_a_file_that_was_not_finished(tmp_path):
    with pytest.raises(ValueError, match="1 episodes were played, 2 announced"):
        write_demonstrations(tmp_path / "short.demos", WORLD, "somebody", 2, [course()])
    assert list(tmp_path.iterdir()) == []
