"""Robots of rods, every part of which is off, measured by a tracker and identified."""

import math
from dataclasses import dataclass

import numpy as np
from family_cases import Member

from campaigns.arrays import Array
from campaigns.design.pose_sampling import sample_workspace
from campaigns.estimation.datum import datum_parameters
from campaigns.estimation.estimators import Model
from campaigns.estimation.rigid_transforms import from_paper_angles
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.evaluation.mechanical_advice import Instruction
from campaigns.identification.model_selection import candidate_models, select_model, terms_to_add
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import IdentificationResult
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.robots.schema import Mechanics
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from sim.geometry import KINDS, geometry_of
from sim.robot.rods import Build, Plate, RodMechanism, turned

SPACING_MM = 80.0
MECHANICS = Mechanics(rod_distance_mm=SPACING_MM, rod_thread_pitch_mm=1.0, bolt_distance_mm=80.0)
SHOTS, UNSEEN = 100, 20
TRACKER_FROM_BASE = from_paper_angles(np.array([2.1, 0.02, -0.03]), np.array([2500.0, 400, 300]))
INSTRUMENT = TrackerUncertainty()
OTHERS_MM = 0.3
SIZES = {"joint_offset_deg": 0.15, "azimuth_deg": math.degrees(5e-4), "elevation_deg": 0.0}
ROD_MM, LEAN_RAD, JOINT_MM = 0.15, 0.5e-3, 0.1
"""1 σ of what is drawn of each part, of all arms alike, those too that place the frame."""
ECCENTRIC_DEG, PLAY_DEG = 30.0 / 3600.0, 1.0 / 60.0
SOME = 1.0 / 3.0
"""Share of robots of which one encoder sits eccentric, and of those whose gear has play."""


@dataclass(frozen=True)
class DrawnRobot:
    """Robot in the frame in which it was built."""

    member: Member
    flat: dict[str, float]
    """Contracted parameters but for rods, leans and the joints on the plate."""
    rods_mm: Array
    """Each rod's error beside its forearm's, (n, 2): right, left."""
    tilts_rad: Array
    leans_rad: Array
    joints_mm: Array
    """Errors of the bars' places on the plate, (n, 3)."""
    gears_deg: dict[str, float]
    """Of encoders and gears, by name."""

    def points_mm(self, readings: Array, sides: Array, near: Array) -> Array:
        """Reflector's places in the base frame, (N, 3), by rods that know no contraction."""
        plate, kind = self.member.mechanism.plate, KINDS[self.member.mechanism.name]
        leans = self.leans_rad if kind.on_rails else None
        where = np.array(plate.joints_mm)
        build = Build(where, SPACING_MM, self.rods_mm, self.tilts_rad, leans)
        rods = RodMechanism(geometry_of(self.flat, kind), build)
        rods._anchors_mm = rods._anchors_mm + np.repeat(self.joints_mm, 2, axis=0)
        joints = readings + self._gears(readings, sides)
        starts = (Plate.level(kind, pose[:3], float(pose[3:].sum())) for pose in near)
        settled = [rods.settle(*each)[0] for each in zip(joints, starts, strict=True)]
        return np.array([rods.reflector_mm(each, np.array(plate.reflector_mm)) for each in settled])

    def _gears(self, readings: Array, sides: Array) -> Array:
        added = np.zeros_like(readings)
        for arm in range(readings.shape[1]):
            own = {name.partition(".")[2]: np.radians(v) for name, v in self._of_arm(arm)}
            q = readings[:, arm]
            added[:, arm] = own.get("eccentricity_sin_deg", 0.0) * np.sin(q)
            added[:, arm] += own.get("eccentricity_cos_deg", 0.0) * np.cos(q)
            added[:, arm] -= 0.5 * own.get("backlash_deg", 0.0) * sides[:, arm]
        return added

    def _of_arm(self, arm: int) -> list[tuple[str, float]]:
        return [item for item in self.gears_deg.items() if item[0].startswith(f"arm{arm}.")]

    @property
    def contracted(self) -> Kinematics:
        """The model's robot of the same parts."""
        member, flat = self.member, dict(self.flat) | self.gears_deg
        skews = np.degrees((self.rods_mm[:, 1] - self.rods_mm[:, 0]) / SPACING_MM)
        for arm, skew in enumerate(skews):
            flat[f"arm{arm}.forearm_mm"] += self.rods_mm[arm].mean()
            flat[f"arm{arm}.parallelogram_skew_deg"] = skew
            flat[f"arm{arm}.axis_tilt_deg"] = math.degrees(self.tilts_rad[arm])
            for axis, off in zip("xyz", self.joints_mm[arm], strict=True):
                flat[f"arm{arm}.{axis}_mm"] -= off
        kind = KINDS[member.mechanism.name]
        if kind.on_rails:
            geometry = geometry_of(self.flat, kind)
            leaning = turned(geometry.rails, geometry.sideways, self.leans_rad)
            rails = turned(leaning, geometry.outward, self.tilts_rad)
            turns = np.radians([self.flat[f"arm{arm}.azimuth_deg"] for arm in range(len(rails))])
            out = rails[:, 0] * np.cos(turns) + rails[:, 1] * np.sin(turns)
            aside = rails[:, 1] * np.cos(turns) - rails[:, 0] * np.sin(turns)
            for arm in range(len(rails)):
                flat[f"arm{arm}.elevation_deg"] = math.degrees(math.atan2(rails[arm, 2], out[arm]))
                flat[f"arm{arm}.rail_tilt_deg"] = math.degrees(math.asin(aside[arm]))
        return Kinematics.of(member.mechanism, flat)

    def truth(self, said: Instruction) -> float:
        """How far the part that is named really is off, in its own unit, by how it was drawn.

        Rods, homes of cranks, encoders and gears as they are; what is said to be seen from others
        as it is seen from them.
        """
        nominal, space = self.member.nominal.parameters, self.member.space
        name, arm = next(iter(said.change)), said.arm
        field = space[name].field.name
        if "rod" in said.says:
            rods = self.rods_mm[arm]
            own = rods[1] if "left rod" in said.says else rods[0]
            own = rods.mean() if "rods" in said.says else own
            return float(self.flat[f"arm{arm}.forearm_mm"] - nominal[f"arm{arm}.forearm_mm"] + own)
        if field.startswith(("eccentricity", "backlash")):  # along what was found of both terms
            drawn = (by * self.gears_deg.get(term, 0.0) for term, by in said.change.items())
            return sum(drawn) / math.hypot(*said.change.values())
        if field == "joint_offset_deg":
            return self.flat[name] - nominal[name]
        if field == "joint_offset_mm":
            heights = [
                sum(self.flat[f"arm{k}.{e}_mm"] - nominal[f"arm{k}.{e}_mm"] for e in OF_A_HOME)
                - self.joints_mm[k, 2]
                for k in (0, arm)
            ]
            return float(heights[1] - heights[0])
        if field == "azimuth_deg":
            seen = "arm0.azimuth_deg" if "seen from arm 0" in said.says else ""
            return (
                self.flat[name] - nominal[name] - (self.flat[seen] - nominal[seen] if seen else 0)
            )
        seen = datum_parameters(self.member.nominal, self.contracted).parameters
        return seen.get(name, 0.0) - nominal.get(name, 0.0)


