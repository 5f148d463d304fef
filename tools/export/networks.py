"""The networks of `common.policy`, written as graphs of ONNX.

Every model takes `observation` [trains, F] and gives `q_values` [trains, 5], or `logits` [trains, 5], `probabilities`
[trains, 5] and `value` [trains]. A recurrent one takes `state` [trains, S] as well, zeros before a train's first
decision, and gives `next_state` [trains, S], which goes into the train's next decision.
"""

import math
from typing import NamedTuple

from onnx import ModelProto

from railctl.common.policy.exit_layers import NO_EXIT
from railctl.common.policy.flat import Arrays
from railctl.common.policy.packing import POLICIES, Layout
from railctl.common.rail.observations.traffic_shape import (
    EXITS_END,
    N_EXIT,
    N_EXITS,
    N_MEETING,
    N_OTHER,
    N_ROW,
    N_TRAIN,
)
from railctl.tools.export.graph import Graph

FAR_BELOW = -1e9  # a score whose weight is 0

Shapes = dict[str, list[int]]


class Ends(NamedTuple):
    """Inputs and outputs of a model, with their shapes without the batch."""

    inputs: Shapes
    outputs: Shapes


def ends_of(layout: Layout) -> Ends:
    """What the model of a network takes and gives."""
    inputs: Shapes = {"observation": [layout.n_features]}
    if layout.kind in POLICIES:
        return Ends(inputs, {"logits": [layout.n_actions], "probabilities": [layout.n_actions], "value": []})
    outputs: Shapes = {"q_values": [layout.n_actions]}
    if layout.kind != "recurrent":
        return Ends(inputs, outputs)
    state = [layout.n_state]
    return Ends(inputs | {"state": state}, outputs | {"next_state": state})


def model_of(layout: Layout, weights: Arrays, metadata: dict[str, str], about: str) -> ModelProto:
    """The model of a network with these parameters."""
    graph = Graph(weights)
    _WRITERS[layout.kind](graph, layout)
    return graph.model(*ends_of(layout), metadata, about)


def _plain(graph: Graph, _layout: Layout) -> None:
    graph.linear(graph.layers("observation", "hidden", "Relu"), "q", "q_values")


def _dueling(graph: Graph, _layout: Layout) -> None:
    _join_heads(graph, *[graph.layers("observation", "hidden", "Relu")] * 2)


def _dueling_apart(graph: Graph, _layout: Layout) -> None:
    parts = (graph.layers("observation", f"{part}_hidden", "Relu") for part in ("value", "advantage"))
    _join_heads(graph, *parts)


def _actor_critic(graph: Graph, _layout: Layout) -> None:
    logits = graph.linear(graph.layers("observation", "actor_hidden", "Tanh"), "actor", "logits")
    graph.op("Softmax", logits, axis=-1, name="probabilities")
    value = graph.linear(graph.layers("observation", "critic_hidden", "Tanh"), "critic")
    graph.op("Squeeze", value, graph.whole(-1), name="value")


def _recurrent(graph: Graph, layout: Layout) -> None:
    """One step of the LSTM, whose gates come in the order input, forget, cell, output."""
    width = layout.hidden[0]
    hidden, cell = graph.split("state", [width, width], axis=-1)
    sums = [_into_gates(graph, x, end) for x, end in (("observation", "ih_l0"), (hidden, "hh_l0"))]
    taken, kept, new, shown = graph.split(graph.op("Add", *sums), [width] * 4, axis=-1)
    fresh = graph.op("Mul", graph.op("Sigmoid", taken), graph.op("Tanh", new))
    cell = graph.op("Add", graph.op("Mul", graph.op("Sigmoid", kept), cell), fresh)
    hidden = graph.op("Mul", graph.op("Sigmoid", shown), graph.op("Tanh", cell))
    graph.op("Concat", hidden, cell, axis=-1, name="next_state")
    _join_heads(graph, *[graph.layers(hidden, "hidden", "Relu")] * 2)


def _exits(graph: Graph, layout: Layout) -> None:
    """As `common.policy.exits`: B trains, 3 exits, R others, h units of the encoders."""
    train, exits, others = _traffic(graph, layout.n_features)
    there = graph.op("Greater", _first(graph, exits), graph.number(0))  # [B, 3, 1]
    each = graph.op("Tile", graph.op("Unsqueeze", train, graph.whole(1)), graph.whole(1, N_EXITS, 1))
    code = graph.op("Tanh", graph.linear(graph.op("Concat", each, exits, axis=-1), "exit"))
    x = graph.op("Concat", code, _attended(graph, code, others, layout.hidden[0]), axis=-1)
    x = graph.layers(x, "shared", "Tanh")
    moves = graph.op("Where", there, graph.linear(x, "move"), graph.number(NO_EXIT))
    described = graph.op("Concat", *_pooled(graph, x, there), train, axis=-1)
    pooled = graph.op("Tanh", graph.linear(described, "pooled"))
    nothing, stop = graph.split(graph.linear(pooled, "stay"), [1, 1], axis=-1)
    ways = graph.op("Squeeze", moves, graph.whole(-1))
    logits = graph.op("Concat", nothing, ways, stop, axis=-1, name="logits")
    graph.op("Softmax", logits, axis=-1, name="probabilities")
    graph.op("Squeeze", graph.linear(pooled, "value"), graph.whole(-1), name="value")


