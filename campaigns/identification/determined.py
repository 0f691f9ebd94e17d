"""What observations determine of a robot, each quantity with its σ and what that rests on.

A σ that comes from tolerances is no measurement: a tracker's points of one reflector say little of
a platform's rotation, however small its σ by tolerances is. Each quantity is therefore stated with
two facts. It is *determined* if at most half of its variance comes from tolerances whose size the
shots do not estimate, and it is *tested* if shots that were never fitted check it. A pass needs
both.

All are stated up to motions that their users define. Positions and rotations are up to a motion of
the base's frame, rotations up to a turn of the tool's own axes too. Where heights were touched the
robot is *flat* up to a plane, and in the plane (*xy*) up to two shifts and a turn: heights alone
say much of the first and nothing of a robot's scale.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import OptionsInvalid
from campaigns.evaluation.decision import COVERAGE, decide
from campaigns.fit.error_model import ErrorModel, frame_columns
from campaigns.fit.error_sources import SOURCES, TRACKER_SOURCES
from campaigns.fit.fit import Fit
from campaigns.fit.kinds import Block
from campaigns.fit.predicted_rows import moved_body
from campaigns.fit.uncertainty import budget, free_turns_deg, length_std, without_motions
from campaigns.identification.findings import NOT_DETERMINED, NOT_TESTED, TOO_UNCERTAIN, Finding
from campaigns.identification.options import QuantityWord
from campaigns.kinematics.model import Kinematics

UNITS: Mapping[QuantityWord, str] = {"flat": "mm", "xy": "mm", "position": "mm", "rotation": "deg"}
ON_PLANE: Mapping[QuantityWord, tuple[Sequence[int], Sequence[int]]] = {
    "flat": ([2], [0, 1, 5]),
    "xy": ([0, 1], [2, 3, 4]),
}
"""Coordinates of quantities on a touched plane, and motions of the frame that are its users' own,
of three turns and three shifts."""
UNTESTED: Mapping[QuantityWord, str] = {
    "flat": "no height was held out to check it",
    "xy": "no distance was held out to check it",
    "rotation": "no shot checks it: points of one reflector show no rotation",
}
UNSTATED: Mapping[QuantityWord, str] = {
    **dict.fromkeys(ON_PLANE, "no heights of a plane were measured, at which it could be stated"),
    "rotation": "the robot has no workspace over which it could be stated",
}
MOST_ASSUMED = 0.5
"""Share of a quantity's variance that may come from tolerances if shots determine it."""
FEWEST_DETERMINED = 1.0
"""Number of unknowns of a group that shots must determine to estimate the group's size."""


@dataclass(frozen=True, slots=True)
class Determined:
    """Quantity with its σ over the workspace, and what that σ rests on."""

    name: QuantityWord
    mean: float
    """1 σ, the root of the summed variances of its coordinates, mm or deg."""
    max: float
    rms: float
    assumed: float
    """Share of its variance that comes from tolerances whose size no shot estimates."""
    is_tested: bool
    """Whether shots that were never fitted check it."""

    @property
    def unit(self) -> str:
        """Unit of σ."""
        return UNITS[self.name]

    @property
    def is_determined(self) -> bool:
        """Whether shots determine it, rather than tolerances."""
        return self.assumed <= MOST_ASSUMED


# A size is estimated where shots determine at least one unknown of its group: C_jj / ρ² is what is
# left of a prior's variance ρ², and 1 less that is the part of unknown j that shots determine. The
# tracker's own errors are no tolerances of the robot: a data sheet or a calibration states them.
# The scatter's parts are tolerances too where there are fewer degrees of freedom than parts.
def assumed_share(fit: Fit, squares: Mapping[str, float]) -> float:
    """Return the share of tolerances whose size no shot estimates in the squares of `budget`."""
    variances, assumed = np.diag(fit.covariance), 0.0
    scatter = {*fit.factors} - {*fit.prior.factors, "stated"}
    if fit.freedom < FEWEST_DETERMINED * len(scatter):
        assumed += sum(square for source, square in squares.items() if source in scatter)
    for source in squares:
        if source not in SOURCES or source in TRACKER_SOURCES:
            continue
        places = fit.model.sized_groups.get(source)
        of_priors = np.inf
        if places is not None:
            of_priors = variances[places].sum() / fit.sizes[source] ** 2
        if places is None or len(places) - of_priors < FEWEST_DETERMINED:
            assumed += squares[source]
    return float(assumed / max(sum(squares.values()), 1e-300))


