"""Schema of robot files (`pkmcal/robot/1`): the keys that a file may hold, each with its limits.

All robot files share the keys of `RobotContents`. The keys of `geometry` and `limits` follow from
the mechanism: its parameter space lists the fields of an arm and of the platform, its axes the
units of joints and turns. So one pydantic model for each mechanism is made at run time, and a new
mechanism needs no schema of its own. Errors can then name the missing key of the third arm, and
the tables of keys in the documentation are written from these models too.
"""

import json
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, JsonValue, PlainValidator, WithJsonSchema, create_model

from campaigns.errors import ConfigInvalid
from campaigns.files.wording import shown, suggestion
from campaigns.files.yaml_file import (
    RISING,
    FileModel,
    Length,
    Place,
    PlaceRange,
    Point,
    broken_rule,
)
from campaigns.fit.error_sources import SOURCES, TRACKER_SOURCES
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.catalog import MECHANISMS
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.parameters import OPTIONAL, Parameter, ParameterField
from campaigns.kinematics.platforms import ON_PLATE
from campaigns.robots.program import find_mechanism

SCHEMA = "pkmcal/robot/1"


# `JsonValue` lets NaN and infinity pass, although JSON has no words for them.
def _check_finite(provenance: dict[str, JsonValue]) -> dict[str, JsonValue]:
    try:
        json.dumps(provenance, allow_nan=False)
    except ValueError as error:
        raise broken_rule("holds a number that is not finite") from error
    return provenance


Turn = Annotated[float, Field(ge=-360.0, le=360.0)]
Tilt = Annotated[float, Field(ge=-10.0, le=10.0)]
TurnRange = Annotated[tuple[Turn, Turn], RISING]
Deviation = Annotated[float, Field(ge=0.0)]
Expansion = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Deviations = dict[str, Deviation]

Rates = float | tuple[float, ...] | None
"""Rate of ripples: of all joints, or of each, 0 for one without a ripple; None: unknown."""


# pydantic would report a wrong value once for each form of the key, in words of its own.
def _check_rates(value: object, lowest: float) -> Rates:
    """Check a rate of ripples: a number, or a list with a number, 0 or null for each joint."""
    if value is None:
        return None
    if not isinstance(value, list):
        return _check_rate(value, "is", lowest)
    # a joint of a list may have no ripple
    return tuple(
        0.0 if entry is None or entry == 0.0 else _check_rate(entry, "holds", lowest)
        for entry in value
    )


def _check_rate(value: Any, verb: str, lowest: float) -> float:
    is_number = type(value) in {int, float}  # a bool is none
    if is_number and lowest <= value <= 10000.0:
        return float(value)
    text = shown(json.dumps(value, ensure_ascii=False))
    raise broken_rule(f"{verb} {text}, must be a number from {lowest:g} to 10000")


# described as the number that most files hold
RATES_SCHEMA = WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "null"}]})
Period = Annotated[Rates, PlainValidator(partial(_check_rates, lowest=1.0)), RATES_SCHEMA]
RipplesPerTurn = Annotated[Rates, PlainValidator(partial(_check_rates, lowest=2.0)), RATES_SCHEMA]


# Any: pydantic takes types made at run time, of which mypy can know nothing.
Definition = tuple[Any, Any]

VALUE_OF: dict[str, Any] = {
    "place": Place,
    "length": Length,
    "angle": Turn,
    "small angle": Tilt,
    "ratio": Annotated[float, Field(ge=-1e5, le=1e5)],
}
JOINTS_ON_PLATE = "where each arm's bar sits on its part of the plate, [x, y, z] mm"
LARGEST_ON_PLATE_MM = 100.0
"""Largest change of a place on the plate that `load` takes: it moves the robot by the plate's tilt
times this, 0.1 mm at 1 mrad."""
COUNTS = {2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}


class Tolerance(FileModel):
    """Largest change of a parameter from its nominal value that is accepted."""

    length_mm: float = Field(
        default=10.0,
        gt=0.0,
        description="the largest change of a length or place that load takes, mm",
    )
    angle_deg: float = Field(
        default=5.0, gt=0.0, description="the largest change of an angle that load takes, deg"
    )
    ratio_ppm: float = Field(
        default=10000.0, gt=0.0, description="the largest change of a ratio that load takes, ppm"
    )

    def of(self, parameter: Parameter) -> float:
        """Return the limit for a parameter, in the parameter's unit in the file."""
        if parameter.field.group in ON_PLATE:
            return LARGEST_ON_PLATE_MM
        limits = {"deg": self.angle_deg, "mm": self.length_mm, "ppm": self.ratio_ppm}
        return limits[parameter.unit]


