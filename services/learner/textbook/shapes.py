"""Shapes of what losses and targets are given, checked at their top: broadcasting would hide a mistake."""

from torch import Tensor


def check_shapes(letters: str, *tensors: Tensor) -> None:
    """Compare shapes with their letters; equal letters are equal sizes.

    >>> import torch
    >>> check_shapes("B BA", torch.zeros(3), torch.zeros(3, 5))
    >>> check_shapes("B BA", torch.zeros(3, 1), torch.zeros(3, 5))
    Traceback (most recent call last):
    ...
    ValueError: shapes are [3, 1] [3, 5], not those of B BA

    Args:
        letters: a word a tensor, a letter a dimension.
        tensors: as many.

    Raises:
        ValueError: they do not fit.
    """
    sizes: dict[str, int] = {}
    for word, tensor in zip(letters.split(), tensors, strict=True):
        shape = tensor.shape
        if len(shape) != len(word) or any(sizes.setdefault(*pair) != pair[1] for pair in zip(word, shape, strict=True)):
            found = " ".join(str(list(other.shape)) for other in tensors)
            raise ValueError(f"shapes are {found}, not those of {letters}")
