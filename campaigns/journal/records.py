"""Records of the journal: one frozen value per kind. Units: mm, mm², rad, s, °C."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, JsonValue, TypeAdapter, ValidationError

from campaigns.errors import FindingUnreadable
from drivers.values import Identity, Matrix3, Pose, Vector3, Weather

Joints = tuple[float, ...]
"""Joint values, one a joint, by whose kind the unit is rad or mm. Keys in the file say rad."""
Stage = Literal[
    "run",
    "before",
    "after",
    "after by targets",
    "import",
    "verify before",
    "verify after",
    "check",
    "repair",
]
Command = Literal["joints", "pose"]
Ending = Literal["finished", "interrupted", "aborted"]
EventKind = Literal[
    "beam broken",
    "suspended",
    "resumed",
    "reconnected",
    "drift check",
    "temperature alarm",
    "settling",
    "goal met",
    "operator note",
    "wrong stage",
    "tracker place",
    "shot voided",
    "shot skipped",
    "shots left out",
    "gone on anyway",
]
FindingKind = Literal[
    "identification", "validation", "check", "export", "load begun", "load", "load failed"
]
"""A load is begun, and then it took effect ("load") or did not; neither: the process died."""


@dataclass(frozen=True, slots=True)
class SeriesStarted:
    """Start of one execution of a plan for a stage. An import has neither device nor weather.

    `declared`: the file by which somebody says what the controller held while shots were measured
    elsewhere for a validation; "" where it was read from the controller.
    `model` is what the shots were planned to determine, by the word of `--model`; `lacks` what the
    controller's kinematics has no parameters for. Empty and None in older files: no one said so.
    """

    stage: Stage
    plan_digest: str
    configuration: Mapping[str, JsonValue]
    software_version: str
    robot_file_digest: str
    robot: Identity | None
    tracker: Identity | None
    weather: Weather | None
    declared: str = ""
    model: str = ""
    lacks: tuple[str, ...] | None = None

    @property
    def imported(self) -> bool:
        """Whether the shots were measured elsewhere."""
        return self.stage == "import" or bool(self.declared)


@dataclass(frozen=True, slots=True)
class SeriesFinished:
    """End of a series: every shot has an accepted outcome, or was left out as the goal was met."""


@dataclass(frozen=True, slots=True)
class BeamStart:
    """Joints at which the robot stood before a session moved it, and the beam's direction then.

    The direction is a unit vector in the tracker's frame.
    """

    joints: Annotated[Joints, Field(alias="joints_rad")]
    direction: Vector3


@dataclass(frozen=True, slots=True)
class SessionStarted:
    """A process takes up a series, for the first time or after a stop or a crash.

    `beam` is None where the tracker reported no direction or the robot moved, and in old files.
    """

    software_version: str
    robot: Identity | None
    tracker: Identity | None
    weather: Weather | None
    beam: BeamStart | None = None


@dataclass(frozen=True, slots=True)
class SessionStopped:
    """A process leaves its series in order. Its absence is the mark of a crash."""

    how: Ending
    reason: str


@dataclass(frozen=True, slots=True)
class Intent:
    """Intention of one attempt, written before anything moves. `purpose` is the shot's set.

    `commanded` is the pose that the controller is sent where that is another than the target.
    `nest` names the fixed place whose reflector is measured while the robot stands there.
    """

    shot: int
    attempt: int
    purpose: str
    target: Pose
    target_joints: Annotated[Joints, Field(alias="target_joints_rad")]
    command: Command
    pair: int | None = None
    commanded: Pose | None = None
    nest: str = ""


@dataclass(frozen=True, slots=True)
class Durations:
    """Durations of a shot's parts."""

    move_s: float
    settle_s: float
    measure_s: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """An accepted shot: the joints as read, the point as measured, both raw answers beside them.

    `came_from` is where the joints stood before the last leg of the way; None if unknown.
    """

    shot: int
    attempt: int
    joints: Annotated[Joints, Field(alias="joints_rad")]
    point_in_tracker_mm: Vector3
    covariance_mm2: Matrix3 | None
    weather: Weather | None
    raw_robot: str
    raw_tracker: str
    durations: Durations | None
    predicted_in_tracker_mm: Vector3 | None = None
    residual_mm: float | None = None
    came_from: Annotated[Joints | None, Field(alias="came_from_rad")] = None
    approach: tuple[int, ...] | None = None
    """Sides from which joints came, +1, -1 or 0, where a file says so; else by `came_from`."""
    part_temperature_degC: float | None = None
    """Temperature of the robot's parts; None: not measured."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """A shot that does not count, and what had been measured when it got that far."""

    shot: int
    attempt: int
    reason: str
    measured: Outcome | None = None

    def __post_init__(self) -> None:
        """Refuse the data of another shot."""
        numbers = (self.shot, self.attempt)
        if self.measured and (self.measured.shot, self.measured.attempt) != numbers:
            raise ValueError(f"shot and attempt {numbers} are rejected with another shot's data")


@dataclass(frozen=True, slots=True)
class PairVoided:
    """The outcomes that these shots have so far no longer count; the pair is measured again.

    Without a pair, it is one shot that stands alone.
    """

    pair: int | None
    shots: tuple[int, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class Event:
    """Event for the reader of the report. `shots` are those that it names, where that matters."""

    kind: EventKind
    text: str
    shots: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Finding:
    """A result or decision, with the digests of what it rests on."""

    kind: FindingKind
    body: Mapping[str, JsonValue]


Record = (
    SeriesStarted
    | SeriesFinished
    | SessionStarted
    | SessionStopped
    | Intent
    | Outcome
    | Rejected
    | PairVoided
    | Event
    | Finding
)

TYPE_OF_KIND: Mapping[str, type[Record]] = {
    "series-started": SeriesStarted,
    "series-finished": SeriesFinished,
    "session-started": SessionStarted,
    "session-stopped": SessionStopped,
    "intent": Intent,
    "outcome": Outcome,
    "rejected": Rejected,
    "pair-voided": PairVoided,
    "event": Event,
    "finding": Finding,
}
BodyT = TypeVar("BodyT")
KIND_OF_TYPE: Mapping[type[object], str] = {type_: kind for kind, type_ in TYPE_OF_KIND.items()}


_made: Callable[[type], TypeAdapter[Any]] = cache(TypeAdapter[Any])


def adapter_of(kind: type[BodyT]) -> TypeAdapter[BodyT]:
    """Return reader and writer of a class's values, made once: that takes as long as half a fit."""
    return _made(kind)


