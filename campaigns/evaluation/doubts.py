"""Doubts: findings that speak against taking a result, each with its name and its numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from campaigns.estimation.change_detection import Change
from campaigns.estimation.information import ChiSquareTest
from campaigns.estimation.lack_of_fit import LackOfFit
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.plausibility import beyond_tolerance, common_scale
from campaigns.mechanisms.mechanism import ParameterSpace
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
    def weighs(self) -> bool:
        """Whether the verdict has to heed it."""
        return self.decision is not None and not self.accepted


def change_doubts(
    nominal: Mapping[str, float],
    changes: Mapping[str, float],
    tolerance: Tolerance,
    accepted: frozenset[str],
) -> Iterator[Doubt]:
    """Doubts of found changes (new − nominal, mm and deg, by name)."""
    beyond = tuple(beyond_tolerance(tolerance, changes))
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
    scale = common_scale(nominal, changes)
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


def campaign_doubt(change: Change, numbers: tuple[int, int], space: ParameterSpace) -> Doubt:
    """Doubt of a change between two shots, by their numbers."""
    size = [float(each) for each in change.size]
    before, after = numbers
    where = f"between shots {before} and {after}"
    chance = f"p = {change.p:.1g}" if change.p > 0.0 else "p < 1e-300"
    values: dict[str, float | str] = {
        "kind": change.kind,
        "cause": change.name,
        "after_shot": float(before),
        "before_shot": float(after),
        "p": change.p,
    }
    if change.kind == "drift" and len(size) == 1:
        values |= {"size": size[0], "std": float(change.std[0])}
        what = f"all arms changed their lengths by {size[0]:+.2g} mm over the campaign"
        remedy = "let the robot warm up first, or measure again when it is warm"
    elif change.kind in ("frame", "drift"):
        moved_mm = float(sum(each**2 for each in size[3:]) ** 0.5)
        values |= {"moved_mm": moved_mm}
        what = (
            f"the tracker or the robot's base moved by {moved_mm:.2g} mm {where}"
            if change.kind == "frame"
            else f"the tracker or the robot's base drifted by {moved_mm:.2g} mm over the campaign"
        )
        remedy = (
            "if it was between two sessions, --sessions; else identify from the shots before or "
            f"after alone, {_ranges(before, after)}"
        )
    else:
        unit = float(space.units((change.name,))[0])
        values |= {"size": size[0] / unit, "std": float(change.std[0]) / unit}
        arm = change.name.partition(".")[0].removeprefix("arm")
        if change.kind == "joint":
            degrees = "°" if change.name.endswith("_deg") else " mm"
            what = f"arm {arm}'s encoder changed by {size[0] / unit:+.3g}{degrees} {where}"
            remedy = (
                "mend the encoder or its coupling; identify from the shots before or after alone, "
                f"{_ranges(before, after)}"
            )
        else:
            what = f"arm {arm} changed its length by {size[0] / unit:+.3g} mm {where}"
            remedy = (
                "look for warmth or a loose joint; identify from the shots before or after alone, "
                f"{_ranges(before, after)}"
            )
    return Doubt(CHANGE, f"{what} ({chance}): {remedy}", "fail", values)


def _ranges(before: int, after: int) -> str:
    return f"--shots -{before} or --shots {after}-"


def lack_doubt(found: LackOfFit, *, limits_met: bool) -> Doubt:
    """Doubt of residuals that follow the joints, as no scatter does."""
    more = "; acceptance limits are met all the same" if limits_met else ""
    return Doubt(
        LACK,
        f"{100.0 * found.share:.0f} % of what is left follows the joints (p = {found.p:.1g}): the "
        "model lacks something (rods of unequal length, tilted axes, bending), and positions are "
        f"worse than their σ{more}",
        None if limits_met else "not decided",
        {"share": found.share, "p": found.p},
    )


def hold_out_doubt(ratio: float, p: float, pairs: int, *, limits_met: bool) -> Doubt:
    """Doubt of unseen pairs that are farther off than their σ say."""
    more = "; acceptance limits are met all the same" if limits_met else ""
    return Doubt(
        HOLD_OUT,
        f"{pairs} unseen pairs are {ratio:.2g} times as far off as their σ say (p = {p:.1g}): the "
        f"model lacks something; σ of positions are multiplied by it{more}",
        None if limits_met else "not decided",
        {"ratio": ratio, "p": p, "pairs": float(pairs)},
    )
