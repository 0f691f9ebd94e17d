"""The mechanic's list: what repairs bring, and the robot from above with what there is to mend.

The terminal shows the table too, so nothing here needs matplotlib.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from markupsafe import Markup

from campaigns.arrays import Array
from campaigns.evaluation.mechanical_advice import Instruction, MechanicalAdvice
from campaigns.files.table import Column
from campaigns.mechanisms.parameters import FOREARM
from campaigns.robots.robot import RobotFile

INK, GREY, MEND, WASH = "#22303c", "#9aa4ac", "#98281f", "#f4f6f7"
SIZE, RIM = 420.0, 44.0
"""Of the square drawing, in its own units: on a phone one is about a pixel."""
DISC, MOTOR, ROD, LABEL = 10.0, 20.0, 8.0, 26.0
"""A number's radius, half of a motor, half of two rods' distance, an arm's name from its end."""
DOWN = 0.25
"""Of a forearm from its upper end, where a number stands clear of motors and carriages."""
Spot = tuple[int | None, tuple[int, ...]]
"""Arm, and sides of its rods, of which left is 1; none: its motor or carriage."""

BROUGHT: tuple[Column[tuple[int, Instruction]], ...] = (
    Column("after", lambda row: row[0]),
    Column("mean", lambda row: row[1].mean_mm),
    Column("max", lambda row: row[1].max_mm),
    Column("better by", lambda row: row[1].gain_mm),
    Column("± σ", lambda row: row[1].gain_std_mm),
)


def robot_from_above(robot: RobotFile, advice: MechanicalAdvice) -> Markup:
    """Robot in the middle of its workspace as an SVG element, x to the right, y up.

    Arms with something to mend are dark, all others grey. An instruction's number stands on the
    forearm, else at the motor or carriage; on the platform where it is of no arm. Rods that are
    off are red.
    """
    space, discs = robot.parameters.space, list[str]()
    numbers, off = defaultdict[Spot, list[int]](list), set[tuple[int | None, int]]()
    for number, each in advice.numbered:
        by = {space[name].field.name: change for name, change in each.change.items()}
        half = by.get(FOREARM, 0.0) * (sum(by.values()) - by.get(FOREARM, 0.0))
        rods = tuple(side for side in (1, -1) if FOREARM in by and side * half >= 0.0)
        numbers[each.arm, rods].append(number)
        off |= {(each.arm, side) for side in rods}
    motors, elbows, ends, bars = _places(robot)
    mended = {arm for arm, _ in numbers}
    shapes = [*_axes(), _path(ends, INK if None in mended else GREY, 3.0, WASH)]
    for arm, (motor, elbow, end, bar) in enumerate(zip(motors, elbows, ends, bars, strict=True)):
        colour, away = INK if arm in mended else GREY, elbow - SIZE / 2.0
        shapes.append(_path(np.array([motor, elbow]), colour, 6.0))
        shapes.append(_path(np.array([motor - MOTOR * bar, motor + MOTOR * bar]), colour, 12.0))
        for side in (1, -1):
            rod = np.array([elbow, end]) + side * ROD * bar
            shapes.append(_path(rod, MEND if (arm, side) in off else colour, 2.5))
        shapes.append(_text(f"arm {arm}", elbow + LABEL * away / np.hypot(*away), colour))
    for (at, rods), those in numbers.items():
        place, way = ends.mean(axis=0), np.array([1.0, 0.0])
        if at is not None:
            along, bar = ends[at] - elbows[at], bars[at]
            beside = elbows[at] + DOWN * along + (DISC + ROD) * sum(rods) * bar
            place, way = (beside, along / np.hypot(*along)) if rods else (motors[at], bar)
        discs += _discs(those, place, way)
    named = ", ".join(f"arm {arm}" for arm in range(len(motors)) if arm in mended) or "no arm"
    head = (
        f'<svg viewBox="0 0 {SIZE:g} {SIZE:g}" role="img" aria-label="The robot from above; '
        f'to mend: {named}" font-size="14" text-anchor="middle" stroke-linejoin="round">'
    )
    return Markup("".join([head, *shapes, *discs, "</svg>"]))  # noqa: S704 - numbers alone


def _places(robot: RobotFile) -> tuple[Array, Array, Array, Array]:
    """Motors, elbows and plate's joints (n, 2) in the drawing, and directions of their bars.

    To the left as seen from the middle, as a mechanic's list has it.
    """
    model, parameters = robot.kinematics, robot.parameters
    pose, plate = robot.workspace_centre[None], model.mechanism.plate
    joints = model.inverse(pose)
    if not joints.found.all():  # a file's centre need not be a pose that it can take
        pose = replace(robot, workspace_centre_mm=None).workspace_centre[None]
        joints = model.inverse(pose)
    found = model.mechanism.configuration(model.p, joints.values_or_raise())
    elbows = found.arms.elbows_mm[:2, :, 0].T
    ends = elbows + found.forearms_mm(pose)[:2, :, 0].T
    x, y, azimuths = (
        np.array([parameters[name] for name in parameters.space.of_field(field)])
        for field in ("x_mm", "y_mm", "azimuth_deg")
    )
    outward = np.radians(azimuths) if plate.outward_rad is None else np.array(plate.outward_rad)
    places = np.array([np.stack([x, y], axis=1), elbows, ends]) + np.array(plate.joints_mm)[:, :2]
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    scale = (SIZE - 2.0 * RIM) / (high - low).max() * np.array([1.0, -1.0])
    motors, elbows, ends = SIZE / 2.0 + scale * (places - (low + high) / 2.0)
    return motors, elbows, ends, np.stack([-np.sin(outward), -np.cos(outward)], axis=1)


def _axes() -> Iterator[str]:
    corner = np.array([SIZE / 2.0 - 15.0, SIZE - 6.0])  # where no robot has an arm
    for name, way in (("x", np.array([1.0, 0.0])), ("y", np.array([0.0, -1.0]))):
        tip, aside = corner + 28.0 * way, 3.0 * way[::-1]
        yield _path(np.array([corner, tip]), GREY, 1.5)
        yield _path(np.array([tip - aside, tip + aside, tip + 6.0 * way]), GREY, 1.0, GREY)
        yield _text(name, corner + 44.0 * way, GREY)


def _discs(numbers: Sequence[int], place: Array, way: Array) -> Iterator[str]:
    """Numbers beside each other about a place."""
    for at, number in enumerate(numbers):
        x, y = centre = place + 2.2 * DISC * (at - (len(numbers) - 1) / 2.0) * way
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{DISC:g}" fill="{MEND}" stroke="#fff"/>'
        yield _text(str(number), centre, "#fff")


def _path(places: Array, colour: str, width: float, fill: str = "none") -> str:
    """Closed line through places (K, 2): one of two goes there and back."""
    way = "L".join(f"{x:.1f} {y:.1f}" for x, y in places.tolist())
    return f'<path d="M{way}Z" fill="{fill}" stroke="{colour}" stroke-width="{width:g}"/>'


def _text(words: str, place: Array, colour: str) -> str:
    return f'<text x="{place[0]:.1f}" y="{place[1] + 5.0:.1f}" fill="{colour}">{words}</text>'