_WRITERS = {
    "plain": _plain,
    "dueling": _dueling,
    "dueling-apart": _dueling_apart,
    "actor-critic": _actor_critic,
    "recurrent": _recurrent,
    "exits": _exits,
}


def _join_heads(graph: Graph, for_value: str, for_advantage: str) -> None:
    """`Q = V + A - mean(A)`."""
    advantage = graph.linear(for_advantage, "advantage")
    mean = graph.op("ReduceMean", advantage, graph.whole(-1), keepdims=1)
    sums = graph.op("Add", graph.linear(for_value, "value"), advantage)
    graph.op("Sub", sums, mean, name="q_values")


def _into_gates(graph: Graph, x: str, end: str) -> str:
    """A linear layer of the LSTM, whose parameters have names of their own."""
    weight = graph.constant(f"lstm.weight_{end}", graph.weights[f"lstm.weight_{end}"].T)
    bias = graph.constant(f"lstm.bias_{end}", graph.weights[f"lstm.bias_{end}"])
    return graph.op("Add", graph.op("MatMul", x, weight), bias)


def _traffic(graph: Graph, n_features: int) -> tuple[str, str, str]:
    """The parts of `observation`: train [B, 13], exits [B, 3, 16], others [B, 3, R, 25]."""
    rows = (n_features - EXITS_END) // N_ROW
    sizes = [N_TRAIN, N_EXITS * N_EXIT, rows * N_ROW]
    train, flat_exits, flat_rows = graph.split("observation", sizes, axis=-1)
    exits = graph.op("Reshape", flat_exits, graph.whole(-1, N_EXITS, N_EXIT))
    others = graph.op("Reshape", flat_rows, graph.whole(-1, rows, N_ROW))
    common, behind = graph.split(others, [N_OTHER, N_EXITS * N_MEETING], axis=-1)
    each = graph.op("Tile", graph.op("Unsqueeze", common, graph.whole(1)), graph.whole(1, N_EXITS, 1, 1))
    meetings = graph.op("Reshape", behind, graph.whole(-1, rows, N_EXITS, N_MEETING))
    return train, exits, graph.op("Concat", each, graph.op("Transpose", meetings, perm=[0, 2, 1, 3]), axis=-1)


def _attended(graph: Graph, code: str, others: str, units: int) -> str:
    """[B, 3, h]: what each exit takes along of the others; zeros if there are none."""
    rows = graph.op("Tanh", graph.linear(others, "row"))
    present = graph.op("Greater", _first(graph, others), graph.number(0))  # [B, 3, R, 1]
    query = graph.op("Unsqueeze", graph.linear(code, "query"), graph.whole(-1))
    scores = graph.op("Div", graph.op("MatMul", rows, query), graph.number(math.sqrt(units)))
    weights = graph.op("Softmax", graph.op("Where", present, scores, graph.number(FAR_BELOW)), axis=-2)
    kept = graph.op("Where", present, weights, graph.number(0))
    return graph.op("ReduceSum", graph.op("Mul", kept, rows), graph.whole(-2), keepdims=0)


def _pooled(graph: Graph, x: str, there: str) -> tuple[str, str]:
    """Mean and maximum [B, z] of what is said of the exits [B, 3, z] that are there; zeros if there is none."""
    nothing, one = graph.number(0), graph.number(1)
    axis = graph.whole(1)
    count = graph.op("ReduceSum", graph.op("Where", there, one, nothing), axis, keepdims=0)  # [B, 1]
    total = graph.op("ReduceSum", graph.op("Where", there, x, nothing), axis, keepdims=0)
    most = graph.op("ReduceMax", graph.op("Where", there, x, graph.number(-1)), axis, keepdims=0)
    some = graph.op("Min", count, one)
    return graph.op("Div", total, graph.op("Max", count, one)), graph.op("Mul", most, some)


def _first(graph: Graph, x: str) -> str:
    """The first number along the last axis, which stays."""
    return graph.op("Slice", x, graph.whole(0), graph.whole(1), graph.whole(-1))
