"""python -m railctl.tools.render.task REQUEST: draws episodes; how it answers: see `common.task`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from railctl.common.bounded import MOST_DOCUMENT_BYTES, read_bounded
from railctl.common.playback import Playback
from railctl.common.requests import RenderRequest, asked
from railctl.common.strict import ConfigError
from railctl.common.task import Teller, carry_out, say
from railctl.tools.render.films import Film, FilmError, Gif, Mp4, timed
from railctl.tools.render.scene import Scene

FILM_PIXELS, STILL_PIXELS = 1500, 2600  # how wide maps may be altogether
MOST_PICTURES = 1500  # of a film
SAMPLES = 5  # pictures whose colours are those of a film


def render(request: RenderRequest) -> None:
    """Draw the episodes into one file."""
    episodes = [(title, read_playback(path)) for title, path in zip(request.titles, request.playbacks, strict=True)]
    first = episodes[0][1].level
    if any((other.level.grid, other.level.trains) != (first.grid, first.trains) for _, other in episodes):
        raise ConfigError("the policies did not play the same level: name it with --level and --number")
    still = request.file.suffix == ".png"
    scene = Scene(episodes, STILL_PIXELS if still else FILM_PIXELS)
    if request.step is not None and request.step > scene.ends:
        raise ConfigError(f"--step {request.step}: the episode ends at step {scene.ends}: use that or a lower one")
    part = request.file.with_name(f".{request.file.name}.part")
    try:
        pictures = _still(scene, request, part) if still else _film(scene, request, part)
        part.replace(request.file)
    finally:
        part.unlink(missing_ok=True)
    say({"picture": str(request.file), "bytes": request.file.stat().st_size, "pictures": pictures})


def read_playback(path: Path) -> Playback:
    """A playback document.

    Raises:
        ConfigError: it is none.
        OSError: it cannot be read.
    """
    try:
        return Playback.model_validate_json(read_bounded(path, MOST_DOCUMENT_BYTES))
    except ValidationError:
        raise ConfigError(f"{path}: no playback document of this version: have railctl write a new one") from None


def _still(scene: Scene, request: RenderRequest, part: Path) -> int:
    moment = scene.ends if request.step is None else request.step
    scene.picture(moment, with_paths=True).save(part, "PNG", optimize=True)
    return 1


def _film(scene: Scene, request: RenderRequest, part: Path) -> int:
    moments = scene.shown()
    if len(moments) > MOST_PICTURES:
        moments = [moments[at] for at in np.linspace(0, len(moments) - 1, MOST_PICTURES).astype(int).tolist()]
    film = _opened(scene, moments, request, part)
    teller = Teller("pictures")
    for done, (moment, seconds) in enumerate(timed(moments, request.fps)):
        film.add(scene.picture(moment), seconds)
        teller.tell(done + 1, len(moments))
    film.close()
    return len(moments)


def _opened(scene: Scene, moments: Sequence[int], request: RenderRequest, part: Path) -> Film:
    if request.file.suffix == ".mp4":
        return Mp4(part, scene.picture(0).size, request.fps)
    some = np.linspace(0, len(moments) - 1, min(SAMPLES, len(moments))).astype(int).tolist()
    return Gif(part, [scene.picture(moments[at]) for at in some])


def main() -> None:
    carry_out(lambda: render(asked(RenderRequest)), FilmError)


if __name__ == "__main__":
    main()
