"""Networks as models of ONNX: in onnxruntime they say what our compiled twins say, or nothing is written."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import onnx
import pytest

from railctl.common.policy.compiled import Twin
from railctl.common.policy.first_weights import first_actor_critic, first_exits, first_recurrent, first_values
from railctl.common.policy.packing import Layout
from railctl.common.rail.observations.traffic import TrafficObservation
from railctl.common.rail.observations.tree import TreeObservation
from railctl.common.rail.world import N_ACTIONS
from railctl.common.requests import ExportRequest
from railctl.common.rules.settings import NetworkConfig
from railctl.deploy.runs import find_checkpoint
from railctl.tools.export import onnx_file
from railctl.tools.export.checking import TOLERANCE, drawn_observations, outputs_of, outputs_with_state
from railctl.tools.export.networks import ends_of, model_of

ROOT = Path(__file__).parents[4]
FIRST = {
    "plain": first_values,
    "dueling": first_values,
    "dueling-apart": first_values,
    "actor-critic": first_actor_critic,
    "recurrent": first_recurrent,
    "exits": first_exits,
}


def made(kind, hidden, observation):
    """A twin with parameters larger than a fresh one's, and the model of the same network."""
    n_features = observation.n_features()
    first = FIRST[kind](NetworkConfig(kind=kind, hidden=hidden), n_features, N_ACTIONS, 1)
    rng = np.random.default_rng(1)
    weights = {
        name: array + 0.1 * rng.standard_normal(array.shape, np.float32) for name, array in first.weights.items()
    }
    twin = Twin(Layout(kind, n_features, N_ACTIONS, hidden))
    twin.load(weights)
    return twin, model_of(twin.layout, weights, {"told": "so"}, "a test")


@pytest.mark.parametrize("hidden", [(16,), (24, 16), (9, 20, 12)])
@pytest.mark.parametrize("kind", FIRST)
def test_every_kind_of_network_says_what_its_twin_says(kind, hidden):
    observation = TrafficObservation(others=3) if kind == "exits" else TreeObservation()
    twin, model = made(kind, hidden, observation)
    config = SimpleNamespace(world=SimpleNamespace(observation=observation))
    rows = drawn_observations(twin, config)
    states = np.random.default_rng(2).uniform(-1, 1, (len(rows), twin.n_state)).astype(np.float32)
    expected = outputs_with_state(twin, rows, states)
    assert len(np.unique(expected.argmax(-1))) > 1
    np.testing.assert_allclose(outputs_of(model.SerializeToString(), twin, rows, states), expected, atol=TOLERANCE)


def test_a_model_says_what_it_takes_and_gives():
    twin, model = made("recurrent", (8, 4), TreeObservation(depth=1))
    ends = ends_of(twin.layout)
    assert ends == ({"observation": [60], "state": [16]}, {"q_values": [5], "next_state": [16]})
    shapes = {
        value.name: [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim]
        for value in (*model.graph.input, *model.graph.output)
    }
    assert shapes == {name: ["trains", *shape] for name, shape in (ends.inputs | ends.outputs).items()}
    assert {prop.key: prop.value for prop in model.metadata_props} == {"told": "so"}


def test_a_checkpoint_is_written_with_all_that_one_must_know_of_it(write_checkpoint, tmp_path, capsys):
    path = write_checkpoint(tmp_path / "weights.safetensors")
    onnx_file.export(ExportRequest(checkpoint=path, output=tmp_path / "net.onnx"))
    said = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert said["largest_difference"] <= TOLERANCE
    assert said["same_action"] == said["drawn"] + said["played"]
    assert said["played"] > 50
    told = {prop.key: prop.value for prop in onnx.load(tmp_path / "net.onnx").metadata_props}
    assert json.loads(told["actions"]) == ["DO_NOTHING", "MOVE_LEFT", "MOVE_FORWARD", "MOVE_RIGHT", "STOP_MOVING"]
    assert json.loads(told["observation"])["kind"] == "tree"
    assert json.loads(told["observation_range"]) == [-1.0, 0.0]
    assert (told["episode"], told["network"], told["interlocking"]) == ("300", "dueling", "off")
    assert json.loads(told["science"])["rule"] == "dqn"


def test_the_example_of_the_document_runs_a_dispatcher(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    path = find_checkpoint("pretrained/dispatch-hard")
    onnx_file.export(ExportRequest(checkpoint=path, output=Path("dispatch.onnx")))
    [code] = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "export.md").read_text(), re.DOTALL)
    exec(code, {})  # noqa: S102  (ours)
    assert capsys.readouterr().out.splitlines()[-1] in {
        f"['{name}', '{name}']" for name in ("MOVE_FORWARD", "STOP_MOVING")
    }


def test_a_model_that_differs_is_not_written(write_checkpoint, tmp_path, monkeypatch):
    def spoiled(layout, weights, metadata, about):
        return model_of(layout, {name: 1.01 * array for name, array in weights.items()}, metadata, about)

    monkeypatch.setattr(onnx_file, "model_of", spoiled)
    path = write_checkpoint(tmp_path / "weights.safetensors")
    with pytest.raises(onnx_file.DiffersError, match=r"net.onnx was not written: .* more than 1e-04: use another"):
        onnx_file.export(ExportRequest(checkpoint=path, output=tmp_path / "net.onnx"))
    assert not (tmp_path / "net.onnx").exists()