def _check_tolerances(values: dict[str, float]) -> dict[str, float]:
    """Check that tolerances are positive, and of a group of error sources in its unit."""
    for key, value in values.items():
        if key not in TOLERANCES:
            hint = suggestion(key, TOLERANCES)
            raise broken_rule(f"names {shown(key)}, which is no group of error sources ({hint})")
        if not 0.0 < value < float("inf"):
            raise broken_rule(f"{key} is {value:g}, must be above 0")
    return values


# The groups of the robot's error sources, each in every unit that its parameters can have. Those of
# the tracker have their limits in campaign.yaml: they belong to the cell and not to the robot.
TOLERANCES = tuple(
    f"{group}_{unit}"
    for group in SOURCES
    if group not in TRACKER_SOURCES
    for unit in (("ppm",) if group in {"ratio", "growth"} else ("mm", "deg"))
)
"""Keys of the section `tolerances`."""


class RobotContents(FileModel):
    """Keys of every robot file; the model of a mechanism adds those of geometry and limits."""

    page = "docs/reference/files.md#robotyaml"

    mechanism: str = Field(description=f"the kind of mechanism: {', '.join(MECHANISMS)}")
    name: str = Field(min_length=1, description="the robot's name")
    geometry: FileModel = Field(description="the parameters")
    limits: FileModel = Field(description="what the mechanism allows")
    workspace_centre_mm: Point | None = Field(
        default=None, description="the middle of the workspace, [x, y, z] mm; may be left out"
    )
    plate_joints_mm: tuple[Point, ...] | None = Field(
        default=None, description=f"{JOINTS_ON_PLATE}; may be left out"
    )
    reflector_mm: Point | None = Field(
        default=None,
        description="the reflector on the plate, [x, y, z] mm from the controlled point; may be "
        "left out",
    )
    reflector_std_mm: float | None = Field(
        default=None,
        gt=0.0,
        le=1000.0,
        description="1 σ of reflector_mm along each axis, mm; may be left out",
    )
    reflector_half: Literal[1, 2] | None = Field(
        default=None,
        description="1 or 2, the part of a platform of two parts that carries the reflector; may "
        "be left out",
    )
    drive_period_mm: Period = Field(
        default=None,
        description="of robots on rails: a carriage's travel in a turn of its screw or pulley, "
        "or a list with one for each, mm; may be left out",
    )
    ripples_per_turn: RipplesPerTurn = Field(
        default=None,
        description="of robots with cranks: periods of a gear's error in a turn of the arm, as its "
        "ratio is, or a list with one for each; may be left out",
    )
    expansion_ppm_per_degC: dict[Literal["arm", "forearm", "frame"], Expansion] | None = Field(
        default=None,
        description="growth of arms or rails, forearms and frame, ppm/°C; may be left out",
    )
    reference_temperature_degC: float | None = Field(
        default=None,
        ge=-50.0,
        le=150.0,
        description="the parts' temperature for which the geometry is stated, °C",
    )
    tolerance: Tolerance = Field(
        default=Tolerance(),
        description="how far a parameter may be from its nominal value; may be left out",
    )
    tolerances: Annotated[dict[str, float], AfterValidator(_check_tolerances)] = Field(
        default_factory=dict,
        description="1 σ of how far parts usually are from nominal, by group of error sources; "
        "may be left out",
    )
    uncertainty: Deviations | None = Field(
        default=None,
        description="one standard deviation for each identified parameter, in its unit",
    )
    provenance: Annotated[dict[str, JsonValue], AfterValidator(_check_finite)] | None = Field(
        default=None, description="keys and values that say where the parameters come from"
    )
    sha256: str | None = Field(
        default=None,
        pattern="^[0-9a-f]{64}$",
        description="the geometry's sha256 in 64 digits, or delete the line",
    )


def contents_model(word: object, folder: Path) -> type[RobotContents]:
    """Return the model of the files of a mechanism, named by its word.

    Raise `ConfigInvalid` where a file or package gives no mechanism by this word, and
    `ProgramUntrusted` for a file that may not run.
    """
    try:
        mechanism = find_mechanism(word, folder)
    except (TypeError, ImportError, AttributeError) as error:
        raise ConfigInvalid(
            f"mechanism {shown(str(word))} gives no mechanism ({error})",
            remedy="give FILE.py:NAME, seen from the robot file, or mend that file or package",
        ) from error
    if mechanism is not None:
        return _model_of(mechanism, str(word))
    # Any other word is unknown. A model that accepts only the shipped words refuses it with the
    # line of the key, as any wrong value; without a mechanism the geometry is not judged.
    return create_model(
        "RobotContents",
        __base__=RobotContents,
        mechanism=(_literal(*MECHANISMS), RobotContents.model_fields["mechanism"]),
        geometry=(Any, ...),
        limits=(Any, ...),
    )


