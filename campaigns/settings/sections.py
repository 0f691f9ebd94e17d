"""Sections of campaign.yaml but `space`: devices, plan, settling, gate, run, tests, people.

Defaults of the plan and of the tests are the paper's where it states a number (Corbel 2006: 120
shots in 60 pairs, 28 approaches, lines of 800, 800 and 500 mm), and ISO 9283's for its cube (30
cycles of five poses). Defaults of the tracker are limits of a common instrument. The upper limits
of fields are no advice: they catch a wrong unit or a slip of the finger.
"""

import math
from collections.abc import Collection, Sequence
from datetime import date
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from campaigns.files.yaml_file import FileModel, Point, broken_rule
from drivers import names
from drivers.names import CONTROLLER_NAMES, TRACKER_NAMES, ControllerName, TrackerName

OFFLINE = "offline"
"""Word in place of an address: nothing is connected, programs are exported and files imported."""
SIMULATED = "sim://"
"""Beginning of the address of a device of a simulated cell."""
BY_HAND, FILE = names.BY_HAND, names.FILE
# a user name or a path in an address is refused, because no driver would use it
URL_PATTERN = (
    r"^(tcp://[^\s@/?#]+:\d{1,5}|serial://\S+|"
    rf"{SIMULATED}[\w-]+|{FILE}.+|{OFFLINE}|{BY_HAND})$"
)
URL_FORMS = (
    "tcp://HOST:PORT, serial:///dev/ttyUSB0?baud=115200, sim://SCENARIO, file:NAME of a tracker, "
    f"{BY_HAND} or {OFFLINE}"
)


