"""Beam: waits for a broken beam, and looks for the reflector where it was seen before.

The danger is not a broken beam, which costs time, but a search that succeeds at the wrong
reflector. Therefore a search begins only where the robot's reflector can be: in the direction of
the beam, and where the reflector of this very pose should be. While the beam stays broken, the
tracker also looks at the point that was measured last, at another pose. It never goes on with a
reflector found there: the robot does not move although its encoders turn (a slipping coupling), and
the run ends.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import dist, hypot

from campaigns.errors import GateRefused, NotSettled, TargetOutOfReach
from campaigns.journal.records import BeamStart, Event, EventKind, Outcome
from campaigns.measuring.gate import STANDING_MM, is_same_pose
from campaigns.measuring.results import Loss, Skipped
from campaigns.measuring.run_state import EngineState, Wish
from campaigns.measuring.stopping_rule import in_ranges
from campaigns.measuring.work import Session
from drivers.errors import BeamBroken, LimitViolation
from drivers.values import Vector3

NOT_MOVING = "the robot does not move although its encoders say so"
ELSEWHERE = "the tracker is on a reflector that stands elsewhere"
LOOK_AT_THE_DRIVES = (
    "see whether the robot moves (couplings, brakes, drives), and put the beam onto its reflector "
    "by hand; then run again: it resumes"
)
REPEATED_AFTER_S = (30.0, 300.0, 3000.0)
"""Times at which the operator is reminded that the beam is still broken.

While the reflector's place is unknown the first reminder comes at once: he has to place the beam.
"""
MOST_ANCHORS = 3
"""Number of poses, latest first, at which the reflector is looked for where it was measured.

