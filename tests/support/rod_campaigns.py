"""Campaigns measured on the simulator's rods and gears, which share no equation with the fit."""

from dataclasses import dataclass, replace

import numpy as np
from remembered import remembered

from benchmarks.truths import ROD_SPACING_MM, settled_points
from campaigns.design.pose_sampling import workspace_poses
from campaigns.fit.rigid_transforms import fit_transform, from_paper_angles
from campaigns.kinematics.transmission import approach_along
from campaigns.robots.robot import find_robot
from campaigns.shots.shots import Shots
from sim.geometry import PLATE_KINDS, geometry_of
from sim.robot.rods import Build, RodMechanism
from sim.robot.transmission import Transmission

TRACKER_FROM_BASE = from_paper_angles(
    np.array([0.02, -0.03, 2.1]), np.array([2500.0, 400.0, 300.0])
)
SETTLED_POINTS = remembered(settled_points)


@dataclass(frozen=True)
class Errors:
    """Sizes (1 σ) of what is wrong with a drawn robot; of a crank in angles, of a rail in mm."""

    places_mm: float = 0.5
    lengths_mm: float = 0.5
    offsets: float = 0.2
    """deg or mm"""
    rods_mm: float = 0.0
    tilts_mrad: float = 0.0
    azimuths_mrad: float = 0.0
    eccentricity_deg: float = 0.0
    ratio_ppm: float = 0.0
    backlash: float = 0.0
    """Arc minutes or hundredths of a mm."""
    sag_mm: float = 0.0


SMALL = Errors(
    rods_mm=0.05, tilts_mrad=0.3, azimuths_mrad=0.3, eccentricity_deg=0.007, ratio_ppm=100.0,
    backlash=0.2, sag_mm=0.03,
)  # fmt: skip


class RodRobot:
    """A robot of rods and gears: encoders in, the reflector's position out."""

    def __init__(self, robot, errors, seed, reflector_mm=None):
        rng = np.random.default_rng([seed, 1])
        kind, arms = PLATE_KINDS[robot.mechanism.name], robot.mechanism.parameters.arms
        self.plate = robot.mechanism.plate
        self.reflector_mm = np.array(
            self.plate.reflector_mm if reflector_mm is None else reflector_mm
        )
        flat = {name: robot.parameters[name] for name in kind.names}
        sizes = {
            "x_mm": errors.places_mm, "y_mm": errors.places_mm, "z_mm": errors.places_mm,
            "arm_mm": errors.lengths_mm, "forearm_mm": errors.lengths_mm,
            "plate_mm": errors.lengths_mm, "joint_offset_deg": errors.offsets,
            "joint_offset_mm": errors.offsets,
            "azimuth_deg": np.degrees(1e-3 * errors.azimuths_mrad),
            "elevation_deg": np.degrees(1e-3 * errors.azimuths_mrad),
        }  # fmt: skip
        for name in flat:
            flat[name] += sizes.get(name.rpartition(".")[2], 0.0) * rng.standard_normal()
        build = Build(
            plate_joints_mm=np.array(self.plate.joints_mm),
            rod_spacing_mm=ROD_SPACING_MM,
            rod_errors_mm=errors.rods_mm * rng.standard_normal((arms, 2)),
            axis_tilts_rad=1e-3 * errors.tilts_mrad * rng.standard_normal(arms),
        )
        self.rods = RodMechanism(geometry_of(flat, kind), build)
        revolute = not kind.on_rails
        sine, cosine = np.radians(errors.eccentricity_deg) * rng.standard_normal((2, arms))
        ratio, none = 1e-6 * errors.ratio_ppm * rng.standard_normal(arms), np.zeros(arms)
        size, phase_rad = revolute * np.hypot(sine, cosine), np.arctan2(-cosine, sine)
        self.gears = Transmission(size, phase_rad, ratio, none, none)
        unit = np.radians(1.0 / 60.0) if revolute else 0.01
        self.backlash = unit * errors.backlash * np.abs(rng.standard_normal(arms))
        self.encoder_shift = np.zeros(arms)
        self.sag_mm = errors.sag_mm * rng.standard_normal()

    def positions(self, joints, near, approach=0.0):
        """Positions (N, 3) of the reflector, less its place on a level plate at θ = 0."""
        true = self.gears.joints(joints - self.encoder_shift) - 0.5 * self.backlash * approach
        points = SETTLED_POINTS(self.rods, true, near, self.reflector_mm).copy()
        points[:, 2] += self.sag_mm * (points[:, 0] ** 2 + points[:, 1] ** 2) / 400.0**2
        return points


@dataclass(frozen=True, eq=False)
class RodCampaign:
    """A nominal robot, the robot that was measured, and its shots."""

    robot: object
    truth: RodRobot
    shots: Shots

    def position_error_mm(self, found, count=60):
        """Root mean square error of positions by an identified robot, the frame best fitted."""
        rng = np.random.default_rng(77)
        nominal = self.robot.kinematics
        limits, centre = self.robot.limits, self.robot.workspace_centre
        poses = workspace_poses(nominal, limits, centre, count, rng)
        joints = nominal.inverse(poses).values_or_raise()
        real = self.truth.positions(joints, poses)
        identified = nominal.of(nominal.mechanism, found.value.flat())
        modelled = identified.forward(joints, poses).values_or_raise()[:, :3]
        left = fit_transform(modelled, real).apply(modelled) - real
        return float(np.sqrt((left**2).sum(axis=1).mean()))


def rod_campaign(
    name, errors=Errors(), *, shots=60, pairs=10, seed=1, noise_mm=0.01, stated=True,
    reflector_mm=None,
):  # fmt: skip
    """Draw a robot of a shipped kind or a file, and measure it all over its workspace.

    Its reflector is at `reflector_mm` from the controlled point; None: where the robot has it.
    """
    robot = find_robot(name).robot if isinstance(name, str) else name
    truth = RodRobot(robot, errors, seed, reflector_mm)
    rng = np.random.default_rng([seed, 2])
    count = shots + 2 * pairs
    nominal = robot.kinematics
    poses = workspace_poses(nominal, robot.limits, robot.workspace_centre, count, rng)
    joints = nominal.inverse(poses).values_or_raise()
    approach = approach_along(joints)
    points = TRACKER_FROM_BASE.apply(truth.positions(joints, poses, approach))
    points = points + noise_mm * rng.standard_normal(points.shape)
    measured = Shots.of(
        joints,
        points,
        robot,
        sets=["identification"] * shots + ["validation"] * (2 * pairs),
        pairs=[place // 2 for place in range(shots)] + [place // 2 for place in range(2 * pairs)],
        covariance_mm2=noise_mm**2 * np.eye(3) if stated else None,
        approach=approach,
    )
    return RodCampaign(robot, truth, measured)


def with_points(campaign, points):
    """The same campaign with other points (N, 3)."""
    return replace(campaign, shots=replace(campaign.shots, points_in_tracker_mm=points))


def with_joints(campaign, joints):
    """The same campaign with other encoder readings (N, n)."""
    return replace(campaign, shots=replace(campaign.shots, joints=joints))
