"""One line for whatever is wrong with settings, as users write them: nested, chosen by kind, in lists and mappings."""

from typing import Annotated, Literal

import pytest
from fuzzing import cases, fuzz
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, Tag, ValidationError, model_validator

from railctl.common.strict import Strict, by_kind, describe, flat, nearest, section_of, shortened


class Point(Strict):
    """A section without a kind."""

    x: int = Field(ge=0)
    y: int = 0

    @model_validator(mode="after")
    def _y_is_less(self):
        if self.y > self.x:
            raise ValueError(f"y {self.y} exceeds x {self.x}: make it less")
        return self


class Round(Strict):
    kind: Literal["round"] = "round"
    radius: float = Field(default=1.0, gt=0)
    centre: Point | None = None


class Square(Strict):
    kind: Literal["square"] = "square"
    corners: tuple[Point, Point] | None = None


Shape = Annotated[Annotated[Round, Tag("round")] | Annotated[Square, Tag("square")], by_kind("round")]


class Picture(Strict):
    """All that settings are made of."""

    title: str
    shape: Shape = Round()
    shapes: dict[str, Shape] = Field(default_factory=dict)
    path: tuple[Point, ...] = ()
    frame: Round | Square | None = None
    scales: dict[Annotated[float, Field(gt=0)], Annotated[float, Field(le=1)]] | None = None
    border: Annotated[float, Field(gt=0, lt=1)] | Annotated[tuple[str, ...], Field(min_length=1)] = 0.5


def said(**changes):
    with pytest.raises(ValidationError) as caught:
        Picture.model_validate({"title": "t"} | changes)
    text = describe(caught.value, Picture)
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"title": 5}, "title: input should be a valid string, not 5"),
        (
            {"titel": 5},
            "unknown key titel: did you mean title? known are border, frame, path, scales, shape, shapes, title",
        ),
        ({"shape": {"radius": 0}}, "shape.radius: input should be greater than 0, not 0"),
        ({"shape": {"kind": "round", "radius": 0}}, "shape.radius: input should be greater than 0, not 0"),
        ({"shape": {"radios": 1}}, "unknown key shape.radios: did you mean radius? known are centre, kind, radius"),
        ({"shape": {"kind": "square", "radius": 1}}, "unknown key shape.radius: known are corners, kind"),
        ({"shape": {"kind": "sqare"}}, "shape.kind: unknown 'sqare': known are 'round', 'square'"),
        ({"shape": {"kind": 5}}, "shape.kind: unknown '5': known are 'round', 'square'"),
        ({"shape": {"centre": 3}}, "shape.centre: input should be a valid dictionary, not 3"),
        ({"shape": {"centre": {}}}, "shape.centre.x is missing: give it a value"),
        ({"shape": {"centre": {"x": -1}}}, "shape.centre.x: input should be greater than or equal to 0, not -1"),
        ({"shape": {"centre": {"x": 1, "z": 1}}}, "unknown key shape.centre.z: known are x, y"),
        ({"shape": {"centre": {"x": 1, "y": 2}}}, "shape.centre: y 2 exceeds x 1: make it less"),
        ({"shape": 5}, "shape: input should be a valid dictionary, not 5"),
        ({"shapes": {"a": {"radius": 0}}}, "shapes.a.radius: input should be greater than 0, not 0"),
        ({"shapes": {"a": {"kind": "square", "x": 0}}}, "unknown key shapes.a.x: known are corners, kind"),
        ({"shapes": {"round": {"kind": "oval"}}}, "shapes.round.kind: unknown 'oval': known are 'round', 'square'"),
        ({"shapes": {5: {}}}, "shapes.5: input should be a valid string, not 5"),
        (
            {"shapes": {"a": {"kind": "square", "corners": [{"x": 1}]}}},
            "shapes.a.corners.1 is missing: give it a value",
        ),
        (
            {"shapes": {"a": {"kind": "square", "corners": [{"x": 1}, {"x": -1}]}}},
            "shapes.a.corners.1.x: input should be greater than or equal to 0, not -1",
        ),
        ({"path": [{"x": 1}, {"x": 1, "z": 2}]}, "unknown key path.1.z: known are x, y"),
        ({"path": [{"x": 1}, 7]}, "path.1: input should be a valid dictionary, not 7"),
        ({"path": 7}, "path: input should be a list, not 7"),
        (
            {"shape": {"kind": "square", "corners": [{"x": 1}] * 3}},
            "shape.corners: input should be a list of at most 2 items, not [{'x': 1}, {'x': 1}, {'x': 1}]",
        ),
        ({"scales": {"0.5": 1, 0.5: 1}}, "scales: a key is there twice in {'0.5': 1, 0.5: 1}: leave one out"),
        ({"scales": {0: 1}}, "scales.0: input should be greater than 0, not 0"),
        ({"scales": {0.5: 2}}, "scales.0.5: input should be less than or equal to 1, not 2"),
        ({"scales": 5}, "scales: input should be a valid dictionary, not 5"),
        ({"border": 2}, "border: input should be less than 1, not 2"),
    ],
)
def test_a_problem_is_one_line_with_field_value_and_remedy(changes, text):
    assert said(**changes) == text


def test_a_problem_of_everything_together_has_no_field():
    with pytest.raises(ValidationError) as caught:
        Point(x=1, y=2)
    assert describe(caught.value, Point) == "y 2 exceeds x 1: make it less"