def _check_direction(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    if any(direction):
        return direction
    raise broken_rule("is [0, 0, 0], which is no direction")


Url = Annotated[str, Field(pattern=URL_PATTERN)]
Direction = Annotated[Point, AfterValidator(_check_direction)]
Seconds = Annotated[float, Field(ge=0.0, le=600.0)]
Distance = Annotated[float, Field(gt=0.0, le=10_000.0)]
SmallAngle = Annotated[float, Field(gt=0.0, le=5.0)]
Acceptable = Annotated[float, Field(gt=0.0, le=1000.0)] | None
LimitUm = Annotated[float, Field(gt=0.0, le=100_000.0)]
LimitPerMetre = Annotated[float, Field(ge=0.0, le=10_000.0)]


# Two drivers have no wire, and each has its own form of address: `by-hand`, and `file:NAME` of a
# watched file. Driver and address must belong together; all other drivers take all other forms.
def _require_address(driver: str, url: str) -> None:
    owner, address = names.driver_of_address(url), names.ADDRESSES.get(driver)
    if owner != (driver if address else None):
        reason = f"such an address is of driver {owner}" if owner else f"it needs {address}"
        raise broken_rule(f"has driver {driver} and url {url}: {reason}")


class ControllerConfig(FileModel):
    """The robot's controller."""

    driver: ControllerName = Field(
        default="robotline", description=f"its protocol: {' or '.join(CONTROLLER_NAMES)}"
    )
    url: Url = Field(description=f"its address: {URL_FORMS}")
    serial: str | None = Field(
        default=None, description="the serial number it must have, in quotes; empty for any"
    )
    speed_percent: float = Field(
        default=30.0, gt=0.0, le=100.0, description="the share of its full speed to move at, %"
    )

    @model_validator(mode="after")
    def _driver_has_its_address(self) -> Self:
        _require_address(self.driver, self.url)
        return self


class TrackerLimitsConfig(FileModel):
    """The largest errors that the tracker's data sheet allows: a constant and a part per metre."""

    # The distance meter measures along the beam, the angle encoders across it: so the limit grows
    # fast with distance across the beam and slowly along it. `fit/tracker_noise.py` makes standard
    # deviations of these limits (MPE).
    along_um: LimitUm = Field(default=10.0, description="the limit along the beam, µm")
    along_um_per_m: LimitPerMetre = Field(
        default=0.3, description="the increase of this limit per metre of distance, µm"
    )
    across_um: LimitUm = Field(default=15.0, description="the limit across the beam, µm")
    across_um_per_m: LimitPerMetre = Field(
        default=6.0, description="the increase of this limit per metre of distance, µm"
    )
    data_sheet: str = Field(
        default="",
        description="the document that states these limits; empty: they are a common tracker's, by "
        "which no certificate is issued",
    )
    typed_by: str = Field(default="", description="who took the limits from it")


class TrackerCommonConfig(FileModel):
    """Largest errors that all shots have in common: tolerances of the fit."""

    # Averaging over shots does not reduce these errors. The fit estimates each of them, with its
    # limit as prior knowledge; so they enter the stated uncertainty, and parameters of the robot
    # need not absorb them.
    scale_ppm: LimitPerMetre = Field(
        default=17.0, description="the scale error of every length, of tracker and air, ppm"
    )
    axes_um_per_m: LimitPerMetre = Field(
        default=84.0, description="the error of the transit axis out of square, µm per metre"
    )
    reflector_mm: float = Field(
        default=0.035,
        gt=0.0,
        le=100.0,
        description="the error of the reflector's constant, mm; 0.35 if its type is unknown",
    )
    data_sheet: str = Field(
        default="",
        description="the documents that state these three; empty: they are a common tracker's, by "
        "which no certificate is issued",
    )
    typed_by: str = Field(default="", description="who took them from there")


class NestConfig(FileModel):
    """A place that stands fixed beside the robot and takes a reflector."""

    name: str = Field(min_length=1, max_length=64, description="the nest's name")
    place_mm: Point | None = Field(
        default=None,
        description="its rough place in the tracker's frame, [x, y, z] mm; empty: it is asked for",
    )
    reflector: str = Field(
        default="",
        description="the name in the tracker of the reflector in it; empty: tracker.reflector",
    )
    occupied: bool = Field(
        default=False, description="whether a reflector stays in it, so that nobody has to put one"
    )


def _check_distinct_names(nests: tuple[NestConfig, ...]) -> tuple[NestConfig, ...]:
    names = [nest.name for nest in nests]
    if len(set(names)) == len(names):
        return nests
    raise broken_rule(f"has two nests of one name, of {names}")


Nests = Annotated[tuple[NestConfig, ...], AfterValidator(_check_distinct_names)]


class KnownLengthConfig(FileModel):
    """A calibrated length, between two points at which a reflector can be put."""

    name: str = Field(min_length=1, max_length=64, description="the bar's name")
    length_mm: Distance = Field(description="its length at the temperature of the cell, mm")
    std_mm: float = Field(
        gt=0.0, le=10.0, description="its standard uncertainty, temperature included, mm"
    )
    pairs: tuple[Annotated[int, Field(ge=0)], ...] = Field(
        default=(), description="the pairs that measure it; empty: all that no other length names"
    )
    nests: tuple[str, ...] = Field(
        default=(), max_length=2, description="the names of the two nests at its ends, if it has"
    )


# A length that names the pair or its two nests takes it. A length that names neither takes all
# other pairs, but only if it is the only such length: else the pair could be of either.
def bar_of(
    lengths: Sequence[KnownLengthConfig], pair: int, nests: Collection[str] = ()
) -> int | None:
    """Return the index of the known length that a pair measures, or None."""
    for place, length in enumerate(lengths):
        if pair in length.pairs or (length.nests and set(length.nests) == set(nests)):
            return place
    for_all = [place for place, length in enumerate(lengths) if not (length.pairs or length.nests)]
    return for_all[0] if len(for_all) == 1 else None


Length = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]
Percent = Annotated[float, Field(ge=-10.0, le=10.0)]


class ObjectConfig(FileModel):
    """What was measured besides the robot, or carried by it: a bed, a block, a part, a probe."""

    name: str = Field(
        min_length=1, max_length=64, description="the object's name in observations.csv"
    )
    body: Literal["tool", "half 1", "half 2"] | None = Field(
        default=None,
        description="the part of the platform that carries it: tool, half 1 or half 2; empty: the "
        "controlled point",
    )
    on: str | None = Field(default=None, description="the name of the object that it stands on")
    place_mm: Point | None = Field(
        default=None, description="its place on its body, or in the base frame, [x, y, z] mm"
    )
    std_mm: float | None = Field(
        default=None,
        gt=0.0,
        le=1000.0,
        description="1 σ of what is stated of it: its place, height or length, mm",
    )
    turn_deg: Point | None = Field(
        default=None,
        description="the rotation vector of its axes, seen from those of its body, [x, y, z], deg",
    )
    turn_std_deg: float | None = Field(
        default=None, gt=0.0, le=180.0, description="1 σ of this turn or of its axis, deg"
    )
    axis: Direction | None = Field(
        default=None,
        description="the direction on its body in which a gauge is pressed; empty: its z",
    )
    shrinkage_percent: Percent = Field(
        default=0.0, description="how much a printed part shrank before it was measured, %"
    )
    shrinkage_std_percent: float | None = Field(
        default=None,
        ge=0.0,
        le=10.0,
        description="1 σ of this shrinkage, %: 0.3 of a usual plastic; empty: nothing is known",
    )
    height_mm: Length | None = Field(
        default=None, description="the height of a block above what it stands on, mm"
    )
    length_mm: Distance | None = Field(
        default=None, description="the length of a bar or gauge block, mm"
    )
    length_std_mm: float | None = Field(
        default=None, gt=0.0, le=1000.0, description="1 σ of this length; empty: that of std_mm"
    )


