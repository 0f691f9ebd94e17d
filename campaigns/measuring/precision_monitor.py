"""How surely the parameters are known while a plan is measured, shot by shot."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.design.pose_sampling import WorkspaceTooSmall, workspace_poses
from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.incremental_fit import LinearizedModel
from campaigns.estimation.information import (
    PosteriorCovariance,
    covariance_from_distances,
    covariance_from_fit,
    covariance_from_points,
    marginalise_frame,
    point_jacobian,
    position_std_mm,
)
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.identification.observations import observations
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import IdentificationRequest
from campaigns.journal.records import Intent, Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.measuring.run_state import ParameterPrecision
from campaigns.mechanisms.geometry import (
    FILE_UNIT,
    FREE_BY_DEFAULT,
    IS_ANGLE,
    Geometry,
    indices,
)
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, pairs_of, poses_of
from campaigns.planning.predicted_precision import point_jacobian_at
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import outcomes_covariance_mm2, shots_of_journal
from drivers.values import Vector3

WORKSPACE_SAMPLE = 200


@dataclass(frozen=True, slots=True, eq=False)
class PrecisionMonitor:
    """Tells of any shots of one plan what they tell of the parameters."""

    planned: Mapping[int, PlannedShot]
    """The identification shots by their numbers."""
    geometry: Geometry
    """The nominal one."""
    estimator: Estimator
    instrument: TrackerUncertainty
    """For shots of which the tracker states none."""
    free: tuple[str, ...]
    """The parameters that will be identified, F of them."""
    workspace_rows: Array
    """∂position/∂parameters all over the workspace, after the best fit of the frame, (K, 3, F)."""

    @classmethod
    def of_plan(
        cls,
        shots: Iterable[PlannedShot],
        mechanism: RobotModel,
        estimator: Estimator,
        instrument: TrackerUncertainty,
        rng: np.random.Generator,
        free: tuple[str, ...] = FREE_BY_DEFAULT,
    ) -> "PrecisionMonitor":
        """For a plan; `rng` draws the poses at which positions are judged."""
        planned = {s.shot: s for s in shots if s.purpose is ShotSet.IDENTIFICATION}
        geometry = mechanism.geometry
        poses = _workspace(mechanism, poses_of(tuple(planned.values())), rng)
        rows = marginalise_frame(point_jacobian_at(geometry, free, poses))
        return cls(planned, geometry, estimator, instrument, free, rows)

    def after(
        self, outcomes: Sequence[Outcome], seen: LinearizedModel | None
    ) -> ParameterPrecision | None:
        """What accepted shots tell, those that are in `seen`; None for too few to tell.

        At once, but an outlier among them makes it look worse than it is.
        """
        if seen is None:
            return None
        seen = seen.by(self.free)
        counted = enumerate(outcomes[: len(seen.points_mm)])
        places = [place for place, outcome in counted if outcome.shot in self.planned]
        taken = [outcomes[place] for place in places]
        shots = tuple(self.planned[outcome.shot] for outcome in taken)
        covariance = outcomes_covariance_mm2(taken, self.instrument)
        return self._known(shots, seen.taken(np.array(places, dtype=np.intp)), covariance)

    def fitted(self, outcomes: Iterable[Outcome]) -> ParameterPrecision | None:
        """What accepted shots tell when they are fitted as `identify` does; None for too few."""
        data = shots_of_journal(
            [
                AcceptedShot(_intent(self.planned[outcome.shot], outcome), outcome, "")
                for outcome in outcomes
                if outcome.shot in self.planned
            ]
        )
        known = ParameterSelection(self.free)
        request = IdentificationRequest(self.estimator, known, instrument=self.instrument)
        try:
            problem = observations(self.geometry, data, request).problem
        except (ShotsMissing, ShotsInvalid):
            return None
        trusted = self.estimator is Estimator.POINTS
        told = covariance_from_fit(problem, len(self.free), trusted=trusted)
        return None if told is None else self._in_words(len(data.numbers), told)

    def foreseen(self, tracker_mm: Vector3, count: int | None = None) -> ParameterPrecision | None:
        """What the plan's first shots or all will tell, seen from there, if they scatter as stated.

        None for too few to tell.
        """
        shots = tuple(self.planned.values())[:count]
        if not shots:
            return None
        poses = poses_of(shots)
        rows = point_jacobian(self.geometry, self.free, joints_of(shots), poses)
        points = poses[:, :3]
        covariance = point_covariance_mm2(points - np.array(tracker_mm), self.instrument)
        off = np.zeros(len(self.free))
        seen = LinearizedModel(self.free, rows, points, np.zeros_like(points), off)
        return self._known(shots, seen, covariance, foreseen=True)

    def _known(
        self,
        shots: Sequence[PlannedShot],
        seen: LinearizedModel,
        covariance_mm2: Array,
        *,
        foreseen: bool = False,
    ) -> ParameterPrecision | None:
        if self.estimator is Estimator.POINTS:
            told = covariance_from_points(seen, covariance_mm2, foreseen=foreseen)
        else:
            pairs = pairs_of(shots, ShotSet.IDENTIFICATION)
            told = covariance_from_distances(seen, covariance_mm2, pairs, foreseen=foreseen)
        return None if told is None else self._in_words(len(shots), told)

    def _in_words(self, shots: int, told: PosteriorCovariance) -> ParameterPrecision:
        free = indices(self.free)
        std = np.sqrt(np.diag(told.covariance))
        weakest = int(np.argmax(std * _lever_arms_mm(self.geometry, self.free)))
        return ParameterPrecision(
            shots,
            self.free[weakest],
            float(std[weakest] / FILE_UNIT[free[weakest]]),
            float(std[~IS_ANGLE[free]].max(initial=0.0)),
            float(position_std_mm(self.workspace_rows, told.covariance).mean()),
            told.scatter,
            told.scale,
        )


def _intent(planned: PlannedShot, outcome: Outcome) -> Intent:
    """What an outcome came of."""
    return Intent(
        planned.shot,
        outcome.attempt,
        planned.purpose.value,
        planned.pose,
        planned.joints_rad,
        "joints",
        planned.pair,
    )


def _workspace(mechanism: RobotModel, planned: Array, rng: np.random.Generator) -> Array:
    """Poses all over the workspace, (K, 4); those planned where hardly any other can be taken."""
    geometry, limits, centre = mechanism.geometry, mechanism.limits, mechanism.centre
    try:
        return workspace_poses(geometry, limits, centre, WORKSPACE_SAMPLE, rng)
    except WorkspaceTooSmall:
        return planned.reshape(-1, 4)


def _lever_arms_mm(geometry: Geometry, free: tuple[str, ...]) -> Array:
    """What makes each parameter's σ one of the arm's end: its arm for an angle, (F,)."""
    flat = geometry.flat()
    arms = [flat.get(f"{name.partition('.')[0]}.arm_mm", 1.0) for name in free]
    return np.where(IS_ANGLE[indices(free)], arms, 1.0)
