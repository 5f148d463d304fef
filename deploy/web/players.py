"""Who may play a level on the page, and which: checkpoints of the run, those that ship, and reference policies."""

from pathlib import Path
from typing import Any

from railctl.common.folder import RunFolder
from railctl.common.levels.bank import bank_root
from railctl.common.levels.distributions import LevelFiles
from railctl.common.requests import LevelChoice, PlaybackRequest, ReferenceRequest
from railctl.common.strict import ConfigError, nearest
from railctl.deploy.commands.references import REFERENCES
from railctl.deploy.playback import playback_request
from railctl.deploy.runs import pretrained, runs_root

CHECKPOINT = "checkpoint:"
LONGEST = 12  # digits of a number of episodes


def players_of(folder: RunFolder) -> dict[str, Any]:
    """What there is to choose from; reference policies know no levels of files."""
    levels = folder.config().world.levels
    return {
        "levels": [
            {
                "name": name,
                "count": spec.evaluation_levels,
                "references": not isinstance(spec, LevelFiles),
            }
            for name, spec in levels.items()
        ],
        "pretrained": pretrained(),
        "references": list(REFERENCES),
    }


def page_request(folder: RunFolder, player: str, level: str, number: int, file: Path) -> PlaybackRequest:
    """A player plays evaluation level `number` of a level of a run.

    Args:
        folder: of the run.
        player: `checkpoint:600`, `pretrained/NAME`, or the name of a reference policy.
        level: of the run.
        number: from 0.
        file: that is to be written.

    Raises:
        ConfigError: there is no such player, level or number.
        Failed: the run has no checkpoint.
    """
    levels = _choice(folder, level)
    count = folder.config().world.levels[level].evaluation_levels
    if not 0 <= number < count:
        raise ConfigError(f"number {number}: {level} has evaluation levels 0 to {count - 1}")
    return playback_request(_policy(folder, player), levels, number, file)


def reference_request(folder: RunFolder, policy: str, level: str) -> ReferenceRequest:
    """A reference policy plays the evaluation levels on which a run is evaluated; raises as `page_request`."""
    if policy not in REFERENCES:
        raise ConfigError(f"policy {policy}{nearest(policy, list(REFERENCES))}")
    choice = _choice(folder, level).model_copy(update={"episodes": folder.config().evaluation.levels})
    return ReferenceRequest.model_validate({"policy": policy, "levels": choice})


def _choice(folder: RunFolder, level: str) -> LevelChoice:
    known = folder.config().world.levels
    if level not in known:
        raise ConfigError(f"level {level}{nearest(level, list(known))}")
    own = {} if isinstance(known[level], LevelFiles) else {level: known[level]}
    return LevelChoice(names=(level,), own=own, base=folder.path.resolve(), bank=bank_root(runs_root()).resolve())


def _policy(folder: RunFolder, player: str) -> str:
    """A player by a name that `railctl evaluate` takes; raises ConfigError."""
    if player.startswith(CHECKPOINT):
        number = player.removeprefix(CHECKPOINT)
        is_number = number.isdecimal() and len(number) <= LONGEST
        path = folder.checkpoints / f"{int(number):08}.safetensors" if is_number else None
        if path is None or not path.is_file():
            raise ConfigError(f"player {player}: the run has no such checkpoint")
        return str(path.resolve())
    if player in (*pretrained(), *REFERENCES):
        return player
    raise ConfigError(f"player {player}: use checkpoint:EPISODES, {', '.join([*pretrained(), *REFERENCES])}")