def _check_objects(objects: tuple[ObjectConfig, ...]) -> tuple[ObjectConfig, ...]:
    names = [item.name for item in objects]
    if len(set(names)) < len(names):
        raise broken_rule(f"has two objects of one name, of {names}")
    for item in objects:
        if item.on is not None and (item.on == item.name or item.on not in names):
            raise broken_rule(f"has {item.name} on {item.on}, must be another of {names}")
    return objects


Objects = Annotated[tuple[ObjectConfig, ...], AfterValidator(_check_objects)]


class WatchConfig(FileModel):
    """How rows of a watched file are read; a header in the file takes precedence."""

    unit: Literal["mm", "m", "inch", "ft", "cm", "um"] = Field(
        default="mm", description="the unit of lengths"
    )
    columns: str = Field(
        default="",
        pattern=r"^(|(name|x|y|z|-)(,(name|x|y|z|-))*)$",
        description="the columns from the left, name,x,y,z, with - for one that is ignored; "
        "empty: the first three numbers in a row",
    )
    coordinates: Literal["actual", "nominal"] | None = Field(
        default=None, description="which of two sets of x, y and z in the header counts"
    )
    decimal: Literal["point", "comma"] | None = Field(
        default=None, description="the decimal sign; empty: as the numbers show"
    )
    encoding: Literal["utf-8", "utf-16", "cp1252"] | None = Field(
        default=None, description="the encoding of a file without a byte-order mark; empty: utf-8"
    )
    wait_s: float = Field(
        default=600.0, gt=0.0, le=86_400.0, description="how long a row is waited for, s"
    )


class TrackerConfig(FileModel):
    """The laser tracker and its reflector."""

    driver: TrackerName = Field(
        default="emscon", description=f"its protocol: {' or '.join(TRACKER_NAMES)}"
    )
    url: Url = Field(description=f"its address: {URL_FORMS}")
    serial: str | None = Field(
        default=None, description="the serial number it must have, in quotes; empty for any"
    )
    reflector: str = Field(min_length=1, description="the reflector's name in the tracker")
    measuring_time_s: float = Field(
        default=1.0, gt=0.0, le=100.0, description="the time over which a point is averaged, s"
    )
    place_mm: Point = Field(
        default=(2500.0, 0.0, -500.0),
        description="the tracker's rough place in the robot's base frame, [x, y, z] mm",
    )
    reflector_facing: Direction | None = Field(
        default=None,
        description="the direction [x, y, z] in which the reflector looks, base frame; "
        "empty: from the workspace's centre to the tracker",
    )
    acceptance_deg: float = Field(
        default=25.0,
        gt=0.0,
        lt=90.0,
        description="the largest angle of the beam to that direction, deg",
    )
    watch: WatchConfig = Field(
        default=WatchConfig(), description="how a file is read; with driver watch-file alone"
    )
    uncertainty: TrackerLimitsConfig = Field(
        default=TrackerLimitsConfig(),
        description="the limits (MPE) of its data sheet, for plans and for points without an "
        "uncertainty of their own; state them before anything is measured",
    )
    common: TrackerCommonConfig = Field(
        default=TrackerCommonConfig(),
        description="limits of what all shots have in common, by default a common tracker's; state "
        "them too before anything is measured",
    )

    @model_validator(mode="after")
    def _driver_has_its_address(self) -> Self:
        _require_address(self.driver, self.url)
        return self

    @property
    def states_no_uncertainty(self) -> bool:
        """Whether its points come without an uncertainty: they are typed, or read from a file."""
        return self.driver in names.ADDRESSES

    @property
    def acceptance_rad(self) -> float:
        """The largest angle of the beam to the reflector's direction."""
        return math.radians(self.acceptance_deg)


