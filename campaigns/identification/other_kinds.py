"""Observations of other kinds than points: blocks of the fit from what was measured, and tests.

Held-out observations are never fitted: their residuals are compared with what the posterior and
the noise allow, χ² = r'(A C A' + V)⁻¹ r.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy

from campaigns.arrays import Array, Index, Mask
from campaigns.errors import ObservationsInvalid, OptionsInvalid, ShotsInvalid, ShotsMissing
from campaigns.evaluation.decision import Decision, chance_of_larger, effective_dof
from campaigns.files.wording import suggestion
from campaigns.fit.error_model import Observations, first_frames, frame_motion, frames_of_shots
from campaigns.fit.events import changes_without_points
from campaigns.fit.fit import Fit
from campaigns.fit.kinds import KINDS, Block, Bodies, Differentiated, differentiate
from campaigns.fit.predicted_rows import SeenPlaces, predict_block
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.slots import PLACE, Slot, SlotKind
from campaigns.identification.findings import (
    HOLD_OUT_LEVEL,
    MOST_WRONG_SHOTS,
    NOT_TESTED,
    UNSEEN_ROWS,
    WRONG_ROWS,
    Finding,
    change_finding_of_rows,
)
from campaigns.identification.objects import Object, linked, with_supports
from campaigns.kinematics.model import Kinematics

ROWS_OF_AN_UNKNOWN = 2
"""Rows for each unknown of the surroundings of which nothing is known: six heights of a plane, of
which three place it, and the others are of the robot."""
START_MM = 1.0
"""Residual beyond which rows count less where the search for the surroundings begins."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Measured:
    """Observations of one kind at one object, as they were measured."""

    kind: str
    """Word of `campaigns.fit.kinds.KINDS`, such as height, distance, reflector or probe."""
    object: Object
    """What was measured: a bed, a part, a probe."""
    joints: Array
    """Encoder readings (M, n), rad or mm; (M, 2, n) of what is between two poses."""
    values: Array
    """Values in the order of the kind's columns, (M, v) or (M,), mm and rad; those that a tracker
    took are in its frame."""
    std_mm: float | Sequence[float] | Array
    """1 σ of a value, or of each of its rows (r,), or of those of each observation (M, r); of
    turns that of points 100 mm apart."""
    held_out: bool = False
    """Whether these check the result, and are not fitted."""
    moment: Array | None = None
    """Time of each, (M,), s; None: no time is known."""
    session: Array | None = None
    """Number of the tracker's station of each, (M,), from 1; None: there is one."""
    labels: tuple[str, ...] = ()
    """Names of them in messages, such as file and line; (): their numbers from 0."""


@dataclass(frozen=True, slots=True, eq=False)
class OtherKinds:
    """Blocks to fit, blocks held out, and the slots of both."""

    fitted: tuple[Block, ...] = ()
    held_out: tuple[Block, ...] = ()
    slots: tuple[Slot, ...] = ()
    untested: tuple[Block, ...] = ()
    """Blocks held out, with surroundings that nothing fitted or stated determines."""

    @property
    def has_moments(self) -> bool:
        """Whether any fitted observation has its moment."""
        return any(bool(np.isfinite(block.moment).any()) for block in self.fitted)


NO_KINDS = OtherKinds()


@dataclass(frozen=True, slots=True)
class KindTest:
    """Test of held-out observations of one kind and object."""

    object: str
    kind: str
    count: int
    p: float
    """Probability that chance alone makes χ² larger."""
    rms_mm: float
    """Root mean square of their residuals."""
    stated_mm: float
    """That which the posterior and the noise state."""
    checks: tuple[str, ...] = ()
    """Quantities of which it is a test."""

    @property
    def applied_ratio(self) -> float:
        """Factor of σ of these quantities: 1 while chance explains the residuals."""
        return 1.0 if self.p >= HOLD_OUT_LEVEL else max(1.0, self.rms_mm / self.stated_mm)


