"""What encoders, gears and warmth leave of positions, without and with their own parameters.

python -m benchmarks.transmission [--robots N] [--json]

Truth is made by the simulated cell's own rods, gears and warm parts, with errors of manufacture
drawn: 120 random poses, each joint come to from a random side, a tracker of 0.015/√3 mm on each
coordinate. Errors of unseen positions, wanted cold, rms in µm, medians of the robots; and the share
of robots of which an F test asks for the added parameters, p < 1e-3. What is told of angles of
cranks is told of carriages by the way of a crank of 300 mm. Then how many 95 % intervals of the
added parameters hold the truth, and the time that all terms take beside the full model. Exit code 1
when a limit is missed.
"""

import math
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.shared.yardstick import Figure, Report, Table, main
from campaigns.design.pose_sampling import workspace_poses
from campaigns.estimation.f_test import log_p
from campaigns.estimation.information import covariance
from campaigns.estimation.least_squares import solve
from campaigns.estimation.residuals import PointResiduals, PositionModel
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.robots.robot import RobotFile, find_robot
from sim.geometry import KINDS, Kind, geometry_of
from sim.robot.rods import Build, Growth, Plate, RodMechanism
from sim.robot.transmission import Transmission

ROBOTS = ("par4-prototype", "delta", "linear-delta")
SHOTS, UNSEEN = 120, 120
STD_MM = 0.015 / 3**0.5
ERRORS = {"mm": 0.5, "deg": 0.1}
"""Of manufacture, standard deviations by the parameters' units."""
TURNS = 30.0
"""Of a motor for one of its crank; a carriage's screw has the pitch that compares with it."""
ARCSEC = math.radians(1.0 / 3600.0)
TIME_CONSTANTS = 3.0
"""Of warming in a campaign."""
SAID = 1e-3
Sizes = Mapping[str, float]
STEMS = {
    "eccentric": ("eccentricity_sin_deg", "eccentricity_cos_deg"),
    "ripple": ("ripple_sin_{unit}", "ripple_cos_{unit}"),
    "ratio": ("encoder_gain_ppm",),
    "backlash": ("backlash_{unit}",),
    "warm": ("arm_expansion_ppm", "forearm_expansion_ppm", "frame_expansion_ppm"),
}
"""Parameters of each cause."""
TRUTHS: Mapping[str, Sizes] = {
    "clean": dict.fromkeys(STEMS, 0.0),
    **{f"eccentricity {size}″": {"eccentric": size} for size in (20.0, 41.0, 300.0)},
    **{f"ripple {size}″": {"ripple": size} for size in (10.0, 20.0)},
    "ratio 100 ppm": {"ratio": 100.0},
    **{f"backlash {size}′": {"backlash": size} for size in (0.1, 0.3, 1.0)},
    "warm-up of 48 ppm": {"warm": 48.0},
    "41″, ripple 10″, 0.3′, 48 ppm": {"eccentric": 41, "ripple": 10, "backlash": 0.3, "warm": 48},
}
"""Sizes in arcsec, ppm and arcmin; what is named is fitted too."""
ALONE_SAID, NEVER_SAID, OVER_CLEAN = 0.9, 0.1, 1.6
LONGER = 1.5
NORMAL_95 = 1.96


@dataclass(frozen=True)
class Fitted:
    """A robot by the plain model and with its parameters, and by the full one without and with all.

    Errors of unseen positions, µm; whether the parameters are asked for; errors of these in σ;
    seconds.
    """

    errors: tuple[float, float]
    said: bool
    sigmas: tuple[float, ...]
    seconds: tuple[float, float]


def measure(robots: int) -> Report:
    tables, figures = [], []
    every: list[Fitted] = []
    for name in ROBOTS:
        file = find_robot(name).robot
        kind = KINDS[file.mechanism.name]
        found = {
            label: [one_robot(file, kind, sizes, seed) for seed in range(robots)]
            for label, sizes in TRUTHS.items()
            if not (kind.on_rails and sizes.keys() == {"eccentric"})
        }
        every += (one for own in found.values() for one in own)
        rows = {label: medians(own) for label, own in found.items()}
        columns = ("truth", "plain", "with its parameters", "said")
        table = [(label, *row) for label, row in rows.items()]
        tables.append(Table(f"{name}: unseen positions, µm", columns, table))
        plain, widened, alarms = rows.pop("clean")
        least = min(said for _, _, said in rows.values())
        worst = max(fitted for _, fitted, _ in rows.values()) / plain
        figures += [
            Figure(f"{name}: said of the clean", alarms, highest=NEVER_SAID),
            Figure(f"{name}: said, least of the others", least, lowest=ALONE_SAID),
            Figure(f"{name}: worst with its parameters, over clean", worst, highest=OVER_CLEAN),
            Figure(f"{name}: all parameters on the clean, over plain", widened / plain),
        ]
    held = [abs(sigmas) < NORMAL_95 for one in every for sigmas in one.sigmas]
    full, with_all = (statistics.median(one.seconds[at] for one in every) for at in (0, 1))
    figures += [
        Figure("95 % intervals of added parameters hold", statistics.fmean(held), "", 0.93, 0.97),
        Figure("all terms, time over the full model's", with_all / full, highest=LONGER),
    ]
    return Report(figures, tables)


def medians(found: Sequence[Fitted]) -> tuple[float, float, float]:
    plain, fitted = (statistics.median(one.errors[at] for one in found) for at in (0, 1))
    return plain, fitted, statistics.fmean(one.said for one in found)


