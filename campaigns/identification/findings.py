"""Findings: what contradicts a result, each with its cause, size, uncertainty and remedy.

Every test of an identification ends here as a row: what it saw, in words and numbers, and the
verdict that it allows at most. A finding with no such limit is only reported. The verdict follows
from the rows alone, so a reader can check why a result did not pass.

One rule covers all parameters: an unknown contradicts its tolerance if its value is beyond three
tolerances even after two standard deviations are taken off. That asks for both a large value and a
sure one: an unknown that the shots hardly determine stays near zero with a wide σ.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from campaigns.evaluation.decision import COVERAGE, Decision
from campaigns.evaluation.region import FARTHER_OFF, Region
from campaigns.fit.changes import FRAME, SHOT, Change
from campaigns.fit.error_sources import (
    ARCMIN,
    SCATTER_TOLERANCE_MM,
    SOURCES,
    TRACKER_SOURCES,
    scatter_tolerance_of_joints,
)
from campaigns.fit.posterior import Posterior
from campaigns.fit.uncertainty import NullDirections
from campaigns.kinematics.parameters import SIGNS

FAR_TOLERANCES = 3.0
"""Tolerances beyond which a value is far outside."""
SURE_SIGMAS = 2.0
"""Standard deviations by which the value must exceed those tolerances."""
MOST_BEYOND = 0.05
"""Share of the workspace that may be far from all shots."""
HOLD_OUT_LEVEL = 1e-3
"""Probability of a larger χ² of hold-out pairs below which their errors contradict σ."""
MOST_WRONG_SHOTS = 0.1
"""Share of shots left out beyond which they are no single mistakes."""
BEYOND_TOLERANCE = "beyond-tolerance"
CHANGE = "change"
WRONG_SHOTS = "wrong-shots"
SCATTER = "scatter"
HOLD_OUT = "hold-out"
EXTRAPOLATION = "extrapolation"
NO_POSITIONS = "no-positions"
NOTHING_UNSEEN = "nothing-unseen"
NOT_TAKEN = "unseen-not-taken"
WORSE = "unseen-worse"
NOT_ARRIVED = "not-arrived"
KNOWN_LENGTH = "known-length"
ACCEPTABLE = (BEYOND_TOLERANCE,)
"""Findings with which a result may be taken nevertheless, by `--force`."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Finding about a result: name, words with size and remedy, and numbers."""

    name: str
    says: str
    decision: Decision | None = None
    """Verdict that this finding allows at most; None: it is only reported."""
    numbers: dict[str, float | str] = field(default_factory=dict)
    accepted: bool = False
    """Whether somebody took the result in spite of this finding."""

    @property
    def affects_verdict(self) -> bool:
        """Whether the verdict depends on this finding."""
        return self.decision is not None and not self.accepted

    def accept(self, names: Sequence[str]) -> "Finding":
        """Return this finding, accepted if its name is among these."""
        return replace(self, accepted=True) if self.name in names else self


@dataclass(frozen=True, slots=True)
class HoldOut:
    """Test of pairs that were never fitted, by their distances."""

    pairs: int
    chi2: float
    p: float
    ratio: float
    """Rms of the pairs' errors over the rms that the posterior states."""

    @property
    def believable(self) -> bool:
        """Whether chance explains the pairs' errors."""
        return self.p >= HOLD_OUT_LEVEL

    @property
    def applied_ratio(self) -> float:
        """Factor of σ of positions: 1 while chance explains the errors."""
        return 1.0 if self.believable else max(1.0, self.ratio)


def tolerance_findings(posterior: Posterior, null: NullDirections) -> Iterator[Finding]:
    """Yield a finding for each group with an unknown that is surely far outside its tolerance.

    Directions `null` that no shot determines are held at nominal, so nothing is far off there.
    """
    # Unknowns and σ are in tolerances, so one limit holds for mm, rad and ratios. A group gives one
    # finding, by its worst unknown, which counts the others.
    model = posterior.model
    x = null.transform(posterior.x)
    std = np.sqrt(np.maximum(np.diag(null.transform_covariance(posterior.model_covariance)), 0.0))
    excess = np.abs(x) - SURE_SIGMAS * std - FAR_TOLERANCES
    groups = np.array(model.groups)
    for group in dict.fromkeys(model.groups):
        places = np.flatnonzero((groups == group) & (excess > 0.0))
        if len(places):
            worst = int(places[excess[places].argmax()])
            yield _beyond_tolerance(posterior, worst, x[worst], std[worst], len(places) - 1)


def _beyond_tolerance(
    posterior: Posterior, place: int, x: float, std: float, others: int
) -> Finding:
    """Name an unknown with its value and 1 σ in tolerances, and count the `others` of its group."""
    model = posterior.model
    name, source = model.names[place], SOURCES[model.groups[place]]
    is_of_tracker = name in TRACKER_SOURCES
    words = source.words if is_of_tracker else model.nominal.mechanism.parameters[name].words
    sign, limit = SIGNS[model.units[place]], model.file_tolerance[place]
    value, width = x * limit, COVERAGE * std * limit
    more = f" (and {others} more of {source.words})" if others else ""
    says = (
        f"{words} is off by {value:+.3g} ± {width:.2g}{sign}{more}, usual are {limit:.2g}{sign}: "
        f"{source.remedy}"
    )
    numbers: dict[str, float | str] = {"parameter": name, "value": float(value)}
    numbers |= {"U": float(width), "tolerance": float(limit)}
    return Finding(BEYOND_TOLERANCE, says, "fail", numbers)