# Slots of which nothing is known come from what is fitted: held-out observations alone would not
# determine them, and test nothing.
def other_kinds(
    measured: Iterable[Measured],
    nominal: Kinematics,
    points: Observations | None = None,
    sessions: Index | None = None,
) -> OtherKinds:
    """Make blocks of observations, each with its moment in s, infinite where it has none.

    `points` place the tracker's frames with those of a tracker's observations that have a place;
    `sessions` are the numbers of the sessions with a frame of their own; None: one for all.

    Raise `OptionsInvalid` for an unknown kind or part, or objects that contradict each other,
    `ShotsMissing` for too few rows or nothing fitted, `ShotsInvalid` for values that are no
    numbers, joints that lead to no assembly, or places that place no frame.
    """
    measured = sorted(measured, key=lambda rows: rows.held_out)
    things = linked(with_supports(rows.object for rows in measured))
    measured = [replace(rows, object=things[rows.object.name]) for rows in measured]
    made = [(rows, _block_of(rows, nominal, sessions)) for rows in measured]
    frames = _frames_of(nominal, [pair for pair in made if not pair[0].held_out], points)
    blocks: dict[bool, list[Block]] = {False: [], True: []}
    slots: dict[str, Slot] = {}
    lacking: dict[str, int] = {}
    untested: list[Block] = []
    for rows, block in made:
        with_its = dict(slots)
        flat = _add_slots(with_its, rows.object, block, bodies_of(block, nominal, frames))
        if flat and rows.held_out:
            untested.append(block)
            continue
        slots = with_its
        blocks[rows.held_out].append(block)
        lacking |= {name: ROWS_OF_AN_UNKNOWN * slots[name].count for name in flat}
    _refuse_too_few(blocks[False], lacking)
    return OtherKinds(
        tuple(blocks[False]), tuple(blocks[True]), tuple(slots.values()), tuple(untested)
    )


# A reflector whose place nothing states would pull the frame by it: it helps where nothing else is.
def _frames_of(
    nominal: Kinematics, made: Iterable[tuple[Measured, Block]], points: Observations | None
) -> tuple[Transform, ...]:
    """Return the first frames, by points and by fitted observations that have a place."""
    stated: list[SeenPlaces] = []
    unstated: list[SeenPlaces] = []
    for rows, block in made:
        if block.kind.has_places:
            body, owner = bodies_of(block, nominal)[0], _owner(block.kind.slots[0], rows.object)
            prior = owner.stated(PLACE.name)
            place = body.point(np.array(prior[0])) if prior is not None else body.place
            seen = SeenPlaces(place, block.values[:, :3], block.frame)
            (unstated if prior is None else stated).append(seen)
    if points is None:
        mechanism = nominal.mechanism
        points = Observations.unmeasured(
            np.zeros((0, len(mechanism.joints))), np.zeros((0, len(mechanism.task)))
        )
    if not len(points) and not stated:
        stated = unstated
    assembly = nominal.mechanism.assemble(nominal.p, points.joints, points.near)
    try:
        return first_frames(points, assembly.points, assembly.is_solved, stated)[0]
    except ValueError as error:
        raise ShotsInvalid(
            f"what the tracker saw does not place its frame: {error}",
            remedy="measure at places all over the workspace, from each of its stations",
        ) from error


