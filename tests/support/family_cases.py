"""The mechanisms of the reference model: their robots, poses, shots and answers."""

import json
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from campaigns.design import pose_sampling
from campaigns.design.pose_sampling import FeasibleRegion, interior_poses
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.paper import free_names
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import find_robot

FAMILY = Path(__file__).parents[1] / "data" / "family"
VECTORS = Path(__file__).parents[1] / "data" / "vectors"
PAR4_REFERENCE = json.loads((VECTORS / "kinematics.json").read_text(encoding="utf-8"))
REFERENCE = json.loads((FAMILY / "kinematics.json").read_text(encoding="utf-8"))


def flat_in(document):
    """Values by name of a geometry in a document, mm and deg."""
    arms = enumerate(document["arms"])
    flat = {f"arm{i}.{key}": value for i, arm in arms for key, value in arm.items()}
    return flat | {key: value for key, value in document.items() if key != "arms"}


def drawn(region, count, seed):
    """Poses (count, t) of a region; draws are those of larger batches, but end sooner."""
    with patch.object(pose_sampling, "BATCH", 500):
        return interior_poses(region, count, np.random.default_rng(seed))


@dataclass(frozen=True)
class Member:
    """A mechanism with its shipped robot and what the reference model says of it."""

    name: str

    @property
    def mechanism(self):
        return self.shipped.mechanism

    @property
    def space(self):
        return self.mechanism.parameters

    @property
    def free(self):
        """Names of what the paper's method fits."""
        return free_names(self.nominal, IdentificationOptions(model="paper"))

    @property
    def reference(self):
        return REFERENCE[self.name]

    @cached_property
    def shipped(self):
        return find_robot(self.name).robot

    @property
    def nominal(self):
        return self.shipped.kinematics

    @property
    def limits(self):
        return self.shipped.limits

    @property
    def well_inside(self):
        """Leaves room for errors of ten millimetres or of a tenth of a radian."""
        narrow = self.limits.narrowed_by(joint=0.1 * self.mechanism.joints[0].scale, swing_rad=0.1)
        return replace(narrow, singularity_margin=0.3)

    @property
    def perturbed(self):
        return self.robot_in(self.reference["cases"][1]["geometry"])

    @property
    def tilted(self):
        """Far more than a workshop would leave, so that no sign and no size goes unnoticed."""
        p = self.perturbed.p.copy()
        for stem in ("elevation", "rail_tilt", "axis_tilt", "parallelogram_skew", "bar_turn"):
            places = self.space.columns.get(stem, ())
            p[list(places)] += [0.03, -0.02, 0.05, -0.04][: len(places)]
        p[self.space.places(self.space.select(group="sag"))] = [0.3, -0.2, 0.5, -0.4]
        on_plate = self.space.places(self.space.select(group="plate_joints"))
        p[on_plate] = np.resize([6.0, -4.0, 3.0, -8.0, 5.0], len(on_plate))
        p[self.space.places(self.space.select(group="reflector"))] = [40.0, -25.0, 30.0]
        return self.robot_of(p)

    @property
    def robots(self):
        return {"nominal": self.nominal, "perturbed": self.perturbed, "tilted": self.tilted}

    def robot_in(self, document):
        return Kinematics.of(self.mechanism, flat_in(document))

    def robot_of(self, vector):
        return Kinematics(self.mechanism, np.asarray(vector))

    def poses_of(self, case):
        return np.array(case["poses_mm_deg"]) * self.file_units(self.mechanism.task)

    def joints_of(self, case):
        return np.array(case["joints"]) * self.file_units(self.mechanism.joints)

    def answers(self, kind):
        """Nominal, truth and least-squares solution of the shots of that kind."""
        return json.loads((FAMILY / f"{self.name}-{kind}.json").read_text(encoding="utf-8"))

    def shots_file(self, kind):
        return FAMILY / f"{self.name}-{kind}.csv"

    def reachable_poses(self, robot, count, seed, limits=None):
        tracker_mm, facing = np.array([2500.0, 0.0, -600.0]), np.array([1.0, 0.0, 0.0])
        centre = self.shipped.workspace_centre
        region = FeasibleRegion(robot, limits or self.limits, centre, tracker_mm, facing, np.pi)
        return drawn(region, count, seed)

    def poses(self, count, seed=1):
        """Poses that the nominal and the perturbed robot can take."""
        return self.reachable_poses(self.nominal, count, seed, self.well_inside)

    def apart_mm(self, robot, truth):
        """Distances (60,) of the points of two robots at equal joints, their frames best fitted."""
        poses = self.poses(60)
        joints = truth.inverse(poses).values_or_raise()
        own, true = (
            each.forward(joints, poses).values_or_raise()[:, :3] for each in (robot, truth)
        )
        return np.linalg.norm(fit_transform(own, true).apply(own) - true, axis=1)

    @staticmethod
    def file_units(axes):
        """Inner values of one in the unit of files."""
        return np.array([axis.from_file(1.0) for axis in axes])


@dataclass(frozen=True)
class Par4Member(Member):
    """Par4, of which a reference model of its own tells poses and joints."""

    @property
    def reference(self):
        names = ("x_mm", "y_mm", "z_mm", "theta_deg")
        return {
            "cases": [
                {
                    "geometry": case["geometry"],
                    "poses_mm_deg": [[pose[name] for name in names] for pose in case["poses"]],
                    "joints": [pose["joints_deg"] for pose in case["poses"]],
                }
                for case in PAR4_REFERENCE["cases"].values()
            ]
        }

    @cached_property
    def shipped(self):
        return find_robot("par4-prototype").robot


MEMBERS = tuple(map(Member, REFERENCE))
ALL_MEMBERS = (Par4Member("par4"), *MEMBERS)
BY_NAME = {member.name: member for member in ALL_MEMBERS}


def closures_at(robot, joints, poses):
    """Closures of a level mechanism (N, n), mm: zero where it is assembled."""
    chain = robot.mechanism
    geometry = chain.geometry(robot.p)
    ends = chain.limb.upper_ends(geometry.arms, joints)
    return chain.closures(geometry, ends, poses)


def closures_by_pose(robot, joints, poses):
    """Derivatives of the closures by poses, (N, n, t), by differences."""
    aside = 1e-4 * np.eye(poses.shape[1])
    columns = [
        (closures_at(robot, joints, poses + step) - closures_at(robot, joints, poses - step)) / 2e-4
        for step in aside
    ]
    return np.stack(columns, axis=-1)


def of_members(*names):
    """Mark of a test of these members."""
    return pytest.mark.parametrize("member", [BY_NAME[name] for name in names], ids=names)


all_members = of_members(*BY_NAME)
some_members = of_members("par4", "linear-delta")
