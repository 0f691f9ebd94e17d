"""Gate: each shot is compared with the prediction of the accepted ones, before it counts.

A tracker may lock onto another reflector, a reflection or a reflector that was left standing, and
then measures well, but not the robot. One such point spoils a fit, and so it is kept out while the
cell can still be asked. The limits (millimetres once there is a fit, centimetres before) are far
above what a calibration corrects.

1. While few shots are accepted, the tracker's frame is unknown. Distances between points need no
   frame, and are compared with those of the nominal robot.
2. As soon as the shots place a frame, a fit of robot and frame predicts each point, with an
   uncertainty from which the limit follows: wide where the shots say little, narrow later.

All shots of the series count here, those of other purposes too, and none is left out as wrong:
`uncertainty_monitor.py` fits what `identify` will use, which says how well, not whether.

Shots of a reflector elsewhere on the platform (`reflector_places.py`) are predicted by the same fit
and their place there; before it, their distances are compared with each other alone.

One of the first shots may itself be of a wrong target. It is found by leaving out one shot at a
time: without it the refused shot agrees with all others.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import dist, inf

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.error_model import ErrorModel, Observations, moved_frames
from campaigns.fit.fit import Fit, Prior, noise_parts
from campaigns.fit.rigid_transforms import Transform, fit_transform
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.identification.objects import Object
from campaigns.journal.records import Outcome
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.reflector_places import PlacedReflector, seen_at
from campaigns.settings.sections import GateConfig
from drivers.values import Vector3, vector

FEWEST_SHOTS = 5
"""Shots from which a fit is tried: three place the frame, the others are to spare."""
SPREAD_FOR_A_FRAME_MM = 50.0
"""Least extent (rms) of the points across their main direction: points on a line place no frame."""
SCATTER_SHARE = {"points": 0.04, "joints": 0.04}
"""Variance of the robot's scatter as a share of its tolerance's: a fifth of the standard deviation.

The first shots are too few to estimate it.
"""
POINTING_STD_MM = 20.0
"""Largest standard deviation of a prediction to which the tracker is pointed; it searches 50 mm."""
FIRST_SHOTS = 12
"""Number of shots up to which a wrong one is looked for among them: the fit of more is firm."""
SAME_POSE_WITHIN = 0.002
"""Largest difference of joints, rad or mm, of a pose that is taken again."""
STANDING_MM = 1.0
"""Points nearer to each other, of a robot that moved, are of a reflector that stands elsewhere."""
LIMIT_SIGMAS = 4.0
WRONG_POINT = "a wrong target or a wrong pose"
Joints = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class GateDecision:
    """Decision of the gate on a shot."""

    predicted_in_tracker_mm: Vector3 | None
    """None if the shot was compared by distances."""
    residual_mm: float | None
    """Distance from the predicted point; None without one."""
    refusal: str
    """Reason why the shot does not count; "" if it counts."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Unknowns of the error model and the frame, estimated from the accepted shots."""

    x: Array
    """Unknowns of the model in tolerances, (P,)."""
    frame: Transform
    """Tracker from base."""
    near: Array
    """Mean pose (1, t) of the shots, at which the search for other poses begins."""
    covariance: Array
    """Covariance of the unknowns and the frame's six, (P + 6, P + 6)."""


