"""Mechanic's list: which parameters may be read as dimensions, and what to do about them.

A fit's lengths take up whatever the model lacks, and the base frame is placed by parts that may be
off themselves. So a part is named only where its error is beyond its uncertainty, beyond what may
hide and, of a joint's home, beyond what the axes that level the frame may lean (docs/advice.md).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.estimation.datum import datum_influence
from campaigns.estimation.information import Uncertainty, WorkspaceSample
from campaigns.estimation.rigid_transforms import fit_transform
from campaigns.evaluation.decision import COVERAGE, Decision
from campaigns.evaluation.diagnostics import Doubt
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import FOREARM, JOINT_OFFSETS, ROD, Repair
from campaigns.mechanisms.transmission import ECCENTRIC
from campaigns.robots.robot import RobotFile

BEYOND = 2.0
"""U by which a part must be off."""
LEAST_LEAN_DEG = math.degrees(0.5e-3)
"""What the axes that level the frame may lean, however little the others were found to."""
UNITS = {
    "mm": (1.0, 2),
    "°": (1.0, 3),
    "mrad": (1e3 * math.radians(1.0), 2),
    "′": (60.0, 2),
    "″": (3600.0, 0),
}
"""Of what is said: factor of the file's unit, and decimals."""
EVERY, SEED = 3, 1
"""Every third pose of the workspace is simulated."""
LEFT_AND_RIGHT = "Left and right are seen from the robot's middle."
HIDES = "what the tests miss may do as much"
LEANS = "a lean of the axes that level the frame may do as much"
USELESS = "after the others it brings nothing: leave it to the parameters"
NO_DISTANCE = "its rods are unequal; mm need mechanics.rod_distance_mm in robot.yaml"
FRAME = "they place the frame: their errors are seen as all others'"
ECCENTRICITY = ("eccentricity_sin_deg", "eccentricity_cos_deg")
SAGS = "its arm's own weight may do as much: look at the encoder before you move it"
UNTESTED = "nothing shows what may hide: identify with --estimator points, from more shots"


@dataclass(frozen=True, slots=True, kw_only=True)
class Instruction:
    """Part that is off, what to do about it, and what that brings after those before it."""

    arm: int | None
    says: str
    act: str
    size: float
    """In the unit of what it says, as U is."""
    expanded: float
    unit: str
    change: dict[str, float]
    """What the repair takes off parameters, mm and deg."""
    mean_mm: float = math.nan
    """Error of position after it, over the workspace, by a controller of nominal parameters."""
    max_mm: float = math.nan
    gain_mm: float = math.nan
    """How much less the mean is than before it."""
    gain_std_mm: float = math.nan


@dataclass(frozen=True, slots=True)
class MechanicalAdvice:
    """Instructions in the order in which they bring most, and what to leave alone, by reason."""

    instructions: tuple[Instruction, ...] = ()
    left: dict[str, tuple[str, ...]] = field(default_factory=dict)
    mean_mm: float | None = None
    """Error of position as it is."""
    refused: str = ""
    """Why nothing may be read as a dimension."""

    @property
    def numbered(self) -> tuple[tuple[int, Instruction], ...]:
        """Instructions as people count them."""
        return tuple(enumerate(self.instructions, 1))


@dataclass(frozen=True, slots=True, eq=False)
class Dimensions:
    """Changes of parameters from nominal, mm and deg, with all that says how far they are true."""

    robot: RobotFile
    """Nominal one, whose ripples come as often as they were found to."""
    changes: Mapping[str, float]
    known: Uncertainty
    coverage: float
    """Half-width of 95 % intervals in σ."""
    hidden: Mapping[str, Mapping[str, float]]
    """By cause: how far each parameter may be off by what goes unseen of it."""

    def refusal(self, verdict: Decision, doubts: Sequence[Doubt]) -> str:
        """Why none may be read as a dimension; "" where they may."""
        doubted = next((each.says for each in doubts if each.of_model), "")
        if doubted or verdict != "pass":
            return f"the model is in doubt: {doubted or f'the verdict is {verdict}'}"
        return "" if self.hidden else UNTESTED

    def size(self, weights: Mapping[str, float]) -> float:
        """Weighted sum of changes."""
        return sum(weight * self.changes.get(name, 0.0) for name, weight in weights.items())

    def expanded(self, weights: Mapping[str, float]) -> float:
        """U of it."""
        return max(self.coverage, COVERAGE) * self.known.of_sum(weights)

    def hides(self, weights: Mapping[str, float]) -> float:
        """How far it may be off by what tests miss."""
        return max(
            sum(abs(weight * by_name.get(name, 0.0)) for name, weight in weights.items())
            for by_name in self.hidden.values()
        )

    def leans(self, added: Mapping[str, float]) -> float:
        """How far a home may be off by the leans that level the frame, each as any other's."""
        space, total = self.robot.parameters.space, 0.0
        for name in (each for each in added if space[each].is_angle):
            others = {*space.of_field(space[name].field.name)} & {*self.known.names}
            far = (abs(self.changes[each]) + self.expanded({each: 1.0}) for each in others)
            total += abs(added[name]) * max((LEAST_LEAN_DEG, *far))
        return total


