"""Calibrate a real UR10 from public measurements, and test σ on points kept unseen.

The robot, six joints one after the other, is the mechanism of `examples/serial_arm.py`. The data
are joints and places of a probe on its flange; who measured them says `data/ur10.md`. Where the
probe sits on the flange is not known: it is estimated from the nominal robot, once.
"""

import csv
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array, Index
from campaigns.fit.rigid_transforms import fit_transform, frame_jacobian
from campaigns.identification.hold_out import predict_points
from campaigns.identification.identify import fit_campaign
from campaigns.identification.options import IdentificationOptions
from campaigns.kinematics.limbs import Fields
from campaigns.shots.shot_sets import ShotSet
from examples.serial_arm import SerialArm, flange
from pkmcal import Kinematics, Limits, RobotFile, Shots

DATA = {"ur10": Path(__file__).parent / "data" / "ur10-joint-configurations.csv"}
JOINTS, POINT = tuple(f"q{joint}_deg" for joint in range(6)), ("x_mm", "y_mm", "z_mm")
TURNS = ("rx_deg", "ry_deg", "rz_deg")
ALPHA_DEG = (90.0, 0.0, 0.0, 90.0, -90.0, 0.0)
A_MM, D_MM = (0.0, -612.0, -572.3, 0.0, 0.0, 0.0), (127.3, 0.0, 0.0, 163.941, 115.7, 92.2)
"""The maker's table, by joint."""
SETTLED_MM = 1e-9


class DataInvalid(ValueError):
    """File of measurements that cannot be read; its words name the line."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredRows:
    """Rows of a file in the order in which they were measured."""

    joints: Array
    """(N, 6), rad"""
    points: Array
    """Places of the probe in the tracker's frame, (N, 3), mm."""
    turns_deg: Array
    """Its turns about x, y', z'' there, (N, 3); (N, 0) of a file without them."""

    @classmethod
    def read(cls, file: Path) -> Self:
        """Read rows in any order; raise `DataInvalid`."""
        rows: dict[float, list[float]] = {}
        with file.open(encoding="utf-8-sig", newline="") as text:
            table = csv.DictReader(text)
            columns = ("row", *JOINTS, *POINT)
            turns = tuple(name for name in TURNS if name in (table.fieldnames or ()))
            if lacking := [name for name in columns if name not in (table.fieldnames or ())]:
                raise DataInvalid(f"{file}: line 1: no column {', '.join(lacking)}")
            for cells in table:
                where = f"{file}: line {table.line_num}"
                number, *values = (
                    _number(cells[name], f"{where}: {name}") for name in (*columns, *turns)
                )
                if number in rows:
                    raise DataInvalid(f"{where}: row {number:g} stands there twice")
                rows[number] = values
        every = np.array([rows[number] for number in sorted(rows)])
        every = every.reshape(-1, 9 + len(turns))
        return cls(np.radians(every[:, :6]), every[:, 6:9], every[:, 9:])


