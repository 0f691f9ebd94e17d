"""Doubts: findings that speak against taking a result, each with its name and its numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from campaigns.estimation.change_detection import Change
from campaigns.estimation.information import ChiSquareTest, Uncertainty
from campaigns.estimation.lack_of_fit import LackOfFit
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.plausibility import beyond_tolerance, common_scale
from campaigns.evaluation.summary import Spread
from campaigns.mechanisms.parameters import Parameters, ParameterSpace
from campaigns.robots.robot import Tolerance

COMMON_SCALE, LARGE_CHANGE, CHANGE, HOLD_OUT, CAREFUL, LACK = (
    "common-scale",
    "large-change",
    "change-during-campaign",
    "hold-out",
    "careful-statement",
    "lack-of-fit",
)
FAR_BELOW = 0.2
"""Scatter over what is stated below which the statement is no caution any more."""
ACCEPT = {COMMON_SCALE: "--accept-scale", LARGE_CHANGE: "--accept-large-change"}
"""Option with which a result is taken all the same."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Finding that speaks against a result: by name, in words, in numbers.

    `decision` is what the verdict can be at most; empty for what is only told.
    """

    name: str
    says: str
    decision: Decision | None = None
    numbers: dict[str, float | str] = field(default_factory=dict)
    accepted: bool = False

    @property
    def affects_verdict(self) -> bool:
        """Whether the verdict has to heed it."""
        return self.decision is not None and not self.accepted


def parameter_doubts(
    nominal: Parameters,
    changes: Mapping[str, float],
    known: Uncertainty,
    tolerance: Tolerance,
    accepted: frozenset[str],
) -> Iterator[Doubt]:
    """Doubts of what a fit found: changes in mm and deg, with their uncertainty."""
    beyond = tuple(beyond_tolerance(nominal.space, tolerance, changes))
    if beyond:
        more = f" (and {len(beyond) - 1} more)" if len(beyond) > 1 else ""
        yield Doubt(
            LARGE_CHANGE,
            f"{beyond[0]}{more}: no robot is built so far off; look at units, joints and "
            f"robot.yaml, or say {ACCEPT[LARGE_CHANGE]}",
            "fail",
            {"beyond": float(len(beyond))},
            LARGE_CHANGE in accepted,
        )
    scale = common_scale(nominal, changes, known)
    if scale.significant:
        yield Doubt(
            COMMON_SCALE,
            f"all lengths changed by the same share, {100.0 * scale.share:+.3f} % (p = "
            f"{scale.p:.1g}): a wrong reflector or air constant, or a scale in the export, rather "
            f"than the robot; if it is the robot, say {ACCEPT[COMMON_SCALE]}",
            "fail",
            {"share": scale.share, "p": scale.p},
            COMMON_SCALE in accepted,
        )


def noise_doubts(noise: ChiSquareTest) -> Iterator[Doubt]:
    """Doubt of a scatter far below what is stated."""
    ratio = noise.birge_ratio
    if ratio is not None and noise.consistent is False and ratio < FAR_BELOW:
        yield Doubt(
            CAREFUL,
            f"the shots scatter by {ratio:.2g} of what is stated: is the statement in other units, "
            "or are the points no measurements?",
            None,
            {"birge_ratio": ratio},
        )


def change_doubt(change: Change, numbers: tuple[int, int], space: ParameterSpace) -> Doubt:
    """Doubt of a change between two shots, by their numbers."""
    before, after = numbers
    size = float(change.size[0])
    values: dict[str, float | str] = {
        "kind": change.kind,
        "cause": change.name,
        "after_shot": float(before),
        "before_shot": float(after),
        "p": change.p,
    }
    where = f"between shots {before} and {after}"
    alone = f"identify from the shots before or after alone, --shots -{before} or --shots {after}-"
    if change.kind == "drift" and len(change.size) == 1:
        values |= {"size": size, "std": float(change.std[0])}
        what = f"all arms changed their lengths by {size:+.2g} mm over the campaign"
        remedy = "let the robot warm up first, or measure again when it is warm"
    elif change.kind in ("frame", "drift"):
        moved_mm = float(np.linalg.norm(change.size[3:]))
        values |= {"moved_mm": moved_mm}
        moved = "the tracker or the robot's base"
        what = (
            f"{moved} moved by {moved_mm:.2g} mm {where}"
            if change.kind == "frame"
            else f"{moved} drifted by {moved_mm:.2g} mm over the campaign"
        )
        remedy = f"if it was between two sessions, --sessions; else {alone}"
    else:
        changed, unit = space[change.name], float(space.units((change.name,))[0])
        values |= {"size": size / unit, "std": float(change.std[0]) / unit}
        if change.kind == "joint":
            what = (
                f"arm {changed.arm}'s encoder changed by {size / unit:+.3g}{changed.sign} {where}"
            )
            remedy = f"mend the encoder or its coupling; {alone}"
        else:
            what = f"arm {changed.arm} changed its length by {size / unit:+.3g} mm {where}"
            remedy = f"look for warmth or a loose joint; {alone}"
    chance = f"p = {change.p:.1g}" if change.p > 0.0 else "p < 1e-300"
    return Doubt(CHANGE, f"{what} ({chance}): {remedy}", "fail", values)


def lack_doubt(found: LackOfFit, *, limits_met: bool) -> Doubt:
    """Doubt of residuals that follow the joints, as no scatter does."""
    share = f"{100.0 * found.share:.0f} % of what is left"
    if found.kind == "parts":
        says = (
            f"{share} is as rods of unequal length and tilted axes make it (p = {found.p:.1g}), "
            "and positions are worse than their σ: --model full, or auto, looks for them"
        )
    else:
        says = (
            f"{share} follows the joints (p = {found.p:.1g}): the model lacks something (bending, "
            "backlash, tilted axes), and positions are worse than their σ: --model auto may tell"
        )
    return _unless_limits_are_met(LACK, says, {"share": found.share, "p": found.p}, met=limits_met)


def hold_out_doubt(ratio: float, p: float, pairs: int, *, limits_met: bool) -> Doubt:
    """Doubt of unseen pairs that are farther off than their σ say."""
    says = (
        f"{pairs} unseen pairs are {ratio:.2g} times as far off as their σ say (p = {p:.1g}): the "
        "model lacks something; σ of positions are multiplied by it"
    )
    numbers = {"ratio": ratio, "p": p, "pairs": float(pairs)}
    return _unless_limits_are_met(HOLD_OUT, says, numbers, met=limits_met)


def limits_met(after: Spread, limits_mm: Mapping[str, float]) -> bool:
    """State in which acceptance limits of distances are asked for and all of them kept."""
    reached = {"mean": after.mean_abs, "max": after.max_abs}
    return bool(limits_mm) and all(reached[name] <= limit for name, limit in limits_mm.items())


def _unless_limits_are_met(
    name: str, says: str, numbers: Mapping[str, float], *, met: bool
) -> Doubt:
    more = "; acceptance limits are met all the same" if met else ""
    return Doubt(name, f"{says}{more}", None if met else "not decided", dict(numbers))
