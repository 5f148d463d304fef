"""The configuration of a run: frozen models, checked before any process starts.

A run's learning curve is a function of `RunConfig` without `cluster` and `engine`, which say only how the work is
carried out; with `lag: free` it depends on who was how fast as well. Every part of the system receives its own section,
never the tree. In files all keys stand side by side: those of the run, of its `WorldSpec`, and of its rule's settings.
"""

from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    Field,
    SerializeAsAny,
    ValidationError,
    field_validator,
    model_validator,
)

from railctl.common.bounded import parse_json
from railctl.common.levels.distributions import ANY, LevelName
from railctl.common.rules import rules, settings_of
from railctl.common.rules.settings import Mode, RuleSettings
from railctl.common.strict import ConfigError, Positive, Share, Strict, brief, describe, nearest, section_of, shortened
from railctl.common.tls import host_and_port
from railctl.common.world import WorldSpec, chosen_levels

MAX_ACTORS = 256  # of one level
MAX_LAG = 1024
MOST_CHECKPOINTS = 90_000  # of a run; the learner lists all it has, and `railctl checkpoint` may add some
MAX_STALENESS = 32  # of new runs with `lag: free`
PARTS = ("world", "learning")  # whose keys stand beside the others in files
PATHS = {"start_from": "checkpoint", "demonstrations": "file"}  # sections of files that have a digest beside it
Plain = dict[str, Any]


def checked_lag(value: Any) -> Any:
    """A lag as it was given; raises ValueError for what is none."""
    if value == "free" or (isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MAX_LAG):
        return value
    raise ValueError(f"{shortened(value)} is no lag: give a whole number from 0 to {MAX_LAG}, or free")


Lag = Annotated[int | Literal["free"], BeforeValidator(checked_lag)]


class EvaluationConfig(Strict):
    """How often a checkpoint is written, and on how many fixed levels it is scored."""

    mode: Mode = "greedy"  # the best action, or for policies one as probable as the network says
    every_episodes: int = Field(default=100, ge=1)
    levels: int = Field(default=50, ge=1, le=1000)


class ClusterConfig(Strict):
    """How the work is carried out; nothing here changes a learning curve."""

    # By the levels that they serve, or `any`; if none are wanted, the learner acts itself:
    actors: dict[LevelName, Annotated[int, Field(ge=0, le=MAX_ACTORS)]]
    cores: int = Field(default=2, ge=1)
    snapshot_every_episodes: int = Field(default=50, ge=1)
    hang_timeout_s: float = Field(default=60.0, ge=5, allow_inf_nan=False)  # silent for longer: killed, started anew
    max_restarts: int = Field(default=5, ge=0)  # of one process within `restart_window_s`
    restart_window_s: Positive = 120.0
    listen: str | None = None  # for other machines, an address of TLS
    keys: str | None = None  # the folder of the certificates by which they know each other

    @field_validator("listen")
    @classmethod
    def _is_of_tls(cls, listen: str | None) -> str | None:
        if listen is not None:
            host_and_port(listen)
        return listen

    @model_validator(mode="after")
    def _listens_with_keys(self) -> Self:
        if self.listen is not None and self.keys is None:
            raise ValueError(f"listen {self.listen} needs keys: add --keys DIR, as railctl keys create made it")
        if self.listen is None and self.keys is not None:
            raise ValueError(f"keys {brief(self.keys)} need an address: add --listen tls/0.0.0.0:7447")
        return self

    @model_validator(mode="before")
    @classmethod
    def _without_port(cls, data: Any) -> Any:
        """Runs of earlier versions name the loopback port of their router: 0, any."""
        if isinstance(data, dict) and data.get("port") == 0:
            return {key: value for key, value in data.items() if key != "port"}
        return data