def scatter_findings(posterior: Posterior) -> Iterator[Finding]:
    """Yield a finding where points or joints scatter beyond any robot that repeats."""
    # The fit would explain any nonsense as scatter, for its size is estimated. No robot repeats so
    # badly: joints and points do not belong together.
    (point, joint), axis = posterior.scatter, posterior.model.nominal.mechanism.joints[0]
    limit = scatter_tolerance_of_joints(revolute=axis.is_revolute)
    remedy = (
        "joints and points may be of different instants, angles in degrees and minutes, or of "
        "another robot"
    )
    if point > SCATTER_TOLERANCE_MM:
        says = f"the points scatter by {point:.3g} mm, limit {SCATTER_TOLERANCE_MM:g} mm: {remedy}"
        yield Finding(SCATTER, says, "fail", {"mm": point})
    if joint > limit:
        unit, sign = (ARCMIN, "′") if axis.is_revolute else (1.0, " mm")
        size, limit = joint / unit, limit / unit
        says = f"the joints scatter by {size:.3g}{sign}, limit {limit:g}{sign}: {remedy}"
        yield Finding(SCATTER, says, "fail", {"joints": size})


def change_findings(
    changes: Sequence[Change], numbers: Sequence[int], *, revolute: bool
) -> Iterator[Finding]:
    """Yield a finding for each change in time, and one for the shots that went wrong.

    `numbers` are the numbers of the fitted shots in the order of time.
    """
    # Single wrong shots have no weight and only are reported. Above a share they fail the result:
    # so many mistakes have a cause of their own.
    wrong = [change for change in changes if change.part == SHOT]
    if wrong:
        named = ", ".join(map(str, sorted(numbers[change.since] for change in wrong)[:6]))
        worst = max(change.size for change in wrong)
        share = len(wrong) / len(numbers)
        is_many = share > MOST_WRONG_SHOTS
        says = f"left out: shots {named} contradict all others, by {worst:.3f} mm at most"
        if is_many:
            limit = f"limit {100 * MOST_WRONG_SHOTS:.0f} %"
            says += f"; {100 * share:.0f} % are no single mistakes ({limit})"
        yield Finding(WRONG_SHOTS, says, "fail" if is_many else None, {"count": float(len(wrong))})
    for change in changes:
        if change.part != SHOT:
            yield _change_finding(change, numbers, revolute=revolute)


def _change_finding(change: Change, numbers: Sequence[int], *, revolute: bool) -> Finding:
    """Say which parts changed between which shots, by how much, and what to do."""
    # Rows of the fit become the operator's shot numbers. A change that ends before the last shot
    # was taken back: the shots within it are measured again. One that stays divides the campaign:
    # the robot of today is the one after it.
    before, first = numbers[change.since - 1], numbers[change.since]
    in_degrees = change.part.startswith("encoder") and revolute
    scale, unit = (float(np.degrees(1.0)), "°") if in_degrees else (1.0, " mm")
    size = f"{scale * change.size:+.3g} ± {COVERAGE * scale * change.std:.2g}{unit}"
    parts = " or ".join(_part_words(part) for part in change.parts)
    was_taken_back = change.until < len(numbers)
    where = f"between shots {before} and {first}"
    if was_taken_back:
        where = f"from shot {first} to {numbers[change.until - 1]}"
    remedy = f"mend it, and identify from the shots after it alone, --only-shots {first}-"
    if change.part == FRAME:
        remedy = (
            "measure these shots again" if was_taken_back else
            f"if it was between two sessions, --sessions; else --only-shots {first}-"
        )  # fmt: skip
    says = f"{parts} changed {where}, by {size}: {remedy}"
    numbers_of: dict[str, float | str] = {
        "part": change.part, "after_shot": float(before), "before_shot": float(first),
        "size": scale * change.size, "U": COVERAGE * scale * change.std,
    }  # fmt: skip
    if was_taken_back:
        numbers_of["last_shot"] = float(numbers[change.until - 1])
    return Finding(CHANGE, says, "fail", numbers_of)


def _part_words(part: str) -> str:
    if part == FRAME:
        return "the tracker's stand or the robot's base"
    kind, _, arm = part.partition(" ")
    return f"arm {arm}" if kind == "arm" else f"arm {arm}'s {kind}"


def hold_out_findings(test: HoldOut, *, limits_met: bool) -> Iterator[Finding]:
    """Yield a finding where hold-out pairs are farther off than their σ allow."""
    # σ of positions are multiplied by the ratio, so they are true again. What is left to decide is
    # whether the robot is good enough: acceptance limits that are met answer that.
    if test.believable:
        return
    says = (
        f"{test.pairs} hold-out pairs are {test.ratio:.2g} times as far off as their σ allow "
        f"(p = {test.p:.1g}, limit {HOLD_OUT_LEVEL:g}): the model lacks something; σ of positions "
        "are multiplied by it"
    )
    if limits_met:
        says += "; the acceptance limits are met all the same"
    numbers: dict[str, float | str] = {"ratio": test.ratio, "p": test.p, "pairs": float(test.pairs)}
    yield Finding(HOLD_OUT, says, None if limits_met else "not decided", numbers)


def region_findings(region: Region | None) -> Iterator[Finding]:
    """Yield a finding where σ of positions is unknown, or much of the workspace is extrapolated."""
    if region is None:
        yield Finding(
            NO_POSITIONS,
            "σ of positions is unknown: the identified robot cannot be assembled in too much of "
            "its workspace; look at units, joints and robot.yaml",
            "not decided",
        )
    elif region.beyond > MOST_BEYOND:
        yield Finding(
            EXTRAPOLATION,
            f"{100.0 * region.beyond:.0f} % of the workspace (limit {100.0 * MOST_BEYOND:.0f} %) "
            f"is too far from all shots: σ of positions there is more than {FARTHER_OFF:g} times "
            "its largest at the shots; measure there too, or leave it out under `space` in "
            "campaign.yaml",
            "not decided",
            {"beyond": region.beyond},
        )
