"""Gate: each shot is compared with what the accepted ones predict, before it counts.

While few shots are accepted, distances between points are compared with those of the nominal robot.
Then a fit of robot and frame predicts each point, and the limit follows its uncertainty. One of the
first shots may itself be of a wrong target, and makes all later ones look wrong: it is found by
leaving out one shot at a time.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import dist, inf

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.error_model import ErrorModel, Observations, moved_frames
from campaigns.fit.posterior import noise_parts
from campaigns.fit.rigid_transforms import Transform, fit_transform
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.journal.records import Outcome
from campaigns.settings.sections import GateConfig
from drivers.values import Vector3, vector

FEWEST_SHOTS = 5
"""Shots that place the frame, and some to spare."""
SPREAD_FOR_A_FRAME_MM = 50.0
"""Least extent of the points across their main direction: less places no frame."""
SCATTER = {"points": 0.04, "joints": 0.04}
"""Variance of the robot's scatter as a share of its tolerance's, which first shots cannot show."""
POINTING_STD_MM = 20.0
"""Standard deviation of a prediction, up to which the tracker is pointed there; it searches 50."""
FIRST_SHOTS = 12
"""Shots among which one of a wrong target is looked for: the fit of more is firm."""
SAME_POSE = 0.002
"""Largest difference of joints, rad or mm, of a pose that is taken again."""
STANDING_MM = 1.0
"""Points nearer to each other, of a robot that moved, are of a reflector that stands elsewhere."""
SIGMAS = 4.0
WRONG = "a wrong target or a wrong pose"
Joints = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class GateDecision:
    """Decision of the gate on a shot. `refusal` is empty when it may count."""

    predicted_in_tracker_mm: Vector3 | None
    residual_mm: float | None
    refusal: str


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Unknowns of the error model and the frame, by accepted shots."""

    x: Array
    """In tolerances, (P,)."""
    frame: Transform
    near: Array
    """Pose (1, t) amid the shots, from which others are searched."""
    covariance: Array
    """Of the unknowns and the frame's six, (P + 6, P + 6)."""