def test_the_first_of_several_problems_is_said():
    assert said(title=1, shape=2).startswith("title: ")


WORDS = st.text("abxy", max_size=3)
ANYTHING = st.recursive(
    st.none() | st.integers() | st.floats() | WORDS | st.sampled_from(["round", "square"]),
    lambda inner: (
        st.lists(inner, max_size=2)
        | st.dictionaries(WORDS | st.sampled_from(["kind", "x", "centre"]), inner, max_size=3)
    ),
    max_leaves=8,
)


@fuzz
@cases(100)
@given(st.sampled_from(sorted(Picture.model_fields)), ANYTHING)
def test_whatever_is_wrong_is_said_in_one_line_that_begins_with_its_field(field, value):
    try:
        Picture.model_validate({"title": "t"} | {field: value})
    except ValidationError as error:
        text = describe(error, Picture)
        assert text.removeprefix("unknown key ").startswith(field)
        assert "\n" not in text


def test_what_does_not_say_its_kind_is_of_the_default_one():
    found = Picture.model_validate({"title": "t", "shapes": {"a": {}, "b": {"kind": "square"}, "c": Square()}})
    assert found.shapes == {"a": Round(), "b": Square(), "c": Square()}


def test_nearest_lists_what_is_known_even_without_a_near_one():
    assert nearest("hrad", ["hard", "easy"]) == ": did you mean hard? known are easy, hard"
    assert nearest("xyz", ["hard", "easy"]) == ": known are easy, hard"


def test_the_model_of_a_field():
    models = {name: section_of(field.annotation) for name, field in Picture.model_fields.items()}
    assert models == {"title": None, "shape": Round, "shapes": None, "path": None, "frame": Round, "scales": None,
                      "border": None}  # fmt: skip
    assert section_of(Shape, "square") is Square
    assert section_of(Shape, "oval") is Round
    assert section_of(Round | None) is Round


def test_values_are_shown_in_short():
    assert shortened({"a": 1}) == "{'a': 1}"
    assert len(shortened(list(range(1000)))) == 80
    assert shortened("x" * 100).endswith("...")


def test_nested_keys_become_dotted_ones():
    assert flat({"a": {"b": {"c": 1}, "d": [2]}, "e": None, 0.5: {1: 2}}) == {
        "a.b.c": 1,
        "a.d": [2],
        "e": None,
        "0.5.1": 2,
    }


class Numbers(Strict):
    """All places where pydantic would take a boolean for a number, or a number for a boolean."""

    count: int = 1
    few: int = Field(default=1, ge=0, le=9)
    share: float = 0.5
    is_on: bool = False
    how: Literal[False, True, "twice"] = False
    sizes: tuple[int, ...] = ()
    scales: dict[float, int] = Field(default_factory=dict)
    maybe: int | None = None
    either: float | tuple[str, ...] = 0.5
    inner: Point | None = None


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"count": True}, "count: input should be a valid integer, not True"),
        ({"share": False}, "share: input should be a valid number, not False"),
        ({"is_on": 1}, "is_on: input should be a valid boolean, not 1"),
        ({"is_on": 0.0}, "is_on: input should be a valid boolean, not 0.0"),
        ({"how": 1}, "how: input should be a valid boolean, not 1"),
        ({"sizes": [1, True]}, "sizes.1: input should be a valid integer, not True"),
        ({"scales": {True: 1}}, "scales.1: input should be a valid number, not True"),
        ({"scales": {0.5: True}}, "scales.0.5: input should be a valid integer, not True"),
        ({"maybe": True}, "maybe: input should be a valid integer, not True"),
        ({"either": True}, "either: input should be a valid number, not True"),
        ({"inner": {"x": True}}, "inner.x: input should be a valid integer, not True"),
        ({"share": float("nan")}, "share: input should be a finite number, not nan"),
        ({"share": "inf"}, "share: input should be a finite number, not 'inf'"),
        ({"count": 2**53}, f"count: input should be less than or equal to {2**53 - 1}, not {2**53}"),
        ({"count": -(2**53)}, f"count: input should be greater than or equal to {1 - 2**53}, not {-(2**53)}"),
        ({"sizes": [10**30]}, f"sizes.0: input should be less than or equal to {2**53 - 1}, not {10**30}"),
        ({"few": 10}, "few: input should be less than or equal to 9, not 10"),
        ({"x" * 5000: 1}, f"unknown key {'x' * 77}...: known are count, "),
    ],
)
def test_a_boolean_is_no_number_and_numbers_are_bounded(changes, text):
    with pytest.raises(ValidationError) as caught:
        Numbers.model_validate(changes)
    assert describe(caught.value, Numbers).startswith(text)


def test_numbers_and_booleans_are_what_they_were():
    given = {
        "count": 2**53 - 1,
        "share": 1,
        "is_on": True,
        "how": True,
        "sizes": [0, 1],
        "scales": {"1": 1},
        "few": "3",
    }
    made = Numbers.model_validate(given)
    assert (made.count, made.share, made.is_on, made.how) == (2**53 - 1, 1.0, True, True)
    assert (made.sizes, made.scales, made.few) == ((0, 1), {1.0: 1}, 3)
    assert Numbers.model_validate_json(made.model_dump_json()) == made
