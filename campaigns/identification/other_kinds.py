"""Observations of other kinds than points: blocks of the fit from what was measured, and tests.

Held-out observations are never fitted: their residuals are compared with what the posterior and
the noise allow, χ² = r'(A C A' + V)⁻¹ r.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.errors import OptionsInvalid, ShotsInvalid, ShotsMissing
from campaigns.evaluation.decision import Decision, chance_of_larger, effective_dof
from campaigns.files.wording import suggestion
from campaigns.fit.error_model import Observations, first_frames
from campaigns.fit.fit import Fit
from campaigns.fit.kinds import FLAT_MM, FLAT_RAD, KINDS, Block, Slot
from campaigns.fit.predicted_rows import predict_block
from campaigns.fit.rigid_transforms import Transform
from campaigns.identification.findings import (
    HOLD_OUT_LEVEL,
    MOST_WRONG_SHOTS,
    UNSEEN_ROWS,
    WRONG_ROWS,
    Finding,
)
from campaigns.kinematics.model import Kinematics

FEWEST_HEIGHTS = 6
"""Heights of a plane: three place it, the others are of the robot."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Measured:
    """Observations of one kind at one target, as they were measured."""

    kind: str
    """Word of `campaigns.fit.kinds.KINDS`: height, distance, reflector or probe."""
    target: str
    """Name of the bed, part, holder or probe."""
    joints: Array
    """Encoder readings (M, n), rad or mm; (M, 2, n) of a distance."""
    values: Array
    """Heights or distances (M,), points (M, 3), or points and rotation vectors (M, 6); mm, rad.
    Points and vectors are in the tracker's frame."""
    std_mm: float | Sequence[float]
    """1 σ of a value, or of each of its coordinates; of turns that of points 100 mm apart."""
    surroundings: tuple[tuple[float, float], ...] = ()
    """Value and 1 σ of what the target is known by: a distance's shrinkage as a ratio, a place
    (x, y, z) of a reflector or a probe on the platform, mm. Nothing is known of planes."""
    part: int | None = None
    """Half of the platform that carries it; None: at the controlled point."""
    held_out: bool = False
    """Whether these check the result, and are not fitted."""


@dataclass(frozen=True, slots=True, eq=False)
class OtherKinds:
    """Blocks to fit, blocks held out, and the slots of both."""

    fitted: tuple[Block, ...] = ()
    held_out: tuple[Block, ...] = ()
    slots: tuple[Slot, ...] = ()


NO_KINDS = OtherKinds()


@dataclass(frozen=True, slots=True)
class KindTest:
    """Test of held-out observations of one kind and target."""

    target: str
    kind: str
    count: int
    p: float
    """Probability that chance alone makes χ² larger."""
    rms_mm: float
    """Root mean square of their residuals."""
    stated_mm: float
    """That which the posterior and the noise state."""


# Slots come from what is fitted: nothing would determine those of held-out observations alone.
def other_kinds(
    measured: Iterable[Measured], nominal: Kinematics, points: Observations | None = None
) -> OtherKinds:
    """Make blocks of observations; `points` place the tracker's frame for those of a tracker.

    Raise `OptionsInvalid` for an unknown kind or part, or surroundings that are missing,
    `ShotsMissing` for too few heights or nothing fitted, `ShotsInvalid` for values that are no
    numbers, or joints that lead to no assembly, `ValueError` for points that place no frame.
    """
    frame = None
    if points is not None:
        assembly = nominal.mechanism.assemble(nominal.p, points.joints, points.near)
        frame = first_frames(points, assembly.points, assembly.is_solved)[0][0]
    blocks: dict[bool, list[Block]] = {False: [], True: []}
    slots: dict[str, Slot] = {}
    kinds: dict[str, str] = {}
    for rows in sorted(measured, key=lambda rows: rows.held_out):
        block = _block_of(rows, nominal)
        blocks[rows.held_out].append(block)
        if kinds.setdefault(rows.target, rows.kind) != rows.kind:
            raise OptionsInvalid(
                f"'{rows.target}' has {kinds[rows.target]}s and {rows.kind}s",
                remedy="give each kind a target of its own",
            )
        if rows.target in slots:
            continue
        if rows.held_out:
            raise ShotsMissing(
                f"{rows.kind}s of {rows.target} are held out, but none is fitted",
                remedy="hold out some of them, and fit the others",
            )
        slots[rows.target] = _slot_of(rows, block, nominal, frame)
    return OtherKinds(tuple(blocks[False]), tuple(blocks[True]), tuple(slots.values()))