class PlanConfig(FileModel):
    """Defaults of `pkmcal plan`."""

    shots: int = Field(
        default=120,
        ge=2,
        le=10_000,
        multiple_of=2,
        description="the number of shots to identify from, two a pair",
    )
    validation_pairs: int = Field(
        default=20, ge=0, le=5000, description="the number of pairs to validate on, never fitted"
    )
    placement: Literal["boundary", "optimal"] = Field(
        default="boundary",
        description="where: boundary (near the limits, as in the paper) or optimal",
    )
    seed: int = Field(default=1, ge=0, description="the seed of what is drawn at random")
    drift_shots: int | None = Field(
        default=None,
        ge=2,
        le=100,
        description="the number of shots at one pose, from start to end; empty: one in 20 shots",
    )


class SettleConfig(FileModel):
    """Conditions by which the robot counts as standing still in place."""

    # Two conditions, for a robot can also stand still elsewhere: joints that move less than
    # `still_deg` during `time_s`, at angles within `in_place_deg` of the command. The fit takes the
    # measured angles, so `in_place_deg` may be much wider than the accuracy that is aimed at.
    time_s: Seconds = Field(
        default=0.2, description="the time for which the joints must be still, s"
    )
    still_deg: SmallAngle = Field(
        default=0.002, description="the largest motion of a joint that counts as still, deg"
    )
    in_place_deg: SmallAngle = Field(
        default=0.02, description="the largest distance of a joint from the commanded angle, deg"
    )
    timeout_s: Seconds = Field(
        default=10.0, description="the longest wait for a move and its settling, above time_s, s"
    )

    @property
    def still_rad(self) -> float:
        """The largest motion of a joint that counts as still."""
        return math.radians(self.still_deg)

    @property
    def in_place_rad(self) -> float:
        """The largest distance of a joint from the commanded angle."""
        return math.radians(self.in_place_deg)

    @field_validator("timeout_s")
    @classmethod
    def _check_timeout(cls, timeout_s: float, fields: ValidationInfo) -> float:
        time_s = fields.data.get("time_s", 0.0)
        if timeout_s > time_s:
            return timeout_s
        raise broken_rule(f"is {timeout_s:g}, must be above time_s, which is {time_s:g}")


class GateConfig(FileModel):
    """Limits that a shot must keep to count."""

    # The gate keeps out shots of a wrong target, it does not judge the robot. So its limits are far
    # above what a calibration corrects: wide while only nominal parameters predict the point,
    # narrower once a fit of the shots so far does.
    distance_mm: Distance = Field(
        default=60.0,
        description="the largest distance from the point that nominal parameters predict, mm",
    )
    fitted_mm: Distance = Field(
        default=3.0,
        description="the largest distance from the point that a running fit predicts, mm",
    )
    temperature_change_degC: float = Field(
        default=1.0,
        gt=0.0,
        le=50.0,
        description="the largest change of the air since the start, °C",
    )
    drift_mm: Distance = Field(
        default=1.0, description="the largest distance of a drift shot from the first one, mm"
    )
    attempts: int = Field(
        default=3,
        ge=1,
        le=20,
        description="the number of attempts at a shot before it is set aside",
    )


class RunConfig(FileModel):
    """Reactions of a run to lost links, faults of drives and reflectors that are not found."""

    # with `retry` 0 a run ends at a lost link or a drive's fault, and a person decides
    retry: int = Field(
        default=0,
        ge=0,
        le=1000,
        description="how often in a row it connects again after a lost link or a drive's fault; a "
        "new shot begins the row anew",
    )
    look_back_s: Seconds = Field(
        default=60.0,
        description="the wait for a reflector that was never seen at a pose, before the robot goes "
        "back to where it was; a beam that breaks is waited for as long as it takes, s",
    )
    park_mm: Point | None = Field(
        default=None,
        description="where the key k parks the robot, [x, y, z] mm in the base frame; left "
        "out: the first drift pose",
    )


