"""The layers of the network of exits, for torch, its compiled twin and its first weights alike; see `exits`."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from railctl.common.rail.observations.traffic_shape import N_EXIT, N_MEETING, N_OTHER, N_TRAIN

N_STAYS: Final = 2  # actions that are no exits: to do nothing, to stop
NO_EXIT: Final = -10.0  # the logit of an exit that is not there


class Layer(NamedTuple):
    """A linear layer: its name, inputs and outputs."""

    name: str
    n_in: int
    n_out: int


def exit_layers(hidden: Sequence[int]) -> list[Layer]:
    """All layers, in the order in which they are computed; the last two lie side by side."""
    first, rest = hidden[0], tuple(hidden[1:] or hidden)
    widths = (2 * first, *rest)
    shared = [Layer(f"shared.{number}", widths[number], width) for number, width in enumerate(rest)]
    return [
        Layer("exit", N_TRAIN + N_EXIT, first),
        Layer("row", N_OTHER + N_MEETING, first),
        Layer("query", first, first),
        *shared,
        Layer("move", rest[-1], 1),
        Layer("pooled", 2 * rest[-1] + N_TRAIN, rest[-1]),
        Layer("stay", rest[-1], N_STAYS),
        Layer("value", rest[-1], 1),
    ]
