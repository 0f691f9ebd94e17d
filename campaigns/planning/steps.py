"""A plan as the measuring engine takes it: steps in groups that count only together."""

from collections.abc import Iterable
from dataclasses import dataclass

from campaigns.journal.records import Command
from campaigns.planning.plan_file import PlannedShot
from drivers.values import Pose


@dataclass(frozen=True, slots=True)
class Step:
    """Shot to take, how it is commanded, and the joints to pass on the way to it."""

    planned: PlannedShot
    command: Command
    approach: tuple[tuple[float, ...], ...] = ()
    """Joints to pass before the shot's own, in this order; () if the way to it is free."""
    corrected: Pose | None = None
    """Pose to command to a controller that keeps its nominal parameters; None: the planned one."""


Group = tuple[Step, ...]
"""The two shots of a pair, or one shot that stands alone; repeated as a whole if one fails."""


def joint_steps(shots: Iterable[PlannedShot]) -> tuple[Step, ...]:
    """Command shots by joint angles: independent of the kinematics that the controller holds."""
    return tuple(Step(shot, "joints") for shot in shots)


def groups(steps: Iterable[Step]) -> tuple[Group, ...]:
    """Group steps in their order, the shots of a pair together where its first one stands."""
    # A dict keeps the order in which keys came. The word keeps pair 3 and step 3 apart.
    by_pair: dict[tuple[str, int], list[Step]] = {}
    for place, step in enumerate(steps):
        pair = step.planned.pair
        key = ("alone", place) if pair is None else ("pair", pair)
        by_pair.setdefault(key, []).append(step)
    return tuple(map(tuple, by_pair.values()))


def shots_of(group: Group) -> tuple[int, ...]:
    """Return the numbers of a group's shots."""
    return tuple(step.planned.shot for step in group)
