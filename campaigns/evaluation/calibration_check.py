"""Check of a calibration: whether new shots agree with stored parameters, and else what changed.

Each part is tried alone beside a free frame; Schwarz's (1978) criterion names the likeliest.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
from pydantic import JsonValue

from campaigns.estimation.change_detection import Cause, CauseKind
from campaigns.estimation.f_test import FittedShots
from campaigns.estimation.information import SIGNIFICANCE, column_effect
from campaigns.evaluation.decision import COVERAGE, Decision
from campaigns.journal.records import read_body
from campaigns.mechanisms.parameters import ParameterSpace

AS_LIKELY = 10.0
"""Difference of the criterion below which causes are not told apart (Kass and Raftery 1995)."""
MOST_PARTS = 2
"""Number of parts that few shots can name where more than one changed."""
OF_THE_SETUP = frozenset({"frame", "shot"})
"""Kinds of causes that say nothing of the robot."""
PPM = 1e-6
SAME = 1e-6
"""Part of a cause's effect that another may leave and still be the same."""
GROWN = {
    "arms": "the length of all arms (warmth)",
    "forearms": "the length of all forearms (warmth)",
    "lengths": "all lengths (warmth, or the tracker's scale)",
}


@dataclass(frozen=True, slots=True)
class PartChange:
    """Change of one part, were it the only one, with U (k = 2); of what has a direction its length.

    `p` is the chance of an unchanged robot to show as much, `score` the gain in χ² less what chance
    gains; `explains`: chance explains what it leaves.
    """

    kind: CauseKind
    name: str
    part: str
    size: float
    expanded_uncertainty: float
    unit: str
    p: float
    score: float
    explains: bool

    @classmethod
    def of(cls, cause: Cause, fit: FittedShots, space: ParameterSpace) -> "PartChange":
        """Change by the columns of its cause."""
        found, covariance, gain = column_effect(fit, cause.columns)
        moved, unit, inner = found[-3:], "mm", 1.0
        signed = len(moved) == 1
        size = float(moved[0]) if signed else float(np.linalg.norm(moved))
        along = np.ones(1) if signed else moved / (size or 1.0)
        if cause.kind == "growth":
            part, unit, inner = GROWN[cause.name], "ppm", PPM
        elif cause.kind in OF_THE_SETUP:
            part = cause.name
        else:
            own, unit = space[cause.name], space[cause.name].unit
            inner = float(space.units((cause.name,))[0])
            words = {"joint": "encoder", "mount": "mount"}
            part = f"arm {own.arm}'s {words.get(cause.kind, own.field.stem)}"
        std = float(np.sqrt(along @ covariance[-3:, -3:] @ along)) / inner
        price, left = len(found) * math.log(fit.left.size), fit.chi2 - gain
        explains = _chance(fit.freedom - len(found), left) >= SIGNIFICANCE
        p, u = _chance(len(found), gain), COVERAGE * std
        return cls(cause.kind, cause.name, part, size / inner, u, unit, p, gain - price, explains)

    @property
    def says(self) -> str:
        """Part, size and U: `arm 2's encoder by +0.0500° ± 0.0040°`."""
        sign, decimals = ("°", 4) if self.unit == "deg" else (f" {self.unit}", 3)
        plus = "+" if self.kind in {"joint", "length", "growth"} else ""
        size = f"{self.size:{plus}.{decimals}f}".replace("-", "−")
        return f"{self.part} by {size}{sign} ± {self.expanded_uncertainty:.{decimals}f}{sign}"


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationCheck:
    """Judgement on a check; misfits are root mean squares of coordinates in the best frame."""

    decision: Decision
    says: str
    changed: tuple[PartChange, ...] = ()
    """What explains the shots."""
    as_likely: tuple[PartChange, ...] = ()
    """What they cannot tell from it, the likeliest first."""
    parts: tuple[PartChange, ...] = field(default=(), repr=False)
    """Each part of the robot, were it the only one that changed."""
    shots: int
    chi2: float
    dof: int
    p: float
    misfit_mm: float
    expected_mm: float
    """By the stored covariance, the tracker and the robot's scatter."""

    @property
    def of_robot(self) -> tuple[PartChange, ...]:
        """Parts of the robot that may have changed; () where it is the set-up, or nothing fits."""
        every = (*self.changed, *self.as_likely)
        return every if all(each.kind not in OF_THE_SETUP for each in every) else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedCheck(CalibrationCheck):
    """Check with what it rests on, as the journal holds it."""

    series: int
    of: str
    """Digest of the set that was checked."""
    at_utc: str


