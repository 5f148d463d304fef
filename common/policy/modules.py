"""Acting with any torch module: the plain path beside the compiled twins, one decision at a time.

Exact as these are on one kind of processor: a row alone in torch's own memory, one thread. Only who acts with a module
imports this.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from railctl.common.policy.compiled import Chooser
from railctl.common.policy.flat import Arrays
from railctl.common.policy.networks import import_parameters
from railctl.common.policy.packing import ACTOR_CRITIC, HEADER_WIDTHS, PLAIN


class ModuleChooser(Chooser):
    """A module that maps observations [R, F] to action values [R, A], or to logits [R, A] and values [R].

    It keeps nothing from one decision to the next.
    """

    n_state = 0

    def __init__(self, module: nn.Module, n_features: int, n_actions: int, *, is_policy: bool) -> None:
        self._module = module
        self._row = torch.zeros(1, n_features)
        self._row_array: NDArray[np.float32] = self._row[0].numpy()  # the same memory
        self.header = np.zeros(HEADER_WIDTHS, np.int64)
        self.header[:3] = ACTOR_CRITIC if is_policy else PLAIN, n_features, n_actions

    def load(self, tensors: Arrays) -> None:
        """Take over parameters, by their names in the module.

        Raises:
            ValueError: naming the parameter that does not fit.
        """
        import_parameters(self._module, tensors)

    def outputs(
        self, observations: NDArray[np.float32], state: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]:
        """The outputs [R, O] of observations [R, F]; `state` [R, 0] holds nothing."""
        if observations.ndim != 2 or observations.shape[1] != len(self._row_array):
            raise ValueError(f"observations have shape {observations.shape}, not [R, {len(self._row_array)}]")
        if state is not None and state.shape != (len(observations), 0):
            raise ValueError(f"state has shape {state.shape}, not {(len(observations), 0)}")
        return np.array([self._outputs_of(row) for row in observations], np.float32).reshape(len(observations), -1)

    def _outputs_of(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        self._row_array[:] = observation
        with torch.inference_mode():
            out = self._module(self._row)
            joined = torch.cat([part.reshape(-1) for part in out]) if isinstance(out, tuple) else out[0]
        numbers: NDArray[np.float32] = joined.numpy()
        return numbers
