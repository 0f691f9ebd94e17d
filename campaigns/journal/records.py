"""Records of the journal: one frozen value per kind. Units: mm, mm², rad, s, °C.

A campaign is a list of these records in the order of time. A series (one execution of a plan for a
stage) begins with `SeriesStarted` and ends with `SeriesFinished`; between them stand the sessions
of the processes that worked at it, each from `SessionStarted` to `SessionStopped`, unless it
crashed.

An attempt at a shot begins with an `Intent`, before anything moves, and ends with exactly one
`Outcome` (the shot counts) or `Rejected` (it does not). An intent without an end is an attempt that
a crash has cut off. A record is never changed: `PairVoided` takes back outcomes that turned out
wrong, and the shot is measured again under the next number of attempt.

Old journals must stay readable. New fields therefore have defaults that mean "not stated", and the
keys in the file stay as they were written first, even where a name in the program has become better
(`alias`).
"""

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
    "robot changed",
]
FindingKind = Literal[
    "identification",
    "validation",
    "check",
    "export",
    "load begun",
    "load",
    "load failed",
    "observations",
]
"""After "load begun" follows "load" if it took effect, or "load failed"; neither if it crashed."""


@dataclass(frozen=True, slots=True)
class SeriesStarted:
    """Start of one execution of a plan for a stage. An import has neither devices nor weather.

    `declared`: name of the file that states the controller's parameters while shots were measured
    elsewhere for a validation, or of the shots of a check; "" where they were read from the
    controller. `model`: parameters that the shots were planned to determine, as the word of
    `--model`; "" in older files. `lacks`: optional parameters that the controller's kinematics does
    not have; None in older files. `planned`: number of shots to measure; None of an import and in
    older files.
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
    planned: int | None = None

    @property
    def imported(self) -> bool:
        """Whether the shots were measured elsewhere."""
        return self.stage == "import" or bool(self.declared)


@dataclass(frozen=True, slots=True)
class SeriesFinished:
    """End of a series: each shot has an accepted outcome, or is named as skipped or left out."""


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

    `beam` is None if the tracker reported no direction or the robot was moving, and in old files.
    """

    software_version: str
    robot: Identity | None
    tracker: Identity | None
    weather: Weather | None
    beam: BeamStart | None = None


@dataclass(frozen=True, slots=True)
class SessionStopped:
    """A process leaves its series in order. A session without this record has crashed."""

    how: Ending
    reason: str


@dataclass(frozen=True, slots=True)
class Intent:
    """Intention of one attempt, written before anything moves. `purpose` is the shot's set.

    `pair`: number of the pair that the shot is a half of; None for a shot that stands alone.
    `commanded`: pose that the controller is sent; None if it is sent the target itself.
    `nest`: fixed place whose reflector is measured while the robot stands; "" for the robot's.
    `reflector`: object on the platform that is measured; "" for the reflector of the robot file.
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
    reflector: str = ""


@dataclass(frozen=True, slots=True)
class Durations:
    """Durations of a shot's parts."""

    move_s: float
    settle_s: float
    measure_s: float


@dataclass(frozen=True, slots=True)
class Outcome:
    """Accepted shot: the joints as read, the point as measured, both raw answers beside them.

    `came_from`: joints at the beginning of the last leg of the way; None if unknown.
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
    """Sides from which the joints came, +1, -1 or 0, as an imported file states them.

    None: they follow from `came_from`.
    """
    part_temperature_degC: float | None = None
    """Temperature of the robot's parts; None: not measured."""
    reflector: str = ""
    """Object on the platform that was measured; "": the reflector of the robot file."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """Attempt that does not count; `measured` is its data, None if it ended without any."""

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
    """Withdrawal of the outcomes that these shots have so far; the pair is measured again.

    `pair`: None for one shot that stands alone.
    """

    pair: int | None
    shots: tuple[int, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class Event:
    """Event for the reader of the report. `shots`: those that the text names, else ()."""

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


# Built once a class: building one takes as long as half a fit.
_cached_adapter: Callable[[type], TypeAdapter[Any]] = cache(TypeAdapter[Any])


def adapter_of(kind: type[BodyT]) -> TypeAdapter[BodyT]:
    """Return the reader and writer of a class's values."""
    return _cached_adapter(kind)  # a generic function of its own: `cache` loses the type variable


def read_body(
    body: Mapping[str, JsonValue], kind: type[BodyT], name: FindingKind, remedy: str
) -> BodyT:
    """Return a finding's body as a value; raise `FindingUnreadable` for a body in another form."""
    try:
        return adapter_of(kind).validate_python(body)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise FindingUnreadable(
            f"the journal's {name}, {where}: {first['msg'].lower()}", remedy=remedy
        ) from error


def as_stored(record: Record) -> str:
    """Return a record as JSON text that can be read back.

    Raise `ValueError`, `TypeError` or `AttributeError` if a value is not finite, not plain data,
    not Unicode or of another type.
    """
    # Python checks no types while the program runs, and the journal cannot be corrected later: a
    # NaN, an array or a number as text has to be refused here. So the text is read back before it
    # is written, strictly, as it will be read at the next opening.
    kind = KIND_OF_TYPE[type(record)]
    if isinstance(record, Finding):  # plain data already: an adapter would walk through all of it
        values = {"kind": record.kind, "body": record.body}
    else:
        # Without its warnings: a value that does not fit is refused by name when it is read back.
        values = _cached_adapter(type(record)).dump_python(record, by_alias=True, warnings="none")
    text = json.dumps(values, allow_nan=False, ensure_ascii=False)
    from_text(kind, text)
    return text


def from_text(kind: str, text: str) -> Record:
    """Return the record that was stored; raise `ValueError` for a text of another kind."""
    if kind not in TYPE_OF_KIND:
        raise ValueError(f"unknown kind of record {kind!r}")
    try:
        record: Record = _cached_adapter(TYPE_OF_KIND[kind]).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "text"
        raise ValueError(f"{kind}: {where}: {first['msg']}") from error
    return record