class Gate:
    """Gate of a series: compares each shot with what the accepted ones predict.

    By a fit of robot and frame, or by distances while the shots place no frame. The fit is repeated
    whenever the shots have grown by a quarter.
    """

    def __init__(
        self,
        model: ErrorModel,
        instrument: TrackerUncertainty,
        rules: GateConfig,
        accepted: Iterable[Outcome] = (),
        carriers: Mapping[str, Object] | None = None,
    ) -> None:
        """`carriers`: objects that carry reflectors elsewhere on the platform, by name."""
        self._model, self._instrument, self._rules = model, instrument, rules
        self._carriers = dict(carriers or {})
        self._elsewhere = {name: PlacedReflector(model, on) for name, on in self._carriers.items()}
        self.accepted = tuple(accepted)
        """The shots that count, in the order in which they came."""
        self.reflector = ""
        """Reflector that is measured now: an object's name; "": that of the robot file."""
        self._restart()

    @property
    def of_reflector(self) -> tuple[Outcome, ...]:
        """Return the shots that count of the reflector that is measured now."""
        return self._shots_of(self.reflector)

    @property
    def of_robot(self) -> tuple[Outcome, ...]:
        """Return the shots that count of the reflector of the robot file."""
        return self._shots_of("")

    def seen_from(self, reflector: str) -> Kinematics:
        """Return the nominal robot with the measured point on the part of a reflector."""
        nominal = self._model.nominal
        return seen_at(nominal, self._carriers[reflector]) if reflector else nominal

    def accept(self, outcome: Outcome) -> None:
        """Add an accepted shot."""
        self.accepted = (*self.accepted, outcome)
        if not outcome.reflector and len(self.of_robot) >= self._fit_due:
            self._fit()

    def reset(self, shots: Iterable[int]) -> None:
        """Take out shots that were accepted and do not count any more."""
        voided = {*shots}
        self.accepted = tuple(outcome for outcome in self.accepted if outcome.shot not in voided)
        self._restart()

    def judge(self, outcome: Outcome) -> GateDecision:
        """Compare a shot with the point predicted, and refuse it if it is too far off."""
        # A prediction less certain than the limit for distances is worth less than a distance. The
        # limit never exceeds that for distances: a fit must not make the gate wider.
        # `not … <= …`: a residual that is NaN is refused.
        rules = self._rules
        if self._carriers and (another := self._another_at(outcome)):
            return GateDecision(None, None, another)
        expected_mm, std_mm = self.predict(outcome.joints, outcome.reflector) or (None, inf)
        # A reflector elsewhere may sit on its part beside what is stated: limits are of 4 σ there.
        most_mm = rules.distance_mm / (LIMIT_SIGMAS if outcome.reflector else 1.0)
        if expected_mm is None or std_mm > most_mm:
            return self._judge_distances(outcome, self._shots_of(outcome.reflector))
        residual_mm = float(np.linalg.norm(outcome.point_in_tracker_mm - expected_mm))
        limit_mm = min(rules.fitted_mm + LIMIT_SIGMAS * std_mm, rules.distance_mm)
        refusal = ""
        if not residual_mm <= limit_mm:
            refusal = (
                f"{residual_mm:.2f} mm from the predicted point, limit {limit_mm:.2f} mm: "
                f"{WRONG_POINT}"
            )
        return GateDecision(vector(expected_mm), residual_mm, refusal)

    def _another_at(self, outcome: Outcome) -> str:
        """Return which other reflector of the platform has a shot's point, in words; "" if none."""
        # A stated place may be wrong by centimetres, but hardly by half of the way to another
        # reflector: a quarter of that way belongs to the other one.
        expected = self.predict(outcome.joints, outcome.reflector)
        for name in {"", *self._carriers} - {outcome.reflector}:
            other = self.predict(outcome.joints, name) if self._shots_of(name) else None
            if expected is None or other is None or other[1] > self._rules.distance_mm:
                continue
            apart_mm = float(np.linalg.norm(expected[0] - other[0]))
            away_mm = float(np.linalg.norm(outcome.point_in_tracker_mm - other[0]))
            limit_mm = min(self._rules.fitted_mm + LIMIT_SIGMAS * other[1], 0.25 * apart_mm)
            if away_mm <= limit_mm:
                where = f"on {name}" if name else "at its own place"
                return (
                    f"{away_mm:.2f} mm from the reflector {where}, {apart_mm:.0f} mm from where it "
                    f"should be (limit {limit_mm:.2f} mm): it was not moved"
                )
        return ""

    def predict(self, joints: Joints, reflector: str = "") -> tuple[Array, float] | None:
        """Return a reflector's point (3,) at joints, and its 1 σ in mm; None if unknown.

        The point is in the tracker's frame; σ is the root of the summed variances of its
        coordinates.
        """
        estimate = self._estimate
        if estimate is None:
            return None
        if reflector:
            elsewhere = self._elsewhere[reflector]
            by = estimate.x, estimate.frame, estimate.covariance
            place = elsewhere.place(*by, self._shots_of(reflector))
            return elsewhere.predict(*by, place, joints)
        observation = Observations.unmeasured(np.array([joints]), estimate.near)
        with np.errstate(all="ignore"):  # at joints that no pose fits, the numbers overflow
            at = self._model.predict(estimate.x, (estimate.frame,), observation, estimate.near)
        if not at.assembly.is_solved[0]:
            return None
        spread = at.jacobian[0] @ estimate.covariance @ at.jacobian[0].T
        # The residual is predicted minus measured: whatever points `unmeasured` has cancel out.
        return observation.points[0] + at.residual[0], float(np.sqrt(np.trace(spread)))

    def find_suspects(self, refused: Outcome) -> list[Outcome]:
        """Return the shots without each of which a refused shot agrees with all others.

        The earliest comes first: the fewer shots there were to contradict it, the likelier it is
        wrong. There are none once the fit rests on more than `FIRST_SHOTS`.
        """
        first = self.accepted if len(self.accepted) <= FIRST_SHOTS else ()
        return [shot for shot in first if not self._without(shot).judge(refused).refusal]

    def is_replaced_by(self, again: Outcome, suspect: Outcome, refused: Outcome) -> bool:
        """Return whether a suspect measured again is elsewhere, and fits the refused shot."""
        # A repetition at the old place acquits the suspect. One that is elsewhere, but contradicts
        # the refused shot, shows that something else is wrong.
        moved_mm = dist(suspect.point_in_tracker_mm, again.point_in_tracker_mm)
        others = self._without(suspect, added=(refused,))
        return moved_mm > self._rules.fitted_mm and not others.judge(again).refusal

    def find_standing(self, refused: Outcome) -> tuple[Outcome, ...]:
        """Return the shots with the point of a refused one, although the robot was elsewhere.

        All of them are then of a reflector that stands still.
        """
        return tuple(
            shot
            for shot in self.accepted
            if dist(shot.point_in_tracker_mm, refused.point_in_tracker_mm) <= STANDING_MM
            and shot.reflector == refused.reflector
            and self._judge_distances(shot, [refused]).refusal
        )

    def expected_point_mm(self, joints: Joints) -> Vector3 | None:
        """Return where to point the tracker for these joints; None while it is too uncertain.

        The point is that of the reflector that is measured now: predicted by the fit, or that of a
        shot at the same pose.
        """
        predicted = self.predict(joints, self.reflector)
        if predicted is not None and predicted[1] <= POINTING_STD_MM:
            return vector(predicted[0])
        same = (s.point_in_tracker_mm for s in self.of_reflector if is_same_pose(s.joints, joints))
        return next(same, None)

    def _shots_of(self, reflector: str) -> tuple[Outcome, ...]:
        return tuple(shot for shot in self.accepted if shot.reflector == reflector)

    def _without(self, shot: Outcome, *, added: tuple[Outcome, ...] = ()) -> "Gate":
        """Return a gate that rests on the other shots and the added ones."""
        others = (*(other for other in self.accepted if other.shot != shot.shot), *added)
        return Gate(self._model, self._instrument, self._rules, others, self._carriers)

    def _judge_distances(self, shot: Outcome, others: Sequence[Outcome]) -> GateDecision:
        """Compare the distances of a shot to others with those of the robot as it is estimated.

        All of them are of one reflector.
        """
        # Positions are in the base frame, points in the tracker's: distances need no common frame.
        # Without a fit the robot is the nominal one, whose errors of some mm are far below the
        # limit.
        estimate, compared = self._estimate, (*others, shot)
        robot = self._model.nominal if estimate is None else self._model.kinematics(estimate.x)
        if shot.reflector:
            robot = seen_at(robot, self._carriers[shot.reflector])
        solution = robot.forward(np.array([outcome.joints for outcome in compared]))
        if not solution.is_solved.all():
            problem = "the robot's model cannot be assembled at the joints that were read"
            return GateDecision(None, None, problem)
        positions_mm = robot.points(solution.values)
        points_mm = np.array([outcome.point_in_tracker_mm for outcome in compared])
        modelled, measured = (
            np.linalg.norm(places[:-1] - places[-1], axis=1) for places in (positions_mm, points_mm)
        )
        error_mm = float(np.abs(modelled - measured).max(initial=0.0))
        limit_mm, refusal = self._rules.distance_mm, ""
        if not error_mm <= limit_mm:
            refusal = (
                f"the distance to an earlier shot is {error_mm:.2f} mm off, "
                f"limit {limit_mm:g} mm: {WRONG_POINT}"
            )
        return GateDecision(None, None, refusal)

    def _restart(self) -> None:
        """Fit the accepted shots without an estimate from before, which voided shots may spoil."""
        self._estimate: Estimate | None = None
        self._fit_due = FEWEST_SHOTS  # number of accepted shots at which they are fitted again
        if len(self.of_robot) >= FEWEST_SHOTS:
            self._fit()

    def _fit(self) -> None:
        """Fit by one Gauss-Newton step, from the nominal robot or the estimate before."""
        # One step leaves an error of second order in the robot's errors, far below the limit, and
        # takes a fraction of a fit that converges.
        model, accepted = self._model, self.of_robot
        self._fit_due = next_fit(len(accepted))
        x = np.zeros(len(model.names)) if self._estimate is None else self._estimate.x
        joints = np.array([shot.joints for shot in accepted])
        points_mm = np.array([shot.point_in_tracker_mm for shot in accepted])
        solution = model.kinematics(x).forward(joints)
        # Without a frame, or with joints that no pose fits, the gate goes on by distances.
        if not _can_place_frame(points_mm) or not solution.is_solved.all():
            return
        poses = solution.values
        noise = {"stated": point_covariance_mm2(points_mm, self._instrument)}
        unmeasured = Observations.unmeasured(joints, poses)
        observations = replace(unmeasured, points=points_mm, noise=noise)
        self._estimate = _gauss_newton_step(model, observations, x, poses)