class Gate:
    """Gate of a series: compares each shot with what the accepted ones predict.

    By a fit of robot and frame, or by distances while the shots place no frame. It is fitted again
    whenever the shots have grown by a share.
    """

    def __init__(
        self,
        model: ErrorModel,
        instrument: TrackerUncertainty,
        rules: GateConfig,
        accepted: Iterable[Outcome] = (),
    ) -> None:
        self._model, self._instrument, self._rules = model, instrument, rules
        self.accepted = tuple(accepted)
        """The shots that count, in the order in which they came."""
        self._restart()

    def accept(self, outcome: Outcome) -> None:
        """Add an accepted shot."""
        self.accepted = (*self.accepted, outcome)
        if len(self.accepted) >= self._fit_due:
            self._fit()

    def reset(self, shots: Iterable[int]) -> None:
        """Take out shots that were accepted and do not count any more."""
        voided = {*shots}
        self.accepted = tuple(outcome for outcome in self.accepted if outcome.shot not in voided)
        self._restart()

    def judge(self, outcome: Outcome) -> GateDecision:
        """Compare a shot with the point predicted, and refuse it if it is too far off."""
        rules = self._rules
        expected_mm, std_mm = self.predict(outcome.joints) or (None, inf)
        if expected_mm is None or std_mm > rules.distance_mm:
            return self._judge_distances(outcome, self.accepted)
        residual_mm = float(np.linalg.norm(outcome.point_in_tracker_mm - expected_mm))
        limit_mm = min(rules.fitted_mm + SIGMAS * std_mm, rules.distance_mm)
        refusal = ""
        if not residual_mm <= limit_mm:
            refusal = (
                f"{residual_mm:.2f} mm from the predicted point, limit {limit_mm:.2f} mm: {WRONG}"
            )
        return GateDecision(vector(expected_mm), residual_mm, refusal)

    def predict(self, joints: Joints) -> tuple[Array, float] | None:
        """Return the point (3,) expected at joints, and its 1 σ in mm; None if unknown."""
        estimate = self._estimate
        if estimate is None:
            return None
        observation = Observations.unmeasured(np.array([joints]), estimate.near)
        with np.errstate(all="ignore"):  # of joints at which nothing can be assembled
            at = self._model.linearise(observation, estimate.x, (estimate.frame,), estimate.near)
        if not at.assembly.is_solved[0]:
            return None
        spread = at.jacobian[0] @ estimate.covariance @ at.jacobian[0].T
        return observation.points[0] + at.residual[0], float(np.sqrt(np.trace(spread)))

    def find_suspects(self, refused: Outcome) -> list[Outcome]:
        """Return the first shots, without one of which a refused shot agrees with all others.

        The earliest comes first: the fewer shots there were to contradict it, the likelier it is
        wrong.
        """
        first = self.accepted if len(self.accepted) <= FIRST_SHOTS else ()
        return [shot for shot in first if not self._without(shot).judge(refused).refusal]

    def is_replaced_by(self, again: Outcome, suspect: Outcome, refused: Outcome) -> bool:
        """Return whether a suspect measured again is elsewhere, and agrees with a refused shot."""
        moved_mm = dist(suspect.point_in_tracker_mm, again.point_in_tracker_mm)
        others = self._without(suspect, refused)
        return moved_mm > self._rules.fitted_mm and not others.judge(again).refusal

    def find_standing(self, refused: Outcome) -> tuple[Outcome, ...]:
        """Return shots with the point of a refused one, although the robot was elsewhere.

        Of a reflector that stands still, all of them.
        """
        return tuple(
            shot
            for shot in self.accepted
            if dist(shot.point_in_tracker_mm, refused.point_in_tracker_mm) <= STANDING_MM
            and self._judge_distances(shot, [refused]).refusal
        )

    def expected_point_mm(self, joints: Joints) -> Vector3 | None:
        """Return where to point the tracker for these joints; None while it is too uncertain.

        By the fit, or where a shot at the same pose was.
        """
        predicted = self.predict(joints)
        if predicted is not None and predicted[1] <= POINTING_STD_MM:
            return vector(predicted[0])
        same = (s.point_in_tracker_mm for s in self.accepted if is_same_pose(s.joints, joints))
        return next(same, None)

    def _without(self, shot: Outcome, *added: Outcome) -> "Gate":
        """Return the gate that rests on the other shots and those added."""
        others = (*(other for other in self.accepted if other.shot != shot.shot), *added)
        return Gate(self._model, self._instrument, self._rules, others)

    def _judge_distances(self, shot: Outcome, others: Sequence[Outcome]) -> GateDecision:
        """Compare the distances of a shot to others with those of the robot as it is estimated."""
        estimate, compared = self._estimate, (*others, shot)
        robot = self._model.nominal if estimate is None else self._model.kinematics(estimate.x)
        solution = robot.forward(np.array([outcome.joints for outcome in compared]))
        if not solution.is_solved.all():
            problem = "the robot's model cannot be assembled at the joints that were read"
            return GateDecision(None, None, problem)
        positions_mm = solution.values[:, :3]
        points_mm = np.array([outcome.point_in_tracker_mm for outcome in compared])
        modelled, measured = (
            np.linalg.norm(places[:-1] - places[-1], axis=1) for places in (positions_mm, points_mm)
        )
        error_mm = float(np.abs(modelled - measured).max(initial=0.0))
        limit_mm, refusal = self._rules.distance_mm, ""
        if not error_mm <= limit_mm:
            refusal = (
                f"the distance to an earlier shot is {error_mm:.2f} mm off, "
                f"limit {limit_mm:g} mm: {WRONG}"
            )
        return GateDecision(None, None, refusal)

    def _restart(self) -> None:
        """Fit the accepted shots as if they were the first."""
        self._estimate: Estimate | None = None
        self._fit_due = FEWEST_SHOTS
        if len(self.accepted) >= FEWEST_SHOTS:
            self._fit()

    def _fit(self) -> None:
        """Fit by one Gauss-Newton step, from the nominal robot or the estimate before.

        It is exact to the square of their errors, which is far below the limit.
        """
        model, count = self._model, len(self.accepted)
        self._fit_due = next_fit(count)
        x = np.zeros(len(model.names))
        if self._estimate is not None:
            x = self._estimate.x
        joints = np.array([shot.joints for shot in self.accepted])
        points_mm = np.array([shot.point_in_tracker_mm for shot in self.accepted])
        solution = model.kinematics(x).forward(joints)
        extent_mm = np.linalg.svd(points_mm - points_mm.mean(axis=0), compute_uv=False)[1]
        if extent_mm / np.sqrt(count) < SPREAD_FOR_A_FRAME_MM or not solution.is_solved.all():
            return
        near = solution.values
        noise = {"stated": point_covariance_mm2(points_mm, self._instrument)}
        observations = replace(Observations.unmeasured(joints, near), points=points_mm, noise=noise)
        frame = fit_transform(near[:, :3], points_mm)
        at = model.linearise(observations, x, (frame,), near)
        parts = noise_parts(model, observations, at.by_joint)
        weights = np.linalg.inv(sum(SCATTER.get(part, 1.0) * parts[part] for part in parts))
        weighted = (weights @ at.jacobian).reshape(3 * count, -1)
        prior = np.diag(np.arange(len(x) + 6) < len(x)).astype(float)
        covariance = np.linalg.inv(weighted.T @ at.jacobian.reshape(3 * count, -1) + prior)
        slope = weighted.T @ at.residual.ravel() + prior @ np.concatenate([x, np.zeros(6)])
        step = -covariance @ slope
        (frame,) = moved_frames((frame,), step[len(x) :])
        amid = near.mean(axis=0, keepdims=True)
        self._estimate = Estimate(x + step[: len(x)], frame, amid, covariance)


def next_fit(shots: int, growth: float = 0.25) -> int:
    """Return the number of shots at which to fit again: more by a share, at least by one."""
    return shots + max(1, int(growth * shots))


def is_same_pose(joints: Joints, others: Joints) -> bool:
    """Return whether two readings of the joints, rad or mm, are of one pose taken again."""
    return bool(np.abs(np.subtract(joints, others)).max() <= SAME_POSE)