def _block_of(rows: Measured, nominal: Kinematics, sessions: Index | None) -> Block:
    """Return the block of these rows, its moments in s; raise if they cannot be one."""
    if rows.kind not in KINDS:
        raise OptionsInvalid(
            f"'{rows.kind}' is no kind of observation", remedy=suggestion(rows.kind, tuple(KINDS))
        )
    kind, name = KINDS[rows.kind], rows.object.name
    axes, width = len(nominal.mechanism.joints), kind.width
    _refuse_shapes(rows, axes, width)
    joints = np.asarray(rows.joints, dtype=np.float64).reshape(-1, kind.poses, axes)
    values = np.asarray(rows.values, dtype=np.float64).reshape(-1, len(kind.columns))
    if len(joints) != len(values):
        raise ShotsInvalid(
            f"{name}: {len(values)} values of {len(joints)} observations",
            remedy="give the joints of each value",
        )
    std = np.broadcast_to(np.asarray(rows.std_mm, dtype=np.float64), (len(values), width))
    if not (np.isfinite(values).all() and np.isfinite(std).all() and (std > 0.0).all()):
        raise ShotsInvalid(
            f"{name}: a value is no number, or a σ not above 0",
            remedy="leave out what was not measured, and state its σ",
        )
    parts, joints = _parts_of(rows), np.repeat(joints, kind.bodies // kind.poses, axis=1)
    near = [_near(nominal, rows, part, joints[:, n]) for n, part in enumerate(parts)]
    owners = (_owner(slot, rows.object) for slot in kind.slots)
    return Block(
        kind=kind,
        name=name,
        parts=parts,
        joints=joints,
        near=np.stack(near, axis=1),
        values=values,
        stated=np.asarray(std[:, :, None] ** 2 * np.eye(width)),
        slots=tuple(f"{s.name} of {o.name}" for s, o in zip(kind.slots, owners, strict=True)),
        frame=_frame_numbers(rows, len(values), sessions if kind.by_tracker else None),
        moment=_moments_s(rows, len(values)),
        labels=rows.labels,
    )


def _refuse_shapes(rows: Measured, axes: int, width: int) -> None:
    """Raise `ShotsInvalid` for joints of another number than `axes`, or σ of another than rows."""
    joints, std = np.shape(rows.joints), np.shape(rows.std_mm)
    if joints[-1:] != (axes,):
        raise ShotsInvalid(
            f"{rows.object.name}: joints {joints} of a robot with {axes}",
            remedy=f"give {axes} joint values at each pose",
        )
    if std not in {(), (width,), (len(rows.values), width)}:
        raise ShotsInvalid(
            f"{rows.object.name}: σ {std} of {len(rows.values)} values with {width} rows each",
            remedy=f"give one σ, {width} of them, or {width} for each value",
        )


# Two bodies at one pose are the object and what it goes with.
def _parts_of(rows: Measured) -> tuple[int | None, ...]:
    """Return the parts of the platform that carry the bodies of an observation."""
    kind, thing = KINDS[rows.kind], rows.object
    if kind.bodies == kind.poses:
        return (thing.part,) * kind.bodies
    if thing.on is None:
        raise OptionsInvalid(
            f"{rows.kind} of {thing.name}: they are two, and only one is named",
            remedy=f"name the first one by `on` of {thing.name}",
        )
    return thing.support.part, thing.part


def _near(nominal: Kinematics, rows: Measured, part: int | None, joints: Array) -> Array:
    """Return the poses (M, t) of a body at joints (M, n) by the nominal robot."""
    try:
        seen = replace(nominal, mechanism=nominal.mechanism.seen_from(part))
    except ValueError as error:
        raise OptionsInvalid(
            f"{rows.object.name}: {error}", remedy="leave out body for the controlled point"
        ) from error
    poses = seen.forward(joints)
    if not poses.is_solved.all():
        first = int(np.argmin(poses.is_solved))
        where = rows.labels[first] if rows.labels else f"{rows.object.name}: observation {first}"
        raise ObservationsInvalid(
            f"{where}: the nominal robot cannot be assembled at its joints",
            remedy="check the order, signs and units of the joints, and that they are this robot's",
        )
    return poses.values


def _moments_s(rows: Measured, count: int) -> Array:
    """Return the moments of rows in s, (M,), infinite where they are unknown."""
    if rows.moment is None:
        return np.full(count, np.inf)
    moment = np.asarray(rows.moment, dtype=np.float64)
    if moment.shape != (count,):
        raise ShotsInvalid(
            f"{rows.object.name}: {moment.size} moments of {count} observations",
            remedy="give a moment of each, NaN where none is known",
        )
    return np.where(np.isfinite(moment), moment, np.inf)


def _frame_numbers(rows: Measured, count: int, sessions: Index | None) -> Index:
    """Return the number of each row's frame, (M,), among those of sessions; None: there is one."""
    if sessions is None:
        return np.zeros(count, dtype=np.intp)
    if rows.session is None or np.shape(rows.session) != (count,):
        raise OptionsInvalid(
            f"{KINDS[rows.kind].plural} of {rows.object.name} do not all state their session",
            remedy="give the number of the tracker's station of each, or leave out --sessions",
        )
    station = np.asarray(rows.session, dtype=np.intp)
    lacking = station[~np.isin(station, sessions)]
    if len(lacking):
        raise ShotsInvalid(
            f"{rows.object.name}: nothing fitted places the tracker's frame of session "
            f"{lacking[0]}",
            remedy="fit some of what was measured there, or leave it out",
        )
    return np.searchsorted(sessions, station)


def _owner(slot: SlotKind, thing: Object) -> Object:
    """Return the object of whose surroundings a slot is."""
    return thing.support if slot.of_support else thing


def bodies_of(
    block: Block, nominal: Kinematics, frames: tuple[Transform, ...] = ()
) -> list[Bodies]:
    """Return the nominal bodies of a block in the frames in which its values are.

    Without frames of a tracker in the base frame.
    """
    bodies = []
    for number, part in enumerate(block.parts):
        poses = block.near[:, number]
        axes = nominal.mechanism.seen_from(part).tool_axes(poses)
        body = Bodies(poses[:, :3], axes)
        if block.kind.by_tracker and frames:
            turns, shifts = frames_of_shots(frames, block.frame)
            place = (turns @ body.place[..., None])[..., 0] + shifts
            body = Bodies(np.asarray(place), np.asarray(turns @ axes))
        bodies.append(body)
    return bodies


def _add_slots(
    slots: dict[str, Slot], thing: Object, block: Block, bodies: Sequence[Bodies]
) -> list[str]:
    """Add a block's slots to those of others; return the names of new ones that nothing states."""
    flat: dict[str, SlotKind] = {}
    for kind, name in zip(block.kind.slots, block.slots, strict=True):
        if name in slots:
            continue
        owner = _owner(kind, thing)
        prior = owner.stated(kind.name)
        if prior is None:
            if any(kind.flat):
                flat[name] = kind
            prior = tuple(kind.begins(bodies[0].place)[0].tolist()), kind.flat
        slots[name] = Slot(owner.name, kind.name, *prior)
    if flat:
        whole = np.concatenate([slots[name].start for name in block.slots])
        sought = np.concatenate(
            [np.full(slots[name].count, name in flat) for name in block.slots]
        ).astype(bool)
        begins = product(*(kind.begins(bodies[0].place) for kind in flat.values()))
        solved = _search(block, bodies, whole, sought, map(np.concatenate, begins))
        for name in flat:
            count = slots[name].count
            slots[name] = replace(slots[name], start=tuple(solved[:count].tolist()))
            solved = solved[count:]
    return list(flat)


# Rows farther off than a millimetre count less, so that one that is wrong hardly moves the start.
def _search(
    block: Block, bodies: Sequence[Bodies], whole: Array, sought: Mask, begins: Iterable[Array]
) -> Array:
    """Return the values (u,) of the unknowns `sought` (s,) of slots that fit nominal bodies best.

    `whole` (s,) are the values of all slots, `begins` those at which a search begins, (u,) each.
    """

    def at(values: Array) -> Differentiated:
        slots = whole.copy()
        slots[sought] = values
        return differentiate(block.kind, block.values, bodies, slots)

    def residual(values: Array) -> Array:
        return at(values).residual.ravel()

    def jacobian(values: Array) -> Array:
        return at(values).by_slots[..., sought].reshape(-1, len(values))

    searches = [
        scipy.optimize.least_squares(
            residual, begin, jacobian, x_scale="jac", loss="soft_l1", f_scale=START_MM
        )
        for begin in begins
    ]
    best = min(searches, key=lambda search: float(search.cost))
    return np.asarray(best.x, dtype=np.float64)


def _refuse_too_few(fitted: Iterable[Block], lacking: Mapping[str, int]) -> None:
    """Raise `ShotsMissing` for slots of which nothing is known and that have too few rows."""
    for name, least in lacking.items():
        blocks = [block for block in fitted if name in block.slots]
        count = sum(block.stated[..., 0].size for block in blocks)
        if count < least:
            first, width = blocks[0], blocks[0].stated.shape[-1]
            raise ShotsMissing(
                f"{sum(map(len, blocks))} {first.kind.plural} of {first.name}: they say nothing "
                f"but what the {name} is",
                remedy=f"measure {-(-least // width)} at least, better five times as many",
            )


def tested_by(blocks: Collection[Block], elsewhere: Collection[int | None]) -> frozenset[str]:
    """Return the quantities that held-out blocks check.

    `elsewhere` are the other parts of the platform than the one that hold-out pairs are of.
    """
    tested = {name for block in blocks for name in block.kind.checks}
    parts = {part for block in blocks if block.kind.name == "reflector" for part in block.parts}
    if len(parts) > 1 or parts & {*elsewhere}:
        tested.add("rotation")
    return frozenset(tested)


# Averaged over sizes, estimates and covariance are of the linear model at the likeliest ones. There
# a bed's plane and the robot's base cancel, by degrees and millimetres; elsewhere a thousandth
# would be left, more than what is tested.
def tests_of(fit: Fit, likeliest: Fit, held_out: Iterable[Block]) -> Iterator[KindTest]:
    """Yield the test of each block that was never fitted, by a fit averaged over its sizes.

    `likeliest` is the fit before, at the likeliest sizes.
    """
    at, middle = likeliest.at, fit.observations.middle
    pairs = zip(at.frames, fit.at.frames, strict=True)
    step = np.concatenate([fit.at.x - at.x, *(frame_motion(*pair) for pair in pairs)])
    for block in held_out:
        rows = predict_block(likeliest.model, at.x, at.frames, block, middle)
        errors, width = (rows.residual + rows.jacobian @ step).ravel(), rows.residual.shape[1]
        by = rows.jacobian.reshape(len(errors), -1)
        noise = {part: fit.factors[part] * v for part, v in rows.noise.items()}
        covariance = by @ fit.covariance @ by.T
        for row, of_row in enumerate(np.asarray(sum(noise.values()))):
            span = slice(width * row, width * (row + 1))
            covariance[span, span] += of_row
        parts = (v for part, v in noise.items() if part != "stated")
        estimated = sum(float(np.trace(v.sum(axis=0))) for v in parts)
        dof = effective_dof(float(np.trace(covariance)), estimated, max(fit.freedom, 1.0))
        chi2 = float(errors @ np.linalg.solve(covariance, errors))
        yield KindTest(
            block.name,
            block.kind.name,
            len(block),
            chance_of_larger(chi2, len(errors), dof),
            float(np.sqrt((errors**2).mean())),
            float(np.sqrt(np.trace(covariance) / len(errors))),
            block.kind.checks,
        )


def ratio_of(name: str, tests: Iterable[KindTest]) -> float:
    """Return the factor of σ of a quantity by the tests of it: what unseen rows contradict."""
    return max((test.applied_ratio for test in tests if name in test.checks), default=1.0)


def change_findings_of_others(fit: Fit) -> Iterator[Finding]:
    """Yield a finding for each change in time that no shot is behind, by other kinds' rows."""
    for event, number in changes_without_points(fit):
        block = fit.observations.blocks[number]
        what = f"{block.kind.plural} of {block.name}"
        yield change_finding_of_rows(event, what, fit.model.nominal.mechanism.joints)


def kind_findings(
    fit: Fit, tests: Iterable[KindTest], untested: Iterable[Block] = ()
) -> Iterator[Finding]:
    """Yield findings on observations left out, and on held-out ones farther off than σ allow.

    `untested` are those held out that nothing can test.
    """
    for block, good in zip(fit.observations.blocks, fit.good_of_others, strict=True):
        left_out = np.flatnonzero(good < 0.5).tolist()
        if left_out:
            numbers = ", ".join(block.labels[n] if block.labels else str(n) for n in left_out)
            says = f"{block.kind.plural} of {block.name} left out as wrong: {numbers}"
            says += "" if block.labels else " (from 0)"
            share = len(left_out) / len(good)
            decision: Decision | None = None
            if share > MOST_WRONG_SHOTS:
                decision = "not decided"
                limit = f"limit {100.0 * MOST_WRONG_SHOTS:.0f} %"
                says += f", {100.0 * share:.0f} % of them ({limit}): measure these again"
            yield Finding(WRONG_ROWS, says, decision, {"count": float(len(left_out))})
    for test in tests:
        says = (
            f"{test.count} {KINDS[test.kind].plural} of {test.object} that were not fitted: rms "
            f"{test.rms_mm:.2g} mm, stated {test.stated_mm:.2g} mm (p = {test.p:.1g}, limit "
            f"{HOLD_OUT_LEVEL:g})"
        )
        decision = None
        if test.p < HOLD_OUT_LEVEL:
            decision = "not decided"
            says += f": σ of {' and '.join(test.checks)} is multiplied by {test.applied_ratio:.2g}"
        figures: dict[str, float | str] = {"p": test.p, "count": float(test.count)}
        figures |= {"rms_mm": test.rms_mm, "stated_mm": test.stated_mm}
        yield Finding(UNSEEN_ROWS, says, decision, figures)
    for block in untested:
        says = (
            f"not tested: {len(block)} {block.kind.plural} of {block.name} were held out, and "
            f"nothing that was fitted determines the {' or the '.join(block.slots)}: fit some of "
            "them, or state it"
        )
        yield Finding(NOT_TESTED, says, "not decided", {"count": float(len(block))})