class RunConfig(Strict):
    """Everything that a run is."""

    algorithm: str
    rule: str  # the update rule: a file of `common.rules`, and of the learner's algorithms
    mix: dict[LevelName, Share]
    episodes: int = Field(ge=1, le=10_000_000)
    seed: int = Field(default=1, ge=0, lt=2**31)
    lag: Lag = 0  # episodes that run ahead of training, with the weights that this names; free: with the newest
    max_staleness: int | None = Field(default=None, ge=1, le=MAX_LAG)  # of `free`: so many run ahead at most
    engine: Literal["compiled", "flatland"] = "compiled"  # both give the same curve
    world: WorldSpec
    learning: SerializeAsAny[RuleSettings]
    evaluation: EvaluationConfig = EvaluationConfig()
    cluster: ClusterConfig

    @model_validator(mode="after")
    def _mix_is_whole(self) -> Self:
        for name in self.mix:
            if name not in self.world.levels:
                raise ValueError(f"mix: there are no levels {name}{nearest(name, list(self.world.levels))}")
        if not self.mix or abs(sum(self.mix.values()) - 1) > 1e-9:
            raise ValueError(f"the shares of mix add up to {sum(self.mix.values()):g}: make it 1")
        return self

    @model_validator(mode="after")
    def _every_level_has_actors(self) -> Self:
        actors = {name: count for name, count in self.cluster.actors.items() if count > 0}
        if actors and ANY not in actors:
            for level in self.mix:
                if level not in actors:
                    raise ValueError(f"no actors for level {level}: add --actors {level}=1")
        for name in actors or self.cluster.actors:
            if name != ANY and name not in self.mix:
                known = ", ".join(self.mix)
                raise ValueError(f"actors for level {name}, which this run does not have: it has {known}")
        return self

    @model_validator(mode="after")
    def _evaluation_fits(self) -> Self:
        if self.evaluation.mode == "sample" and not self.learning.has_probabilities:
            raise ValueError("evaluation.mode sample: action values give no probabilities to sample, make it greedy")
        for name, levels in self.world.levels.items():
            if self.evaluation.levels > levels.evaluation_levels:
                raise ValueError(
                    f"evaluation.levels {self.evaluation.levels}: {name} keeps only "
                    f"{levels.evaluation_levels} from training, use no more"
                )
        return self

    @model_validator(mode="after")
    def _checkpoints_can_be_listed(self) -> Self:
        every = self.evaluation.every_episodes
        if (written := -(-self.episodes // every)) > MOST_CHECKPOINTS:
            raise ValueError(
                f"evaluation.every_episodes {every}: {self.episodes} episodes would have {written} checkpoints, and a "
                f"run has {MOST_CHECKPOINTS} at most, make it {-(-self.episodes // MOST_CHECKPOINTS)}"
            )
        return self

    @model_validator(mode="after")
    def _exits_are_seen(self) -> Self:
        seen = self.world.observation.kind
        if self.learning.network.kind == "exits" and seen != "traffic":
            raise ValueError(f"network.kind exits: it has no use for a {seen} observation, make it traffic")
        return self

    @model_validator(mode="after")
    def _nothing_is_forbidden_on_a_following_step(self) -> Self:
        if self.learning.learns_from_following and self.world.interlocking != "off":
            raise ValueError(
                f"interlocking {self.world.interlocking}: dqn.transitions step cannot say what it allows a train that "
                "does not decide, make it off, or dqn.transitions span"
            )
        return self

    @model_validator(mode="after")
    def _fragments_are_serial(self) -> Self:
        if self.lag and self.learning.steps_a_fragment is not None:
            raise ValueError(f"lag {self.lag} needs whole episodes: add --set fragment_steps=null")
        return self

    @model_validator(mode="after")
    def _only_free_is_bounded(self) -> Self:
        if self.is_free and self.max_staleness is None:
            raise ValueError(f"lag free needs a bound: add --set max_staleness={MAX_STALENESS}")
        if self.max_staleness is not None and not self.is_free:
            raise ValueError(f"max_staleness {self.max_staleness}: lag {self.lag} has no use for it, leave it out")
        return self

    @model_validator(mode="after")
    def _free_can_be_corrected(self) -> Self:
        if self.is_free and self.learning.standardises_returns:
            raise ValueError(
                "lag free: it corrects by values what older weights did, and those of ppo.returns standardised are on "
                "another scale than rewards, make it scaled"
            )
        return self

    @property
    def is_free(self) -> bool:
        """Whether episodes act with the newest weights, so that the curve depends on who was how fast."""
        return self.lag == "free"

    @property
    def most_ahead(self) -> int:
        """How many episodes more than one may be under way."""
        return self.lag if isinstance(self.lag, int) else self.max_staleness or 0

    def plain(self) -> Plain:
        """As plain data, all keys side by side, as files have it; `parse_config` undoes it."""
        parts = self.model_dump(mode="json")
        apart = (*PARTS, "evaluation", "cluster", *([] if self.is_free else ["max_staleness"]))
        return {
            **{key: value for key, value in parts.items() if key not in apart},
            **parts["world"],
            **parts["learning"],
            **{key: parts[key] for key in ("evaluation", "cluster")},
        }

    @property
    def science(self) -> Plain:
        """What determines the learning curve, as plain data: everything but how it is computed, and where files lie."""
        kept = {key: value for key, value in self.plain().items() if key not in ("cluster", "engine")}
        for key, path in PATHS.items():
            if kept.get(key):
                kept[key] = {name: value for name, value in kept[key].items() if name != path}
        return kept


def parse_config(data: Mapping[str, Any]) -> RunConfig:
    """Check plain data against `RunConfig`; levels that are not given are those that ship.

    Raises:
        ConfigError: one line that names the first wrong field, its value and the remedy.
    """
    data = upgraded(data)
    for key in data:
        if not isinstance(key, str):
            raise ConfigError(f"{brief(str(key))}: keys should be strings, not {shortened(key)}")
    if "rule" not in data:
        raise ConfigError("rule is missing: give it a value")
    if (mix := data.get("mix")) is None:
        raise ConfigError("mix is missing: give it a value")
    if not isinstance(mix, dict):
        raise ConfigError(f"mix: input should be a valid dictionary, not {shortened(mix)}")
    if "levels" not in data:
        data["levels"] = chosen_levels(mix, {})
    homes = homes_of(data, data["rule"])
    settings = settings_of(data["rule"])
    parts = {
        home: {key: value for key, value in data.items() if homes[key] is home}
        for home in (WorldSpec, settings, RunConfig)
    }
    world, learning = _checked(WorldSpec, parts[WorldSpec]), _checked(settings, parts[settings])
    config: RunConfig = _checked(RunConfig, parts[RunConfig] | {"world": world, "learning": learning})
    return config


def config_of_science(science: str) -> RunConfig:
    """The configuration of a run from its science, as checkpoints and snapshots carry it in JSON, those of old too.

    Raises:
        ValueError: this is no JSON object.
        ConfigError: it is not what this version knows.
    """
    data = parse_json(science)
    if not isinstance(data, dict):
        raise ValueError("no object")  # noqa: TRY004  (of JSON)
    return parse_config(data | {"cluster": {"actors": {ANY: 1}}})


def homes_of(keys: Iterable[str], rule: str) -> dict[str, type[BaseModel]]:
    """The models that the keys of a run file belong to.

    Raises:
        ConfigError: nobody knows one of them, or there is no such rule.
    """
    homes = {}
    for key in keys:
        if (home := home_of(key, rule)) is None:
            raise ConfigError(_unknown(key, rule))
        homes[key] = home
    return homes


def home_of(key: str, rule: str) -> type[BaseModel] | None:
    """The model that a key of a run file belongs to; None if nobody knows it.

    Raises:
        ConfigError: there is no such rule.
    """
    if key in RunConfig.model_fields and key not in PARTS:
        return RunConfig
    return next((model for model in (WorldSpec, settings_of(rule)) if key in model.model_fields), None)


def upgraded(data: Mapping[str, Any]) -> Plain:
    """A configuration as this version writes it, from one that was resolved before levels had names of their own.

    Those had a key for every section of every rule, null where a rule had no use for it.
    """
    if "levels" in data or not data.keys() >= {"rule", *_ONCE}:
        return dict(data)
    model = settings_of(data["rule"])
    return {
        key: _known_part(model, key, value)
        for key, value in data.items()
        if key not in _ONCE or key in model.model_fields
    }


_ONCE = frozenset({"network", "dqn", "ppo", "sil", "replay", "exploration", "fragment_steps"})


def _known_part(model: type[BaseModel], key: str, value: Any) -> Any:
    """A section without the keys that it no longer has."""
    if key not in _ONCE or not isinstance(value, dict):
        return value
    section = section_of(model.model_fields[key].annotation, value.get("kind"))
    return value if section is None else {name: value[name] for name in value if name in section.model_fields}


def _checked(model: type[Any], data: Mapping[str, Any]) -> Any:
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise ConfigError(describe(error, model)) from None


def _unknown(key: str, rule: str) -> str:
    if any(key in settings_of(other).model_fields for other in rules()):
        return f"{brief(key)}: rule {rule} has no use for it, leave it out"
    known = {name for model in (RunConfig, WorldSpec, settings_of(rule)) for name in model.model_fields}
    return f"unknown key {brief(key)}{nearest(key, sorted(known - set(PARTS)))}"