def one_robot(file: RobotFile, kind: Kind, sizes: Sizes, seed: int) -> Fitted:
    rng = np.random.default_rng(seed)
    nominal = file.kinematics
    space, rate = nominal.mechanism.parameters, TURNS / kind.scale
    nominal = Kinematics(nominal.mechanism.with_ripples(space.phase_rate(rate)), nominal.p)
    poses = workspace_poses(nominal, file.limits, file.workspace_centre, SHOTS + UNSEEN, rng)
    encoders = nominal.inverse(poses).values_or_raise()
    sides = rng.choice([-1.0, 1.0], encoders.shape)
    warmth = np.zeros(len(poses))
    warmth[:SHOTS] = np.expm1(-TIME_CONSTANTS * np.arange(SHOTS) / SHOTS) / np.expm1(
        -TIME_CONSTANTS
    )
    true = made_robot(nominal, kind, rng)
    gears = drawn_gears(kind, sizes, rng)
    joints = gears.joints(encoders)
    joints -= 0.5 * sizes.get("backlash", 0.0) * 60.0 * ARCSEC * kind.scale * sides
    grown = [Growth(*[1e-6 * sizes.get("warm", 0.0) * part] * 3) for part in warmth]
    level = [Plate.level(kind, pose[:3], float(pose[3:].sum())) for pose in poses]
    settled = [true.settle(*row)[0] for row in zip(joints, level, grown, strict=True)]
    points = np.array([plate.position_mm for plate in settled])
    rng = np.random.default_rng([seed, *(int(10 * size) for size in sizes.values())])
    measured = points[:SHOTS] + STD_MM * rng.standard_normal((SHOTS, 3))
    own = [stem.format(unit=kind.unit) for cause in sizes for stem in STEMS[cause]]
    added = [each for each in space.model if each.split(".")[-1] in own]
    usual, full = space.free_by_default, space.free_in_full
    all_terms = (*full, *space.transmission, *space.thermal)
    lefts, errors, seconds, sigmas = [], [], [], tuple[float, ...]()
    for free in (usual, (*usual, *added), full, all_terms):
        places = space.places(free)
        fitted, unseen = (
            PositionModel(
                nominal, places, encoders[rows], poses[rows], approach=sides[rows], regressor=warm
            )
            for rows, warm in ((slice(SHOTS), warmth[:SHOTS]), (slice(SHOTS, None), warmth[SHOTS:]))
        )
        variances = np.broadcast_to(STD_MM**2 * np.eye(3), (SHOTS, 3, 3))
        problem = PointResiduals.from_points(fitted, measured, variances)
        began_s = time.process_time()
        x = solve(problem).x
        seconds.append(time.process_time() - began_s)
        lefts.append((float(np.sum(problem.residual(x) ** 2)), 3 * SHOTS - len(x)))
        off = problem.tracker_from_base(x).apply(unseen.positions_mm(x[: len(free)]))
        errors.append(1e3 * float(np.sqrt(np.mean(np.sum((off - points[SHOTS:]) ** 2, axis=1)))))
        if len(free) == len(usual) + len(added):
            std = np.sqrt(np.diag(covariance(problem.jacobian(x))))
            known = true_terms(space, gears, sizes, kind)
            sigmas = tuple(
                float((value - known[name]) / own_std)
                for name, value, own_std in zip(free, x.tolist(), std.tolist(), strict=False)
                if known.get(name)
            )
    (plain, before), (left, after) = lefts[:2]
    said = float(log_p(before - after, before, plain - left, plain)) < math.log(SAID)
    return Fitted((errors[0], errors[1]), said, sigmas, (seconds[2], seconds[3]))


def true_terms(
    space: ParameterSpace, gears: Transmission, sizes: Sizes, kind: Kind
) -> dict[str, float]:
    """Added parameters, rad, mm and ratios; not the frame's growth, as the plate stays cold."""
    each = np.ones(kind.arms)
    values = {
        "encoder_gain": gears.ratio,
        "eccentricity_sin": gears.eccentricity * np.cos(gears.phase_rad),
        "eccentricity_cos": -gears.eccentricity * np.sin(gears.phase_rad),
        "ripple_sin": gears.ripple * np.cos(gears.ripple_phase_rad),
        "ripple_cos": -gears.ripple * np.sin(gears.ripple_phase_rad),
    }
    values["backlash"] = sizes.get("backlash", 0.0) * 60.0 * ARCSEC * kind.scale * each
    warm = 1e-6 * sizes.get("warm", 0.0) * each
    values |= {"arm_expansion": warm, "forearm_expansion": warm}
    return {
        one.name: float(values[one.field.stem][one.arm or 0])
        for one in space
        if one.field.stem in values
    }


def made_robot(nominal: Kinematics, kind: Kind, rng: np.random.Generator) -> RodMechanism:
    """Robot with perfect parts and errors of manufacture in the parameters that are free."""
    flat = {name: nominal.parameters[name] for name in kind.names}
    for name in nominal.mechanism.parameters.free_by_default:
        flat[name] += ERRORS[kind.parameters[name][1].unit] * rng.standard_normal()
    plate, perfect = np.array(nominal.mechanism.plate.joints_mm), np.zeros((kind.arms, 2))
    return RodMechanism(geometry_of(flat, kind), Build(plate, 80.0, perfect, perfect[:, 0]))


def drawn_gears(kind: Kind, sizes: Sizes, rng: np.random.Generator) -> Transmission:
    phases = rng.uniform(-math.pi, math.pi, (2, kind.arms))
    each = np.ones(kind.arms)
    return Transmission(
        eccentricity=(not kind.on_rails) * ARCSEC * sizes.get("eccentric", 0.0) * each,
        phase_rad=phases[0],
        ratio=1e-6 * sizes.get("ratio", 0.0) * rng.standard_normal(kind.arms),
        ripple=ARCSEC * kind.scale * sizes.get("ripple", 0.0) * each,
        ripple_phase_rad=phases[1],
        motor_rad=TURNS / kind.scale,
    )


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, robots=8))
