"""A plan as the engine takes it: steps in groups that count only together."""

from collections.abc import Iterable, Sequence
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
    """Shots commanded by joint angles: independent of the kinematics that the controller holds."""
    return tuple(Step(shot, "joints") for shot in shots)


def groups(steps: Sequence[Step]) -> tuple[Group, ...]:
    """Steps in their order, the shots of a pair together where its first one stands."""
    partners: dict[int, list[Step]] = {}
    for step in steps:
        if step.planned.pair is not None:
            partners.setdefault(step.planned.pair, []).append(step)
    found: list[Group] = []
    for step in steps:
        pair = step.planned.pair
        if pair is None:
            found.append((step,))
        elif partners[pair][0] is step:
            found.append(tuple(partners[pair]))
    return tuple(found)


def shots_of(group: Group) -> tuple[int, ...]:
    """Numbers of a group's shots."""
    return tuple(step.planned.shot for step in group)


def stops_of(all_groups: Iterable[Group]) -> list[tuple[float, ...]]:
    """The joints at which the robot stops when it takes these groups, one after another."""
    steps = [step for group in all_groups for step in group]
    return [stop for step in steps for stop in (*step.approach, step.planned.joints)]