class ValidationConfig(FileModel):
    """The tests of section IV.E of the paper."""

    repeatability_approaches: int = Field(
        default=28, ge=2, le=1000, description="the number of approaches to one point"
    )
    rotation_steps: int = Field(
        default=19, ge=2, le=1000, description="the number of shots while only the plate turns"
    )
    line_points: int = Field(
        default=17, ge=3, le=1000, description="the number of shots along each straight line"
    )
    line_lengths_mm: tuple[Distance, Distance, Distance] = Field(
        default=(800.0, 800.0, 500.0), description="the lengths of the lines along x, y and z, mm"
    )
    centre_mm: Point = Field(
        default=(0.0, 0.0, -575.0),
        description="the workspace's centre in the base frame, [x, y, z] mm",
    )
    cube_edge_mm: Distance | None = Field(
        default=None,
        description="the edge of ISO 9283's cube about that centre, mm; left out: the largest cube "
        "that can be measured, wherever it is",
    )
    cube_cycles: int = Field(
        default=30, ge=2, le=1000, description="the number of visits to each of its five poses"
    )


class AcceptanceConfig(FileModel):
    """The largest errors at which the robot counts as good; None is not specified."""

    # No limit has a default: what is good enough depends on the robot's task, and a report without
    # limits states its figures and gives no verdict of pass.
    distance_mean_mm: Acceptable = Field(
        default=None, description="the limit of the mean error of distances, mm"
    )
    distance_max_mm: Acceptable = Field(
        default=None, description="the limit of the largest error of distances, mm"
    )
    rotation_mm: Acceptable = Field(
        default=None, description="the limit of the point's motion while the plate turns, mm"
    )
    rotation_deg: Acceptable = Field(
        default=None,
        description="the limit of the tool's rotation from where it is commanded, by the "
        "identification's σ, deg",
    )
    straightness_mm: Acceptable = Field(
        default=None, description="the limit of the deviation from a line, mm"
    )
    repeatability_mm: Acceptable = Field(
        default=None, description="the limit of the radius of the sphere of repeated approaches, mm"
    )
    pose_accuracy_mm: Acceptable = Field(
        default=None, description="the limit of ISO 9283's AP of the worst of five poses, mm"
    )
    pose_repeatability_mm: Acceptable = Field(
        default=None, description="the limit of ISO 9283's pose repeatability RP of the worst, mm"
    )

    @property
    def distances_mm(self) -> dict[str, float]:
        """Specified limits of distances by name: mean and max."""
        limits = {"mean": self.distance_mean_mm, "max": self.distance_max_mm}
        return {name: limit for name, limit in limits.items() if limit is not None}


class PeopleConfig(FileModel):
    """People and place, for the record."""

    operator: str = Field(default="", description="the operator's name")
    site: str = Field(default="", description="the place of the cell")
    notes: str = Field(default="", description="anything else that the record should hold")


class InstrumentsConfig(FileModel):
    """Facts that no device reports, for the record."""

    robot_serial: str = Field(default="", description="the mechanism's serial number, in quotes")
    tracker: str = Field(
        default="", description="the tracker's maker and model, if no device states them"
    )
    reflector_serial: str = Field(
        default="", description="the reflector's serial number, in quotes"
    )


class TrackerCertificateConfig(FileModel):
    """Certificate of the tracker's own calibration, by which lengths are traceable."""

    number: str = Field(default="", description="its number, in quotes")
    laboratory: str = Field(default="", description="who calibrated the tracker")
    issued: date | None = Field(default=None, description="when, as 2026-03-02")
    expires: date | None = Field(default=None, description="until when it is valid")


class CertificateConfig(FileModel):
    """Facts of the calibration that no device and no other section states.

    A number, customer or laboratory asks for a certificate: the report names what it lacks.
    """

    number: str = Field(
        default="",
        pattern=r"^[\w ./-]*$",
        description="the certificate's own number, in quotes: letters, digits, spaces and ./-_",
    )
    customer: str = Field(default="", description="name and address of the customer")
    laboratory: str = Field(default="", description="name and address of the laboratory")
    authorised_by: str = Field(default="", description="who authorises the certificate")
    robot_type: str = Field(default="", description="the robot's maker and type")
    tool: str = Field(default="", description="the tool or reflector holder on the plate")
    payload_kg: float | None = Field(default=None, ge=0.0, description="the payload, kg")
    conditions: str = Field(
        default="", description="conditions beside those measured: warm-up, doors, floor"
    )
    tracker: TrackerCertificateConfig = Field(
        default=TrackerCertificateConfig(), description="the tracker's own certificate"
    )

    @property
    def is_asked(self) -> bool:
        """Whether campaign.yaml asks for a certificate."""
        return bool(self.number or self.customer or self.laboratory)
