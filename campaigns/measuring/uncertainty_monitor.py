"""Uncertainty monitor: how surely the parameters are known while a plan is measured."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.estimation import information
from campaigns.identification.fit import Fit, PointFit, fit_shots
from campaigns.identification.hold_out import unseen_pairs
from campaigns.identification.observations import Inputs
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.journal.records import Outcome
from campaigns.measuring.run_state import ParameterUncertainty
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.predicted_uncertainty import (
    EstimationSetup,
    predicted_uncertainty,
    sample_positions,
    with_common_errors,
)
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, shots_of_outcomes
from drivers.values import Vector3


@dataclass(frozen=True, slots=True, eq=False)
class UncertaintyMonitor:
    """Standard uncertainty that any shots of one plan give the parameters."""

    planned: Mapping[int, PlannedShot]
    """All shots of the plan by their numbers."""
    kinematics: Kinematics
    """The nominal one."""
    setup: EstimationSetup
    """Its uncertainty is for shots of which the tracker states none."""
    workspace: information.WorkspaceSample
    """By the nominal robot."""

    @classmethod
    def of_plan(
        cls, shots: Iterable[PlannedShot], robot: RobotModel, setup: EstimationSetup
    ) -> "UncertaintyMonitor":
        """Monitor of a plan; raises `ConfigInvalid` as `sample_positions` does."""
        planned = {shot.shot: shot for shot in shots}
        sample = sample_positions(robot, setup.free, _identifying(planned.values()))
        return cls(planned, robot.kinematics, setup, sample)

    def fitted(self, outcomes: Iterable[Outcome]) -> ParameterUncertainty | None:
        """Uncertainty by accepted shots as `identify` states it; None for too few."""
        free, (inputs, fit) = self.setup.free, self._fit(outcomes)
        if fit is None:
            return None
        found, noise = fit.found, fit.stated_noise
        if (
            not found.fit.converged
            or found.seen.rank < len(free)
            or noise.dof < information.MINIMUM_DOF
        ):
            return None
        unseen = unseen_pairs(inputs, fit)
        known = fit.uncertainty(free, unseen.tested, self.setup.uncertainty)
        identified = fit.observations.model.kinematics(found.x[: len(free)])
        sample = information.WorkspaceSample.of_workspace(identified, free, self.workspace.poses)
        if known is None or sample is None:
            return None
        count = sum(purpose is ShotSet.IDENTIFICATION for purpose in inputs.shots.purposes)
        return self._in_words(count, known, sample, noise, robot_scatters=fit.scatter.any)

    def point_fit(self, outcomes: Iterable[Outcome]) -> PointFit | None:
        """Fit of all coordinates as `identify` makes it; None for too few shots to tell scatter."""
        _, fit = self._fit(outcomes)
        points = None if fit is None else fit.points
        if points is None or not points.found.fit.converged:
            return None
        return points if points.found.noise.dof >= information.MINIMUM_DOF else None

    def predicted(
        self, tracker_mm: Vector3, count: int | None = None
    ) -> ParameterUncertainty | None:
        """Uncertainty by the plan's first shots or all, seen from there, if they scatter as stated.

        None for too few to tell.
        """
        shots = _identifying(self.planned.values())[:count]
        if not shots:
            return None
        at_mm = np.array(tracker_mm)
        found, _ = predicted_uncertainty(shots, self.kinematics, at_mm, self.setup)
        if not found.full_rank:
            return None
        if count is None:
            every = tuple(self.planned.values())
            found = with_common_errors(found, every, self.kinematics, at_mm, self.setup)
        return self._in_words(len(shots), found, self.workspace)

    def _fit(self, outcomes: Iterable[Outcome]) -> tuple[Inputs, Fit | None]:
        """Fit of those that are in the plan."""
        taken = [outcome for outcome in outcomes if outcome.shot in self.planned]
        inputs = self._inputs(self._shots(taken))
        return inputs, _fit(inputs)

    def _shots(self, taken: Sequence[Outcome]) -> Shots:
        planned = [self.planned[outcome.shot] for outcome in taken]
        return shots_of_outcomes(
            taken,
            self.kinematics.mechanism,
            purposes=[shot.purpose for shot in planned],
            pairs=[shot.pair for shot in planned],
            targets=[shot.pose for shot in planned],
        )

    def _inputs(self, shots: Shots) -> Inputs:
        setup = self.setup
        options = IdentificationOptions(estimator=setup.estimator, instrument=setup.uncertainty)
        return Inputs.of(self.kinematics, shots, ParameterSelection(setup.free), options)

    def _in_words(
        self,
        shots: int,
        known: information.Uncertainty,
        sample: information.WorkspaceSample,
        noise: information.ChiSquareTest | None = None,
        *,
        robot_scatters: bool = False,
    ) -> ParameterUncertainty:
        space, std = self.kinematics.mechanism.parameters, known.std()
        levers_mm = self.kinematics.mechanism.sensitivity_scale_mm(self.kinematics.p)
        sizes_mm = levers_mm[space.places(known.names)] * space.units(known.names)
        weakest = known.names[int(np.argmax(sizes_mm * np.array(list(std.values()))))]
        return ParameterUncertainty(
            shots,
            weakest,
            std[weakest],
            known.largest("mm"),
            float(known.random.of_positions(sample).mean()),
            0.0 if noise is None else noise.birge_ratio or 0.0,
            known.sigma0 > 1.0 or robot_scatters,
            space[weakest].unit,
            space[weakest].words,
            float(known.of_positions(sample).mean()) if known.common else None,
        )


def _fit(inputs: Inputs) -> Fit | None:
    try:
        return fit_shots(inputs)
    except (ShotsMissing, ShotsInvalid, NoSolution, np.linalg.LinAlgError):
        return None


def _identifying(shots: Iterable[PlannedShot]) -> tuple[PlannedShot, ...]:
    return tuple(shot for shot in shots if shot.purpose is ShotSet.IDENTIFICATION)
