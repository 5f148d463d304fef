"""Tensors by name as views of one flat array, in an order that can be told: so weights travel without being rearranged.

A learner lays them down once in the order of the network's compiled twin (`packing`); from there to the twin's own
parameters they are moved as one piece.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[np.float32]]

NUMBER_BYTES = 4


class Place(NamedTuple):
    """Where in a flat array a tensor lies, as `numpy.ndarray` takes it: from which byte on, and how far apart."""

    shape: tuple[int, ...]
    begin: int
    strides: tuple[int, ...]  # bytes between neighbours along each axis

    @classmethod
    def counted(cls, shape: tuple[int, ...], begin: int, strides: tuple[int, ...]) -> "Place":
        """One that is told in numbers, not bytes."""
        return cls(shape, NUMBER_BYTES * begin, tuple(NUMBER_BYTES * stride for stride in strides))


@dataclass(frozen=True)
class Order:
    """Where tensors lie in an array of `size` numbers, an even number; what is between them is zero."""

    size: int
    places: dict[str, Place]

    @classmethod
    def of_shapes(cls, shapes: Mapping[str, tuple[int, ...]]) -> "Order":
        """One tensor after the other, matrices column by column as twins have them."""
        places, end = {}, 0
        for name, shape in shapes.items():
            strides = tuple(math.prod(shape[:axis]) for axis in range(len(shape)))
            places[name] = Place.counted(shape, end, strides)
            end += math.prod(shape)
        return cls(even(end), places)

    @classmethod
    def of(cls, tensors: Arrays) -> "Order":
        """The order that these have, or that of their shapes."""
        if isinstance(tensors, Flat):
            return tensors.order
        return cls.of_shapes({name: array.shape for name, array in tensors.items()})

    def views(self, flat: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """The tensors in an array of this order, of float32 or other numbers of four bytes.

        Raises:
            ValueError, TypeError: they are no part of the array.
        """
        dtype = flat.dtype
        return {
            name: np.ndarray(shape, dtype, flat, begin, strides)
            for name, (shape, begin, strides) in self.places.items()
        }

    def pack(self, tensors: Arrays) -> NDArray[np.float32]:
        """An array of this order: that of the tensors if they have one, else a copy of them.

        Raises:
            KeyError: a tensor is missing.
            ValueError: one has another shape.
        """
        if isinstance(tensors, Flat) and tensors.order == self:
            return tensors.flat
        flat = np.zeros(self.size, np.float32)
        for name, view in self.views(flat).items():
            array = tensors[name]
            if array.shape != view.shape:
                raise ValueError(f"tensor {name} has shape {array.shape}, not {view.shape}")
            view[...] = array
        return flat


class Flat(Mapping[str, NDArray[np.float32]]):
    """Tensors by name that are views of one array; they are made when somebody asks for one.

    Attributes:
        order: theirs.
        flat: the array.
    """

    def __init__(self, order: Order, flat: NDArray[np.float32]) -> None:
        self.order, self.flat = order, flat

    @cached_property
    def _views(self) -> dict[str, NDArray[np.float32]]:
        return self.order.views(self.flat)

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        return self._views[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.order.places)

    def __len__(self) -> int:
        return len(self.order.places)


def even(size: int) -> int:
    """The least even number that is not below: numbers of four bytes are summed in words of eight."""
    return size + size % 2
