"""Robots with six axes, in a plane, and with joints of both kinds; measured by SciPy alone.

No code of the product moves them: legs and forearms are lengths between points.
"""

import csv
from pathlib import Path

import numpy as np
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from campaigns.robots.program import Program, trust

TRACKER_FROM_BASE = Rotation.from_euler("xyz", [8.0, -5.0, 70.0], degrees=True)
PLACE_MM = np.array([2300.0, -400.0, 900.0])
NOISE_MM = 0.012
ON_BASE = np.radians([5, 115, 125, 235, 245, 355])
ON_PLATFORM = np.radians([55, 65, 175, 185, 295, 305])
BASE_MM = np.round(400.0 * np.c_[np.cos(ON_BASE), np.sin(ON_BASE), 0.0 * ON_BASE], 6)
PLATFORM_MM = np.round(150.0 * np.c_[np.cos(ON_PLATFORM), np.sin(ON_PLATFORM), 0 * ON_PLATFORM], 6)
LEG_MM = 450.0
LEGS = "\n".join(
    f"    - {{x_mm: {a[0]}, y_mm: {a[1]}, z_mm: 0.0, plate_x_mm: {b[0]}, plate_y_mm: {b[1]}, "
    f"plate_z_mm: 0.0, joint_offset_mm: {LEG_MM}}}"
    for a, b in zip(BASE_MM.tolist(), PLATFORM_MM.tolist(), strict=True)
)
HEXAPOD = f"""schema: pkmcal/robot/1
mechanism: hexapod
name: hexapod
geometry:
  arms:
{LEGS}
limits:
  joint_mm: [0.0, 300.0]
  x_mm: [-150.0, 150.0]
  y_mm: [-150.0, 150.0]
  z_mm: [-650.0, -450.0]
  rx_deg: [-15.0, 15.0]
  ry_deg: [-15.0, 15.0]
  rz_deg: [-20.0, 20.0]
"""
FIVE_BAR = """schema: pkmcal/robot/1
mechanism: five-bar
name: five-bar
geometry:
  arms:
    - {x_mm: -100.0, y_mm: 0.0, joint_offset_deg: 90.0, arm_mm: 200.0, forearm_mm: 250.0}
    - {x_mm: 100.0, y_mm: 0.0, joint_offset_deg: 90.0, arm_mm: 200.0, forearm_mm: 250.0}
limits:
  joint_deg: [-120.0, 120.0]
  x_mm: [-120.0, 120.0]
  y_mm: [200.0, 380.0]
"""
POLAR = """schema: pkmcal/robot/1
mechanism: polar.py:POLAR
name: polar
geometry:
  arms:
    - {joint_offset_deg: 10.0, aside_mm: -40.0}
    - {joint_offset_mm: -300.0, aside_mm: -40.0}
    - {joint_offset_mm: 200.0, aside_mm: -40.0}
limits:
  joint_deg: [-120.0, 120.0]
  joint_mm: [0.0, 600.0]
  x_mm: [200.0, 500.0]
  y_mm: [-300.0, 300.0]
  z_mm: [-250.0, 250.0]
"""
POLAR_PARTS = '''"""An arm that turns about z, rises and reaches out."""

import numpy as np

from campaigns.kinematics.axes import POSITION
from campaigns.kinematics.implicit import ImplicitMechanism
from campaigns.kinematics.parameters import ParameterField


class Polar(ImplicitMechanism):
    joint_kinds = ("revolute", "prismatic", "prismatic")
    task_axes = POSITION
    arm_fields = (
        ParameterField("joint_offset_deg", "angle less reading, deg", "angle", "offsets"),
        ParameterField("joint_offset_mm", "place less reading, mm", "place", "offsets"),
        ParameterField("aside_mm", "aside of the arm, mm", "QUANTITY", "lengths"),
    )

    def place(self, fields, joints):
        turn, height, reach = (joints[..., k] for k in range(3))
        aside = fields["aside"][..., 0]
        x, y = np.cos(turn), np.sin(turn)
        return reach * x - aside * y, reach * y + aside * x, height

    def misfit(self, fields, joints, pose):
        place = self.place(fields, joints)
        away = np.broadcast_arrays(*(pose[..., k] - place[k] for k in range(3)))
        return np.stack(away, axis=-1)

    def first_joints(self, fields, poses):
        x, y, z = poses.T
        aside = fields["aside"][..., 0]
        reach = np.sqrt(x**2 + y**2 - aside**2)
        return np.stack([np.arctan2(y, x) - np.arctan2(aside, reach), z, reach], axis=1)

    def first_pose(self, fields, joints):
        return np.stack(self.place(fields, joints), axis=1)


POLAR = Polar("polar")
'''
ROBOTS = {"hexapod": HEXAPOD, "five-bar": FIVE_BAR, "polar": POLAR}


