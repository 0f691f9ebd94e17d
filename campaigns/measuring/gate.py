"""Gate: each shot is compared with what the accepted ones predict, before it counts.

While few shots are accepted, distances between points are compared with those of the nominal robot.
Then a fit of robot and frame predicts each point, and the limit follows its uncertainty. One of the
first shots may itself be of a wrong target, and makes all later ones look wrong: it is found by
leaving out one shot at a time.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import dist, inf

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.posterior import Posterior, Prior, fit, noise_parts
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.journal.records import Outcome
from campaigns.measuring.schedule import Schedule
from campaigns.settings.sections import GateConfig
from drivers.values import Vector3, vector

FEWEST_SHOTS = 5
"""Shots that place the frame, with enough to spare to doubt one of them."""
SPREAD_FOR_A_FRAME_MM = 50.0
"""Least extent of the points across their main direction: less places no frame."""
WINDOW = 100
"""Shots of a fit, spread over all: so many predict as well as more, in bounded time."""
FIRM = Prior(factors={"points": 0.04, "joints": 0.04})
"""Scatter at a fifth of its tolerance: the first shots, one of them wrong, cannot tell it."""
POINTING_STD_MM = 20.0
"""Standard deviation of a prediction, up to which the tracker is pointed there; it searches 50."""
SAME_POSE = 0.002
"""Largest difference of joints, rad or mm, of a pose that is taken again."""
FIRST_SHOTS = 12
"""Shots among which one that took the wrong target is looked for; later the fit is firm."""
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


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Shots, and what they predict of others: by a fit, or by distances while there is none."""

    model: ErrorModel
    instrument: TrackerUncertainty
    rules: GateConfig
    shots: tuple[Outcome, ...] = ()
    posterior: Posterior | None = None
    """Fit of these shots, or of most of them; None while they place no frame."""

    def fitted(self) -> "Knowledge":
        """Return the same shots, fitted again; with the fit that there was if they place none."""
        count = len(self.shots)
        if count < FEWEST_SHOTS:
            return self
        places = np.unique(np.linspace(0, count - 1, WINDOW).astype(int))
        joints = np.array([self.shots[place].joints for place in places])
        points_mm = np.array([self.shots[place].point_in_tracker_mm for place in places])
        extent_mm = np.linalg.svd(points_mm - points_mm.mean(axis=0), compute_uv=False)[1]
        if extent_mm / np.sqrt(len(places)) < SPREAD_FOR_A_FRAME_MM:
            return self
        try:
            posterior = fit(self.model, self.observe(joints, points_mm), FIRM)
        except (ValueError, np.linalg.LinAlgError):  # no frame yet: distances alone are compared
            return self
        return replace(self, posterior=posterior)

    def predict(self, joints: Joints) -> tuple[Array, float] | None:
        """Return the point (3,) expected at joints, and its 1 σ in mm; None if unknown."""
        posterior = self.posterior
        if posterior is None:
            return None
        read = np.array([joints])
        solution = self.model.kinematics(posterior.x).forward(read)
        if not solution.found[0]:
            return None
        frame = posterior.at.frames[0]
        near_mm = frame.apply(solution.values[:, :3])
        observation = replace(self.observe(read, near_mm), near=solution.values)
        at = self.model.linearise(observation, posterior.x, (frame,), solution.values)
        spread = at.jacobian[0] @ posterior.covariance_without_changes @ at.jacobian[0].T
        return near_mm[0] + at.residual[0], float(np.sqrt(np.trace(spread)))

    def judge(self, joints: Joints, point_in_tracker_mm: Vector3) -> GateDecision:
        """Compare a point with the one predicted, and refuse it if it is too far off."""
        expected_mm, std_mm = self.predict(joints) or (None, inf)
        if expected_mm is None or std_mm > self.rules.distance_mm:
            return self._judge_distances(joints, point_in_tracker_mm)
        residual_mm = float(np.linalg.norm(point_in_tracker_mm - expected_mm))
        limit_mm = min(self.rules.fitted_mm + SIGMAS * std_mm, self.rules.distance_mm)
        refusal = ""
        if not residual_mm <= limit_mm:
            refusal = (
                f"{residual_mm:.2f} mm from the predicted point, limit {limit_mm:.2f} mm: {WRONG}"
            )
        return GateDecision(vector(expected_mm), residual_mm, refusal)

    def _judge_distances(self, joints: Joints, point_in_tracker_mm: Vector3) -> GateDecision:
        """Compare the distances to the shots with those of the robot as far as it is known."""
        robot = self.model.nominal
        if self.posterior is not None:
            robot = self.model.kinematics(self.posterior.x)
        solution = robot.forward(np.array([*(shot.joints for shot in self.shots), joints]))
        if not solution.found.all():
            problem = "the robot's model cannot be assembled at the joints that were read"
            return GateDecision(None, None, problem)
        positions_mm = solution.values[:, :3]
        points_mm = np.array([*(s.point_in_tracker_mm for s in self.shots), point_in_tracker_mm])
        modelled, measured = (
            np.linalg.norm(places[:-1] - places[-1], axis=1) for places in (positions_mm, points_mm)
        )
        error_mm = float(np.abs(modelled - measured).max(initial=0.0))
        limit_mm, refusal = self.rules.distance_mm, ""
        if not error_mm <= limit_mm:
            refusal = (
                f"the distance to an earlier shot is {error_mm:.2f} mm off, "
                f"limit {limit_mm:g} mm: {WRONG}"
            )
        return GateDecision(None, None, refusal)

    def observe(self, joints: Array, points_mm: Array) -> Observations:
        """Return points with the tracker's stated noise, for the nominal robot's assembly."""
        observations = Observations.unmeasured(joints, self.model.nominal.forward(joints).values)
        noise = {"stated": point_covariance_mm2(points_mm, self.instrument)}
        return replace(observations, points=points_mm, noise=noise)


