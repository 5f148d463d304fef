"""What travels between processes and into files: plain, frozen, strictly checked records.

Shape letters, time first: T environment steps, D decisions, N trains, F features, P parameters.
"""

import hashlib
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema, core_schema

from common.config import MAX_ACTORS, Difficulty, Mode, Serves

Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_.-]+$")]
Text = Annotated[str, Field(max_length=4096)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{32}$")]
Role = Literal["router", "learner", "actor", "evaluator"]
Count = Annotated[int, Field(ge=0, lt=2**53)]


@dataclass(frozen=True)
class Array:
    """Declares an array field: its dtype and one letter (or number) a dimension; equal letters are equal lengths."""

    dtype: str
    dims: tuple[str | int, ...] | None = None  # none: any shape

    def __get_pydantic_core_schema__(self, _source: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.check)

    def check(self, value: Any) -> NDArray[Any]:
        if not isinstance(value, np.ndarray):
            raise ValueError(f"wants an array, got {type(value).__name__}")  # noqa: TRY004  (pydantic wants ValueError)
        if value.dtype != np.dtype(self.dtype):
            raise ValueError(f"wants dtype {self.dtype}, got {value.dtype}")
        if self.dims is not None and value.ndim != len(self.dims):
            raise ValueError(f"wants {len(self.dims)} dimensions, got shape {value.shape}")
        for size, want in zip(value.shape, self.dims or (), strict=self.dims is not None):
            if isinstance(want, int) and size != want:
                raise ValueError(f"wants shape {self.dims}, got {value.shape}")
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            raise ValueError("has non-finite numbers")
        return value


class Record(BaseModel):
    """A strict message: no unknown field, no coercion, no non-finite number, one length a shape letter."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )

    @model_validator(mode="after")
    def _letters_agree(self) -> Self:
        seen: dict[str, int] = {}
        for field, info in type(self).model_fields.items():
            for spec in info.metadata:
                if isinstance(spec, Array):
                    self._match(field, spec, seen)
        return self

    def _match(self, field: str, spec: Array, seen: dict[str, int]) -> None:
        for letter, size in zip(spec.dims or (), getattr(self, field).shape, strict=spec.dims is not None):
            if isinstance(letter, str) and seen.setdefault(letter, size) != size:
                raise ValueError(f"{field}: dimension {letter} is {size} here and {seen[letter]} before")


CIRCUMSTANCES = ("actor", "acting_s", "waited_s")  # what an episode's content does not depend on


class Progressed(Record):
    """Where an episode stands after its first fragments, so that any actor can go on with it.

    Here are the `actions` of all decisions so far, in the order of (time, train), and the trains' `states`.
    """

    fragment: Annotated[int, Field(ge=1)]  # the number of the one to come
    first_step: Annotated[int, Field(ge=1)]
    actions: Annotated[NDArray[np.int8], Array("int8", ("D",))]
    states: Annotated[NDArray[np.float32], Array("float32", ("N", "S"))]


class Lease(Record):
    """The right and duty to act an episode, or a fragment of one: all that its outcome depends on but the weights."""

    episode: Count
    level: Difficulty
    level_seed: Count
    weights_version: Count
    epsilon: float = Field(ge=0, le=1)
    steps: Annotated[int, Field(ge=1)] | None  # at most; none: to the end of the episode
    progressed: Progressed | None  # none: from the start

    @property
    def fragment(self) -> int:
        """The number of the fragment."""
        return 0 if self.progressed is None else self.progressed.fragment

    @property
    def first_step(self) -> int:
        """Steps of the episode before."""
        return 0 if self.progressed is None else self.progressed.first_step


class Episode(Record):
    """What happened in an episode, or in a fragment of one. Decisions are in the order of (time, train).

    The T steps follow on `first_step` others; `times` and `arrived_at` count from the start of the episode. A train
    arrived on step `arrived_at` (0-based), -1 if it has not so far. Once the episode is `over`, `final_observations`
    holds what the trains saw last that the step limit truncated; all else in it is zero. `log_probabilities` of the
    actions and the state `values` are zero for networks of action values; `states` is what trains carry along after
    the last step, S being 0 but for recurrent networks.
    """

    episode: Count
    fragment: Count
    first_step: Count
    over: bool
    level: Difficulty
    level_seed: Count
    level_hash: Digest
    weights_version: Count
    actor: Name
    acting_s: float = Field(ge=0)
    waited_s: float = Field(ge=0)  # for the lease
    max_steps: Annotated[int, Field(ge=1, le=100_000)]
    observations: Annotated[NDArray[np.float32], Array("float32", ("D", "F"))]
    times: Annotated[NDArray[np.int32], Array("int32", ("D",))]
    trains: Annotated[NDArray[np.int32], Array("int32", ("D",))]
    actions: Annotated[NDArray[np.int8], Array("int8", ("D",))]
    log_probabilities: Annotated[NDArray[np.float32], Array("float32", ("D",))]
    values: Annotated[NDArray[np.float32], Array("float32", ("D",))]
    rewards: Annotated[NDArray[np.float32], Array("float32", ("T", "N"))]
    arrived_at: Annotated[NDArray[np.int32], Array("int32", ("N",))]
    final_observations: Annotated[NDArray[np.float32], Array("float32", ("N", "F"))]
    states: Annotated[NDArray[np.float32], Array("float32", ("N", "S"))]

    @model_validator(mode="after")
    def _indices_hold(self) -> Self:
        steps, trains = self.rewards.shape
        end = self.first_step + steps
        for field, first, limit in (("times", self.first_step, end), ("trains", 0, trains), ("actions", 0, 5)):
            values = getattr(self, field)
            if values.size and (values.min() < first or values.max() >= limit):
                raise ValueError(f"{field}: wants values in {first}..{limit - 1}")
        if not 1 <= steps <= self.max_steps - self.first_step or trains < 1:
            most = self.max_steps - self.first_step
            raise ValueError(f"rewards: wants 1..{most} steps of at least one train, got {steps} of {trains}")
        if self.arrived_at.min() < -1 or self.arrived_at.max() >= end:
            raise ValueError(f"arrived_at: wants values in -1..{end - 1}")
        if (self.fragment == 0) != (self.first_step == 0):
            raise ValueError(f"first_step: {self.first_step} does not begin fragment {self.fragment}")
        return self

    @property
    def whole(self) -> bool:
        """This is all of its episode."""
        return self.over and self.first_step == 0

    @property
    def digest(self) -> str:
        """Hash of everything but the circumstances: who acted and how long it took."""
        state = hashlib.blake2b(digest_size=16)
        for field in type(self).model_fields:
            if field in CIRCUMSTANCES:
                continue
            value = getattr(self, field)
            state.update(f"{field}:".encode())
            if isinstance(value, np.ndarray):
                state.update(f"{value.dtype.str}{value.shape}".encode())
                state.update(np.ascontiguousarray(value).tobytes())
            else:
                state.update(repr(value).encode())
        return state.hexdigest()


class EpisodeRow(Record):
    """A line of `episodes.jsonl`: one trained episode. All but `actor` and the two times is a function of the run."""

    episode: Count
    level: Difficulty
    seed: Count
    normalised_return: float = Field(alias="return")
    arrived: Count
    trains: Count
    steps: Count
    decisions: Count
    epsilon: float
    weights_version: Count
    digest: Digest
    actor: Name
    acting_s: float
    trained_unix_s: float

    model_config = ConfigDict(populate_by_name=True)


class MetricRow(Record):
    """A line of `metrics.jsonl`: what learning from an episode told, and where its time went."""

    episode: Count
    metrics: dict[Annotated[str, Field(max_length=64)], float]


class EvaluationRow(Record):
    """A line of `evaluations.jsonl`: a checkpoint scored on the fixed levels of one difficulty."""

    episode: Count
    level: Difficulty
    mode: Mode
    levels: Count
    normalised_return: float = Field(alias="return")
    arrived_share: float
    all_arrived_share: float
    mean_steps: float
    weights_digest: Digest
    evaluated_unix_s: float
    evaluating_s: float

    model_config = ConfigDict(populate_by_name=True)


class Weights(Record):
    """The network's parameters after `version` trained episodes."""

    version: Count
    tensors: dict[Annotated[str, Field(max_length=128)], Annotated[NDArray[np.float32], Array("float32")]]


class WeightsRequest(Record):
    """Asks the learner for one version of the weights."""

    version: Count


class LeaseRequest(Record):
    """An actor asks for work, and says what it still keeps: rows of (episode, fragment)."""

    actor: Name
    incarnation: Name
    serves: Serves
    kept: Annotated[NDArray[np.int64], Array("int64", ("K", 2))]


class LeaseAnswer(Record):
    """The learner's answer: perhaps a lease, and what the actor may forget or must publish again."""

    lease: Lease | None
    safe_before: Count  # episodes below are in a durable snapshot: forget them
    missing: Annotated[NDArray[np.int64], Array("int64", ("K", 2))]  # kept, but not at the learner: publish them again
    finished: bool  # every episode is trained


class HistoryRequest(Record):
    """Asks for rows from position `first` on."""

    first: Count


class EpisodeRows(Record):
    """A stretch of the episode history, starting where it was asked for; `total` rows exist."""

    rows: list[EpisodeRow] = Field(max_length=2_000)
    total: Count


class EvaluationRows(Record):
    """A stretch of the evaluation history, starting where it was asked for; `total` rows exist."""

    rows: list[EvaluationRow] = Field(max_length=2_000)
    total: Count


class CheckpointNotice(Record):
    """The learner has written the checkpoints after these numbers of episodes; `finished`: no more will come."""

    episodes: list[Count] = Field(max_length=100_000)
    finished: bool


class CheckpointRequest(Record):
    """Asks for the checkpoint after `episode` episodes."""

    episode: Count


class CheckpointFile(Record):
    """A checkpoint, byte for byte as on disk; its own digest protects it."""

    episode: Count
    content: bytes = Field(max_length=256_000_000)


class Empty(Record):
    """Asks for something that needs no argument."""


class LearnerCommand(Record):
    """What a user asks of the learner."""

    verb: Literal["pause", "resume", "checkpoint"]


class ScaleRequest(Record):
    """How many actors there shall be for each named difficulty; others stay as they are."""

    actors: dict[Serves, Annotated[int, Field(ge=0, le=MAX_ACTORS)]]


class CommandAnswer(Record):
    """Whether a command was carried out, and what there is to say about it."""

    done: bool
    text: Text


class Heartbeat(Record):
    """A sign of life from a process's own loop, with what it has to tell."""

    process: Name
    role: Role
    pid: Count
    state: Annotated[str, Field(max_length=64)]
    counters: dict[Annotated[str, Field(max_length=64)], float] = {}


class ProcessStatus(Record):
    """A process as its supervisor sees it."""

    process: Name
    role: Role
    difficulty: Serves | None
    pid: Count | None
    state: Annotated[str, Field(max_length=64)]
    restarts: Count
    last_heartbeat_unix_s: float | None


class Progress(Record):
    """How far a run is, as its learner tells."""

    done: Count
    leased: Count
    waiting: dict[Difficulty, Count]  # could be acted now, if an actor asked
    weights_version: Count | None  # only the learner knows
    snapshot: Count  # episodes in the newest snapshot
    evaluations: Count
    evaluations_due: Count
    return_last_100: float | None
    episodes_per_s: float
    steps_per_s: float
    refused: Count  # messages that the strict decoding turned away
    duplicates: Count
    reissued: Count


RunState = Literal[
    "starting", "running", "paused", "finishing", "finished", "stopping", "stopped", "failed", "unsupervised"
]


class Status(Record):
    """The state of a run and of its processes."""

    run: Text
    path: Text
    state: RunState
    algorithm: Text
    episodes: Count
    supervisor_pid: Count | None
    progress: Progress | None
    time_left_s: float | None
    problems: list[Text] = Field(max_length=100)
    processes: list[ProcessStatus] = Field(max_length=2_000)