It is looked for as often, over a whole session, at each place where a session began.
"""


@dataclass(frozen=True, slots=True)
class Anchor:
    """Pose at which the reflector was seen, and to which the robot can go back."""

    name: str
    """Words that complete `back to`."""
    joints: tuple[float, ...]
    point_mm: Vector3
    """Where the reflector was seen there, or a point in the direction of the beam."""


class Beam:
    """Finds the reflector again, at the pose where the robot stands or at one seen before."""

    def __init__(self, session: Session, starts: Sequence[BeamStart]) -> None:
        """Take where robot and beam were when the series' sessions began, in their order."""
        self._session, self._rules = session, session.work.rules
        self._tracker, self._clock = session.cell.tracker, session.cell.clock
        self._mover, self._gate = session.mover, session.gate
        self._run_state = session.run_state
        self._starts = deque(MOST_ANCHORS * tuple(reversed(starts)))
        self._measured: list[Outcome] = []
        """All points of this session in the order of time, also those that do not count."""

    def remember(self, measured: Outcome) -> None:
        """Keep a point that the tracker measured, whether it counts or not."""
        self._measured.append(measured)

    def wait(self, joints: tuple[float, ...], *, seen_here: bool) -> Skipped | Loss:
        """Wait until the reflector is found, while the robot stands still.

        `seen_here`: whether the reflector was seen at this pose before the beam broke. Return
        `Loss.BEAM` once the reflector is found, `Loss.UNSEEN` if it was never seen at this pose,
        `Skipped` by the operator. Raise `GateRefused` if the reflector is found where it was before
        the encoders moved, and after the cell's `beam_wait_s`; raise the robot's faults and
        `Interrupted`.
        """
        # After `look_back_s` a person in the beam is not the likeliest cause any more: the robot
        # may not follow its encoders, or its reflector may be hidden at this pose.
        began_s = self._clock.now_s()
        direction, expected_mm = self._tracker.direction(), self._gate.expected_point_mm(joints)
        suspect = self._shot_to_revisit(expected_mm)
        advice = self._advise(expected_mm)
        reminders_s = deque(REPEATED_AFTER_S if expected_mm else (0.0, *REPEATED_AFTER_S))
        while (failure := self._failure_to_find(expected_mm, direction)) is not None:
            self._mover.check_stop()
            self._mover.require_sound()
            if self._session.wishes.take(Wish.SKIP):
                self._run_state.see_beam(locked=False)
                return Skipped()
            lost_s = self._clock.now_s() - began_s
            self._limit_wait(lost_s, failure)
            self._run_state.see_beam(locked=False, lost_s=lost_s, advice=advice)
            if lost_s >= self._rules.look_back_s:
                if suspect is not None and expected_mm is not None:
                    self._require_moved_since(suspect, expected_mm)
                if not seen_here and self._gate.of_reflector:
                    return Loss.UNSEEN
            if reminders_s and lost_s >= reminders_s[0]:
                reminders_s.popleft()
                text = f"the beam has been broken for {lost_s:.0f} s and is waited for: {failure}"
                self._announce("beam broken", f"{text}; {advice}")
            self._mover.pause(1.0)
        self._run_state.see_beam(locked=True)
        lost_s = self._clock.now_s() - began_s
        self._announce("resumed", f"the tracker has its reflector again, after {lost_s:.0f} s")
        return Loss.BEAM

    def is_at(self, expected_mm: Vector3 | None) -> bool:
        """Return whether the reflector is found at a point; False if the point is None."""
        if expected_mm is None:
            return False
        try:
            self._tracker.go_to(expected_mm)
        except BeamBroken:
            self._run_state.see_beam(locked=False)
            return False
        return True

    def wait_where_it_was(self) -> bool:
        """Go back to the pose of the latest shot that counts, and wait for the beam there.

        Return whether the reflector was there at once: then the other pose is hidden.
        """
        latest = self._gate.of_reflector[-1]
        self._go_back(f"where shot {latest.shot} was", latest.joints)
        began_s = self._clock.now_s()
        waited = self.wait(latest.joints, seen_here=True)
        self._run_state.show_idle()
        if isinstance(waited, Skipped):  # the wish is about the shot that is tried again after this
            self._session.wishes.ask(Wish.SKIP)
            return False
        return self._clock.now_s() - began_s < self._rules.look_back_s

    def look_back(self, standing_mm: Vector3 | None = None) -> bool:
        """Bring robot and beam together where the reflector was seen before; False: nowhere.

        First at the poses of the latest shots that count, then where sessions began: there the
        operator had put the beam onto the robot's reflector. A beginning whose beam pointed at
        `standing_mm`, a reflector that stands elsewhere, is passed over.
        """
        return any(self._lock_at(anchor) for anchor in self._anchors(standing_mm))

    def require_robot_moves(self) -> None:
        """Raise `GateRefused` if the latest measurements have one point at several poses."""
        same_point = self._poses_of_one_point()
        if len(same_point) > 1:
            raise one_point_error(same_point)

    def _poses_of_one_point(self) -> tuple[Outcome, ...]:
        """Return the latest measurements of one point at different poses, the latest first.

        If there are two or more, the robot has not moved, or the reflector is not the robot's.
        """
        poses: list[Outcome] = []
        for shot in reversed(self._measured):
            if dist(shot.point_in_tracker_mm, self._measured[-1].point_in_tracker_mm) > STANDING_MM:
                break
            if not any(is_same_pose(shot.joints, other.joints) for other in poses):
                poses.append(shot)
        return tuple(poses)

    def _limit_wait(self, lost_s: float, failure: str) -> None:
        """Raise `GateRefused` once the beam has been broken for the cell's `beam_wait_s`."""
        if lost_s >= self._session.cell.beam_wait_s:
            raise GateRefused(
                f"the beam has been broken for {lost_s:.0f} s and nobody is there to place "
                f"it: {failure}, or the robot does not move",
                remedy=LOOK_AT_THE_DRIVES,
            )

    def _shot_to_revisit(self, expected_mm: Vector3 | None) -> Outcome | None:
        """Return the latest shot if a reflector that is still at its point accuses the robot.

        `expected_mm`: point at which the robot's reflector should be now.
        """
        # It does if the shot was the robot's (measured where the robot was expected then), and the
        # robot's reflector should be far from there now. The limits are the wide ones of distances,
        # because an accusation ends the run.
        if not self._measured or expected_mm is None:
            return None
        if self._measured[-1].reflector != self._gate.reflector:
            return None  # the beam has been brought onto another one since
        latest, far_mm = self._measured[-1], self._rules.gate.distance_mm
        expected_then_mm = self._gate.expected_point_mm(latest.joints)
        point_mm = latest.point_in_tracker_mm
        if expected_then_mm is None or dist(expected_then_mm, point_mm) > far_mm:
            return None
        return latest if dist(expected_mm, point_mm) > far_mm else None

    def _require_moved_since(self, suspect: Outcome, expected_mm: Vector3) -> None:
        """Raise `GateRefused` if the reflector is still where a shot was."""
        # Only the very same point proves it: the tracker searches around the point, and may find
        # the robot's reflector near it.
        point_mm = suspect.point_in_tracker_mm
        try:
            self._tracker.go_to(point_mm)
            again_mm = self._tracker.measure().point_in_tracker_mm
        except BeamBroken:
            return
        if dist(again_mm, point_mm) <= STANDING_MM:
            raise GateRefused(
                f"the reflector is where it was in shot {suspect.shot}, although by the encoders "
                f"it has moved by {dist(expected_mm, point_mm):.0f} mm since: {NOT_MOVING}",
                remedy=LOOK_AT_THE_DRIVES,
            )

    def _advise(self, expected_mm: Vector3 | None) -> str:
        """Return the advice to the operator, in words."""
        if expected_mm is None:
            away_m = self._rules.search_mm / 1000.0
            put = "put the beam onto the robot's reflector by hand"
            return f"{put}, about {away_m:.1f} m from the tracker"
        away_m, at = hypot(*expected_mm) / 1000.0, ", ".join(f"{v:.0f}" for v in expected_mm)
        return f"clear the way to ({at}) mm in the tracker's frame, {away_m:.2f} m away"

    def _anchors(self, standing_mm: Vector3 | None) -> Iterator[Anchor]:
        """Yield the poses at which the reflector was seen, the latest first."""
        for shot in tuple(reversed(self._gate.of_reflector))[:MOST_ANCHORS]:
            yield Anchor(f"where shot {shot.shot} was", shot.joints, shot.point_in_tracker_mm)
        # Each beginning is used up: the beam may have been on a wrong reflector even then, and the
        # search must come to an end.
        while self._starts:
            start = self._starts.popleft()
            if standing_mm is None or not _points_at(start.direction, standing_mm):
                towards_mm = _point_along(start.direction, self._rules.search_mm)
                yield Anchor("where the run began", start.joints, towards_mm)

    def _lock_at(self, anchor: Anchor) -> bool:
        """Go back to a pose; return whether the reflector is where it was seen there.

        False also if the robot cannot get there.
        """
        try:
            self._go_back(anchor.name, anchor.joints)
        except (TargetOutOfReach, LimitViolation, NotSettled):
            self._run_state.show_idle()
            return False
        locked = self._failure_at(anchor.point_mm) is None
        self._run_state.see_beam(locked=locked)
        self._run_state.show_idle()
        return locked

    def _go_back(self, name: str, joints: tuple[float, ...]) -> None:
        """Go back to a pose; `name` says which one, in words."""
        self._announce("suspended", f"looking for the reflector {name}")
        self._mover.return_to(joints, f"back to {name}", self._run_state.enter)
        self._run_state.enter(EngineState.SUSPENDED)

    def _failure_to_find(
        self, expected_mm: Vector3 | None, direction: Vector3 | None
    ) -> str | None:
        """Look at the expected point of this pose, and in the direction of the broken beam.

        Return None if the reflector is found, else the tracker's problem.
        """
        # The look at the expected point has turned the beam: it is turned back before the search.
        if self.is_at(expected_mm):
            return None
        if direction is not None and expected_mm is not None:
            return self._failure_at(_point_along(direction, self._rules.search_mm))
        return self._failure_to_search(self._rules.search_mm)

    def _failure_at(self, point_mm: Vector3) -> str | None:
        """Point at a place, and search around it; return None if a reflector is found."""
        with suppress(BeamBroken):
            self._tracker.go_to(point_mm)
            return None
        return self._failure_to_search(hypot(*point_mm))

    def _failure_to_search(self, distance_mm: float) -> str | None:
        """Search around the beam's direction at a distance; return None if a reflector is found."""
        try:
            self._tracker.find_reflector(distance_mm)
        except BeamBroken as error:
            return error.problem
        return None

    def _announce(self, kind: EventKind, text: str) -> None:
        self._session.log.announce(Event(kind, text))


def one_point_error(outcomes: Iterable[Outcome]) -> GateRefused:
    """Return the error of measurements that have one point although the encoders moved."""
    problem = f"{one_point_text(outcomes)}: {ELSEWHERE}, or {NOT_MOVING}"
    return GateRefused(problem, remedy=LOOK_AT_THE_DRIVES)


def one_point_text(outcomes: Iterable[Outcome]) -> str:
    """Name the shots that have one point, in words."""
    shots = in_ranges(sorted(outcome.shot for outcome in outcomes))
    return f"shots {shots} have one point, although the encoders moved between them"


def _points_at(direction: Vector3, point_mm: Vector3) -> bool:
    """Return whether a direction from the tracker meets a point within 1 mrad."""
    return dist(_point_along(direction, hypot(*point_mm)), point_mm) <= 1e-3 * hypot(*point_mm)


def _point_along(direction: Vector3, distance_mm: float) -> Vector3:
    x, y, z = direction
    return x * distance_mm, y * distance_mm, z * distance_mm