def read_body(
    body: Mapping[str, JsonValue], kind: type[BodyT], name: FindingKind, remedy: str
) -> BodyT:
    """Return what a finding's body holds; raises `FindingUnreadable` for a body in another form."""
    try:
        return adapter_of(kind).validate_python(body)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise FindingUnreadable(
            f"the journal's {name}, {where}: {first['msg'].lower()}", remedy=remedy
        ) from error


def as_stored(record: Record) -> str:
    """Return a record as JSON text, which can be read back.

    Raises `ValueError`, `TypeError` or `AttributeError` when a value is not finite, not plain data,
    not Unicode or of another type.
    """
    kind = KIND_OF_TYPE[type(record)]
    if isinstance(record, Finding):  # plain data already, of which an adapter asks each value
        values = {"kind": record.kind, "body": record.body}
    else:
        # without its warnings: what does not fit is refused by name, in reading it back
        values = _made(type(record)).dump_python(record, by_alias=True, warnings="none")
    text = json.dumps(values, allow_nan=False, ensure_ascii=False)
    from_text(kind, text)
    return text


def from_text(kind: str, text: str) -> Record:
    """Return the record that was stored; raises `ValueError` for a text of another kind."""
    if kind not in TYPE_OF_KIND:
        raise ValueError(f"unknown kind of record {kind!r}")
    try:
        record: Record = _made(TYPE_OF_KIND[kind]).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "text"
        raise ValueError(f"{kind}: {where}: {first['msg']}") from error
    return record
