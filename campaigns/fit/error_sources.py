"""Sources of error: every part of robot and tracker that may be off, and how far it usually is.

All of them are unknowns of every fit. A source's prior is a normal distribution about nominal
whose 1 σ is the source's tolerance times the size of its group; the sizes of learned groups are
estimated from the shots (`fit.py`). An error that a robot does not have therefore costs little
uncertainty, and one that it has is corrected and stated.

This table is the only place that names the sources: priors, the budget, findings and the
documentation follow from its rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.parameters import Parameter, Unit

DEG = float(np.pi / 180.0)
ARCMIN, ARCSEC = DEG / 60.0, DEG / 3600.0


@dataclass(frozen=True, slots=True)
class ErrorSource:
    """Group of unknowns of one kind: tolerance in mm, rad or ratios (1 σ), meaning and remedy."""

    group: str
    words: str
    of_angles: float
    """Tolerance of its angles, rad; of ratios as they are."""
    of_lengths: float
    """Tolerance of its lengths, mm."""
    source: str
    """Where the tolerance comes from."""
    remedy: str
    """Advice to a user whose value is far outside of its tolerance."""
    is_learned: bool = True
    """Whether the group's size is estimated; geometry keeps its broad tolerance."""
    drift_of_angles: float = 0.0
    """Change of angles until a later check, 1 σ, rad: settling screws and homing."""
    drift_of_lengths: float = 0.0
    """Change of lengths until a later check, 1 σ, mm."""


MACHINED = "parts of a machine shop: 0.5 mm over 500 mm"
MEASURE = "compare with the drawing: a wrong nominal value, or a part mounted elsewhere"
SOURCES: Mapping[str, ErrorSource] = {
    source.group: source
    for source in (
        ErrorSource("places", "places of motors and rails", 5 * DEG, 5.0,
                    "any robot set up by a tape measure", MEASURE,
                    is_learned=False, drift_of_lengths=0.01),
        ErrorSource("lengths", "lengths of arms and forearms", 5 * DEG, 5.0,
                    "any robot set up by a tape measure", MEASURE,
                    is_learned=False, drift_of_lengths=0.005),
        ErrorSource("offsets", "joint offsets", 5 * DEG, 5.0,
                    "homing by eye", "home the joints again",
                    is_learned=False, drift_of_angles=0.002 * DEG, drift_of_lengths=0.01),
        ErrorSource("plate", "the platform's own sizes", 5 * DEG, 5.0,
                    "any plate that was measured by a calliper", MEASURE,
                    is_learned=False, drift_of_lengths=0.005),
        ErrorSource("reflector", "the reflector's place on the plate", 5 * DEG, 30.0,
                    "a holder of unknown size; 3 mm where robot.yaml states its place",
                    "measure where the reflector is on the plate, and correct reflector_mm in "
                    "robot.yaml"),
        ErrorSource("plate_joints", "the joints' places on the plate", 5 * DEG, 5.0,
                    "any plate that was measured by a calliper",
                    "measure where the joints are on the plate, and correct plate_joints_mm in "
                    "robot.yaml", is_learned=False),
        ErrorSource("azimuths", "directions of the arms about z", 2e-3, 1.0, MACHINED, MEASURE),
        ErrorSource("rails", "misalignment of rails", 2e-3, 1.0, MACHINED, MEASURE),
        ErrorSource("rods", "differences of a forearm's two rods", 2e-3, 0.2,
                    "rods cut to 0.1 mm, 90 mm apart", "measure both rods of the forearm named"),
        ErrorSource("axes", "tilt of motor axes and upper bars", 1.5e-3, 0.1,
                    "surfaces milled in one clamping", "check the motor's seat by a level"),
        ErrorSource("bars", "misalignment of the plate's bars", 1e-3, 0.1,
                    "a plate milled in one clamping", "check the plate's bars"),
        ErrorSource("eccentricity", "encoder eccentricity and arm sag", 0.03 * DEG, 0.05,
                    "encoder kits on their own shaft", "re-centre the encoder named"),
        ErrorSource("ratio", "gear ratios and screw pitches", 5e-4, 5e-4,
                    "screws of class T7, stretched belts", "correct the ratio in the controller"),
        ErrorSource("ripple", "ripple of gears and drives", 20 * ARCSEC, 0.02,
                    "strain wave gears of one arc minute", "replace the gear named"),
        ErrorSource("backlash", "lost motion of gears and drives", ARCMIN, 0.05,
                    "gears of normal backlash", "take up or replace the gear named"),
        ErrorSource("compliance", "drive compliance under the plate's weight", ARCMIN, 0.05,
                    "gears of 3 N m per arc minute, belts of 200 N/mm, and 1 kg at 300 mm",
                    "stiffen the drive named, or lighten the plate"),
        ErrorSource("growth", "expansion of warm parts", 15e-6, 15e-6,
                    "steel 12, aluminium 23, carbon fibre 0 ppm/°C",
                    "check the material in robot.yaml, and where its temperature is measured"),
        ErrorSource("sag", "the plate's sag by reach", 0.05, 0.05,
                    "frames that bend by their robot's weight", "stiffen the frame"),
        ErrorSource("constant", "the reflector's constant", 0.02, 0.02,
                    "a reflector of a known type",
                    "enter the reflector's type in the tracker, or measure a known length"),
        ErrorSource("transit", "squareness of the tracker's transit axis", 10 * ARCSEC, 0.05,
                    "a common tracker's data sheet", "have the tracker compensated"),
        ErrorSource("scale", "the tracker's scale", 10e-6, 10e-6,
                    "a common tracker's data sheet, and the air's temperature to 10 °C",
                    "measure a known length", is_learned=False),
    )
}  # fmt: skip
TRACKER_SOURCES: Mapping[str, Unit] = {"constant": "mm", "transit": "deg", "scale": "ppm"}
"""Sources that are no parameter of the robot, with their units on the screen."""
SCATTER_TOLERANCE_MM = 0.5
"""Tolerance of the scatter of the robot's point, 1 σ an axis: a robot that scatters more does not
repeat, or joints and points are of different moments."""