# Making a model takes longer than checking a file with it, and a command reads several files.
@cache
def _model_of(mechanism: Mechanism, word: str) -> type[RobotContents]:
    space = mechanism.parameters
    arms_fields = [
        (space.arm_fields(arm=arm), space.arm_fields(*OPTIONAL, arm=arm))
        for arm in range(space.arms)
    ]
    of_arm = {
        fields: _make_model("ArmContents", **_definitions(*fields))
        for fields in dict.fromkeys(arms_fields)
    }
    count, keys = COUNTS.get(space.arms, str(space.arms)), len(space.arm_fields())
    arms = Field(description=f"{count} arms, each with its {keys} keys")
    geometry = _make_model(
        "GeometryContents",
        arms=(tuple[tuple(of_arm[fields] for fields in arms_fields)], arms),  # type: ignore[misc]
        **_definitions(space.platform_fields(), space.platform_fields(*OPTIONAL)),
    )
    named = ", ".join(("arms", *(field.name for field in space.platform_fields())))
    limits = _limits_model(mechanism)
    described = ", ".join(limits.model_fields)
    points: Any = tuple[(Point,) * space.arms]  # type: ignore[misc]
    joints: Definition = (
        points | None if mechanism.has_forearms else None,
        Field(default=None, description=f"{count} places, {JOINTS_ON_PLATE}"),
    )
    deviations = Annotated[Deviations, AfterValidator(partial(_check_names, names=space.of_robot))]
    return create_model(
        "RobotContents",
        __base__=RobotContents,
        mechanism=(_literal(word), Field(description=f"the kind of mechanism: {word}")),
        geometry=(geometry, Field(description=f"the parameters: {named}")),
        limits=(limits, Field(description=described)),
        plate_joints_mm=joints,
        uncertainty=(deviations | None, RobotContents.model_fields["uncertainty"]),
    )


def _literal(*words: str) -> Any:
    return Literal[words]


def _limits_model(mechanism: Mechanism) -> type[FileModel]:
    what = {"deg": "encoder angle", "mm": "place of a carriage or length of a leg"}
    ranges = {
        f"joint_{axis.unit}": _range_of(axis, f"the lowest and the highest {what[axis.unit]}")
        for axis in mechanism.joints
    }
    # the reach of forearms bounds positions; other mechanisms need a range of each
    ranges |= {
        axis.column: _range_of(
            axis, "the plate's lowest and highest angle" if axis.is_revolute
            else "the controlled point's lowest and highest place"
        )
        for axis in mechanism.task
        if axis.is_revolute or not (mechanism.has_forearms or axis.is_fixed)
    }  # fmt: skip
    if mechanism.has_forearms:
        swing = "the largest angle of a forearm out of its arm's plane, deg"
        ranges["forearm_swing_deg"] = (float, Field(gt=0.0, le=90.0, description=swing))
    return _make_model("LimitsContents", **ranges)


def _range_of(axis: Axis, limits_in_words: str) -> Definition:
    kind = TurnRange if axis.is_revolute else PlaceRange
    return kind, Field(description=f"{limits_in_words}, {axis.unit}")


def _definitions(
    fields: tuple[ParameterField, ...], optional: tuple[ParameterField, ...]
) -> dict[str, Definition]:
    """Return the keys of fields that every file has, and of those that one may leave out."""
    return {
        field.name: (VALUE_OF[field.quantity], Field(default, description=field.description + end))
        for some_fields, default, end in ((fields, ..., ""), (optional, 0.0, "; may be left out"))
        for field in some_fields
    }


def _make_model(name: str, **definitions: Definition) -> type[FileModel]:
    # Any again: the overloads of `create_model` take no table of definitions
    model: type[FileModel] = create_model(name, __base__=FileModel, **definitions)  # type: ignore[call-overload]
    return model


def _check_names(uncertainty: Deviations, names: tuple[str, ...]) -> Deviations:
    """Check that all deviations belong to parameters of these names."""
    for name in uncertainty:
        if name not in names:
            hint = suggestion(name, names)
            raise broken_rule(f"names {shown(name)}, which is not a parameter ({hint})")
    return uncertainty
