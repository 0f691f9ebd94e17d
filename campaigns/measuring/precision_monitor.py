"""Precision monitor: how surely the parameters are known while a plan is measured, shot by shot."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.design.pose_sampling import WorkspaceTooSmall, workspace_poses
from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import (
    MINIMUM_DOF,
    LinearizedModel,
    PosteriorCovariance,
    covariance_from_distances,
    covariance_from_points,
    largest_std,
    position_std_mm,
    workspace_jacobian,
)
from campaigns.identification.fit import Fit, PointFit, fit_shots
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.journal.records import Intent, Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.measuring.run_state import ParameterPrecision
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import pairs_of, poses_of
from campaigns.planning.predicted_precision import EstimationSetup, predicted_covariance
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import outcomes_covariance_mm2, shots_of_journal
from drivers.values import Vector3

WORKSPACE_SAMPLE = 200


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionMonitor:
    """Precision that any shots of one plan give the parameters."""

    planned: Mapping[int, PlannedShot]
    """The identification shots by their numbers."""
    kinematics: Kinematics
    """The nominal one."""
    setup: EstimationSetup
    """Its uncertainty is for shots of which the tracker states none."""
    workspace: Array
    """∂position/∂parameters all over the workspace, after the best fit of the frame, (K, 3, F)."""

    @classmethod
    def of_plan(
        cls,
        shots: Iterable[PlannedShot],
        robot: RobotModel,
        setup: EstimationSetup,
        rng: np.random.Generator,
    ) -> "PrecisionMonitor":
        """Monitor of a plan; `rng` draws the poses at which positions are judged."""
        planned = {s.shot: s for s in shots if s.purpose is ShotSet.IDENTIFICATION}
        poses = _workspace(robot, poses_of(tuple(planned.values())), rng)
        workspace = workspace_jacobian(robot.kinematics, setup.free, poses)
        return cls(planned, robot.kinematics, setup, workspace)

    def after(
        self, outcomes: Sequence[Outcome], model: LinearizedModel | None
    ) -> ParameterPrecision | None:
        """Precision by accepted shots, those that are in `model`; None for too few to tell.

        At once, but an outlier among them makes it look worse than it is.
        """
        if model is None:
            return None
        counted = enumerate(outcomes[: len(model.points_mm)])
        places = [place for place, outcome in counted if outcome.shot in self.planned]
        taken = [outcomes[place] for place in places]
        seen = model.by(self.setup.free).taken(np.array(places, dtype=np.intp))
        covariance = outcomes_covariance_mm2(taken, self.setup.uncertainty)
        if self.setup.estimator is Estimator.POINTS:
            known = covariance_from_points(seen, covariance)
        else:
            shots = tuple(self.planned[outcome.shot] for outcome in taken)
            pairs = pairs_of(shots, ShotSet.IDENTIFICATION)
            known = covariance_from_distances(seen, covariance, pairs)
        return None if known is None else self._in_words(len(taken), known)

    def fitted(self, outcomes: Iterable[Outcome]) -> ParameterPrecision | None:
        """Precision by accepted shots when they are fitted as `identify` does; None for too few.

        Takes some twenty times as long.
        """
        taken = self._to_identify_from(outcomes)
        fit, count = self._fit(taken), len(self.setup.free)
        if fit is None:
            return None
        found = fit.found
        noise, of_all = fit.stated_noise, found.covariance
        if not found.fit.converged or found.seen.rank < count or noise.dof < MINIMUM_DOF:
            return None
        if of_all is None or noise.birge_ratio is None or noise.sigma0 is None:
            return None
        widened = max(1.0, noise.birge_ratio) if fit.scatter.any else noise.sigma0
        known = PosteriorCovariance(of_all[:count, :count], noise.birge_ratio, widened)
        return self._in_words(len(taken), known)

    def point_fit(self, outcomes: Iterable[Outcome]) -> PointFit | None:
        """Fit of all coordinates as `identify` makes it; None for too few shots to tell scatter."""
        fit = self._fit(self._to_identify_from(outcomes))
        points = None if fit is None else fit.points
        if points is None or not points.found.fit.converged:
            return None
        return points if points.found.noise.dof >= MINIMUM_DOF else None

    def _to_identify_from(self, outcomes: Iterable[Outcome]) -> tuple[Outcome, ...]:
        return tuple(outcome for outcome in outcomes if outcome.shot in self.planned)

    def _fit(self, taken: Sequence[Outcome]) -> Fit | None:
        shots = [
            AcceptedShot(_intent(self.planned[outcome.shot], outcome), outcome, "")
            for outcome in taken
        ]
        setup, data = self.setup, shots_of_journal(shots, self.kinematics.mechanism)
        selection = ParameterSelection(setup.free)
        options = IdentificationOptions(estimator=setup.estimator, instrument=setup.uncertainty)
        try:
            return fit_shots(self.kinematics, data, selection, options)
        except (ShotsMissing, ShotsInvalid, NoSolution, np.linalg.LinAlgError):
            return None

    def predicted(self, tracker_mm: Vector3, count: int | None = None) -> ParameterPrecision | None:
        """Precision by the plan's first shots or all, seen from there, if they scatter as stated.

        None for too few to tell.
        """
        shots = tuple(self.planned.values())[:count]
        if not shots:
            return None
        found = predicted_covariance(shots, self.kinematics, np.array(tracker_mm), self.setup)
        if not found.full_rank:
            return None
        return self._in_words(len(shots), PosteriorCovariance(found.covariance, 0.0, 1.0))

    def _in_words(self, shots: int, known: PosteriorCovariance) -> ParameterPrecision:
        space, free = self.kinematics.mechanism.parameters, self.setup.free
        std = np.sqrt(np.diag(known.covariance))
        levers_mm = self.kinematics.mechanism.levers_mm(self.kinematics.p)[space.places(free)]
        weakest = int(np.argmax(std * levers_mm))
        return ParameterPrecision(
            shots,
            free[weakest],
            float(std[weakest] / space.units(free)[weakest]),
            largest_std(std, free)[0],
            float(position_std_mm(self.workspace, known.covariance).mean()),
            known.birge_ratio,
            known.sigma0,
        )


def _intent(planned: PlannedShot, outcome: Outcome) -> Intent:
    """What an outcome came of."""
    return Intent(
        planned.shot,
        outcome.attempt,
        planned.purpose.value,
        planned.pose,
        planned.joints,
        "joints",
        planned.pair,
    )


def _workspace(robot: RobotModel, planned: Array, rng: np.random.Generator) -> Array:
    """Poses all over the workspace, (K, t); those planned where hardly any other can be taken."""
    try:
        return workspace_poses(
            robot.kinematics, robot.limits, robot.centre, WORKSPACE_SAMPLE, rng, robot.space
        )
    except WorkspaceTooSmall:
        return planned.reshape(-1, len(robot.centre))