def scatter_tolerance_of_joints(*, revolute: bool) -> float:
    """Return the tolerance (1 σ) of the scatter of joints, rad of cranks, mm of carriages."""
    return 5 * ARCMIN if revolute else 0.1


def scatter_tolerances(joints: Sequence[Axis]) -> Array:
    """Return the tolerance (1 σ) of the scatter of each joint, (n,), rad or mm."""
    return np.array([scatter_tolerance_of_joints(revolute=axis.is_revolute) for axis in joints])


def by_first_joint(joints: Sequence[Axis], by_joint: Array) -> Array:
    """Return ∂point/∂joints (N, 3, n) by what each joint scatters while the first scatters by 1."""
    tolerances = scatter_tolerances(joints)
    return np.asarray(by_joint * (tolerances / tolerances[0]))


def tolerance_of(parameter: Parameter) -> float:
    """Return the tolerance (1 σ) of a parameter in mm, rad or as a ratio."""
    source = SOURCES[parameter.field.group]
    return source.of_lengths if parameter.unit == "mm" else source.of_angles


def middle_of(points: Array) -> Array:
    """Return the mean (3,) of points (N, 3), 0 of none."""
    return np.asarray(points.sum(axis=0) / max(1, len(points)))


def tracker_columns(points: Array, middle: Array | None = None) -> dict[str, Array]:
    """Return the motions of points (N, 3), seen from the tracker, by a unit of each error, (N, 3).

    Units are mm of the reflector's constant, rad of the transit axis out of square, and the ratio
    of the error of scale about the `middle` (3,) of all points in one frame; None: of these.
    """
    # Constant: along the beam. Transit axis tilted by τ: the azimuth is off by τ tan(elevation),
    # which at the horizontal distance r cos(elevation) is τ z sideways. Scale: about the points'
    # middle, for the frame takes up any shift.
    distance = np.linalg.norm(points, axis=1, keepdims=True)
    # on the tracker's vertical axis no direction is sideways: 1 mm avoids the division by 0
    level = np.maximum(np.hypot(points[:, :1], points[:, 1:2]), 1.0)
    sideways = np.concatenate([-points[:, 1:2], points[:, :1], 0.0 * distance], axis=1) / level
    return {
        "constant": points / distance,
        "transit": sideways * points[:, 2:],
        "scale": points - (middle_of(points) if middle is None else middle),
    }
