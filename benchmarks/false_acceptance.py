"""Count how often `identify` says "pass" of a robot that it has wrong.

python -m benchmarks.false_acceptance [--mechanisms NAME …] [--kinds NAME …] [--campaigns N] …

Each campaign draws a robot with errors of manufacture and one kind of further error, measures it
by the simulator's rods and a tracker whose noise is as it is stated, and identifies it. A pass is
wrong if a parameter is off by more than 4 σ, or positions by more than twice what is stated.
"""

import argparse
import math
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import product
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from campaigns.errors import CampaignError
from pkmcal import Shots, find_robot, identify, plan, sample_workspace
from sim.geometry import KINDS as MECHANISMS
from sim.geometry import Kind, geometry_of
from sim.robot.rods import Build, Plate, RodMechanism
from sim.robot.transmission import Load, Transmission

Array = NDArray[np.float64]
ROBOTS = {name: "par4-prototype" if name == "par4" else name for name in MECHANISMS}
KINDS = (
    *("clean", "eccentricity", "ratio", "azimuths", "rods", "tilts", "backlash", "sag"),
    *("all-small", "encoder-step", "mount-moved", "gross-shot"),
)
FRAME = ("arm0.[xyz]_mm", "*azimuth_deg", "*elevation_deg", "pinion_mm")
FRAMES = {
    "i4r": (*FRAME, "arm2.x_mm"),
    "i4l": (*FRAME, "arm0.joint_offset_mm", "arm*.z_mm", "arm2.x_mm"),
    "linear-delta": (*FRAME, "arm0.joint_offset_mm", "arm*.z_mm", "arm1.x_mm"),
}
"""Parameters that stay nominal, because they only place the base frame or scale the turn."""
TRACKER_MM = np.array([2500.0, 0.0, -500.0])
ROD_SPACING_MM, PITCH_MM, CRANK_MM = 80.0, 20.0, 350.0
WRONG_SIGMAS, WRONG_POSITIONS = 4.0, 2.0


@dataclass
class Truth:
    """A robot as it was made: geometry by name (mm, deg), before a step and now, and the rest."""

    before: dict[str, float]
    now: dict[str, float]
    build: tuple[Array, Array]
    """Errors of rods (n, 2), mm, and tilts of axes (n,), rad."""
    transmission: Transmission
    backlash: float
    sag_mm: float

    def known(self, kind: str, parts: Kind) -> dict[str, float]:
        """Return the model's parameters of which the true values are exact, by name."""
        if kind == "sag" or (parts.on_rails and kind in ("azimuths", "tilts", "all-small")):
            return {}
        (rods_mm, tilts_rad), gears = self.build, self.transmission
        columns = {
            "parallelogram_skew_deg": np.degrees((rods_mm[:, 1] - rods_mm[:, 0]) / ROD_SPACING_MM),
            "axis_tilt_deg": np.degrees(tilts_rad),
            "encoder_gain_ppm": 1e6 * gears.ratio,
            "eccentricity_sin_deg": np.degrees(gears.eccentricity * np.cos(gears.phase_rad)),
            "eccentricity_cos_deg": -np.degrees(gears.eccentricity * np.sin(gears.phase_rad)),
        }
        values = {f"arm{a}.{n}": float(v) for n, c in columns.items() for a, v in enumerate(c)}
        for arm, error_mm in enumerate(rods_mm.mean(axis=1)):
            values[f"arm{arm}.forearm_mm"] = self.now[f"arm{arm}.forearm_mm"] + error_mm
        return self.now | values


