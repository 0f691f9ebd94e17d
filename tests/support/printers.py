"""Delta printers of rods and their observations: touches of a bed, widths of a drawn part."""

import numpy as np
from rod_campaigns import TRACKER_FROM_BASE, Errors, RodRobot

from campaigns.fit.error_model import frame_columns
from campaigns.identification.objects import Object
from campaigns.identification.other_kinds import Measured
from campaigns.robots.robot import parse_robot
from campaigns.shots.shots import Shots

BED = Object("bed")
RADIUS_MM, ROD_MM, BED_MM = 174.75, 333.0, 100.0
GRID_MM = np.linspace(-BED_MM, BED_MM, 7)
DIRECTIONS = np.deg2rad([210.0, 330.0, 90.0])
ARM = """    - {{x_mm: {x:.9f}, y_mm: {y:.9f}, z_mm: 0.0, azimuth_deg: 0.0, elevation_deg: 90.0,
       joint_offset_mm: 0.0, forearm_mm: {rod}}}
"""
ROBOT = """schema: pkmcal/robot/1
mechanism: linear-delta
name: printer
geometry:
  arms:
{arms}limits:
  joint_mm: [0.0, 600.0]
  forearm_swing_deg: 75.0
workspace_centre_mm: [0.0, 0.0, 60.0]
plate_joints_mm: [[-52.0, -30.0, 0.0], [52.0, -30.0, 0.0], [0.0, 60.0, 0.0]]
"""
AS_BUILT = Errors(
    places_mm=0.7, lengths_mm=0.3, offsets=1.0, rods_mm=0.05, tilts_mrad=0.4, ratio_ppm=100.0
)


def printer_text():
    """Robot file of a printer of the size of a Kossel."""
    places = RADIUS_MM * np.stack([np.cos(DIRECTIONS), np.sin(DIRECTIONS)], axis=1)
    arms = "".join(ARM.format(x=x, y=y, rod=ROD_MM) for x, y in places)
    return ROBOT.format(arms=arms)


def printer():
    """That printer."""
    return parse_robot(printer_text(), "printer.yaml").robot


def rings(radius_mm, count):
    """The middle and so many rings of six places, (M, 2)."""
    angles = np.deg2rad(np.arange(0.0, 360.0, 60.0))
    places = [np.zeros((1, 2))]
    for ring in range(1, count + 1):
        turned = angles + (0.0 if ring % 2 else np.deg2rad(30.0))
        radius = radius_mm * ring / count
        places.append(radius * np.stack([np.cos(turned), np.sin(turned)], axis=1))
    return np.concatenate(places)


