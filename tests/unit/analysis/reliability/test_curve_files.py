"""Files of curves: what is read, and what is refused."""

import numpy as np
import pytest

from railctl.analysis.reliability import Curves, CurvesError, parse_switches
from railctl.analysis.reliability.__main__ import parsed, reliability
from railctl.analysis.reliability.files import load
from railctl.common.strict import ConfigError
from railctl.common.task import carry_out

FLOATS = np.linspace(-1, 0, 36).reshape(1, 2, 3, 6)
GIVEN = {"returns": FLOATS, "block": np.array(3), "n_zones": np.array(2)}
SCALED = {"returns_int": -np.arange(36, dtype=np.int16).reshape(1, 2, 3, 6), "scale": np.array(64)}


def spoilt(value):
    returns = FLOATS.copy()
    returns[0, 1, 2, 3] = value
    return returns


def saved(path, arrays):
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def test_floats_with_names(tmp_path):
    names = {"algorithms": np.array(["sil"]), "levels": np.array(["easy", "hard"])}
    curves = load(saved(tmp_path / "curves.npz", GIVEN | names))
    assert curves.returns.tolist() == FLOATS.tolist()
    assert (curves.block, curves.zones, curves.points) == (3, 2, 2)
    assert (curves.algorithms, curves.levels) == (("sil",), ("easy", "hard"))


def test_integers_with_a_scale(tmp_path):
    curves = load(saved(tmp_path / "curves.npz", GIVEN | {"returns": None} | SCALED))
    assert curves.returns[0, 0, 0].tolist() == [0, -1 / 64, -2 / 64, -3 / 64, -4 / 64, -5 / 64]
    assert curves.algorithms == ("algorithm0",)
    assert curves.levels == ("level0", "level1")


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"returns": None}, "the array returns_int is missing: give returns_int, scale, block, n_zones, and names"),
        ({"returns": None, "returns_int": SCALED["returns_int"]}, "the array scale is missing: give "),
        ({"block": None}, "the array block is missing: give returns, block, n_zones, and names if you like"),
        ({"blocks": np.array(3)}, r"unknown array blocks: did you mean block\? known are algorithms, block, "),
        (SCALED, "unknown array returns_int: did you mean returns"),
        ({"returns": FLOATS.astype(int)}, "returns holds int64: use floats, or integers in returns_int with a scale"),
        ({"returns": FLOATS[0]}, r"returns has shape \(2, 3, 6\): give \[algorithms, levels, runs, episodes\]"),
        ({"returns": FLOATS[:, :, :0]}, r"returns has shape \(1, 2, 0, 6\): give "),
        ({"returns": FLOATS[..., :5]}, "block 3 does not divide 5 episodes: cut the runs, or use another"),
        (
            {"returns": spoilt(np.nan)},
            r"returns\[0, 1, 2, 3\] \(.*\) is nan: every run needs a return for every episode",
        ),
        ({"returns": spoilt(-np.inf)}, r"returns\[0, 1, 2, 3\] \(.*\) is -inf: every run needs a return"),
        ({"returns": spoilt(0.5)}, r"returns\[0, 1, 2, 3\] \(.*\) is 0.5: normalise it to \[-1, 0\]"),
        ({"block": np.array(1)}, "block 1: use 2 episodes or more, differences lie within a block"),
        ({"block": np.array(3.0)}, "block is 3.0: use one whole number"),
        ({"block": np.array([3, 3])}, r"block is int64 of shape \(2,\): use one whole number"),
        ({"n_zones": np.array(3)}, "n_zones 3: use 1 to 2, as many as there are blocks of 3 episodes"),
        ({"n_zones": np.array(0)}, "n_zones 0: use 1 to 2, "),
        ({"levels": np.array(["easy"])}, "levels has 1 names, returns has 2 levels: give each one name"),
        ({"levels": np.array(["easy", "easy"])}, r"levels\[1\] is 'easy': give each a name of its own"),
        ({"levels": np.array(["easy", "a\nb"])}, r"levels\[1\] is 'a\\nb': give each a name of its own"),
        ({"levels": np.array([1, 2])}, r"levels is int64 of shape \(2,\): use a list of texts"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, changed, complaint):
    path = saved(tmp_path / "curves.npz", GIVEN | changed)
    with pytest.raises(CurvesError, match=rf"^{path}: {complaint}") as refused:
        load(path)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"returns_int": FLOATS}, "returns_int holds float64: use integers, or floats in an array returns"),
        ({"scale": np.array(0)}, "scale is 0: use one number above 0"),
        ({"scale": np.array(np.inf)}, "scale is inf: use one number above 0"),
        ({"scale": np.array("64")}, "scale is '64': use one number above 0"),
        ({"scale": np.array(32)}, r"returns_int\[0, 1, 2, 3\] is -33: divided by scale 32 it must lie in \[-1, 0\]"),
    ],
)
def test_integers_are_checked_too(tmp_path, changed, complaint):
    path = saved(tmp_path / "curves.npz", GIVEN | {"returns": None} | SCALED | changed)
    with pytest.raises(CurvesError, match=rf"^{path}: {complaint}"):
        load(path)


def test_what_is_no_file_of_curves(tmp_path):
    (tmp_path / "text.npz").write_text("curves")
    with pytest.raises(CurvesError, match=r"is no readable \.npz file of arrays"):
        load(tmp_path / "text.npz")
    with pytest.raises(CurvesError, match="no such file"):
        load(tmp_path / "none.npz")
    np.savez(tmp_path / "objects.npz", **GIVEN, levels=np.array([None, "hard"]))
    with pytest.raises(CurvesError, match="levels holds Python objects, which are not read"):
        load(tmp_path / "objects.npz")


def test_curves_that_are_made_are_checked_as_well():
    with pytest.raises(CurvesError, match=r"^algorithms has 2 names, returns has 1 algorithms"):
        Curves(FLOATS, block=3, zones=1, algorithms=("sil", "ppo"))


def test_switches_from_outside():
    switches = parse_switches({"dr_center": "true", "zones": "tool"})
    assert (switches.dr_center, switches.zones, switches.normalize) == (True, "tool", "none")
    with pytest.raises(ConfigError, match=r"^unknown switch zone: did you mean zones\? known are dr_center, "):
        parse_switches({"zone": "tool"})
    with pytest.raises(ConfigError, match=r"^switch zones: input should be 'index' or 'tool', not 'tol'$"):
        parse_switches({"zones": "tol"})


def test_what_is_wrong_ends_the_process_in_a_line(tmp_path, caplog):
    path = saved(tmp_path / "curves.npz", GIVEN | {"block": np.array(5)})
    with pytest.raises(SystemExit) as ended:
        carry_out(lambda: reliability(parsed([str(path)])), CurvesError)
    assert ended.value.code == 1
    assert caplog.messages == [f"{path}: block 5 does not divide 6 episodes: cut the runs, or use another"]
