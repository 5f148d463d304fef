"""A graph of ONNX, put together operation by operation: names in, names out.

Plain operators of opset 18, which every runtime of the last years knows. The first axis of all that is not a weight is
the batch: trains, any number of them.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from onnx import ModelProto, NodeProto, TensorProto, ValueInfoProto, checker, helper, numpy_helper

from railctl.common.policy.flat import Arrays

OPSET, IR_VERSION = 18, 9  # of 2022: nothing newer is needed
BATCH = "trains"


class Graph:
    """A graph that grows."""

    def __init__(self, weights: Arrays) -> None:
        """An empty graph that knows the parameters of a network by name."""
        self.weights = weights
        self._nodes: list[NodeProto] = []
        self._constants: dict[str, NDArray[Any]] = {}

    def op(self, kind: str, *inputs: str, name: str | None = None, **attributes: Any) -> str:
        """What an operator gives of inputs; its output gets the name, if there is one."""
        output = name or f"{kind.lower()}_{len(self._nodes)}"
        self._nodes.append(helper.make_node(kind, inputs, [output], name=f"make_{output}", **attributes))
        return output

    def split(self, x: str, sizes: list[int], axis: int) -> list[str]:
        """The parts of `x` along an axis."""
        outputs = [f"part_{len(self._nodes)}_{number}" for number in range(len(sizes))]
        node = helper.make_node("Split", [x, self.whole(*sizes)], outputs, axis=axis)
        self._nodes.append(node)
        return outputs

    def constant(self, name: str, array: NDArray[Any]) -> str:
        """An array that is part of the model."""
        self._constants[name] = np.ascontiguousarray(array)
        return name

    def whole(self, *numbers: int) -> str:
        """Whole numbers [n], as operators take shapes and axes."""
        return self.constant(f"whole_{'_'.join(map(str, numbers))}", np.array(numbers, np.int64))

    def number(self, value: float) -> str:
        """A number that is broadcast."""
        return self.constant(f"number_{value:g}", np.array(value, np.float32))

    def linear(self, x: str, layer: str, name: str | None = None) -> str:
        """A linear layer along the last axis; `layer` names its parameters as the modules of torch do."""
        weight = self.constant(f"{layer}.weight", self.weights[f"{layer}.weight"].T)
        bias = self.constant(f"{layer}.bias", self.weights[f"{layer}.bias"])
        return self.op("Add", self.op("MatMul", x, weight), bias, name=name)

    def layers(self, x: str, stack: str, activation: str) -> str:
        """All layers `stack`.0, `stack`.1, ..., each with an activation behind it."""
        for number in range(sum(name.startswith(f"{stack}.") for name in self.weights) // 2):
            x = self.op(activation, self.linear(x, f"{stack}.{number}"))
        return x

    def model(
        self, inputs: dict[str, list[int]], outputs: dict[str, list[int]], metadata: dict[str, str], about: str
    ) -> ModelProto:
        """The whole model, checked.

        Args:
            inputs: names and shapes without the batch.
            outputs: likewise.
            metadata: strings by name that travel with the model.
            about: what it is, for people.
        """
        values = [numpy_helper.from_array(array, name) for name, array in self._constants.items()]
        graph = helper.make_graph(self._nodes, "railctl", _infos(inputs), _infos(outputs), values, doc_string=about)
        opsets = [helper.make_opsetid("", OPSET)]
        model = helper.make_model(graph, producer_name="railctl", opset_imports=opsets, ir_version=IR_VERSION)
        helper.set_model_props(model, metadata)
        checker.check_model(model, full_check=True)
        return model


def _infos(shapes: dict[str, list[int]]) -> list[ValueInfoProto]:
    return [helper.make_tensor_value_info(name, TensorProto.FLOAT, [BATCH, *shape]) for name, shape in shapes.items()]