OF_A_HOME = ("joint_offset", "z")


def drawn_robot(member: Member, rng: np.random.Generator) -> DrawnRobot:
    """Robot of random parts."""
    space, flat, arms = member.space, dict(member.nominal.parameters), member.space.arms
    for name in flat:
        flat[name] += SIZES.get(space[name].field.name, OTHERS_MM) * rng.standard_normal()
    rods, joints = ROD_MM * rng.standard_normal((arms, 2)), rng.standard_normal((arms, 3))
    gears, arm = dict[str, float](), int(rng.integers(arms))
    if member.mechanism.joints[0].is_revolute and rng.random() < SOME:
        for term in ("sin", "cos"):
            gears[f"arm{arm}.eccentricity_{term}_deg"] = ECCENTRIC_DEG * rng.standard_normal()
    if member.mechanism.joints[0].is_revolute and rng.random() < SOME:
        gears[f"arm{arm}.backlash_deg"] = abs(PLAY_DEG * rng.standard_normal())
    tilts, leans = LEAN_RAD * rng.standard_normal((2, arms))
    return DrawnRobot(member, flat, rods, tilts, leans, JOINT_MM * joints, gears)


def workspace_of(member: Member) -> Array:
    poses = sample_workspace(member.nominal, member.limits, member.shipped.workspace_centre)
    assert poses is not None
    return poses


def identified(robot: DrawnRobot, rng: np.random.Generator) -> IdentificationResult:
    """What shots at random poses tell of it, each joint coming from a random side."""
    member, workspace = robot.member, workspace_of(robot.member)
    poses = workspace[rng.permutation(len(workspace))[: SHOTS + UNSEEN]]
    joints = member.nominal.inverse(poses).values_or_raise()
    sides = rng.choice([-1.0, 1.0], joints.shape)
    points = TRACKER_FROM_BASE.apply(robot.points_mm(joints, sides, poses))
    covariance = point_covariance_mm2(points, INSTRUMENT)
    noise = np.linalg.cholesky(covariance) @ rng.standard_normal((len(points), 3, 1))
    count = len(points)
    shots = Shots(
        numbers=tuple(range(count)),
        purposes=(ShotSet.IDENTIFICATION,) * SHOTS + (ShotSet.VALIDATION,) * UNSEEN,
        pairs=tuple(row // 2 for row in range(count)),
        joints=joints,
        points_in_tracker_mm=points + noise[:, :, 0],
        stated_covariance_mm2=covariance,
        approach=sides,
        commanded=poses,
        measured_utc=("",) * count,
        temperature_degC=np.full(count, np.nan),
    )
    options = IdentificationOptions(instrument=INSTRUMENT, workspace=workspace)
    models, terms = (
        candidate_models(member.space, Model.AUTO),
        terms_to_add(member.space, Model.AUTO),
    )
    return select_model(member.nominal, shots, models, options, terms=terms)
