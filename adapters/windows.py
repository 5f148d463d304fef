"""A window that shows pictures, one after the other."""

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.backends.registry import BackendFilter, backend_registry
from numpy.typing import NDArray

PAPER = frozenset(backend_registry.list_builtin(BackendFilter.NON_INTERACTIVE))  # type: ignore[no-untyped-call]


class NoDisplayError(RuntimeError):
    """There is no display, or nothing that opens windows on it."""


class Window:
    """A window of matplotlib's; the first picture opens it."""

    def __init__(self, title: str, frames_a_second: float) -> None:
        """Prepare a window.

        Raises:
            NoDisplayError: there can be none.
        """
        try:
            backend = plt.get_backend()  # Agg where matplotlib finds no display
            plt.switch_backend(backend)
            shows = backend.lower() not in PAPER
        except ImportError:  # as matplotlib says it where a display is missing
            shows = False
        if not shows:
            raise NoDisplayError(
                "render_mode human: there is no display, or no toolkit to open a window on it: use rgb_array"
            )
        self._title, self._pause_s = title, 1 / frames_a_second
        self._image: Any = None

    def show(self, picture: NDArray[np.uint8]) -> None:
        """Show a picture for as long as a frame takes."""
        if self._image is None or self._image.get_array().shape != picture.shape:
            self.close()
            figure = plt.figure(self._title, figsize=(picture.shape[1] / 100, picture.shape[0] / 100))
            axes = figure.add_axes((0, 0, 1, 1))
            axes.set_axis_off()
            self._image = axes.imshow(picture)
        self._image.set_data(picture)
        plt.pause(self._pause_s)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._image is not None:
            plt.close(self._image.figure)
            self._image = None
