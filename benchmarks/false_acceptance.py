"""Count how often `identify` says "pass" of a robot that it has wrong.

python -m benchmarks.false_acceptance [--mechanisms NAME …] [--kinds NAME …] [--campaigns N] …

Each campaign draws a robot with errors of manufacture and one kind of further error, measures it
by the simulator's rods and a tracker whose noise is as it is stated, and identifies it. A pass is
wrong if a parameter is off by more than 4 σ, or positions by more than twice what is stated.
"""

import argparse
import math
from collections import defaultdict
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from campaigns.arrays import Array
from campaigns.errors import CampaignError
from campaigns.fit.rigid_transforms import fit_transform
from pkmcal import Shots, find_robot, identify, plan, sample_workspace
from sim.geometry import KINDS as MECHANISMS
from sim.geometry import Kind, geometry_of
from sim.robot.rods import Build, Plate, RodMechanism
from sim.robot.transmission import WEIGHTLESS, Load, Transmission

ROBOTS = {name: "par4-prototype" if name == "par4" else name for name in MECHANISMS}
KINDS: dict[str, dict[str, float]] = {
    "clean": {},
    **{f"eccentricity {size} deg": {"eccentricity": size} for size in (0.005, 0.01, 0.03)},
    **{f"ratio {size} ppm": {"ratio": size} for size in (200.0, 1000.0)},
    **{f"azimuths {size} mrad": {"azimuths": size} for size in (0.2, 0.5)},
    **{f"rods {size} mm": {"rods": size} for size in (0.05, 0.2)},
    **{f"tilts {size} mrad": {"tilts": size} for size in (0.5, 2.0)},
    **{f"backlash {size} arcmin": {"backlash": size} for size in (0.3, 1.0)},
    **{f"sag {size} mm": {"sag": size} for size in (0.05, 0.2)},
    "all small": {
        "eccentricity": 0.005, "ratio": 100.0, "azimuths": 0.2, "rods": 0.05, "tilts": 0.3,
        "backlash": 0.2,
    },
    "encoder step": {"encoder": 0.05},
    "mount moved": {"mount": 0.3},
    "gross shot": {"gross": 2.0},
}  # fmt: skip
"""Errors beside those of manufacture by effect: deg, ppm, mrad, mm or arc minutes."""
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
        """Return the true values of the model's parameters by name, where they are exact."""
        effects = KINDS[kind]
        if "sag" in effects or (parts.on_rails and {"azimuths", "tilts"} & {*effects}):
            return {}
        (rods_mm, tilts_rad), gears = self.build, self.transmission
        backlash = self.backlash if parts.on_rails else math.degrees(self.backlash)
        columns = {
            "parallelogram_skew_deg": np.degrees((rods_mm[:, 1] - rods_mm[:, 0]) / ROD_SPACING_MM),
            "axis_tilt_deg": np.degrees(tilts_rad),
            "encoder_gain_ppm": 1e6 * gears.ratio,
            "eccentricity_sin_deg": np.degrees(gears.eccentricity * np.cos(gears.phase_rad)),
            "eccentricity_cos_deg": -np.degrees(gears.eccentricity * np.sin(gears.phase_rad)),
            f"backlash_{parts.unit}": np.full(parts.arms, backlash),
        }
        values = {f"arm{a}.{n}": float(v) for n, c in columns.items() for a, v in enumerate(c)}
        for arm, error_mm in enumerate(rods_mm.mean(axis=1)):
            values[f"arm{arm}.forearm_mm"] = self.now[f"arm{arm}.forearm_mm"] + error_mm
        return self.now | values


