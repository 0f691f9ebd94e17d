"""Follows one motion of LinuxCNC from reading to reading: whether it has ended, or died."""

from collections.abc import Sequence

from drivers.linuxcnc.motion import Target
from drivers.linuxcnc.state import Snapshot

MESSAGES_KEPT = 5


class MotionWatch:
    """What was commanded last, what has been said since, and when anything last changed."""

    def __init__(self, frozen_s: float) -> None:
        self._frozen_s = frozen_s
        self._target: Target | None = None
        self._messages: tuple[str, ...] = ()
        self._seen: tuple[float, ...] = ()
        self._changed_s = 0.0

    @property
    def target(self) -> Target | None:
        """Where the motion goes; None when none is watched."""
        return self._target

    def begin(self, target: Target, now_s: float) -> None:
        """Watch a motion that is being started."""
        self._target, self._messages = target, ()
        self._seen, self._changed_s = (), now_s

    def forget(self) -> None:
        """Watch nothing: the motion is over, was refused or was stopped."""
        self._target = None

    def renew(self) -> None:
        """Forget what was said, too: the machine has been made ready."""
        self._target, self._messages = None, ()

    def hear(self, messages: Sequence[str]) -> None:
        """Keep what LinuxCNC has said since the motion began."""
        new = (message for message in messages if message not in self._messages)
        self._messages = (*self._messages, *new)[-MESSAGES_KEPT:]

    def is_under_way(self, snapshot: Snapshot) -> bool:
        """Whether the trajectory still has way to go, as far as a machine without power can."""
        if not snapshot.machine_on:
            return False
        if self._target is None:
            return not snapshot.idle
        return not snapshot.is_commanded(self._target.values)

    def fault(self, snapshot: Snapshot, now_s: float, *, moving: bool) -> str:
        """What is wrong, in LinuxCNC's words where it has any; empty when nothing is."""
        said = "; ".join(self._messages)
        if not snapshot.machine_on:
            return said or "the machine is off"
        if not snapshot.in_control:
            return "another client has taken control of LinuxCNC"
        if self._is_frozen(snapshot, now_s, moving=moving):
            return said or (
                f"a motion has not moved for {self._frozen_s:g} s: "
                "feed hold, or a dead task or realtime part"
            )
        return said

    def _is_frozen(self, snapshot: Snapshot, now_s: float, *, moving: bool) -> bool:
        """Whether positions that should change have stopped changing: stale values look like it."""
        seen = (*snapshot.commanded, *snapshot.joints_deg)
        if seen != self._seen or not moving:
            self._seen, self._changed_s = seen, now_s
        return now_s - self._changed_s > self._frozen_s