def _can_place_frame(points_mm: Array) -> bool:
    """Return whether points (N, 3) extend far enough across the line that fits them best."""
    # The second singular value is the root of the summed squares of the distances along the second
    # main direction.
    extent_mm = np.linalg.svd(points_mm - points_mm.mean(axis=0), compute_uv=False)[1]
    return bool(extent_mm / np.sqrt(len(points_mm)) >= SPREAD_FOR_A_FRAME_MM)


def _gauss_newton_step(
    model: ErrorModel, observations: Observations, x: Array, poses: Array
) -> Estimate:
    """Improve the unknowns of a robot, whose poses (N, t) at the joints read are given.

    `x` (P,): unknowns in units of their tolerances. The frame is fitted from nothing.
    """
    # 1. Place the frame by the rigid motion that carries the model's positions onto the points.
    # 2. Linearise there; weigh each point by the tracker's noise and a part of the robot's scatter.
    # 3. Solve as a fit does, with sizes and noise as they are. As a prior each unknown of the robot
    #    is 0 ± 1 tolerance, the frame's six are free: five shots suffice, and what they do not show
    #    stays uncertain.
    size = len(x)
    frame = fit_transform(model.nominal.points(poses), observations.points)
    at = model.predict(x, (frame,), observations, poses)
    noise = noise_parts(model, observations, at.by_joint)
    shots = np.ones(len(observations))
    fit = Fit(
        model=model,
        observations=observations,
        prior=Prior(),
        at=at,
        noise=noise,
        usable=shots > 0.0,
        good=shots,
        sizes=dict.fromkeys(model.sized_groups, 1.0),
        factors={part: SCATTER_SHARE.get(part, 1.0) for part in noise},
    )
    (frame,) = moved_frames((frame,), fit.step[size:])
    centre = poses.mean(axis=0, keepdims=True)
    return Estimate(x + fit.step[:size], frame, centre, fit.inverse)


def next_fit(shots: int, growth: float = 0.25) -> int:
    """Return the number of shots at which to fit again: larger by `growth`, at least by one."""
    return shots + max(1, int(growth * shots))


def is_same_pose(joints: Joints, others: Joints) -> bool:
    """Return whether two readings of the joints, rad or mm, are of one pose taken again."""
    return bool(np.abs(np.subtract(joints, others)).max() <= SAME_POSE_WITHIN)