def read_check(body: Mapping[str, JsonValue]) -> RecordedCheck:
    """Check of a journal's finding; raises `FindingUnreadable`."""
    remedy = "check again: another version of the software wrote it"
    return read_body(body, RecordedCheck, "check", remedy)


def judge_check(
    fit: FittedShots,
    causes: Sequence[Cause],
    space: ParameterSpace,
    misfit_mm: float,
    expected_mm: float,
) -> CalibrationCheck:
    """Judgement on shots whitened by all that is expected of them about the stored parameters.

    Good unless all of them together, or one cause among all causes, are beyond chance.
    """
    p, every = _chance(fit.freedom, fit.chi2), _tried(fit, causes, space)
    found: list[PartChange] = []
    as_likely: tuple[PartChange, ...] = ()
    tried, left = every, fit
    if min(p, len(tried) * min(each.p for each in tried)) < SIGNIFICANCE:
        while len(found) < MOST_PARTS and not as_likely:
            cause = dict(zip(tried, causes, strict=True))
            if enough := [each for each in tried if each.explains]:
                best = _simplest(enough, cause, left)
                found.append(best)
                wider = [e for e in tried if _is_special_case(cause[best], cause[e], left)]
                as_likely = _as_likely(best, [each for each in enough if each not in wider])
                break
            found.append(max(tried, key=lambda each: each.score))
            left = left.fitted(cause[found[-1]].columns)
            tried = _tried(left, causes, space)
    decision, says = _answer(found, as_likely)
    return CalibrationCheck(
        decision=decision,
        says=says,
        changed=tuple(found) if not found or found[-1].explains else (),
        as_likely=as_likely,
        parts=tuple(each for each in every if each.kind not in OF_THE_SETUP),
        shots=fit.left.size // 3,
        chi2=fit.chi2,
        dof=fit.freedom,
        p=p,
        misfit_mm=misfit_mm,
        expected_mm=expected_mm,
    )


def _tried(fit: FittedShots, causes: Sequence[Cause], space: ParameterSpace) -> list[PartChange]:
    return [PartChange.of(cause, fit, space) for cause in causes]


def _is_special_case(cause: Cause, of: Cause, fit: FittedShots) -> bool:
    """Whether another cause with more unknowns does the same, as a rail's mount does its encoder's.

    What no shots can tell apart is called by the simpler name.
    """
    own, wider = fit.beside(cause.columns), fit.beside(of.columns)
    if own.shape[1] >= wider.shape[1]:
        return False
    left = own - wider @ np.linalg.lstsq(wider, own, rcond=None)[0]
    return bool(np.linalg.norm(left) < SAME * np.linalg.norm(own))


def _simplest(
    enough: list[PartChange], cause: Mapping[PartChange, Cause], fit: FittedShots
) -> PartChange:
    """The likeliest, or what is a special case of it and about as likely.

    Its further unknowns gain something by chance.
    """
    best = max(enough, key=lambda each: each.score)
    within = (e for e in enough if _is_special_case(cause[e], cause[best], fit))
    near = (each for each in within if each.score > best.score - AS_LIKELY)
    return max(near, key=lambda each: each.score, default=best)


def _as_likely(best: PartChange, enough: list[PartChange]) -> tuple[PartChange, ...]:
    """Others that explain as much: a stand that moved is one part, whenever it did."""
    near = sorted(enough, key=lambda each: -each.score)
    near = [each for each in near if each.score > best.score - AS_LIKELY]
    parts = {each.kind if each.kind == "frame" else each.part: each for each in reversed(near)}
    own = best.kind if best.kind == "frame" else best.part
    return tuple(each for part, each in reversed(parts.items()) if part != own)


def _answer(changed: Sequence[PartChange], as_likely: Sequence[PartChange]) -> tuple[Decision, str]:
    if not changed:
        return "pass", "good: the shots agree with the stored parameters"
    if not changed[-1].explains:
        return "fail", f"not good: more changed than {MOST_PARTS} parts, or something else"
    says = " and ".join(each.says for each in changed)
    if as_likely:
        others = ", or ".join(each.says for each in as_likely)
        says = f"cannot tell {says} from {others}"
    if any(each.kind in OF_THE_SETUP for each in (*changed, *as_likely)):
        return "not decided", f"not decided: {says}; make it firm and check again"
    return "fail", f"not good: {says}"


def _chance(freedom: int, chi2: float) -> float:
    """Chance of good shots to have a larger χ²."""
    return float(scipy.special.chdtrc(freedom, max(chi2, 0.0))) if freedom > 0 else 1.0
