"""The method of the paper: identify a robot by the distances of pairs alone (eq. 19).

A distance between two points is the same in every frame, so neither the tracker's place nor its
axes have to be known or fitted. The residual of a pair is the distance between the positions that
the model has at the two joint readings, minus the measured distance. Levenberg-Marquardt minimises
the sum of the squared residuals, all with equal weight, over 22 of a Par4's 29 parameters: the
others would turn or shift the whole robot, which distances cannot show, or are held by the paper's
hypotheses. σ follow from the residuals themselves, s² = Σr²/ν: those of the parameters from
s² (J'J)⁺, those of positions from the parameters'.

The method is here to repeat the paper and to compare with it. It uses one number of the six that
a pair gives, models no noise, no transmission and no change in time, and its σ hold only if the
geometry is all that is wrong: `GEOMETRY_ALONE` says so in every result.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.evaluation.region import Region
from campaigns.fit.rigid_transforms import directions
from campaigns.identification import findings
from campaigns.identification.findings import Finding
from campaigns.identification.hold_out import distance_errors
from campaigns.identification.options import IdentificationOptions, matching
from campaigns.identification.positions import FEWEST_POSES, std_of_positions
from campaigns.identification.result import (
    Excluded,
    IdentificationResult,
    Judgement,
    ModelledTable,
    ParameterCovariance,
    PositionStd,
    Provenance,
    Residuals,
    ResidualTable,
    Share,
    Uncertainty,
    Value,
    identified_parameters,
)
from campaigns.kinematics.model import Kinematics, KinematicSolution, NoSolution
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

STEP_TOLERANCE = 1e-12
"""Relative change of the parameters at which the solver stops: rounding, not a choice."""
GEOMETRY_ALONE = Finding(
    "geometry-alone",
    "σ count the fitted lengths, places and joint offsets alone: tilts, gears, backlash and the "
    "tracker's scale are left out, and a robot with usual ones errs by one to three times these σ",
)
"""Finding of every result, which is only reported."""


def free_names(nominal: Kinematics, options: IdentificationOptions) -> tuple[str, ...]:
    """Return the parameters that the paper's method fits, by the options."""
    mechanism = nominal.mechanism
    table = mechanism.parameters
    freed = {name for pattern in options.free for name in matching(pattern, table)}
    fixed = {name for pattern in options.fix for name in matching(pattern, table)}
    free = {*mechanism.free_by_paper, *freed} - fixed
    return tuple(name for name in table.of_robot if name in free)


