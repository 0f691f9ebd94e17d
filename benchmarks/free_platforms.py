"""Campaigns of robots whose platform is one body, whose truth is known: real errors against σ.

The true robot is one of bars (sim/robot/bars.py): bodies, points and distances, no equation of the
estimator. Each of its parameters is beside its nominal value by a normal draw. It is measured at
poses drawn over the workspace, by one reflector and a tracker with noise; a dozen held-out pairs
are measured too. At the joints of 150 unseen poses are compared:

- position: rms of the reflector's errors, less a shift and a turn of the base;
- rotation: rms of the platform's turns, less a turn of the base and one of the platform's own axes,
  which no reflector shows.

Both stand beside what the result states of them.
"""

import argparse
import json
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.observed_truths import TrueBodies
from campaigns.arrays import Array
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.fit.tracker_noise import point_covariance_mm2
from campaigns.identification.result import IdentificationResult
from campaigns.robots.robot import RobotFile
from pkmcal import Shots, TrackerUncertainty, find_robot, identify, sample_workspace
from sim.robot.rods import rotation

PAIRS = 12
POSES = 150
STATION_MM = np.array([2300.0, -400.0, 500.0])
TOO_LARGE = 2.0
"""Real error over the stated one above which σ is wrong."""


def measure_campaign(nominal: RobotFile, shots: int, seed: int) -> dict[str, object]:
    """Measure and identify a robot; return its verdict, and errors with σ in µm and mrad."""
    rng, truth = np.random.default_rng((seed, 20)), TrueBodies(nominal, seed)
    taken = sample_workspace(nominal, shots + 2 * PAIRS, seed=seed)
    joints = nominal.kinematics.inverse(taken).values_or_raise().round(9)
    offset_mm = nominal.mechanism.points(np.zeros((1, len(nominal.mechanism.task))))[0]
    places_mm = truth.stood(joints, taken).points(offset_mm)
    seen_mm = (places_mm - STATION_MM) @ rotation(0.1, -0.2, 2.5)
    covariance = point_covariance_mm2(seen_mm, TrackerUncertainty())
    seen_mm += [rng.multivariate_normal(np.zeros(3), each) for each in covariance]
    measured = Shots.of(
        joints,
        seen_mm,
        nominal,
        covariance_mm2=covariance,
        sets=["identification"] * shots + ["validation"] * (2 * PAIRS),
        pairs=[None] * shots + [row // 2 for row in range(2 * PAIRS)],
    )
    result = identify(measured, nominal)
    return {
        "seed": seed,
        "verdict": str(result.judgement.verdict),
        **_errors(nominal, truth, result),
    }


def _errors(
    nominal: RobotFile, truth: TrueBodies, result: IdentificationResult
) -> dict[str, float]:
    """Return real and stated errors of positions, µm, and of turns, mrad, at unseen poses."""
    poses = sample_workspace(nominal, POSES, seed=99)
    joints = nominal.kinematics.inverse(poses).values_or_raise()
    stood = truth.stood(joints, poses)
    offset_mm = nominal.mechanism.points(np.zeros((1, len(nominal.mechanism.task))))[0]
    places_mm, turned = stood.points(offset_mm), stood.axes
    robot = nominal.of(
        nominal.mechanism, result.value.flat(), name="identified", limits=nominal.limits
    )
    model = robot.kinematics
    found = model.forward(joints, poses).values_or_raise()
    points_mm, covariance = model.points(found), result.uncertainty.covariance
    assert covariance is not None, "as the model with priors gives it"
    names = covariance.names
    places = model.mechanism.parameters.places(names)
    scaled = model.mechanism.parameters.file_unit[places]
    by_p = model.jacobian(joints, found)[..., places] * scaled
    of_points = model.mechanism.point_rows(found, by_p)
    factor = 1e3 * covariance.hold_out_ratio
    left_mm = fit_transform(points_mm, places_mm).apply(points_mm) - places_mm
    levers = points_mm - points_mm.mean(axis=0)
    motions = np.concatenate([np.tile(np.eye(3), (POSES, 1, 1)), -_skew(levers)], axis=2)
    answer = {
        "real_um": 1e3 * _rms(left_mm),
        "stated_um": factor * _stated(of_points, motions, covariance.array),
    }
    if len(model.mechanism.task) == 6:
        turns = _between(model.mechanism.tool_axes(found), turned)
        free = np.concatenate([np.tile(np.eye(3), (POSES, 1, 1)), turned], axis=2)
        by_turn = model.mechanism.turn_rows(found, by_p)
        answer["real_mrad"] = 1e3 * _rms(_without(turns[..., None], free)[..., 0])
        answer["stated_mrad"] = factor * _stated(by_turn, free, covariance.array)
    return answer


def _between(first: Array, second: Array) -> Array:
    """Return the small turns (N, 3) that take the second rotations to the first, rad."""
    apart = first @ second.transpose(0, 2, 1)
    way = apart - apart.transpose(0, 2, 1)
    return 0.5 * np.stack([way[:, 2, 1], way[:, 0, 2], way[:, 1, 0]], axis=1)


def _skew(vectors: Array) -> Array:
    """Return the matrices (N, 3, 3) of the cross products with vectors (N, 3)."""
    return np.stack([np.cross(vectors, axis) for axis in np.eye(3)], axis=-1)


def _without(rows: Array, motions: Array) -> Array:
    """Return rows (N, 3, k) less the best sum of motions (N, 3, m)."""
    basis = np.linalg.qr(motions.reshape(-1, motions.shape[2]))[0]
    flat = rows.reshape(len(basis), -1)
    return np.asarray((flat - basis @ (basis.T @ flat)).reshape(rows.shape))


def _stated(rows: Array, motions: Array, covariance: Array) -> float:
    """Return the rms σ of vectors by their derivatives (N, 3, k), less motions."""
    left = _without(rows, motions)
    return float(np.sqrt(np.einsum("nik,kl,nil->", left, covariance, left) / len(left)))


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def _line(rows: Sequence[Mapping[str, object]], quantity: str, unit: str) -> str:
    """Return medians of a quantity, and how many campaigns are far from what they state."""
    real, stated = (
        np.array([row[f"{kind}_{unit}"] for row in rows], dtype=float)
        for kind in ("real", "stated")
    )
    unit_text = unit.replace("um", "µm")
    return (
        f"{quantity}: real {np.median(real):.3g} {unit_text}, stated {np.median(stated):.3g} "
        f"(medians); largest {real.max():.3g}; real over stated {np.median(real / stated):.2f}, "
        f"at most {(real / stated).max():.2f}; above {TOO_LARGE:g}: "
        f"{int((real > TOO_LARGE * stated).sum())} of {len(rows)}"
    )


def main() -> None:
    """Run campaigns and print real errors against stated ones."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("robot", help="a robot file, or the name of a shipped robot")
    parser.add_argument("--campaigns", type=int, default=20)
    parser.add_argument("--shots", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true", help="one object a campaign and line")
    asked = parser.parse_args()
    nominal, rows = find_robot(asked.robot), []
    for seed in range(asked.seed, asked.seed + asked.campaigns):
        rows.append(measure_campaign(nominal, asked.shots, seed))
        if asked.json:
            print(json.dumps(rows[-1]), flush=True)
    if not asked.json:
        verdicts = [row["verdict"] for row in rows]
        counts = ", ".join(
            f"{word} {verdicts.count(word)}" for word in sorted({*map(str, verdicts)})
        )
        print(f"{nominal.name}, {asked.shots} shots: {counts}")
        print(_line(rows, "position", "um"))
        if "real_mrad" in rows[0]:
            print(_line(rows, "rotation", "mrad"))


if __name__ == "__main__":
    main()
