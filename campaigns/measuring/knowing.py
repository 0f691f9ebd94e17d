"""How surely the parameters are known while a plan is measured, shot by shot."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.estimators import Estimator
from campaigns.identification.fitted_shots import fitted_shots
from campaigns.identification.identified import IdentificationRequest
from campaigns.identification.knowledge import Knowledge
from campaigns.journal.records import Intent, Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.measuring.progress import Known
from campaigns.numerics.candidates import point_rows, without_frame
from campaigns.numerics.geometry import (
    FILE_UNIT,
    FREE_BY_DEFAULT,
    IS_ANGLE,
    Array,
    Geometry,
    indices,
)
from campaigns.numerics.instrument import TrackerUncertainty, point_covariance_mm2
from campaigns.numerics.knowing import Told, told_by_distances, told_by_fit, told_by_points
from campaigns.numerics.placement import WorkspaceTooSmall, workspace_poses
from campaigns.numerics.point_prediction import position_std_mm
from campaigns.numerics.running import Linearised
from campaigns.planning.foresight import rows_at
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, pairs_of, poses_of
from campaigns.planning.ways import Mechanism
from campaigns.shot_sets import ShotSet
from campaigns.shots.dataset import dataset_of_journal, outcomes_covariance_mm2
from drivers.values import Vector3

WORKSPACE_SAMPLE = 200


@dataclass(frozen=True, slots=True, eq=False)
class Knowing:
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
        mechanism: Mechanism,
        estimator: Estimator,
        instrument: TrackerUncertainty,
        rng: np.random.Generator,
        free: tuple[str, ...] = FREE_BY_DEFAULT,
    ) -> "Knowing":
        """For a plan; `rng` draws the poses at which positions are judged."""
        planned = {s.shot: s for s in shots if s.purpose is ShotSet.IDENTIFICATION}
        geometry = mechanism.geometry
        poses = _workspace(mechanism, poses_of(tuple(planned.values())), rng)
        rows = without_frame(rows_at(geometry, free, poses))
        return cls(planned, geometry, estimator, instrument, free, rows)

    def after(self, outcomes: Sequence[Outcome], seen: Linearised | None) -> Known | None:
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

    def fitted(self, outcomes: Iterable[Outcome]) -> Known | None:
        """What accepted shots tell when they are fitted as `identify` does; None for too few."""
        data = dataset_of_journal(
            [
                AcceptedShot(_intent(self.planned[outcome.shot], outcome), outcome, "")
                for outcome in outcomes
                if outcome.shot in self.planned
            ]
        )
        known = Knowledge(self.free)
        request = IdentificationRequest(self.estimator, known, instrument=self.instrument)
        try:
            problem = fitted_shots(self.geometry, data, request).problem
        except (ShotsMissing, ShotsInvalid):
            return None
        trusted = self.estimator is Estimator.POINTS
        told = told_by_fit(problem, len(self.free), trusted=trusted)
        return None if told is None else self._in_words(len(data.numbers), told)

    def foreseen(self, tracker_mm: Vector3, count: int | None = None) -> Known | None:
        """What the plan's first shots or all will tell, seen from there, if they scatter as stated.

        None for too few to tell.
        """
        shots = tuple(self.planned.values())[:count]
        if not shots:
            return None
        poses = poses_of(shots)
        rows = point_rows(self.geometry, self.free, joints_of(shots), poses)
        points = poses[:, :3]
        covariance = point_covariance_mm2(points - np.array(tracker_mm), self.instrument)
        off = np.zeros(len(self.free))
        seen = Linearised(self.free, rows, points, np.zeros_like(points), off)
        return self._known(shots, seen, covariance, foreseen=True)

    def _known(
        self,
        shots: Sequence[PlannedShot],
        seen: Linearised,
        covariance_mm2: Array,
        *,
        foreseen: bool = False,
    ) -> Known | None:
        if self.estimator is Estimator.POINTS:
            told = told_by_points(seen, covariance_mm2, foreseen=foreseen)
        else:
            pairs = pairs_of(shots, ShotSet.IDENTIFICATION)
            told = told_by_distances(seen, covariance_mm2, pairs, foreseen=foreseen)
        return None if told is None else self._in_words(len(shots), told)

    def _in_words(self, shots: int, told: Told) -> Known:
        free = indices(self.free)
        std = np.sqrt(np.diag(told.covariance))
        weakest = int(np.argmax(std * _levers_mm(self.geometry, self.free)))
        return Known(
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


def _workspace(mechanism: Mechanism, planned: Array, rng: np.random.Generator) -> Array:
    """Poses all over the workspace, (K, 4); those planned where hardly any other can be taken."""
    geometry, limits, centre = mechanism.geometry, mechanism.limits, mechanism.centre
    try:
        return workspace_poses(geometry, limits, centre, WORKSPACE_SAMPLE, rng)
    except WorkspaceTooSmall:
        return planned.reshape(-1, 4)


def _levers_mm(geometry: Geometry, free: tuple[str, ...]) -> Array:
    """What makes each parameter's σ one of the arm's end: its arm for an angle, (F,)."""
    flat = geometry.flat()
    arms = [flat.get(f"{name.partition('.')[0]}.arm_mm", 1.0) for name in free]
    return np.where(IS_ANGLE[indices(free)], arms, 1.0)