class Printer:
    """Drawn printer that touches, draws and is measured; its equations are those of rods."""

    def __init__(self, seed, errors=AS_BUILT):
        self.robot = printer()
        self.truth = RodRobot(self.robot, errors, seed)
        self.rng = np.random.default_rng([seed, 7])
        self.slopes = self.rng.normal(0.0, 1e-3, 2)

    def positions(self, joints):
        """Real positions at joints (M, n)."""
        near = self.robot.kinematics.forward(joints).values_or_raise()
        return self.truth.positions(joints, near, np.zeros_like(joints))

    def touched(self, places, level_mm=0.0):
        """Joints at which the real nozzle is so far above the bed, over commanded places (M, 2)."""
        z = np.zeros(len(places))
        above = level_mm * np.sqrt(1.0 + self.slopes @ self.slopes)
        for _ in range(3):  # each leaves less than a hundredth
            poses = np.column_stack([places, z])
            joints = self.robot.kinematics.inverse(poses).values_or_raise()
            real = self.positions(joints)
            z = z - real[:, 2] + real[:, :2] @ self.slopes + above
        return joints

    def heights(self, places, *, std_mm=0.01, level_mm=0.0, held_out=False):
        joints = self.touched(places, level_mm)
        values = level_mm + std_mm * self.rng.standard_normal(len(places))
        return Measured(
            kind="height", object=BED, joints=joints, values=values, std_mm=std_mm,
            held_out=held_out,
        )  # fmt: skip

    def widths(self, radius_mm, *, std_mm=0.05, shrinkage=(0.0, 1e-4), held_out=False, wrong=()):
        """Twelve distances on a part that shrank by 0.2 %, of which callipers know so much."""
        angles = np.deg2rad(np.arange(30.0, 390.0, 60.0))
        ring = radius_mm * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        poses = np.column_stack([np.vstack([np.zeros((1, 2)), ring]), np.full(7, 5.0)])
        joints = self.robot.kinematics.inverse(poses).values_or_raise()
        pairs = np.array([(0, k) for k in range(1, 7)] + [(k, k % 6 + 1) for k in range(1, 7)])
        real = self.positions(joints)[pairs]
        apart = np.linalg.norm(real[:, 0] - real[:, 1], axis=1)
        values = 0.998 * apart + std_mm * self.rng.standard_normal(12)
        values[list(wrong)] = 9.0
        percent, std_percent = (None if ratio is None else 100.0 * ratio for ratio in shrinkage)
        part = Object("part", shrinkage_percent=percent, shrinkage_std_percent=std_percent)
        return Measured(
            kind="distance", object=part, joints=joints[pairs], values=values, std_mm=std_mm,
            held_out=held_out,
        )  # fmt: skip

    def points(self, count, *, pairs=10, std_mm=0.015):
        """Shots of a tracker all over the workspace."""
        rng, nominal = self.rng, self.robot.kinematics
        sample = np.array(
            [[x, y, z] for x in GRID_MM for y in GRID_MM for z in (0.0, 60.0, 120.0, 200.0)]
        )
        sample = sample[np.hypot(sample[:, 0], sample[:, 1]) < BED_MM + 1.0]
        poses = sample[rng.permutation(len(sample))[: count + 2 * pairs]]
        joints = nominal.inverse(poses).values_or_raise()
        seen = TRACKER_FROM_BASE.apply(self.positions(joints))
        return Shots.of(
            joints,
            seen + std_mm * rng.standard_normal(seen.shape),
            self.robot,
            sets=["identification"] * count + ["validation"] * (2 * pairs),
            pairs=[place // 2 for place in range(count)] + [p // 2 for p in range(2 * pairs)],
            covariance_mm2=std_mm**2 * np.eye(3),
        )

    def errors_mm(self, result):
        """Real errors of the identified printer, rms: flat and xy on the bed, in space."""
        nominal = self.robot.kinematics
        return self.errors_of(nominal.of(nominal.mechanism, result.value.flat()))

    def errors_of(self, modelled):
        """The same of a modelled printer."""
        nominal = self.robot.kinematics
        flat = np.array([[x, y, z] for x in GRID_MM for y in GRID_MM for z in (0.0, 60.0, 200.0)])
        poses = flat[np.hypot(flat[:, 0], flat[:, 1]) < BED_MM + 1.0]
        joints = nominal.inverse(poses).values_or_raise()
        places = modelled.forward(joints, poses).values_or_raise()[:, :3]
        errors, motions = places - self.positions(joints), frame_columns(places)
        bed, every = poses[:, 2] == 0.0, np.ones(len(poses), dtype=bool)
        return {
            "flat": _rms_without(errors[bed][:, 2:], motions[bed][:, 2:][..., [0, 1, 5]]),
            "xy": _rms_without(errors[bed][:, :2], motions[bed][:, :2][..., [2, 3, 4]]),
            "position": _rms_without(errors[every], motions[every]),
        }


def _rms_without(errors, motions):
    """Root mean square length of errors (M, r) less the motions (M, r, k) that explain most."""
    columns = motions.reshape(errors.size, -1)
    flat = errors.ravel()
    left = flat - columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]
    return float(np.sqrt((left**2).sum() / len(errors)))