def draw(mechanism: str, kind: str, rng: np.random.Generator) -> Truth:
    """Draw a robot with errors of manufacture and those of a kind."""
    parts, nominal = MECHANISMS[mechanism], find_robot(ROBOTS[mechanism]).parameters
    arms, size = np.arange(parts.arms), defaultdict(float, KINDS[kind])
    before = {name: nominal[name] for name in parts.names}
    for name in before:
        spread = 0.1 if "offset_deg" in name else 0.5 if name.endswith("_mm") else 0.0
        if name.endswith("elevation_deg" if parts.on_rails else "azimuth_deg"):
            spread = math.degrees(1e-3 * size["azimuths"])
        if name != "pinion_mm":  # which only scales the turn
            before[name] += spread * rng.standard_normal()
    now, arm = dict(before), rng.integers(parts.arms)
    now[f"arm{arm}.joint_offset_{parts.unit}"] += size["encoder"] * (6.0 if parts.on_rails else 1.0)
    now[f"arm{arm}.y_mm"] += size["mount"]
    off = np.full(parts.arms, math.radians(size["eccentricity"]))
    eccentricity, ripple = (0.0 * off, 57.3 * off) if parts.on_rails else (off, 0.0 * off)
    phases_rad = rng.uniform(-math.pi, math.pi, parts.arms)
    ratio = 1e-6 * size["ratio"] * (arms == arm)
    rods_mm = size["rods"] * rng.standard_normal((parts.arms, 2))
    tilts_rad = 1e-3 * size["tilts"] * rng.standard_normal(parts.arms)
    motor = 2.0 * math.pi / PITCH_MM if parts.on_rails else 1.0
    gears = Transmission(eccentricity, phases_rad, ratio, ripple, phases_rad, motor)
    backlash = math.radians(size["backlash"] / 60.0) * parts.scale
    return Truth(before, now, (rods_mm, tilts_rad), gears, backlash, size["sag"])


def points_of(
    truth: Truth, flat: dict[str, float], robot: str, joints: Array, sides: Array, near: Array
) -> Array:
    """Return points (N, 3) of the simulator's rods at encoder values, near poses (N, t)."""
    parts = MECHANISMS[robot]
    plate: Any = find_robot(ROBOTS[robot]).mechanism.plate
    build = Build(np.array(plate.joints_mm), ROD_SPACING_MM, *truth.build)
    rods = RodMechanism(geometry_of(flat, parts), build)
    load = Load(0.0, truth.sag_mm, 1.0 if parts.on_rails else CRANK_MM**2)
    moved = truth.transmission.joints(joints) - 0.5 * truth.backlash * sides
    return settled_points(rods, moved, near, np.array(plate.reflector_mm), load)


def settled_points(
    rods: RodMechanism, joints: Array, near: Array, reflector_mm: Array, load: Load = WEIGHTLESS
) -> Array:
    """Return where rods put a reflector (N, 3) at joints, near poses (N, t), less its offset."""
    points = []
    for row, pose in zip(joints, near, strict=True):
        plate = rods.settle(row, Plate.level(rods.kind, pose[:3], float(pose[3:].sum())))[0]
        if load.at_plate_n:
            plate = rods.settle(row + load.yielding(rods, row, plate), plate)[0]
        points.append(rods.reflector_mm(plate, reflector_mm) - reflector_mm)
    return np.array(points)


def stated_covariance_mm2(beams: Array) -> Array:
    """Return what a tracker states (N, 3, 3) of points (N, 3) in its frame, better along beams."""
    range_mm = np.linalg.norm(beams, axis=1)[:, None, None]
    along = (beams[:, :, None] * beams[:, None, :]) / range_mm**2
    across = (0.0075 + 3e-6 * range_mm) ** 2 * (np.eye(3) - along)
    return np.asarray(0.006**2 * along + across)


def noise_mm(covariance_mm2: Array, rng: np.random.Generator) -> Array:
    """Draw errors (N, 3) of points with covariances (N, 3, 3)."""
    drawn = rng.standard_normal((len(covariance_mm2), 3, 1))
    return np.asarray((np.linalg.cholesky(covariance_mm2) @ drawn)[..., 0])


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
    stated = stated_covariance_mm2(beams)
    measured = beams + noise_mm(stated, rng)
    fitted = [row for row, shot in enumerate(planned) if shot.purpose.value == "identification"]
    measured[rng.choice(fitted)] += [KINDS[kind].get("gross", 0.0), 0.0, 0.0]
    how: dict[str, Any] = {"approach": sides, "covariance_mm2": stated}
    how["sets"], how["pairs"] = zip(*((s.purpose.value, s.pair) for s in planned), strict=True)
    return Shots.of(joints, measured, robot, **how)


