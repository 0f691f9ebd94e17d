"""Nests: fixed places whose reflector the tracker is sent to while the robot stands still.

A nest shows whether the tracker itself has moved, whatever the robot does. A nest may have a
reflector of its own, or borrow the robot's: then the operator carries it there and back, and
nothing moves until he has confirmed that he stands clear.
"""

from collections.abc import Iterable
from contextlib import suppress
from math import dist, hypot

from campaigns.errors import GateRefused
from campaigns.journal.records import Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.measuring.work import Session
from drivers.errors import BeamBroken
from drivers.values import Vector3

SAME_REFLECTOR_MM = 10.0
"""Points nearer to each other are of one reflector."""


class NestPointer:
    """Brings the beam onto a nest's reflector and back onto the robot's."""

    def __init__(self, session: Session, kept: Iterable[AcceptedShot]) -> None:
        self._session, self._tracker = session, session.cell.tracker
        self._rules = session.work.rules
        self._nests = {nest.name: nest for nest in self._rules.nests}
        taken = sorted((shot for shot in kept if shot.intent.nest), key=lambda shot: shot.number)
        points = [(shot.intent.nest, shot.outcome.point_in_tracker_mm) for shot in taken]
        # A dict keeps the last of equal keys: the first point of each nest, and its latest one.
        self._first_mm, self._latest_mm = dict(reversed(points)), dict(points)
        self._reflector = self._rules.reflector
        """Name of the reflector that the tracker is set to now."""
        self._robot_mm: Vector3 | None = None
        """Point towards which the beam pointed before it left the robot."""
        self._is_away = self._is_borrowed = False
        """Whether the beam is on a nest, and whether the robot's reflector lies in one."""

    def leave(self) -> None:
        """Point at the robot's reflector again, if the beam has left it, before the robot moves.

        Raise `GateRefused` if no one puts the reflector back.
        """
        if not self._is_away:
            return
        if self._is_borrowed:
            self._ask("put the reflector back onto the robot")
        self._use(self._rules.reflector)
        self._is_away = self._is_borrowed = False
        joints = self._session.cell.robot.state().joints
        robot_mm = self._session.gate.expected_point_mm(joints) or self._robot_mm
        if robot_mm is not None:
            with suppress(BeamBroken):  # the next shot waits for it
                self._tracker.go_to(robot_mm)

    def moved_mm(self, nest: str, outcome: Outcome) -> float:
        """Return how far a nest has moved since it was measured first.

        Raise `GateRefused` if the point is another reflector's.
        """
        point_mm = outcome.point_in_tracker_mm
        expected_mm = self._session.gate.expected_point_mm(outcome.joints)
        others = self._latest_mm | ({"the robot": expected_mm} if expected_mm else {})
        for name, other_mm in others.items():
            if name != nest and (apart_mm := dist(point_mm, other_mm)) < SAME_REFLECTOR_MM:
                raise GateRefused(
                    f"shot {outcome.shot}: nest {nest} is {apart_mm:.1f} mm from the reflector of "
                    f"{name} (limit {SAME_REFLECTOR_MM:g} mm): it is the same one",
                    remedy="correct place_mm of the nest, or point the beam at it when asked",
                )
        self._latest_mm[nest] = point_mm
        return dist(point_mm, self._first_mm.setdefault(nest, point_mm))

    def point_at(self, name: str) -> None:
        """Point at a nest's reflector.

        Raise `BeamBroken` if there is none, and `GateRefused` if no one puts a reflector there.
        """
        nest, far_mm = self._nests[name], self._rules.search_mm
        place_mm = self._latest_mm.get(name, nest.place_mm)
        if not self._is_away and (direction := self._tracker.direction()) is not None:
            x, y, z = direction
            self._robot_mm = x * far_mm, y * far_mm, z * far_mm
        self._is_away = True
        self._use(nest.reflector or self._rules.reflector)
        if not nest.occupied:
            # With the robot's type of reflector it is taken for the robot's own: asking the
            # operator once too often is harmless, a robot that moves without its reflector is not.
            self._is_borrowed |= self._reflector == self._rules.reflector
            self._ask(f"put the reflector into nest {name}")
        if place_mm is None:
            self._ask(f"point the beam at the reflector in nest {name}")
            return
        try:
            self._tracker.go_to(place_mm)
        except BeamBroken:
            # The place is given by hand, or the nest has moved: search around it once.
            self._tracker.find_reflector(hypot(*place_mm))

    def _use(self, reflector: str) -> None:
        """Set the tracker to a reflector, whose constant it adds to distances."""
        if reflector != self._reflector:
            self._tracker.prepare(reflector, self._rules.measuring_time_s)
            self._reflector = reflector

    def _ask(self, what: str) -> None:
        """Have the operator do something while the robot stands still."""
        if not self._session.cell.ask(f"the robot stands still: {what} and stand clear. Done?"):
            raise GateRefused(
                f"nobody has done what was asked for: {what}",
                remedy="run on a terminal and answer y; or leave a reflector in each nest and "
                "give it place_mm and occupied: true in campaign.yaml",
            )
        self._session.mover.check_stop()  # the question may have been answered by Ctrl-C