def identify_as_paper(
    nominal: Kinematics, shots: Shots, at_nominal: KinematicSolution, options: IdentificationOptions
) -> IdentificationResult:
    """Identify from the distances of the identification pairs; raise `ShotsMissing` for too few."""
    # x_scale="jac" scales the columns: mm and rad differ by orders of magnitude in their effect.
    # The pseudo-inverse in s² (J'J)⁺ is finite also where distances do not distinguish parameters.
    names = free_names(nominal, options)
    table = nominal.mechanism.parameters
    places = table.places(names)
    units = table.file_unit[places]
    rows, excluded = _pairs(shots, at_nominal, ShotSet.IDENTIFICATION, options)
    if len(rows) < len(names):
        raise ShotsMissing(
            f"{len(rows)} pairs cannot give {len(names)} parameters",
            remedy=f"measure at least {len(names)} pairs, better 60; or fix some parameters",
        )
    problem = _Distances(nominal, places, shots.rows(rows.ravel()), at_nominal.values[rows.ravel()])
    start = nominal.whole_p[places]
    try:
        solved = scipy.optimize.least_squares(
            problem.residual,
            start,
            problem.jacobian,
            method="lm",
            x_scale="jac",
            xtol=STEP_TOLERANCE,
        )
    except (NoSolution, np.linalg.LinAlgError) as error:
        raise _no_robot(shots, rows, problem.residual(start), error) from error
    # With one pair for each parameter the fit is exact: no residuals are left to estimate σ from.
    dof = len(rows) - len(names)
    variance = float((solved.fun**2).sum() / dof) if dof else np.nan
    jacobian = np.asarray(solved.jac, dtype=np.float64)
    covariance = variance * np.linalg.pinv(jacobian.T @ jacobian) / np.outer(units, units)
    identified = problem.robot(solved.x)
    validation, unusable = _pairs(shots, at_nominal, ShotSet.VALIDATION, options)
    nominal_poses = at_nominal.values
    solution = identified.forward(shots.joints, nominal_poses, shots.approach)
    poses = solution.values
    points = identified.points(nominal_poses), identified.points(poses)
    fitted = distance_errors(shots, rows, *points)
    unseen = None
    if len(validation):
        unseen = distance_errors(shots, validation, *points)
    counted = np.union1d(rows, validation)
    counted = counted[solution.is_solved[counted]]
    std = np.sqrt(np.diag(covariance)).tolist()
    values = zip((solved.x / units).tolist(), std, strict=True)
    stored = ParameterCovariance(names, tuple(map(tuple, covariance.tolist())))
    positions = Uncertainty()
    if dof and options.workspace is not None:
        positions = _positions(identified, stored, options.workspace, poses[np.unique(rows)])
    modelled = ModelledTable.of(shots.rows(counted), nominal_poses[counted], poses[counted])
    return IdentificationResult(
        value=Value(identified_parameters(nominal, dict(zip(names, values, strict=True)))),
        uncertainty=replace(positions, covariance=stored),
        judgement=Judgement.of(
            (*_findings(unseen, positions, converged=bool(solved.success)), GEOMETRY_ALONE),
            _gains(unseen, positions),
            excluded=(*excluded, *unusable),
        ),
        residuals=Residuals.of(fitted, unseen, modelled),
        provenance=Provenance("paper", bool(solved.success), int(solved.nfev)),
    )


class _Distances:
    """Distances of pairs by parameters; rows 2 i and 2 i + 1 are the shots of pair i."""

    def __init__(self, nominal: Kinematics, places: Index, shots: Shots, near: Array) -> None:
        self._nominal, self._places, self._shots, self._near = nominal, places, shots, near
        self._pairs = np.arange(len(shots)).reshape(-1, 2)

    def robot(self, x: Array) -> Kinematics:
        """Return the robot with the free parameters x (F,)."""
        p = self._nominal.whole_p
        p[self._places] = x
        return Kinematics(self._nominal.mechanism, p)

    def residual(self, x: Array) -> Array:
        """Return modelled minus measured distances (M,), mm."""
        poses = self.robot(x).forward(self._shots.joints, self._near, self._shots.approach)
        points = self._nominal.points(poses.values_or_raise())
        return self._shots.distance_errors_mm(self._pairs, points)

    def jacobian(self, x: Array) -> Array:
        """Return the derivatives of the distances, (M, F)."""
        robot, shots = self.robot(x), self._shots
        # A small motion of an end changes a distance by its component along the pair's line.
        poses = robot.forward(shots.joints, self._near, shots.approach).values_or_raise()
        by = robot.point_jacobian(shots.joints, poses, shots.approach)[..., self._places]
        first, second = self._pairs.T
        along = directions(robot.points(poses), first, second)
        return np.asarray(np.einsum("mk,mkf->mf", along, by[second] - by[first]))