def mechanical_advice(found: Dimensions, poses: Array) -> MechanicalAdvice:
    """List by dimensions, with repairs simulated at poses (N, t) of the workspace."""
    robot, space = found.robot, found.robot.parameters.space
    influence = datum_influence(robot.kinematics, poses)
    instructions, left = list[Instruction](), dict[str, tuple[str, ...]]()
    for part in _parts(found):
        size, expanded = found.size(part.weights), found.expanded(part.weights)
        if abs(size) <= BEYOND * expanded:
            continue
        first = space[next(iter(part.weights))]
        added = influence.get(first.name, {})
        limit = BEYOND * expanded + found.hides(part.weights)
        leans = found.leans(added) if first.field.name in JOINT_OFFSETS else 0.0
        repair, says = part.repair, None
        if isinstance(repair, Repair):
            says = repair.above if size > 0.0 else repair.below
        if isinstance(repair, Repair) and isinstance(says, tuple) and abs(size) > limit + leans:
            instructions.append(_instruction(found, part, repair.unit, says, added))
            continue
        why = says if isinstance(says, str) else repair if isinstance(repair, str) else ""
        why = why or (HIDES if abs(size) <= limit else LEANS)
        decimals = {"mm": 2, "deg": 3, "ppm": 0}[first.unit]
        told = f"{part.name or first.label} {size:+.{decimals}f}{first.sign}"
        left[why] = (*left.get(why, ()), told)
    mean_mm, done = _in_order(found, poses[::EVERY], instructions)
    useless = {each.says for each in instructions} - {each.says for each in done}
    left |= {USELESS: tuple(sorted(useless))} if useless else {}
    left[FRAME] = tuple(space[name].label for name in space.datum)
    return MechanicalAdvice(tuple(done), left, mean_mm)


@dataclass(frozen=True, slots=True)
class _Part:
    """Part, its repair, and the weights of the parameters whose sum is its error."""

    name: str
    repair: Repair | str
    weights: dict[str, float]
    shares: dict[str, float]
    """What each parameter has of a unit of the error."""


def _parts(found: Dimensions) -> Iterator[_Part]:
    """Parts of a robot: rods one by one where their distance tells them apart.

    By mean and half of the difference; eccentric encoders by both of their terms.
    """
    space, apart_mm = found.robot.parameters.space, found.robot.mechanics.rod_distance_mm
    for forearm, skew in zip(space.of_field(FOREARM), space.skews, strict=True):
        name = f"forearm {space[forearm].arm}"
        if skew not in found.known.names:
            yield _Part(f"{name}: both rods", ROD, {forearm: 1.0}, {forearm: 1.0})
        elif apart_mm is None:
            yield _Part(f"{name}: rods on average", ROD, {forearm: 1.0}, {forearm: 1.0})
            yield _Part(name, NO_DISTANCE, {skew: 1.0}, {skew: 1.0})
        else:
            half = 0.5 * math.radians(apart_mm)
            for side, way in (("left", half), ("right", -half)):
                shares = {forearm: 0.5, skew: 0.5 / way}
                yield _Part(f"{name}: {side} rod", ROD, {forearm: 1.0, skew: way}, shares)
    for sine, cosine in zip(*map(space.of_field, ECCENTRICITY), strict=True):
        both = {name: found.changes.get(name, 0.0) for name in (sine, cosine)}
        size = math.hypot(*both.values())
        if size > 0.0:
            ways = {name: each / size for name, each in both.items()}
            told = abs(both[sine]) > BEYOND * found.expanded({sine: 1.0})
            yield _Part(f"encoder {space[sine].arm}", ECCENTRIC if told else SAGS, ways, ways)
    for each in map(space.__getitem__, found.known.names):
        if each.field.repair not in {ROD, ECCENTRIC}:
            yield _Part("", each.field.repair, {each.name: 1.0}, {each.name: 1.0})