def _number(cell: str | None, where: str) -> float:
    try:
        value = float(cell or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise DataInvalid(f"{where} is '{cell or ''}', must be a number")
    return value


@dataclass(frozen=True, eq=False)
class MeasuredArm(SerialArm):  # type: ignore[misc]  # examples have no types
    """Serial arm whose inverse is searched from measured joints: it bends in several ways."""

    known: Array | None = None
    """(N, 6), rad"""

    @override
    def first_joints(self, fields: Fields, poses: Array) -> Array:
        assert self.known is not None
        there = self.first_pose(fields, self.known)
        apart = np.linalg.norm(poses[:, None, :3] - there[:, :3], axis=2)
        turned = np.linalg.norm(self.tool_axes(poses)[:, None] - self.tool_axes(there), axis=(2, 3))
        return np.asarray(self.known[(apart + self.lever_mm * turned).argmin(axis=1)])


# X = A (P + R r) + b with the flange's place P and axes R by the nominal robot. Motions of the
# frame and of the probe are linear, so that a few rounds of least squares settle both.
def probe_mm(place: Array, axes: Array, points: Array) -> Array:
    """Return the probe seen from the flange (3,), by places (N, 3) and axes (N, 3, 3) of it."""
    probe, change = np.zeros(3), np.ones(3)
    while np.abs(change).max() > SETTLED_MM:
        seen = place + axes @ probe
        left = fit_transform(points, seen).apply(points) - seen
        columns = np.concatenate([frame_jacobian(seen), axes], axis=2).reshape(-1, 9)
        change = np.linalg.lstsq(columns, left.ravel(), rcond=None)[0][6:]
        probe = probe + change
    return probe


def nominal_ur10(measured: MeasuredRows, fitted: Index) -> RobotFile:
    """Return the maker's robot with a probe where the fitted rows see it."""
    each = {"a_mm": A_MM, "d_mm": D_MM, "alpha_deg": ALPHA_DEG, "joint_offset_deg": (0.0,) * 6}
    values = {f"arm{k}.{key}": row[k] for key, row in each.items() for k in range(6)}
    arm = MeasuredArm("serial-arm", known=measured.joints)
    place, axes = flange(arm.fields_of(Kinematics.of(arm, values).p), measured.joints[fitted])
    probe = probe_mm(place, axes, measured.points[fitted])
    turn = 2.0 * np.pi
    limits = Limits((-turn, turn), ((-1500.0, 1500.0),) * 3 + ((-turn, turn),) * 3)
    placed = arm.placed(np.zeros(0), None, tuple(probe.tolist()))
    return RobotFile.of(placed, values, name="ur10", limits=limits)


@dataclass(frozen=True, slots=True)
class Figures:
    """What a calibration says of itself, and what the unseen points say of it."""

    verdict: str
    before_mm: float
    """Distances between the points of unseen pairs, rms of their errors, by the nominal robot."""
    after_mm: float
    """The same by the identified parameters."""
    stated_mm: float | None
    """Stated 1 σ of positions by these parameters at the unseen rows' poses, rms in space."""
    ratio: float
    """Unseen pairs over what the whole fit predicts: also by errors that no parameter describes."""
    p: float
    """Probability of a larger χ² of these pairs."""
    unseen_mm: float
    """Unseen points off where the whole fit puts them, rms in space."""
    predicted_mm: float
    """The same by the fit's covariance."""
    chi2_per_row: float
    """χ² of unseen points a coordinate, by that covariance."""
    fitted: int
    unseen: int
    """Points in `chi2_per_row`, without those that the result names as wrong."""
    wrong: int
    """Shots that the result names as wrong, fitted and unseen."""
    seconds: float
    reasons: tuple[str, ...]


def calibrate(measured: MeasuredRows, shots: int, unseen: int, seed: int) -> Figures:
    """Fit rows, and test the result on others; raise `DataInvalid` for too few."""
    count = len(measured.points)
    if shots + unseen > count:
        raise DataInvalid(f"{count} rows, {shots + unseen} are asked for")
    order = np.random.default_rng(seed).permutation(count)
    robot = nominal_ur10(measured, order[:shots])
    # the clock of a public file is its order, which drifts need
    place = np.argsort(order[: shots + unseen])
    rows = order[place]
    is_fitted = place < shots
    given = Shots.of(
        measured.joints[rows],
        measured.points[rows],
        robot,
        sets=[(ShotSet.IDENTIFICATION if yes else ShotSet.VALIDATION).value for yes in is_fitted],
        pairs=[(k if k < shots else k - shots) // 2 for k in place.tolist()],
    )
    at_nominal = robot.kinematics.forward(given.joints)
    workspace = at_nominal.values_or_raise()[~is_fitted]
    began_s = time.process_time()
    options = IdentificationOptions(tolerances=robot.tolerances, workspace=workspace)
    campaign = fit_campaign(robot.kinematics, given, options)
    result = campaign.make_result()
    seconds = time.process_time() - began_s
    judgement, errors = result.judgement, result.residuals.unseen_mm
    test, std = judgement.hold_out, result.uncertainty.position_std_mm
    assert errors is not None
    assert test is not None
    wrong = {event.first for event in judgement.events if event.leaves_out}
    kept = np.array([row for row in np.flatnonzero(~is_fitted).tolist() if row not in wrong])
    fit = campaign.fit
    at = predict_points(fit, campaign.observations.rows(kept))
    covariance = at.jacobian @ fit.covariance @ at.jacobian.swapaxes(1, 2) + at.noise
    scaled = np.linalg.solve(covariance, at.residual[..., None])[..., 0]
    return Figures(
        verdict=judgement.verdict,
        before_mm=errors.before.rms,
        after_mm=errors.after.rms,
        stated_mm=None if std is None else std.rms,
        ratio=test.ratio,
        p=test.p,
        unseen_mm=float(np.sqrt((at.residual**2).sum(axis=1).mean())),
        predicted_mm=float(np.sqrt(covariance.trace(axis1=1, axis2=2).mean())),
        chi2_per_row=float((at.residual * scaled).sum(axis=1).mean() / 3.0),
        fitted=shots,
        unseen=len(kept),
        wrong=len(wrong),
        seconds=seconds,
        reasons=judgement.reasons,
    )


def text_of(figures: Figures) -> str:
    """Say them in lines."""
    reasons = "".join(f"  {reason}\n" for reason in figures.reasons)
    stated = "unknown" if figures.stated_mm is None else f"{figures.stated_mm:.3f}"
    by_parameters = f"{figures.before_mm:.3f} → {figures.after_mm:.3f} mm"
    of_points = f"{figures.unseen_mm:.3f} mm, predicted {figures.predicted_mm:.3f} mm"
    return f"""\
verdict: {figures.verdict} ({figures.fitted} shots fitted, {figures.wrong} of all named as wrong)
{reasons}distances of unseen pairs  {by_parameters} rms, by the identified parameters
σ of positions             {stated} mm rms, as it is stated for them
unseen points              {of_points}, rms, by the whole fit
χ² a row of these points   {figures.chi2_per_row:.2f}
pairs of them              {figures.ratio:.2f} times as far off as predicted, p = {figures.p:.2g}
time                       {figures.seconds:.1f} s"""