def determined_by(
    name: QuantityWord, fit: Fit, by: Array, ratio: float = 1.0, *, is_tested: bool
) -> Determined:
    """Return how well a quantity is known, by its derivatives (M, r, P) without free motions.

    `ratio` multiplies σ where hold-out shots showed larger errors.
    """
    std = ratio * length_std(by, fit.covariance[: fit.model.size, : fit.model.size])
    return Determined(
        name,
        float(std.mean()),
        float(std.max()),
        float(np.sqrt((std**2).mean())),
        assumed_share(fit, budget(fit, by)),
        is_tested=is_tested,
    )


def widened(quantity: Determined, ratio: float) -> Determined:
    """Return a quantity with σ multiplied, since held-out observations contradict it."""
    mean, largest, rms = (ratio * std for std in (quantity.mean, quantity.max, quantity.rms))
    return replace(quantity, mean=mean, max=largest, rms=rms)


def determined_on_planes(fit: Fit, tested: Collection[str]) -> Iterator[Determined]:
    """Yield how well the robot is known where heights were touched, in height and in the plane.

    `tested` are the quantities that held-out observations check.
    """
    touched = [
        block.rows(np.flatnonzero(good >= 0.5))
        for block, good in zip(fit.observations.blocks, fit.good_of_others, strict=True)
        if "flat" in block.kind.checks
    ]
    for name, by in by_on_planes(fit.model, fit.at.x, touched):
        yield determined_by(name, fit, by, is_tested=name in tested)


def by_on_planes(
    model: ErrorModel, x: Array, touched: Sequence[Block]
) -> Iterator[tuple[QuantityWord, Array]]:
    """Yield quantities on planes with their derivatives (M, r, P) at unknowns x (P,).

    They are of the bodies that touched, without the motions that their users define.
    """
    if not touched:
        return
    moved = [moved_body(model, x, block.of_today(), 0) for block in touched]
    by_unknowns = np.concatenate([bodies.place_by_unknowns(model) for bodies in moved])
    motions = frame_columns(np.concatenate([bodies.bodies.place for bodies in moved]))
    for name, (rows, free) in ON_PLANE.items():
        yield name, without_motions(by_unknowns[:, rows], motions[:, rows][..., free])


def rotation_determined(
    fit: Fit,
    identified: Kinematics,
    joints: Array,
    poses: Array,
    ratio: float,
    *,
    is_tested: bool = False,
) -> Iterator[Determined]:
    """Yield how well the tool's rotation is known at joints (N, n) and poses (N, t), if it turns.

    `ratio` multiplies σ where hold-out shots showed larger errors.
    """
    if len(identified.mechanism.task) == 3:
        return
    by = free_turns_deg(fit.model, fit.at.x, joints, poses)
    yield determined_by("rotation", fit, by, ratio, is_tested=is_tested)


def require_turns(wanted: Sequence[str], nominal: Kinematics) -> None:
    """Raise `OptionsInvalid` if rotation is wanted of a robot whose platform does not turn."""
    if "rotation" in wanted and len(nominal.mechanism.task) == 3:
        raise OptionsInvalid(
            f"--for rotation: the platform of a {nominal.mechanism.name} does not turn",
            remedy="ask for position, which is the default",
        )


def quantity_findings(
    determined: Sequence[Determined], wanted: Sequence[str], rotation_deg: float | None
) -> Iterator[Finding]:
    """Yield findings on quantities that are asked for, and not determined, tested or certain.

    `rotation_deg` is the acceptance limit of the tool's rotation; None if there is none.
    """
    stated = {quantity.name for quantity in determined}
    for name, lacking in UNSTATED.items():
        if name in wanted and name not in stated:
            yield Finding(NOT_DETERMINED, f"{name}: {lacking}", "not decided")
    for quantity in determined:
        if quantity.name not in wanted:
            continue
        what = f"{quantity.name}: 1 σ is {quantity.rms:.2g} {quantity.unit} rms"
        if not quantity.is_determined:
            says = (
                f"{what}, but {100.0 * quantity.assumed:.0f} % of its variance comes from "
                f"tolerances (limit {100.0 * MOST_ASSUMED:.0f} %): these shots do not determine "
                "it; measure more shots at more turns, or lengths and places better"
            )
            yield Finding(NOT_DETERMINED, says, "not decided", {"assumed": quantity.assumed})
        # position has a finding of its own where no pairs were held out
        elif quantity.name != "position" and not quantity.is_tested:
            says = f"{what}, and {UNTESTED[quantity.name]}"
            yield Finding(NOT_TESTED, says, "not decided")
        is_limited = quantity.name == "rotation" and rotation_deg is not None
        if is_limited and decide(0.0, quantity.max, rotation_deg or 0.0) != "pass":
            says = (
                f"rotation: U is {COVERAGE * quantity.max:.2g} deg at its largest, limit "
                f"{rotation_deg:g} deg: measure more shots"
            )
            yield Finding(TOO_UNCERTAIN, says, "not decided")