def leave_one_out(known: Knowledge, refused: Outcome) -> list[Outcome]:
    """Return the shots without which a refused one agrees with all others, the first one first.

    The fewer shots were there to contradict a shot, the likelier it is the wrong one.
    """
    return [
        shot
        for place, shot in enumerate(known.shots)
        if agrees((*known.shots[:place], *known.shots[place + 1 :]), refused, known)
    ]


def agrees(others: tuple[Outcome, ...], shot: Outcome, known: Knowledge) -> bool:
    """Return whether a shot agrees with others, by one Gauss-Newton step from the nominal robot.

    A fit that contains a wrong shot is torn, and takes long: from the nominal robot one step is
    exact to the square of the robot's errors, which is far below the limit. While too few shots
    are known for a fit, distances are compared.
    """
    if len(others) < FEWEST_SHOTS or known.posterior is None:
        unfitted = replace(known, shots=others, posterior=None)
        return not unfitted.judge(shot.joints, shot.point_in_tracker_mm).refusal
    shots, model = (*others, shot), known.model
    points_mm = np.array([s.point_in_tracker_mm for s in shots])
    observations = known.observe(np.array([s.joints for s in shots]), points_mm)
    positions_mm = observations.near[:, :3]
    frame = fit_transform(positions_mm[:-1], points_mm[:-1])
    at = model.linearise(observations, np.zeros(len(model.names)), (frame,), observations.near)
    noise = noise_parts(model, observations, at.by_joint)
    covariance = sum(FIRM.factors.get(part, 1.0) * noise[part] for part in noise)
    weighted = np.linalg.inv(covariance) @ at.jacobian
    prior = np.diag(np.arange(at.jacobian.shape[2]) < len(model.names)).astype(float)
    normal = prior + np.einsum("nij,nik->jk", at.jacobian[:-1], weighted[:-1])
    slope = np.einsum("nij,ni->j", weighted[:-1], at.residual[:-1])
    off_mm = at.residual[-1] - at.jacobian[-1] @ np.linalg.solve(normal, slope)
    spread = at.jacobian[-1] @ np.linalg.solve(normal, at.jacobian[-1].T)
    limit_mm = known.rules.fitted_mm + SIGMAS * float(np.sqrt(np.trace(spread)))
    return bool(np.linalg.norm(off_mm) <= min(limit_mm, known.rules.distance_mm))