def _block_of(rows: Measured, nominal: Kinematics) -> Block:
    """Return the block of these rows; raise if they cannot be one."""
    if rows.kind not in KINDS:
        raise OptionsInvalid(
            f"'{rows.kind}' is no kind of observation", remedy=suggestion(rows.kind, tuple(KINDS))
        )
    kind = KINDS[rows.kind]
    axes, width = len(nominal.mechanism.joints), len(kind.columns)
    joints = np.asarray(rows.joints, dtype=np.float64).reshape(-1, kind.bodies, axes)
    values = np.asarray(rows.values, dtype=np.float64).reshape(-1, width)
    if len(joints) != len(values):
        raise ShotsInvalid(
            f"{rows.target}: {len(values)} values of {len(joints)} observations",
            remedy="give the joints of each value",
        )
    if rows.kind == "height" and not rows.held_out and len(values) < FEWEST_HEIGHTS:
        raise ShotsMissing(
            f"{len(values)} heights of {rows.target}: they say nothing but where its plane is",
            remedy=f"touch it at {FEWEST_HEIGHTS} places at least, better 30",
        )
    std = np.broadcast_to(np.asarray(rows.std_mm, dtype=np.float64), (width,))
    if not (np.isfinite(values).all() and np.isfinite(std).all() and std.min() > 0.0):
        raise ShotsInvalid(
            f"{rows.target}: a value is no number, or a σ not above 0",
            remedy="leave out what was not measured, and state its σ",
        )
    try:
        seen = replace(nominal, mechanism=nominal.mechanism.seen_from(rows.part))
    except ValueError as error:
        raise OptionsInvalid(
            f"{rows.target}: {error}", remedy="leave out part for the controlled point"
        ) from error
    poses = seen.forward(joints.reshape(-1, axes))
    is_solved = poses.is_solved.reshape(len(joints), kind.bodies).all(axis=1)
    if not is_solved.all():
        raise ShotsInvalid(
            f"{rows.target}: no assembly at the joints of observation {int(np.argmin(is_solved))}",
            remedy="look at the order and signs of joints, and at their units",
        )
    return Block(
        kind=kind,
        name=rows.target,
        parts=(rows.part,) * kind.bodies,
        joints=joints,
        near=poses.values.reshape(len(joints), kind.bodies, -1),
        values=values,
        stated=np.broadcast_to(np.diag(std**2), (len(values), width, width)),
        slots=(rows.target,),
        frame=np.zeros(len(values), dtype=np.intp),
    )


def _slot_of(rows: Measured, block: Block, nominal: Kinematics, frame: Transform | None) -> Slot:
    """Return the unknowns of the surroundings of a block, with what is known of them."""
    start = tuple(value for value, _ in rows.surroundings)
    std = tuple(sigma for _, sigma in rows.surroundings)
    wanted = {"height": 0, "distance": 1}.get(rows.kind, 3)
    if len(start) != wanted:
        what = {0: "none", 1: "a shrinkage and its σ"}.get(wanted, "a place of three and their σ")
        raise OptionsInvalid(
            f"{rows.kind}s of {rows.target} have {len(start)} surroundings, must have {what}",
            remedy="give value and 1 σ of each",
        )
    if rows.kind == "height":
        level = float((block.near[:, 0, 2] - block.values[:, 0]).mean())
        return Slot(rows.target, (0.0, 0.0, level), (FLAT_RAD, FLAT_RAD, FLAT_MM))
    if rows.kind == "probe" and frame is not None:
        # T = (R A)⁻¹ M: how the probe is turned on the platform, by its mean over all poses
        axes = nominal.mechanism.seen_from(rows.part).tool_axes(block.near[:, 0])
        measured = scipy.spatial.transform.Rotation.from_rotvec(block.values[:, 3:])
        seen = scipy.spatial.transform.Rotation.from_matrix(frame.rotation @ axes)
        turn = (seen.inv() * measured).mean().as_rotvec()
        start, std = (*start, *turn.tolist()), (*std, *(FLAT_RAD,) * 3)
    return Slot(rows.target, start, std)


def tested_by(blocks: Iterable[Block]) -> frozenset[str]:
    """Return the quantities that held-out blocks check."""
    return frozenset(name for block in blocks for name in block.kind.checks)


# Averaged over sizes, the covariance is of the linear model at the likeliest ones. There a bed's
# plane and the robot's base cancel, by degrees and millimetres; elsewhere a thousandth would be
# left, more than what is tested.
def tests_of(fit: Fit, likeliest: Fit, held_out: Iterable[Block]) -> Iterator[KindTest]:
    """Yield the test of each block that was never fitted, by a fit averaged over its sizes.

    `likeliest` is the fit before, at the likeliest sizes.
    """
    middle = fit.observations.middle
    for block in held_out:
        unseen, rows = (
            predict_block(of.model, of.at.x, of.at.frames, block, middle) for of in (fit, likeliest)
        )
        errors, width = unseen.residual.ravel(), unseen.residual.shape[1]
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
        )


def kind_findings(fit: Fit, tests: Iterable[KindTest]) -> Iterator[Finding]:
    """Yield findings on observations left out, and on held-out ones farther off than σ allow."""
    for block, good in zip(fit.observations.blocks, fit.good_of_others, strict=True):
        left_out = np.flatnonzero(good < 0.5).tolist()
        if left_out:
            numbers = ", ".join(map(str, left_out))
            says = f"{block.kind.name}s of {block.name} left out as wrong: {numbers} (from 0)"
            share = len(left_out) / len(good)
            decision: Decision | None = None
            if share > MOST_WRONG_SHOTS:
                decision = "not decided"
                limit = f"limit {100.0 * MOST_WRONG_SHOTS:.0f} %"
                says += f", {100.0 * share:.0f} % of them ({limit}): measure these again"
            yield Finding(WRONG_ROWS, says, decision, {"count": float(len(left_out))})
    for test in tests:
        says = (
            f"{test.count} {test.kind}s of {test.target} that were not fitted: rms "
            f"{test.rms_mm:.2g} mm, stated {test.stated_mm:.2g} mm (p = {test.p:.1g}, limit "
            f"{HOLD_OUT_LEVEL:g})"
        )
        decision = None if test.p >= HOLD_OUT_LEVEL else "not decided"
        yield Finding(UNSEEN_ROWS, says, decision, {"p": test.p, "count": float(test.count)})