def robot_file(folder: Path, name: str, quantity: str = "place") -> Path:
    """Write a robot's file, and beside it the parts of the one of joints of both kinds."""
    (folder / "polar.py").write_text(POLAR_PARTS.replace("QUANTITY", quantity), encoding="utf-8")
    trust(Program.read(folder / "polar.py"))
    path = folder / f"{name}.yaml"
    path.write_text(ROBOTS[name], encoding="utf-8")
    return path


class Imagined:
    """A robot that is made a little otherwise than its drawing."""

    def __init__(self, name: str, seed: int = 3):
        rng = np.random.default_rng(seed)
        self.rng = rng
        self.point_mm = getattr(self, f"_{name.replace('-', '_')}_mm")
        self.base_mm = BASE_MM + rng.normal(0.0, 1.0, BASE_MM.shape)
        self.platform_mm = PLATFORM_MM + rng.normal(0.0, 0.5, PLATFORM_MM.shape)
        self.leg_mm = LEG_MM + rng.normal(0.0, 1.0, 6)
        self.crank_mm, self.forearm_mm = 200.0 + rng.normal(0.0, 0.5, 2), np.array([250.4, 249.7])
        self.angles = np.radians([90.0, 90.0]) + np.radians(rng.normal(0.0, 0.3, 2))

    def _hexapod_mm(self, row: dict[str, str]) -> np.ndarray:
        legs = self.leg_mm + [float(row[f"q{leg}_mm"]) for leg in range(6)]
        pose = [float(row[f"{c}_mm"]) for c in "xyz"]
        pose += np.radians([float(row[f"r{c}_deg"]) for c in "xyz"]).tolist()

        def misfit(pose: np.ndarray) -> np.ndarray:
            ends = pose[:3] + Rotation.from_rotvec(pose[3:]).apply(self.platform_mm)
            return np.linalg.norm(ends - self.base_mm, axis=1) - legs

        return fsolve(misfit, pose, xtol=1e-13)[:3]

    def _five_bar_mm(self, row: dict[str, str]) -> np.ndarray:
        angles = self.angles + np.radians([float(row[f"q{arm}_deg"]) for arm in range(2)])
        elbows = self.crank_mm[:, None] * np.c_[np.cos(angles), np.sin(angles)]
        elbows[:, 0] += [-100.3, 100.2]
        # the crossing of two circles, on the left of the way from the first elbow to the second
        way, (first, second) = elbows[1] - elbows[0], self.forearm_mm
        apart = np.linalg.norm(way)
        along = (first**2 - second**2 + apart**2) / (2.0 * apart)
        aside = np.sqrt(first**2 - along**2)
        return np.r_[elbows[0] + (along * way + aside * np.array([-way[1], way[0]])) / apart, 0.0]

    def _polar_mm(self, row: dict[str, str]) -> np.ndarray:
        turn = np.radians(10.2 + float(row["q0_deg"]))
        reach, height = 200.5 + float(row["q2_mm"]), -300.4 + float(row["q1_mm"])
        aside, x, y = -40.3, np.cos(turn), np.sin(turn)
        return np.array([reach * x - aside * y, reach * y + aside * x, height])

    def measured(self, plan: Path, to: Path) -> Path:
        """Write the shots that a tracker would take at the joints of a plan, in its frame."""
        rows = [
            row
            for row in csv.DictReader(plan.read_text(encoding="utf-8").splitlines())
            if row["set"] not in {"drift", "passes"}
        ]
        joints = [name for name in rows[0] if name.startswith("q")]
        lines = [",".join(["pair", "set", *joints, "x_mm", "y_mm", "z_mm"])]
        for row in rows:
            point = TRACKER_FROM_BASE.apply(self.point_mm(row)) + PLACE_MM
            point += self.rng.normal(0.0, NOISE_MM, 3)
            cells = [row["pair"], row["set"], *(row[each] for each in joints)]
            lines.append(",".join([*cells, *(f"{mm:.6f}" for mm in point)]))
        to.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return to