def draw(mechanism: str, kind: str, rng: np.random.Generator) -> Truth:
    """Draw a robot whose errors leave the base frame where the model's held parameters put it."""
    parts, nominal = MECHANISMS[mechanism], find_robot(ROBOTS[mechanism]).parameters
    arms, held = np.arange(parts.arms), FRAMES.get(mechanism, FRAME)

    def size(of: str, full: float) -> float:
        return 0.3 * full if kind == "all-small" else full if kind == of else 0.0

    before = {name: nominal[name] for name in parts.names}
    for name in before:
        if not any(fnmatch(name, pattern) for pattern in held):
            before[name] += (0.1 if name.endswith("_deg") else 0.5) * rng.standard_normal()
    turned = "elevation_deg" if parts.on_rails else "azimuth_deg"
    for arm in arms[1:]:
        before[f"arm{arm}.{turned}"] += size("azimuths", 0.03) * rng.standard_normal()
    now, arm = dict(before), rng.integers(1, parts.arms)
    if kind == "encoder-step":
        now[f"arm{arm}.joint_offset_{parts.unit}"] += 0.3 if parts.on_rails else 0.05
    if kind == "mount-moved":
        now[f"arm{arm}.y_mm"] += 0.3
    off = np.full(parts.arms, size("eccentricity", 0.01 if parts.on_rails else 1.75e-4))
    eccentricity, ripple = (0.0 * off, off) if parts.on_rails else (off, 0.0 * off)
    phases_rad = rng.uniform(-math.pi, math.pi, parts.arms)
    ratio = size("ratio", 500e-6) * (arms == arm)
    rods_mm = size("rods", 0.1) * rng.standard_normal((parts.arms, 2))
    tilts_rad = size("tilts", 1e-3) * rng.standard_normal(parts.arms) * (arms >= 2)
    motor = 2.0 * math.pi / PITCH_MM if parts.on_rails else 1.0
    gears = Transmission(eccentricity, phases_rad, ratio, ripple, phases_rad, motor)
    backlash, sag_mm = size("backlash", 1.45e-4) * parts.scale, 0.1 if kind == "sag" else 0.0
    return Truth(before, now, (rods_mm, tilts_rad), gears, backlash, sag_mm)


def points_of(
    truth: Truth, flat: dict[str, float], robot: str, joints: Array, sides: Array, near: Array
) -> Array:
    """Return points (N, 3) of the simulator's rods at encoder values, near poses (N, t)."""
    parts = MECHANISMS[robot]
    geometry = geometry_of(flat, parts)
    plate_file = find_robot(ROBOTS[robot]).mechanism.plate
    on_plate, reflector_mm = np.array(plate_file.joints_mm), np.array(plate_file.reflector_mm)
    rods = RodMechanism(geometry, Build(on_plate, ROD_SPACING_MM, *truth.build))
    load = Load(0.0, truth.sag_mm, 1.0 if parts.on_rails else CRANK_MM**2)
    points = []
    for row, side, pose in zip(joints, sides, near, strict=True):
        moved = truth.transmission.joints(row) - 0.5 * truth.backlash * side
        plate = rods.settle(moved, Plate.level(parts, pose[:3], float(pose[3:].sum())))[0]
        if truth.sag_mm:
            plate = rods.settle(moved + load.yielding(rods, moved, plate), plate)[0]
        points.append(rods.reflector_mm(plate, reflector_mm) - reflector_mm)
    return np.array(points)


