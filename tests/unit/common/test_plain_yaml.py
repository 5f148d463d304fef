"""YAML is read as plain data, or refused in one short line and in no time, whatever a text holds."""

import pytest
import yaml
from fuzzing import cases, fuzz
from hypothesis import example, given
from hypothesis import strategies as st

from railctl.common.plain_yaml import NotPlainYamlError, dump_yaml, parse_yaml

BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{at}: &a{at} [{', '.join([f'*a{at - 1}'] * 10)}]\n" for at in range(1, 12)
)
MERGED_BOMB = "a0: &a0 {k: 1}\n" + "".join(
    f"a{at}: &a{at} {{<<: [{', '.join([f'*a{at - 1}'] * 10)}]}}\n" for at in range(1, 12)
)
CHAIN = "a0: &a0 [x]\n" + "".join(f"a{at}: &a{at} [*a{at - 1}]\n" for at in range(1, 3000))


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("", None),
        ("{a: 1, b: [x, 2.5, true, null, 'y']}", {"a": 1, "b": ["x", 2.5, True, None, "y"]}),
        ("1e-3", 0.001),
        ("-2E5", -200_000.0),
        ("2020-01-01", "2020-01-01"),
        ("[&a {b: 1}, *a]", [{"b": 1}, {"b": 1}]),
        ("{<<: {a: 1, b: 1}, b: 2}", {"a": 1, "b": 2}),
        (str(2**63 - 1), 2**63 - 1),
        ("[0, 0.5, 00.5, 0x1f, 1_000]", [0, 0.5, 0.5, 31, 1000]),
        ("['010', \"1:30\", 089, a:1]", ["010", "1:30", "089", "a:1"]),
        ("{1: a, '1': b}", {1: "a", "1": "b"}),
    ],
)
def test_what_is_plain_is_read(text, data):
    assert parse_yaml(text) == data


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("a: 1\nb: 2\na: 3", "the key 'a' is there twice: leave one out (line 3, column 1)"),
        ("a: {b: 1, b: 1}", "the key 'b' is there twice: leave one out (line 1, column 11)"),
        ("- a: {b: 1}\n  a: 2", "the key 'a' is there twice: leave one out (line 2, column 3)"),
        ("{1: a, 1.0: b}", "the key 1.0 is there twice: leave one out (line 1, column 8)"),
        (
            "{<<: {a: 1}, <<: {b: 1}}",
            "the key 'tag:yaml.org,2002:merge' is there twice: leave one out (line 1, column 14)",
        ),
        ("? [1]\n: 2", "a key that is a list or a mapping (line 1, column 3)"),
        ("a: &a [*a]", "*'a' is a part of itself (line 1, column 8)"),
        ("a: *b", "found undefined alias 'b' (line 1, column 4)"),
        ("a: !!int ''", "a tag (tag:yaml.org,2002:int): leave it out (line 1, column 4)"),
        ("!!set {a, b}", "a tag (tag:yaml.org,2002:set): leave it out (line 1, column 1)"),
        ("a: 010", "'010' is in base 8 or 60 to YAML: write it in base 10, or in quotes (line 1, column 4)"),
        ("[-0_7]", "'-0_7' is in base 8 or 60 to YAML: write it in base 10, or in quotes (line 1, column 2)"),
        ("1:30", "'1:30' is in base 8 or 60 to YAML: write it in base 10, or in quotes (line 1, column 1)"),
        ("{1:30.5: a}", "'1:30.5' is in base 8 or 60 to YAML: write it in base 10, or in quotes (line 1, column 2)"),
        (str(2**63), f"'{2**63}' is beyond 64 bits (line 1, column 1)"),
        ('"a\\0b"', "'a\\x00b' has line ends or other characters that cannot be printed (line 1, column 1)"),
        ('"\\ud800"', "'\\ud800' has line ends or other characters that cannot be printed (line 1, column 1)"),
        ("a: [1", "while parsing a flow sequence: expected ',' or ']', but got '<stream end>' (line 1, column 6)"),
    ],
)
def test_what_is_not_plain_is_named_with_its_place(text, problem):
    with pytest.raises(NotPlainYamlError) as caught:
        parse_yaml(text)
    assert str(caught.value) == problem


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        "{a: " * 100_000,
        "- " * 100_000,
        BOMB,
        MERGED_BOMB,
        CHAIN,
        "0x" + "f" * 100_000,
        "1" * 100_000,
        ":".join(["59"] * 10_000),
        ":".join(["59"] * 10_000) + ".5",
        ":".join(["59"] * 20),
        "x" * 100_000,
        "*" + "x" * 100_000,
        "!" + "x" * 100_000,
        "0b_",
        "=",
        "--- a\n--- b",
    ],
    ids=range(17),
)
def test_what_is_enormous_or_broken_is_refused_in_a_short_line(text):
    with pytest.raises(NotPlainYamlError) as caught:
        parse_yaml(text)
    assert len(str(caught.value)) < 400
    assert "\n" not in str(caught.value)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.text(st.characters(codec="ascii"), max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("abc", max_size=3), inner, max_size=3),
    max_leaves=8,
)


def read(text):
    """What is read, or the refusal."""
    try:
        return parse_yaml(text)
    except NotPlainYamlError as error:
        return str(error)


@fuzz
@cases(100)
@given(PLAIN)
@example(["0E0", "1e5", 1e5])
@example(["010", "1:30", "-1:30.5", 8, 90])
def test_what_is_written_is_read_again(data):
    text = dump_yaml(data)
    found = read(text)
    assert found == yaml.safe_load(text) == data or "cannot be printed" in str(found)


@fuzz
@cases(100)
@given(st.text(st.sampled_from("ab:-{}[]&*!|>'\"\\#%@,?= \n0.e<"), max_size=30))
def test_any_text_is_data_or_refused_in_one_line(text):
    assert "\n" not in str(read(text))