def _instruction(
    found: Dimensions, part: _Part, unit: str, words: tuple[str, str], added: Mapping[str, float]
) -> Instruction:
    """Instruction in a mechanic's words, with the arms of the datum that are seen in it."""
    space, mechanics = found.robot.parameters.space, found.robot.mechanics
    arm = space[next(iter(part.weights))].arm
    (factor, decimals), change = UNITS[unit], found.size(part.weights)
    size, wide = factor * change, factor * found.expanded(part.weights)
    sign = f" {unit}" if unit.isalpha() else unit
    shown = f"{abs(size):.{decimals}f}{sign} ± {wide:.{decimals}f}{sign}"
    arms = sorted({str(space[name].arm) for name in added if space[name].arm != arm})
    seen = f" (seen from arm{'s' * (len(arms) > 1)} {' and '.join(arms)})" if arms else ""
    bolts_mm, pitch_mm = mechanics.bolt_distance_mm, mechanics.rod_thread_pitch_mm
    by = f"{abs(size):.{decimals}f}{sign}"
    if unit == "mrad":
        over = "a metre" if bolts_mm is None else f"{bolts_mm:g} mm"
        by = f"{abs(size) * (bolts_mm or 1e3) / 1e3:.2f} mm over {over}"
    elif part.repair is ROD and pitch_mm is not None:
        by = f"{abs(size) / pitch_mm:.2f} turns of its thread ({pitch_mm:g} mm)"
    finding, act = (text.format(arm=arm, part=part.name, size=shown, by=by) for text in words)
    return Instruction(
        arm=arm,
        says=f"{finding}{seen}",
        act=act,
        size=size,
        expanded=wide,
        unit=unit,
        change={name: change * share for name, share in part.shares.items()},
    )


def _in_order(
    found: Dimensions, poses: Array, instructions: Sequence[Instruction]
) -> tuple[float, list[Instruction]]:
    """Mean error of position, mm, and instructions as each brings most after those before it.

    As far as they bring anything. The controller keeps its nominal parameters, its frame is best
    fitted; poses are those that every robot takes, each from a side drawn for each joint.
    """
    nominal, rng = found.robot.kinematics, np.random.default_rng(SEED)
    own, joints = _after(found, ()), nominal.inverse(poses)
    taken = joints.found & own.inverse(poses).found
    readings, wanted = joints.values[taken], poses[taken]
    sides = rng.choice([-1.0, 1.0], size=readings.shape)
    sample = WorkspaceSample.of(own, found.known.names, wanted, approach=sides)
    moved_mm = {
        each.says: sample.jacobian @ [each.change.get(name, 0.0) for name in sample.names]
        for each in instructions
    }
    order, rest = list[Instruction](), [*instructions]
    error = np.nan_to_num(_errors_mm(own.forward(readings, wanted, sides).values, wanted))
    while rest:  # to first order, which is near enough to choose by
        after = [error - moved_mm[each.says] for each in rest]
        best = int(np.argmin([np.linalg.norm(each, axis=1).mean() for each in after]))
        error = after[best]
        order.append(rest.pop(best))
    robots = [_after(found, order[:count]) for count in range(len(order) + 1)]
    reached = [each.forward(readings, wanted, sides) for each in robots]
    both = np.all([each.found for each in reached], axis=0)
    errors = np.array([_errors_mm(each.values[both], wanted[both]) for each in reached])
    size = np.linalg.norm(errors, axis=2)
    mean = size.mean(axis=1)
    std = found.known.of_gains(replace(sample, jacobian=sample.jacobian[both]), errors, rng)
    figures = zip(order, mean[1:], size.max(axis=1)[1:], -np.diff(mean), std, strict=True)
    done = [
        replace(each, mean_mm=float(a), max_mm=float(b), gain_mm=float(c), gain_std_mm=float(d))
        for each, a, b, c, d in figures
    ]
    return float(mean[0]), done[: int(np.argmin(mean))]


def _after(found: Dimensions, done: Sequence[Instruction]) -> Kinematics:
    """Robot as it was found, after repairs."""
    nominal = found.robot.parameters
    values = {name: nominal.get(name, 0.0) + by for name, by in found.changes.items()}
    for name, by in (item for each in done for item in each.change.items()):
        values[name] -= by
    return Kinematics.of(found.robot.mechanism, nominal | values)


def _errors_mm(reached: Array, wanted: Array) -> Array:
    points, aims = reached[:, :3], wanted[:, :3]
    return np.asarray(fit_transform(points, aims).apply(points) - aims)