class InnovationGate:
    """Gate of a series: the accepted shots, fitted again whenever they have grown by a share."""

    def __init__(self, nothing: Knowledge, accepted: Iterable[Outcome] = ()) -> None:
        """`nothing` has the model and the rules, and no shots yet."""
        self._nothing = self._known = nothing
        self._schedule = Schedule(0.1, first=FEWEST_SHOTS)
        self._restart(accepted)

    @property
    def accepted(self) -> tuple[Outcome, ...]:
        """The shots that count, in the order in which they came."""
        return self._known.shots

    def judge(self, outcome: Outcome) -> GateDecision:
        """Compare a shot with what the accepted ones predict."""
        return self._known.judge(outcome.joints, outcome.point_in_tracker_mm)

    def accept(self, outcome: Outcome) -> None:
        """Add an accepted shot."""
        self._known = replace(self._known, shots=(*self._known.shots, outcome))
        self._fit_if_due()

    def reset(self, shots: Iterable[int]) -> None:
        """Take out shots that were accepted and do not count any more."""
        voided = {*shots}
        self._restart([outcome for outcome in self.accepted if outcome.shot not in voided])

    def find_suspects(self, refused: Outcome) -> list[Outcome]:
        """Return the first shots of a series that may be wrong instead of a refused one."""
        return leave_one_out(self._known, refused) if len(self.accepted) <= FIRST_SHOTS else []

    def replaces(self, suspect: Outcome, again: Outcome, refused: Outcome) -> bool:
        """Return whether a suspect measured again is elsewhere, and agrees with a refused shot."""
        moved_mm = dist(suspect.point_in_tracker_mm, again.point_in_tracker_mm)
        if moved_mm <= self._nothing.rules.fitted_mm:
            return False
        others = [shot for shot in self.accepted if shot.shot != suspect.shot]
        return agrees((*others, refused), again, self._known)

    def find_standing(self, refused: Outcome) -> tuple[Outcome, ...]:
        """Return shots with the point of a refused one, although the robot was elsewhere.

        Of a reflector that stands still, all of them.
        """
        alone = replace(self._nothing, shots=(refused,))
        return tuple(
            shot
            for shot in self.accepted
            if dist(shot.point_in_tracker_mm, refused.point_in_tracker_mm) <= STANDING_MM
            and alone.judge(shot.joints, shot.point_in_tracker_mm).refusal
        )

    def expected_point_mm(self, joints: Joints) -> Vector3 | None:
        """Return where to point the tracker for these joints; None while it is too uncertain.

        By the fit, or where a shot at the same pose was.
        """
        predicted = self._known.predict(joints)
        if predicted is not None and predicted[1] <= POINTING_STD_MM:
            return vector(predicted[0])
        same = (s.point_in_tracker_mm for s in self.accepted if is_same_pose(s.joints, joints))
        return next(same, None)

    def _restart(self, accepted: Iterable[Outcome]) -> None:
        """Begin again with these shots alone."""
        self._known = replace(self._nothing, shots=tuple(accepted))
        self._schedule.done(0)
        self._fit_if_due()

    def _fit_if_due(self) -> None:
        if self._schedule.is_due(len(self.accepted)):
            self._schedule.done(len(self.accepted))
            self._known = self._known.fitted()


def is_same_pose(joints: Joints, others: Joints) -> bool:
    """Return whether two readings of the joints, rad or mm, are of one pose taken again."""
    return bool(np.abs(np.subtract(joints, others)).max() <= SAME_POSE)
