"""Carrier: brings the beam onto the reflector of the next shot, and has it carried there.

A platform may carry several reflectors, or one that somebody carries from one of its places to the
other. Which of both it is shows itself: the tracker looks where the other reflector should be, and
only if nothing is there the operator is asked. Nothing moves meanwhile, nor before he has confirmed
that he stands clear.
"""

from math import dist

from campaigns.errors import GateRefused
from campaigns.journal.records import Event
from campaigns.measuring.work import Session
from drivers.errors import BeamBroken
from drivers.values import Vector3, vector


class ReflectorCarrier:
    """Changes the reflector that is measured while the robot stands still."""

    def __init__(self, session: Session) -> None:
        self._session, self._gate, self._rules = session, session.gate, session.work.rules
        self._tracker = session.cell.tracker

    def bring(self, reflector: str) -> None:
        """Have this reflector measured from here on; "" is that of the robot file.

        Raise `GateRefused` if it is not there and no one carries it.
        """
        before = self._gate.reflector
        if reflector == before:
            return
        joints = self._session.cell.robot.state().joints
        former_mm, expected_mm = (self._place_mm(joints, name) for name in (before, reflector))
        self._gate.reflector = reflector
        is_there = expected_mm is not None and self._finds(expected_mm, former_mm)
        if not is_there:
            self._have_carried(reflector, before)
            # A beam that came with the reflector is better than what is predicted of its place.
            if expected_mm is not None and not self._tracker.state().beam_locked:
                self._point_at(expected_mm)  # if it is not there, the next shot waits for it
        how = "found by the tracker" if is_there else "carried there"
        where = f"on {reflector}" if reflector else "at its own place"
        text = f"measured from here on: the reflector {where}, {how}"
        self._session.log.announce(Event("operator note", text))

    def _place_mm(self, joints: tuple[float, ...], reflector: str) -> Vector3 | None:
        """Return where a reflector should be, to some cm; None: unknown."""
        predicted = self._gate.predict(joints, reflector)
        if predicted is None or predicted[1] > self._rules.gate.distance_mm:
            return None
        return vector(predicted[0])

    def _finds(self, expected_mm: Vector3, former_mm: Vector3 | None) -> bool:
        """Return whether a reflector is where this one should be, and is not the former one."""
        # A tracker that knows no direction is aimed by its operator. One that searches around a
        # point may find the former reflector beside it.
        if self._tracker.direction() is None or not self._point_at(expected_mm):
            return False
        try:
            found_mm = self._tracker.measure().point_in_tracker_mm
        except BeamBroken:
            return False
        return former_mm is None or dist(found_mm, expected_mm) < dist(found_mm, former_mm)

    def _point_at(self, point_mm: Vector3) -> bool:
        """Point the beam at a place; return whether a reflector is there."""
        try:
            self._tracker.go_to(point_mm)
        except BeamBroken:
            return False
        return True

    def _have_carried(self, reflector: str, before: str) -> None:
        """Have the reflector carried; raise `GateRefused` if no one does."""
        place = reflector or "its own place, as robot.yaml has it"
        what = f"move the reflector to {place}, with the beam on it"
        if not self._session.cell.carries(reflector, what):
            self._gate.reflector = before
            raise GateRefused(
                f"no one has done what was asked for: {what}",
                remedy="run on a terminal and answer y; or mount a reflector at each of the "
                "places, and state them by place_mm and std_mm under objects in campaign.yaml",
            )
        self._session.mover.check_stop()  # the question may have been answered by Ctrl-C
