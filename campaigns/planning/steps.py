"""A plan as the engine takes it: steps in groups that count only together."""

from collections.abc import Iterable
from dataclasses import dataclass

from campaigns.journal.records import Command
from campaigns.planning.plan_file import PlannedShot
from drivers.values import Pose


@dataclass(frozen=True, slots=True)
class Step:
    """Shot to take, how it is commanded, and the joints to pass on the way to it.

    `corrected` is the pose to command instead of the wanted one, to a controller that keeps its
    nominal parameters.
    """

    planned: PlannedShot
    command: Command
    approach: tuple[tuple[float, ...], ...] = ()
    corrected: Pose | None = None


Group = tuple[Step, ...]
"""The two shots of a pair, or one shot that stands alone. It is measured whole, or again."""


def joint_steps(shots: Iterable[PlannedShot]) -> tuple[Step, ...]:
    """Command shots by joint angles: independent of the kinematics that the controller holds."""
    return tuple(Step(shot, "joints") for shot in shots)


def groups(steps: Iterable[Step]) -> tuple[Group, ...]:
    """Group steps in their order, the shots of a pair together where its first one stands."""
    by_pair: dict[tuple[str, int], list[Step]] = {}
    for place, step in enumerate(steps):
        pair = step.planned.pair
        by_pair.setdefault(("alone", place) if pair is None else ("pair", pair), []).append(step)
    return tuple(map(tuple, by_pair.values()))


def shots_of(group: Group) -> tuple[int, ...]:
    """Return the numbers of a group's shots."""
    return tuple(step.planned.shot for step in group)