def position_error_mm(mechanism: str, truth: Truth, values: dict[str, float], seed: int) -> float:
    """Return the rms error of poses that the identified robot is told to take, frame fitted."""
    nominal = find_robot(ROBOTS[mechanism])
    robot = nominal.of(nominal.mechanism, values, name="identified", limits=nominal.limits)
    sample = sample_workspace(nominal, 150, seed=seed)
    inverse = robot.kinematics.inverse(sample)
    poses, joints = sample[inverse.is_solved], inverse.values[inverse.is_solved]
    true = points_of(truth, truth.now, mechanism, joints, np.zeros(joints.shape), poses)
    left = fit_transform(poses[:, :3], true).apply(poses[:, :3]) - true
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def judge(mechanism: str, kind: str, shots: int, seed: int) -> tuple[str, float, float]:
    """Return a verdict, the worst parameter's error in σ, positions' over what is stated."""
    rng = np.random.default_rng([seed, list(ROBOTS).index(mechanism), list(KINDS).index(kind)])
    truth, robot = draw(mechanism, kind, rng), find_robot(ROBOTS[mechanism])
    try:
        result: Any = identify(measure(mechanism, kind, truth, shots, rng), robot)
    except CampaignError as error:
        return type(error).__name__, math.nan, math.nan
    off = parameter_errors(result, robot, truth.known(kind, MECHANISMS[mechanism]))
    stated = result.position_std_mm
    if stated is None:
        return str(result.verdict), off, math.nan
    real_mm = position_error_mm(mechanism, truth, result.flat(), seed)
    return str(result.verdict), off, real_mm / stated.rms


def parameter_errors(result: Any, robot: Any, known: dict[str, float]) -> float:
    """Return the largest error of a parameter in its σ, in the datum of the result."""
    posterior, table = result.posterior, robot.mechanism.parameters
    if posterior is None or not known:
        return 0.0
    names = [name for name in posterior.names if name in result.parameters]
    tolerance, units = np.array(posterior.tolerances), np.ones(len(posterior.names))
    units[: len(names)] = table.file_unit[table.places(names)]
    nominal = {name: result.parameters[name].nominal for name in names}
    true = np.zeros(len(posterior.names))
    true[: len(names)] = [known.get(name, nominal[name]) - nominal[name] for name in names]
    true *= units / tolerance
    null = np.array(posterior.undetermined).reshape(-1, len(true))
    true = (true - null.T @ (null @ true)) * tolerance / units
    rows = zip(names, true.tolist(), strict=False)
    fitted = ((result.parameters[name], value) for name, value in rows)
    return max((abs(p.delta - value) / p.std for p, value in fitted if p.std), default=0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--mechanisms", nargs="+", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS))
    for option, default in (("campaigns", 12), ("shots", 60), ("seed", 1), ("jobs", 2)):
        parser.add_argument(f"--{option}", type=int, default=default)
    asked = parser.parse_args()
    print(f"{'':35} pass  wrong  other   worst σ   positions (medians)", flush=True)
    for mechanism, kind in product(asked.mechanisms, asked.kinds):
        seeds = range(asked.seed, asked.seed + asked.campaigns)
        rows = Parallel(asked.jobs)(delayed(judge)(mechanism, kind, asked.shots, s) for s in seeds)
        passed = [row for row in rows if row[0] == "pass"]
        wrong = [row for row in passed if row[1] > WRONG_SIGMAS or row[2] > WRONG_POSITIONS]
        sigmas, positions = np.nanmedian([row[1:] for row in rows], axis=0)
        counts = f"{len(passed):5}{len(wrong):7}{len(rows) - len(passed):7}"
        print(f"{mechanism:13}{kind:22}{counts}{sigmas:10.1f}{positions:12.2f}", flush=True)


if __name__ == "__main__":
    main()
