"""Having episodes played and drawn: a process plays each, another draws them (`tools.render.task`)."""

import os
import re
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from railctl.common.requests import DRAWING, LevelChoice, PlaybackRequest, RenderRequest
from railctl.common.strict import ConfigError
from railctl.deploy.commands.references import REFERENCES
from railctl.deploy.output import check_replaceable, check_unused, counted
from railctl.deploy.playback import play_back, playback_request
from railctl.deploy.runs import Failed
from railctl.deploy.task import run_task

DRAWER = "railctl.tools.render.task"
FORMATS = (".gif", ".mp4", ".png")
SIGNS = re.compile(r"[^A-Za-z0-9._-]+")  # that a file's name does not need


@dataclass(frozen=True)
class Rendering:
    """What is played, and how.

    Attributes:
        choice: of levels.
        number: of the level.
        sample: how checkpoints act; None: as their runs score them.
        draws: seed of what is drawn; None: the default.
    """

    choice: LevelChoice
    number: int
    sample: bool | None
    draws: int | None

    def draw(self, names: Sequence[str], output: Path | None, step: int | None, fps: float) -> dict[str, Any]:
        """Play the level with each policy, and draw all beside each other; what is said of it.

        Raises:
            ConfigError, Failed: as `deploy.playback`; or the drawing process complains.
        """
        with tempfile.TemporaryDirectory(prefix="railctl-") as folder:
            requests = [self._request(name, names, Path(folder) / f"{at}.json") for at, name in enumerate(names)]
            episodes: list[dict[str, Any]] = []
            for name, request in zip(names, requests, strict=True):
                asked = request if not episodes else _on_the_same(request, episodes[0]["level"])
                episodes.append({"name": name} | play_back(asked))
            drawing = RenderRequest(
                playbacks=tuple(request.file for request in requests),
                titles=tuple(map(title, episodes)),
                step=step,
                fps=fps,
                file=output or default_name(names, episodes[0]["level"]),
            )
            drawn = run_task(DRAWER, drawing.model_dump_json())
        for episode in episodes:
            del episode["file"]
        return drawn | {"episodes": episodes}

    def _request(self, name: str, names: Sequence[str], file: Path) -> PlaybackRequest:
        """Options that are of use to another policy are no mistake."""
        sample, draws = self.sample, self.draws
        if name in REFERENCES and len(names) > 1:
            sample = None if set(names) - set(REFERENCES) else sample
            draws = draws if name in DRAWING else None
        return playback_request(name, self.choice, self.number, file, sample=sample, draws=draws, observations=False)


def _on_the_same(request: PlaybackRequest, level: Mapping[str, Any]) -> PlaybackRequest:
    """The level by its name, as the default may be another one."""
    return request.model_copy(update={"levels": request.levels.model_copy(update={"names": (level["name"],)})})


def check_output(output: Path | None, step: int | None, fps: float | None) -> None:
    """Raise ConfigError or Failed if this cannot be written, before anything is played."""
    suffix = FORMATS[0] if output is None else output.suffix
    if suffix not in FORMATS:
        raise ConfigError(f"--output {output}: use a name that ends with {', '.join(FORMATS)}")
    if step is not None and suffix != ".png":
        raise ConfigError(f"--step {step}: a film shows all steps: add --output NAME.png, or leave it out")
    if suffix == ".png":
        check_unused({"--fps": fps}, "a picture shows one moment: leave it out")
    if suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ConfigError(f"--output {output}: there is no ffmpeg to write it with: install ffmpeg, or write a .gif")
    if output is not None:
        check_replaceable(output, f"--output {output}")
    folder = Path.cwd() if output is None else output.absolute().parent
    if not os.access(folder, os.W_OK):
        raise Failed(f"{folder}: nothing can be written there: give --output in another folder")


def default_name(names: Sequence[str], level: Mapping[str, Any]) -> Path:
    """A film in the working directory.

    >>> default_name(["pretrained/dispatch-hard", "planner"], {"name": "hard", "number": 7}).name
    'dispatch-hard-against-planner-hard-7.gif'
    >>> default_name(["runs/some/checkpoints/00000300.safetensors"], {"name": "easy", "number": 0}).name
    'some-00000300-easy-0.gif'
    """
    who = "-against-".join(map(_short, names))
    return Path(f"{SIGNS.sub('-', who)}-{SIGNS.sub('-', level['name'])}-{level['number']}.gif")


def _short(name: str) -> str:
    path = Path(name)
    if path.suffix != ".safetensors":
        return path.name
    return f"{path.parent.parent.name}-{path.stem}" if path.parent.name == "checkpoints" else path.stem


def title(episode: Mapping[str, Any]) -> str:
    """Who plays, above its map.

    >>> title({"name": "planner", "policy": "planner, the best of 50 orders"})
    'planner, the best of 50 orders'
    >>> title({"name": "some", "policy": "sil after 7 episodes, greedy"})
    'some: sil after 7 episodes, greedy'
    """
    return episode["policy"] if episode["name"] in REFERENCES else f"{episode['name']}: {episode['policy']}"


def told(episode: Mapping[str, Any]) -> str:
    """What became of an episode, in a line."""
    level, result = episode["level"], episode["result"]
    return (
        f"{title(episode)}, on {level['name']} {level['number']}: {result['arrived']} of "
        f"{counted(result['trains'], 'train')} arrived, {counted(result['steps'], 'step')}, "
        f"return {result['return']:.3f}"
    )
