"""Writing pictures one after the other, so that a film is never in memory: GIF by Pillow's encoder, MP4 by ffmpeg.

All pictures of a GIF share a palette: the colours that are most frequent in some of them. Only what changes from one
to the next is written.
"""

import subprocess
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import GifImagePlugin, Image

CLEAR = 255  # the colour of what stays as it is
LAST_S = 3.0  # how long the last picture stays
LEAST_MS = 20  # faster is not shown as it is written


class FilmError(RuntimeError):
    """A film could not be written: one line."""


class Film(Protocol):
    """Takes pictures of the same size."""

    def add(self, image: Any, seconds: float) -> None:
        """Show a picture for so long."""

    def close(self) -> None:
        """No more will come."""


class Gif:
    """An animated GIF, which begins again at its end."""

    def __init__(self, path: Path, some: Sequence[Any]) -> None:
        """`some` are pictures whose colours are those of all."""
        self._palette = Palette(some)
        self._before: NDArray[np.uint8] | None = None
        self._file: IO[bytes] = path.open("wb")
        width, height = some[0].size
        colours = self._palette.colours.astype(np.uint8).tobytes()
        self._file.write(b"GIF89a" + width.to_bytes(2, "little") + height.to_bytes(2, "little") + b"\xf7\0\0")
        self._file.write(colours.ljust(768, b"\0"))
        self._file.write(b"!\xff\x0bNETSCAPE2.0\x03\x01\0\0\0")  # for ever

    def add(self, image: Any, seconds: float) -> None:
        numbers = self._palette.numbers(image)
        for part in self._changes(numbers, max(LEAST_MS, round(1000 * seconds))):
            self._file.write(part)
        self._before = numbers

    def close(self) -> None:
        self._file.write(b";")
        self._file.close()

    def _changes(self, numbers: NDArray[np.uint8], milliseconds: int) -> Iterable[bytes]:
        top, bottom, left, right = 0, numbers.shape[0], 0, numbers.shape[1]
        if self._before is not None:
            differs = numbers != self._before
            rows, columns = np.flatnonzero(differs.any(axis=1)), np.flatnonzero(differs.any(axis=0))
            top, bottom = (int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 1)
            left, right = (int(columns[0]), int(columns[-1]) + 1) if len(columns) else (0, 1)
            numbers = np.where(differs, numbers, CLEAR).astype(np.uint8)
        part = Image.fromarray(np.ascontiguousarray(numbers[top:bottom, left:right]), "P")
        return GifImagePlugin.getdata(part, (left, top), duration=milliseconds, transparency=CLEAR, disposal=1)


class Palette:
    """The 255 most frequent colours of some pictures; others become the nearest of them."""

    def __init__(self, some: Sequence[Any]) -> None:
        colours, counts = np.unique(np.concatenate([_packed(each).reshape(-1) for each in some]), return_counts=True)
        most = colours[np.argsort(-counts, kind="stable")[:CLEAR]]
        self.colours = _unpacked(most)  # [K, 3]
        self._numbers = np.full(1 << 24, CLEAR, np.uint8)  # by packed colour; CLEAR where it is not known yet
        self._numbers[most] = np.arange(len(most))

    def numbers(self, image: Any) -> NDArray[np.uint8]:
        """[H, W]: the number of each pixel's colour."""
        packed = _packed(image)
        found: NDArray[np.uint8] = self._numbers[packed]
        new = np.unique(packed[found == CLEAR])
        if len(new):
            apart = ((_unpacked(new)[:, None] - self.colours[None]) ** 2).sum(axis=2)
            self._numbers[new] = apart.argmin(axis=1)
            found = self._numbers[packed]
        return found


def _packed(image: Any) -> NDArray[np.int32]:
    """[H, W]: a number for each colour."""
    pixels = np.asarray(image.convert("RGB"), np.int32)
    packed: NDArray[np.int32] = pixels[..., 0] << 16 | pixels[..., 1] << 8 | pixels[..., 2]
    return packed


def _unpacked(packed: NDArray[np.int32]) -> NDArray[np.int32]:
    """[K, 3]: red, green, blue."""
    colours: NDArray[np.int32] = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1)
    return colours


class Mp4:
    """A film in H.264, which every browser and slide show plays."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        """`size` of the pictures, width and height."""
        self._fps = fps
        told = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-r", f"{fps:g}", "-i", "-"]
        even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white"]  # which H.264 asks for
        code = ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20", "-movflags", "+faststart", "-f", "mp4"]
        self._process = subprocess.Popen(  # wherever PATH has it
            ["ffmpeg", "-y", "-loglevel", "error", *told, *even, *code, str(path.absolute())],  # noqa: S607
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )

    def add(self, image: Any, seconds: float) -> None:
        assert self._process.stdin is not None  # noqa: S101  (a pipe was asked for)
        content = image.convert("RGB").tobytes()
        try:
            for _ in range(max(1, round(seconds * self._fps))):
                self._process.stdin.write(content)
        except BrokenPipeError:
            self.close()

    def close(self) -> None:
        """Raises FilmError if ffmpeg complains."""
        _, complaints = self._process.communicate()
        if self._process.returncode:
            said = (complaints.decode(errors="replace").strip().splitlines() or ["no word"])[-1]
            raise FilmError(f"ffmpeg failed: {said}: write a .gif instead, or install an ffmpeg with H.264")


def timed(moments: Sequence[int], fps: float) -> Iterator[tuple[int, float]]:
    """Each moment, and for how many seconds it is shown."""
    for moment in moments[:-1]:
        yield moment, 1 / fps
    yield moments[-1], max(LAST_S, 1 / fps)