def measure(mechanism: str, kind: str, truth: Truth, shots: int, rng: np.random.Generator) -> Shots:
    """Measure a plan for the nominal robot by a tracker that is better along its beam."""
    robot = find_robot(ROBOTS[mechanism])
    planned = plan(robot, TRACKER_MM.tolist(), shots=shots).shots
    joints = np.array([shot.joints for shot in planned])
    sides = rng.choice([-1.0, 1.0], joints.shape)
    at = (mechanism, joints, sides, robot.kinematics.forward(joints).values_or_raise())
    step = rng.uniform(0.25, 0.75) * len(planned)
    is_late = np.arange(len(planned))[:, None] >= (step if truth.now != truth.before else 0.0)
    points = points_of(truth, truth.now, *at)
    if not is_late.all():
        points = np.where(is_late, points, points_of(truth, truth.before, *at))
    beams = points - TRACKER_MM
    range_mm = np.linalg.norm(beams, axis=1)[:, None, None]
    along = (beams[:, :, None] * beams[:, None, :]) / range_mm**2
    stated = 0.006**2 * along + (0.0075 + 3e-6 * range_mm) ** 2 * (np.eye(3) - along)
    measured = beams + (np.linalg.cholesky(stated) @ rng.standard_normal((*beams.shape, 1)))[..., 0]
    if kind == "gross-shot":
        measured[rng.integers(len(planned))] += [2.0, 0.0, 0.0]
    how: dict[str, Any] = {"approach": sides, "covariance_mm2": stated}
    how["sets"], how["pairs"] = zip(*((s.purpose.value, s.pair) for s in planned), strict=True)
    return Shots.of(joints, measured, robot, **how)


def position_error_mm(mechanism: str, truth: Truth, values: dict[str, float], seed: int) -> float:
    """Return the rms error of poses that the identified robot is told to take, frame fitted."""
    nominal = find_robot(ROBOTS[mechanism])
    robot = nominal.of(nominal.mechanism, values, name="identified", limits=nominal.limits)
    sample = sample_workspace(nominal, 150, seed=seed)
    inverse = robot.kinematics.inverse(sample)
    poses, joints = sample[inverse.found], inverse.values[inverse.found]
    true = points_of(truth, truth.now, mechanism, joints, np.zeros(joints.shape), poses)
    wanted, true = poses[:, :3] - poses[:, :3].mean(axis=0), true - true.mean(axis=0)
    u, _, vt = np.linalg.svd(wanted.T @ true)
    return float(np.sqrt(np.mean(np.sum((wanted @ u @ vt - true) ** 2, axis=1))))


def judge(mechanism: str, kind: str, shots: int, seed: int) -> tuple[str, float, float]:
    """Return a verdict, the worst parameter's error in σ, positions' over what is stated."""
    rng = np.random.default_rng([seed, list(ROBOTS).index(mechanism), KINDS.index(kind)])
    truth, robot = draw(mechanism, kind, rng), find_robot(ROBOTS[mechanism])
    try:
        result: Any = identify(measure(mechanism, kind, truth, shots, rng), robot)
    except CampaignError as error:
        return type(error).__name__, math.nan, math.nan
    found, known = result.parameters, truth.known(kind, MECHANISMS[mechanism])
    off = [abs(p.value - known[n]) / p.std for n, p in found.items() if p.std and n in known]
    real_mm = position_error_mm(mechanism, truth, {n: p.value for n, p in found.items()}, seed)
    stated = result.position_std_mm
    ratio = real_mm / stated.total_mean if stated else math.nan
    return str(result.verdict), max(off, default=0.0), ratio


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--mechanisms", nargs="+", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    for option, default in (("campaigns", 12), ("shots", 120), ("seed", 1), ("jobs", 2)):
        parser.add_argument(f"--{option}", type=int, default=default)
    asked = parser.parse_args()
    print(f"{'':28} pass  wrong  other   worst σ   positions (medians)", flush=True)
    for mechanism, kind in product(asked.mechanisms, asked.kinds):
        seeds = range(asked.seed, asked.seed + asked.campaigns)
        rows = Parallel(asked.jobs)(delayed(judge)(mechanism, kind, asked.shots, s) for s in seeds)
        passed = [row for row in rows if row[0] == "pass"]
        wrong = [row for row in passed if row[1] > WRONG_SIGMAS or row[2] > WRONG_POSITIONS]
        sigmas, positions = np.nanmedian([row[1:] for row in rows], axis=0)
        counts = f"{len(passed):5}{len(wrong):7}{len(rows) - len(passed):7}"
        print(f"{mechanism:13}{kind:15}{counts}{sigmas:10.1f}{positions:12.2f}", flush=True)


if __name__ == "__main__":
    main()
