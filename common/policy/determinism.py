"""Torch set up so that equal inputs give equal bits, in every process on the same kind of processor."""

import os

import torch

MKL_MODE = "AUTO,STRICT"


class DeterminismError(RuntimeError):
    """This process cannot promise to repeat its arithmetic."""


def deterministic_torch() -> None:
    """One thread, deterministic kernels, and matrix products that ignore the alignment of their inputs.

    Call it before anything else is asked of torch; again does no harm.

    Raises:
        DeterminismError: the environment lacks `MKL_CBWR=AUTO,STRICT`. MKL reads it once and for all, so it
            must be there before torch is imported: whoever starts the process sets it.
    """
    mode = os.environ.get("MKL_CBWR")
    if mode != MKL_MODE:
        raise DeterminismError(
            f"MKL_CBWR is {mode or 'not set'}: start this process with MKL_CBWR={MKL_MODE} in its environment"
        )
    torch.set_num_threads(1)
    if torch.get_num_interop_threads() != 1:  # torch lets it be set only once
        torch.set_num_interop_threads(1)
    # As `use_deterministic_algorithms`, which also sets up torch's compiler, and takes 1.7 s for that.
    torch.set_deterministic_debug_mode("error")
