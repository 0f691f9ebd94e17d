"""Uncertainty monitor: uncertainty of positions while a plan is measured.

The accepted shots are fitted and explained as `identify` will do it, and the covariance of the
parameters gives σ at many positions all over the workspace. Their mean is what the screen shows and
what `--until` is compared with.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import PlanInvalid
from campaigns.fit.effects import Walk
from campaigns.fit.events import explain
from campaigns.fit.fit import Fit, integrate_sizes
from campaigns.fit.uncertainty import length_std, null_directions
from campaigns.identification.observations import error_model, observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.journal.records import Outcome
from campaigns.kinematics.platforms import ON_PLATE
from campaigns.measuring.run_state import PositionUncertainty
from campaigns.planning.forecast import forecast, judged_positions
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import poses_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, shots_of_outcomes
from drivers.values import Vector3

FEWEST_SHOTS = 6
"""Least number of shots for which an uncertainty is stated."""


class UncertaintyMonitor:
    """Monitor of the uncertainty of positions by any shots of one plan."""

    def __init__(
        self, shots: Iterable[PlannedShot], robot: RobotModel, options: IdentificationOptions
    ) -> None:
        """Choose positions all over the workspace; raise the `ConfigInvalid` of that choice."""
        self._planned = {shot.shot: shot for shot in shots}
        self._options = options
        self._model = error_model(robot.kinematics, None, options)
        otherwise = poses_of(tuple(self._planned.values())).reshape(-1, len(robot.centre))
        self._judged = judged_positions(self._model, robot, otherwise)
        self._last: tuple[list[Outcome], Fit | None] | None = None
        """Shots fitted last, and their fit."""

    def fitted(self, outcomes: Iterable[Outcome]) -> PositionUncertainty | None:
        """Fit accepted shots; return the uncertainty as `identify` states it, None for too few."""
        return self.stated(self.posterior(outcomes))

    def posterior(self, outcomes: Iterable[Outcome]) -> Fit | None:
        """Fit the accepted shots to identify from; return None for too few of them.

        The same shots as at the last call have the same fit.
        """
        to_identify = [outcome for outcome in outcomes if self._is_to_identify(outcome)]
        if self._last is None or self._last[0] != to_identify:
            self._last = (to_identify, self._fit(to_identify))
        return self._last[1]

    def _fit(self, outcomes: Sequence[Outcome]) -> Fit | None:
        """Fit shots to identify from; return None for too few, or if they place no frame."""
        # Shots whose joints no pose fits are left out, as `identify` leaves them out. A fit that
        # has not converged states no uncertainty: its covariance would belong to other parameters.
        if len(outcomes) < FEWEST_SHOTS:
            return None
        shots = self._make_shots(outcomes)
        solution = self._model.nominal.forward(shots.joints, approach=shots.approach)
        rows = np.flatnonzero(solution.is_solved)
        observations = observations_of(shots.rows(rows), solution.values[rows], self._options)
        try:
            posterior = integrate_sizes(explain(self._model.with_effects((Walk(0),)), observations))
        except (ValueError, np.linalg.LinAlgError):  # the shots place no frame yet
            return None
        return posterior if posterior.has_converged else None

    def predicted(
        self, tracker_mm: Vector3, count: int | None = None
    ) -> PositionUncertainty | None:
        """Return the uncertainty by the plan's first shots or all, seen from a tracker's place.

        `count`: number of the first identification shots to use; None for all. Return None for too
        few of them.
        """
        shots = list(self._planned.values())
        places = [n for n, s in enumerate(shots) if s.purpose is ShotSet.IDENTIFICATION]
        if count is not None and count < len(places):
            # With the shots of other purposes between them: joints come from there to the next
            # shot.
            shots = shots[: places[count]]
        instrument = self._options.instrument
        try:
            at = forecast(shots, self._model, np.array(tracker_mm), instrument, self._judged)
        except PlanInvalid:
            return None
        worst = at.worst("mm") or ("", 0.0)
        return PositionUncertainty(at.shots, *worst, float(at.position_std_mm.mean()))

    def _is_to_identify(self, outcome: Outcome) -> bool:
        planned = self._planned.get(outcome.shot)
        to_identify = planned is not None and planned.purpose is ShotSet.IDENTIFICATION
        return to_identify and not outcome.reflector

    def _make_shots(self, taken: Sequence[Outcome]) -> Shots:
        planned = [self._planned[outcome.shot] for outcome in taken]
        return shots_of_outcomes(
            taken,
            self._model.nominal.mechanism,
            purposes=[shot.purpose for shot in planned],
            pairs=[shot.pair for shot in planned],
            targets=[shot.pose for shot in planned],
        )

    def stated(self, posterior: Fit | None) -> PositionUncertainty | None:
        """Return the fitted uncertainty at the judged positions; None without a fit.

        The derivatives are the nominal robot's: those of the fitted one differ in second order, and
        would cost half a fit.
        """
        if posterior is None:
            return None
        std = length_std(self._judged, posterior.model_covariance)
        name, largest_std = self._worst_length(posterior)
        scatter, _ = posterior.scatter
        count = int(posterior.kept.sum())
        return PositionUncertainty(count, name, largest_std, float(std.mean()), scatter)

    def _worst_length(self, posterior: Fit) -> tuple[str, float]:
        """Return the length with the largest uncertainty, and its 1 σ in mm."""
        # Directions in which the data leave a parameter free are taken out: there σ would be that
        # of the tolerance, whatever is measured.
        table = self._model.nominal.mechanism.parameters
        covariance = null_directions(posterior).transform_covariance(posterior.model_covariance)
        std: Array = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * self._model.tolerance
        lengths = {
            name: float(std[place])
            for place, name in enumerate(self._model.parameters)
            if table[name].unit == "mm" and table[name].field.group not in ON_PLATE
        }
        return max(lengths.items(), key=lambda row: row[1], default=("", 0.0))
