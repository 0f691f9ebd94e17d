"""What a robot file (`pkmcal/robot/1`) may hold, each key with its limits."""

import json
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, JsonValue

from campaigns.files.wording import shown, suggestion
from campaigns.files.yaml_file import FileModel, broken_rule
from campaigns.mechanisms.geometry import AXIS_TILT_NAMES, PARAMETER_NAMES

SCHEMA = "pkmcal/robot/1"


def _rising(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] < limits[1]:
        return limits
    raise broken_rule(f"is {list(limits)}, the lowest must be below the highest")


def _known_parameters(uncertainty: dict[str, float]) -> dict[str, float]:
    known = PARAMETER_NAMES + AXIS_TILT_NAMES
    for name in uncertainty:
        if name not in known:
            hint = suggestion(name, known)
            raise broken_rule(f"names {shown(name)}, which is not a parameter ({hint})")
    return uncertainty


def _finite(provenance: dict[str, JsonValue]) -> dict[str, JsonValue]:
    try:
        json.dumps(provenance, allow_nan=False)
    except ValueError as error:
        raise broken_rule("holds a number that is not finite") from error
    return provenance


Place = Annotated[float, Field(ge=-100_000.0, le=100_000.0)]
Length = Annotated[float, Field(gt=0.0, le=100_000.0)]
Turn = Annotated[float, Field(ge=-360.0, le=360.0)]
Tilt = Annotated[float, Field(ge=-10.0, le=10.0)]
TurnRange = Annotated[tuple[Turn, Turn], AfterValidator(_rising)]
Deviation = Annotated[float, Field(ge=0.0)]


class ArmContents(FileModel):
    """One arm; the names are those of `ARM_FIELDS`, and one beyond them."""

    x_mm: Place = Field(description="the motor centre's x in the base frame, mm")
    y_mm: Place = Field(description="the motor centre's y in the base frame, mm")
    z_mm: Place = Field(description="the motor centre's z in the base frame, mm")
    azimuth_deg: Turn = Field(description="the arm's direction about z at joint angle 0, deg")
    joint_offset_deg: Turn = Field(description="the joint angle minus the encoder's reading, deg")
    arm_mm: Length = Field(description="the arm's length, mm")
    forearm_mm: Length = Field(description="the forearm's length, mm")
    axis_tilt_deg: Tilt = Field(
        default=0.0, description="the motor's axis out of the horizontal, deg; may be left out"
    )


class GeometryContents(FileModel):
    """The 29 parameters, and axis tilts where there are any."""

    arms: tuple[ArmContents, ArmContents, ArmContents, ArmContents] = Field(
        description="four arms, each with its seven keys"
    )
    plate_mm: Length = Field(description="the distance between the halves of the plate, mm")


class LimitsContents(FileModel):
    """What the mechanism allows."""

    joint_deg: TurnRange = Field(description="the lowest and the highest encoder angle, deg")
    theta_deg: TurnRange = Field(description="the plate's lowest and highest angle, deg")
    forearm_swing_deg: float = Field(
        gt=0.0, le=90.0, description="the largest angle of a forearm out of its arm's plane, deg"
    )


class RobotContents(FileModel):
    """A robot file."""

    mechanism: Literal["par4"] = Field(description="the kind of mechanism: par4")
    name: str = Field(min_length=1, description="the robot's name")
    geometry: GeometryContents = Field(description="the parameters: arms and plate_mm")
    limits: LimitsContents = Field(description="joint_deg, theta_deg and forearm_swing_deg")
    uncertainty: Annotated[dict[str, Deviation], AfterValidator(_known_parameters)] | None = Field(
        default=None, description="one standard deviation for each identified parameter, mm or deg"
    )
    provenance: Annotated[dict[str, JsonValue], AfterValidator(_finite)] | None = Field(
        default=None, description="keys and values that say where the parameters come from"
    )
    sha256: str | None = Field(
        default=None,
        pattern="^[0-9a-f]{64}$",
        description="the geometry's sha256 in 64 digits, or delete the line",
    )