def _pairs(
    shots: Shots, at_nominal: KinematicSolution, purpose: ShotSet, options: IdentificationOptions
) -> tuple[Index, tuple[Excluded, ...]]:
    """Return the rows (M, 2) of the usable pairs of a set, and the other pairs with the reason."""
    rows = shots.whole_pairs(purpose).rows
    session = shots.session[rows]
    in_one_frame = np.ones(len(rows), dtype=bool)
    if options.sessions:  # the tracker moved between sessions: no distance between two of them
        in_one_frame = session[:, 0] == session[:, 1]
    is_solved = at_nominal.is_solved[rows].all(axis=1)
    excluded = tuple(
        Excluded(reason, pair=shots.pairs[row])
        for reason, is_wrong in (
            ("its shots are of two sessions", ~in_one_frame),
            ("the nominal robot cannot be assembled at its joints", in_one_frame & ~is_solved),
        )
        for row in rows[is_wrong, 0].tolist()
    )
    return rows[in_one_frame & is_solved], excluded


def _no_robot(shots: Shots, rows: Index, misfits_mm: Array, error: Exception) -> ShotsInvalid:
    """Return the refusal of pairs (M, 2) that lead to no robot; it names the pair farthest off.

    `misfits_mm` (M,) are the errors of the nominal robot's distances.
    """
    worst = int(np.abs(misfits_mm).argmax())
    pair, typical_mm = shots.pairs[rows[worst, 0]], float(np.median(np.abs(misfits_mm)))
    return ShotsInvalid(
        f"the pairs lead to no robot ({error}): pair {pair} is {abs(misfits_mm[worst]):.2f} mm off "
        f"the nominal robot's distance, half of all pairs at most {typical_mm:.2g} mm",
        remedy=f"measure pair {pair} again or leave it out; or identify without --model paper, "
        "which leaves wrong shots out by itself",
    )


def _positions(
    identified: Kinematics, covariance: ParameterCovariance, workspace: Array, measured: Array
) -> Uncertainty:
    """Return the uncertainty of positions at poses (N, t); nothing where too few can be taken.

    `measured` (M, t) are the poses of the fitted shots.
    """
    # As `uncertainty_of_positions` has it: size in the frame of the sample alone, region in one
    # frame of sample and shots.
    _, sample = identified.select_reachable(workspace)
    if len(sample) < FEWEST_POSES * len(workspace):
        return Uncertainty()
    std = std_of_positions(identified, covariance, sample, sample[:0])
    of_both = std_of_positions(identified, covariance, np.vstack([sample, measured]), sample[:0])
    count, task = len(sample), identified.mechanism.task
    region = Region.of(sample, of_both[:count], of_both[count:], task)
    rms = float(np.sqrt((std**2).mean()))
    size = PositionStd(float(std.mean()), float(std.max()), rms, len(workspace) - count)
    share = Share("pairs", "distances of the fitted pairs", "A", rms)
    return Uncertainty(position_std_mm=size, budget=(share,), region=region)


def _findings(
    unseen: ResidualTable | None, positions: Uncertainty, *, converged: bool
) -> Iterator[Finding]:
    """Yield what is against a result: of the solver, the validation pairs and σ of positions."""
    if not converged:
        yield Finding(findings.NOT_ARRIVED, "the solver did not converge", "fail")
    if unseen is None:
        says = "no validation pairs: nothing shows that the result holds elsewhere"
        yield Finding(findings.NOTHING_UNSEEN, says, "not decided")
    else:
        errors = unseen.summary()
        if not errors.after.rms < errors.before.rms:  # "not <", so that NaN fails as well
            yield Finding(findings.WORSE, f"worse: hold-out pairs: {errors.says}", "fail")
    if positions.region is None:
        says = (
            "σ of positions is unknown: there are as many pairs as parameters, or no poses of the "
            "workspace that the identified robot can take; measure more pairs, look at robot.yaml"
        )
        yield Finding(findings.NO_POSITIONS, says, "not decided")
    else:
        yield from findings.position_findings(positions.region, None, was_asked=True)


def _gains(unseen: ResidualTable | None, positions: Uncertainty) -> tuple[str, ...]:
    """Return what a passed result gained, and where it is valid."""
    if unseen is None or positions.region is None:
        return ()
    return f"hold-out pairs: {unseen.summary().says}", positions.region.says
