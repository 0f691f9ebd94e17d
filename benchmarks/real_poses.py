"""Calibrate a real UR10 from poses of a probe of six degrees of freedom, and test unseen poses.

Some rows count as points of a reflector, which place the tracker's frame; the others are poses.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.real_ur10 import DATA, TURNS, DataInvalid, MeasuredRows, nominal_ur10
from campaigns.arrays import Array, Index
from campaigns.fit.kinds import TURN_LEVER_MM
from campaigns.fit.predicted_rows import predict_block
from campaigns.identification.identify import fit_campaign
from campaigns.identification.objects import Object
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.other_kinds import Measured
from campaigns.robots.robot import RobotFile
from pkmcal import Shots

PLACE_STD_MM, TURN_STD_RAD = 0.03, 1.5e-4
"""Usual 1 σ of such a probe; the fit estimates the robot's own scatter beside it."""
POINTS = 20
"""Rows that count as points."""


@dataclass(frozen=True, slots=True)
class PoseFigures:
    """Unseen poses of a probe, beside what is stated of them."""

    position_mm: float
    """Errors of position in space, rms."""
    stated_mm: float
    rotation_deg: float
    """Errors of rotation, rms."""
    stated_deg: float
    chi2_per_row: float
    fitted: int
    unseen: int
    verdict: str
    reasons: tuple[str, ...]


def calibrate_poses(
    fitted: int = 60, unseen: int = 200, seed: int = 1, file: Path = DATA["ur10"]
) -> PoseFigures:
    """Fit poses, and test others; raise `DataInvalid` for a file that cannot be read."""
    rows = MeasuredRows.read(file)
    count = len(rows.points)
    if not rows.turns_deg.shape[1]:
        raise DataInvalid(f"{file}: line 1: no column {', '.join(TURNS)}")
    if fitted + unseen > count:
        raise DataInvalid(f"{file}: {count} rows, {fitted + unseen} are asked for")
    order = np.random.default_rng(seed).permutation(count)
    seen, tested = np.sort(order[:fitted]), np.sort(order[fitted : fitted + unseen])
    robot = nominal_ur10(rows, seen)
    points = seen[:: max(fitted // POINTS, 1)]
    poses = np.setdiff1d(seen, points)
    measured = [_probe(rows, poses, held_out=False), _probe(rows, tested, held_out=True)]
    options = IdentificationOptions(
        tolerances=robot.tolerances,
        workspace=robot.kinematics.forward(rows.joints[tested]).values_or_raise(),
        quantities=("position,rotation",),
    )
    campaign = fit_campaign(robot.kinematics, _shots(rows, points, robot), options, None, measured)
    judgement, fit = campaign.make_result().judgement, campaign.fit
    (block,) = campaign.kinds.held_out
    at = predict_block(fit.model, fit.at.x, fit.at.frames, block, fit.observations.middle)
    noise = sum(fit.factors[part] * v for part, v in at.noise.items())
    covariance = at.jacobian @ fit.covariance @ at.jacobian.swapaxes(1, 2) + noise
    scaled = np.linalg.solve(covariance, at.residual[..., None])[..., 0]
    stated = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    degrees = float(np.degrees(1.0 / TURN_LEVER_MM))
    return PoseFigures(
        _rms(at.residual[:, :3]),
        _rms(stated[:, :3]),
        degrees * _rms(at.residual[:, 3:]),
        degrees * _rms(stated[:, 3:]),
        float((at.residual * scaled).mean()),
        fitted,
        len(tested),
        judgement.verdict,
        judgement.reasons,
    )


def _shots(rows: MeasuredRows, points: Index, robot: RobotFile) -> Shots:
    return Shots.of(
        rows.joints[points], rows.points[points], robot, covariance_mm2=PLACE_STD_MM**2 * np.eye(3)
    )


def _probe(rows: MeasuredRows, places: Index, *, held_out: bool) -> Measured:
    """Return poses of the probe as observations."""
    turns = Rotation.from_euler("XYZ", rows.turns_deg[places], degrees=True).as_rotvec()
    std = [PLACE_STD_MM] * 3 + [TURN_LEVER_MM * TURN_STD_RAD] * 3
    return Measured(
        kind="probe",
        object=Object("T-Mac"),
        joints=rows.joints[places],
        values=np.hstack([rows.points[places], turns]),
        std_mm=std,
        held_out=held_out,
    )


def _rms(vectors: Array) -> float:
    """Return the root mean square length of vectors (M, 3)."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def text_of_poses(figures: PoseFigures) -> str:
    """Say them in lines."""
    reasons = "".join(f"\n  {reason}" for reason in figures.reasons)
    return f"""\
{figures.fitted} poses fitted, {figures.unseen} unseen, rms:
position  {figures.position_mm:.3f} mm, stated {figures.stated_mm:.3f} mm
rotation  {figures.rotation_deg:.4f}°, stated {figures.stated_deg:.4f}°
χ² a row  {figures.chi2_per_row:.2f}
verdict: {figures.verdict}{reasons}"""
