"""Findings: what contradicts a result, each with its cause, size, uncertainty and remedy.

Every test of an identification ends here as a row: what it saw, in words and numbers, and the
verdict that it allows at most. A finding with no such limit is only reported. The verdict follows
from the rows alone, so a reader can check why a result did not pass.

One rule covers all parameters: an unknown contradicts its tolerance if its value is beyond three
tolerances even after two standard deviations are taken off. That asks for both a large value and a
sure one: an unknown that the shots hardly determine stays near zero with a wide σ.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.decision import COVERAGE, Decision, decide, decide_all
from campaigns.evaluation.region import FARTHER_OFF, Region
from campaigns.files.wording import listed
from campaigns.fit.effects import FRAME, Effect, Lag, Layer, RateError, Ripple, Step, Walk
from campaigns.fit.error_sources import (
    ARCMIN,
    SCATTER_TOLERANCE_MM,
    SOURCES,
    TRACKER_SOURCES,
    scatter_tolerance_of_joints,
)
from campaigns.fit.events import Event, changes_by_angle
from campaigns.fit.fit import Fit
from campaigns.fit.periods import places_of_ripples
from campaigns.fit.uncertainty import NullDirections
from campaigns.kinematics.axes import Axis
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
MOST_NAMED = 6
"""Shots that a finding names; it counts the others."""
NAMED_LOG_ODDS = float(np.log(100.0))
"""Log odds from which an effect that corrects the result is reported as its cause."""
BEYOND_TOLERANCE = "beyond-tolerance"
CHANGE = "change"
WRONG_SHOTS = "wrong-shots"
SCATTER = "scatter"
HOLD_OUT = "hold-out"
EXTRAPOLATION = "extrapolation"
NO_POSITIONS = "no-positions"
TOO_UNCERTAIN = "too-uncertain"
NOTHING_UNSEEN = "nothing-unseen"
NOT_DETERMINED, NOT_TESTED = "not-determined", "not-tested"
WRONG_ROWS, UNSEEN_ROWS = "wrong-observations", "unseen-observations"
NOT_TAKEN = "unseen-not-taken"
WORSE = "unseen-worse"
NOT_ARRIVED = "not-arrived"
CONTRADICTS = "contradicts-former"
NOT_REPRODUCED = "not-reproduced"
STAND, PERIOD, LAG, LAYER = "stand", "period", "lag", "unexplained"
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
    """Rms of the pairs' errors over the rms that the fit states."""
    reach_mm: dict[str, float] = field(default_factory=dict)
    """Mean and largest error, `mean` and `max`, each with its U added, mm."""

    @property
    def believable(self) -> bool:
        """Whether chance explains the pairs' errors."""
        return self.p >= HOLD_OUT_LEVEL

    def meets(self, limits_mm: Mapping[str, float]) -> bool:
        """Return whether there are acceptance limits of distances, and all are met with U."""
        decisions = [
            decide(self.reach_mm.get(name, math.inf), 0.0, limit)
            for name, limit in limits_mm.items()
            if name in self.reach_mm
        ]
        return len(decisions) == len(limits_mm) and decide_all(decisions) == "pass"

    @property
    def applied_ratio(self) -> float:
        """Factor of σ of positions: 1 while chance explains the errors."""
        return 1.0 if self.believable else max(1.0, self.ratio)


def tolerance_findings(fit: Fit, null: NullDirections) -> Iterator[Finding]:
    """Yield a finding for each group with an unknown that is surely far outside its tolerance.

    Directions `null` that no shot determines are held at nominal, so nothing is far off there.
    """
    # Unknowns and σ are in tolerances, so one limit holds for mm, rad and ratios. A group gives one
    # finding, by its worst unknown, which counts the others.
    model = fit.model
    x = null.transform(fit.model.of_today @ fit.at.x)
    matrix, size = model.of_today, model.size
    covariance = null.transform_covariance(matrix @ fit.covariance[:size, :size] @ matrix.T)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    excess = np.abs(x) - SURE_SIGMAS * std - FAR_TOLERANCES
    groups = np.array(model.groups)
    for group in dict.fromkeys(model.groups):
        places = np.flatnonzero((groups == group) & (excess > 0.0))
        if len(places):
            worst = int(places[excess[places].argmax()])
            yield _beyond_tolerance(fit, worst, x[worst], std[worst], len(places) - 1)


def _beyond_tolerance(fit: Fit, place: int, x: float, std: float, others: int) -> Finding:
    """Name an unknown with its value and 1 σ in tolerances, and count the `others` of its group."""
    model = fit.model
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


def scatter_findings(fit: Fit) -> Iterator[Finding]:
    """Yield a finding where points or joints scatter beyond any robot that repeats."""
    # The fit would explain any nonsense as scatter, for its size is estimated. No robot repeats so
    # badly: joints and points do not belong together.
    point, _ = fit.scatter
    remedy = (
        "joints and points may be of different instants, angles in degrees and minutes, or of "
        "another robot"
    )
    if point > SCATTER_TOLERANCE_MM:
        says = f"the points scatter by {point:.3g} mm, limit {SCATTER_TOLERANCE_MM:g} mm: {remedy}"
        yield Finding(SCATTER, says, "fail", {"mm": point})
    # the joints of both kinds scatter alike in parts of their tolerances
    revolute, joint = next(_kinds_of_joints(fit))
    limit = scatter_tolerance_of_joints(revolute=revolute)
    if joint > limit:
        unit, sign = (ARCMIN, "′") if revolute else (1.0, " mm")
        size, limit = joint / unit, limit / unit
        says = f"the joints scatter by {size:.3g}{sign}, limit {limit:g}{sign}: {remedy}"
        yield Finding(SCATTER, says, "fail", {"joints": size})


def scatter_in_words(fit: Fit) -> str:
    """Return the scatter of joints, 1 σ, of each kind that the robot has."""
    return " and ".join(
        f"{size / ARCMIN:.2g}′" if revolute else f"{size:.2g} mm"
        for revolute, size in _kinds_of_joints(fit)
    )


def _kinds_of_joints(fit: Fit) -> Iterator[tuple[bool, float]]:
    """Yield for each kind of joint whether it turns, and its scatter, rad or mm."""
    joints = fit.model.nominal.mechanism.joints
    turns = [axis.is_revolute for axis in joints]
    yield from dict(zip(turns, fit.joint_scatters.tolist(), strict=True)).items()


# A layer of several directions has as many sizes: what it moves at the shots is what counts.
def effect_findings(fit: Fit) -> Iterator[Finding]:
    """Yield a finding for each effect on the whole campaign that is likely or large.

    These are a stand that moved slowly, gears with a period, joints read too early, and an error
    for which the table has no source.
    """
    for effect, where in zip(fit.model.effects, fit.model.effect_places, strict=True):
        if isinstance(effect, Walk):
            yield from _stand_finding(fit, effect, where)
        elif isinstance(effect, Layer):
            yield from _layer_finding(fit, effect, where)
        elif isinstance(effect, Step) or log_odds_of(fit, effect, where) <= NAMED_LOG_ODDS:
            continue
        elif isinstance(effect, (Ripple, RateError)):
            yield _period_finding(fit, effect, where)
        elif isinstance(effect, Lag):
            share = float(np.abs(fit.at.x[where]).max()) * effect.usual
            says = (
                f"the joints were read {100 * share:.2g} % of their way before they arrived: wait "
                "longer before the joints are read; the result is corrected for it"
            )
            yield Finding(LAG, says, None, {"share": share})


# Savage-Dickey ratio: the Bayes factor of an effect is the prior's density at z = 0 over the
# fit's. With prior N(0, ρ²) and fit N(z, C) that is log B = ½ z'C⁻¹z + ½ log |C / ρ²|.
def log_odds_of(fit: Fit, effect: Effect, where: slice) -> float:
    """Return the log posterior odds of an effect against none, by its unknowns' posterior."""
    sizes = [fit.sizes.get(group, 1.0) for group, count in effect.sizes_of for _ in range(count)]
    places, odds = [*range(*where.indices(len(fit.at.x)))], effect.log_odds
    if isinstance(effect, RateError):  # of a ripple that is the robot's own: by its amplitudes
        places, odds = places_of_ripples(fit.model, effect.arms), effect.ripple_log_odds
        sizes = [fit.sizes.get("ripple", 1.0)] * len(places)
    z, covariance = fit.at.x[places], fit.inverse[np.ix_(places, places)]
    gain = z @ np.linalg.solve(covariance, z) + np.linalg.slogdet(covariance)[1]
    return float(0.5 * gain - np.log(sizes).sum() + odds)


def _moved_mm(fit: Fit, where: slice) -> Array:
    """Return how far the effect with these unknowns moves the points of the shots, (N, 3)."""
    return np.asarray(fit.at.jacobian[..., where] @ fit.at.x[where])


def _stand_finding(fit: Fit, effect: Walk, where: slice) -> Iterator[Finding]:
    if fit.sizes[effect.name] < FAR_TOLERANCES:
        return
    rows = fit.observations.frame == effect.session
    moved = _moved_mm(fit, where)[rows]
    travel = float(np.linalg.norm(moved - moved.mean(axis=0), axis=1).max() * 2.0)
    says = (
        f"the tracker's stand or the robot's base moved slowly, by up to {travel:.2g} mm: the "
        "result is corrected for it; let stand and tracker warm up"
    )
    yield Finding(STAND, says, None, {"mm": travel, "session": float(effect.session)})


def _layer_finding(fit: Fit, effect: Layer, where: slice) -> Iterator[Finding]:
    size = float(np.linalg.norm(_moved_mm(fit, where), axis=1).max())
    is_large = size > SCATTER_TOLERANCE_MM
    if not is_large and log_odds_of(fit, effect, where) <= NAMED_LOG_ODDS:
        return
    by = "the place in the workspace" if effect.kind == "place" else "the angles of the arms"
    says = f"an error of up to {size:.2g} mm depends on {by}, and no known source explains it"
    if is_large:
        says += (
            f"; limit {SCATTER_TOLERANCE_MM:g} mm: look for a part that is bent, loose or pulled"
        )
    else:
        says += ": `correct` follows it, a set of parameters cannot"
    yield Finding(LAYER, says, "fail" if is_large else None, {"mm": size, "of": effect.kind})


def _period_finding(fit: Fit, effect: Ripple | RateError, where: slice) -> Finding:
    waves = np.array(effect.amplitudes)
    if isinstance(effect, Ripple):
        waves = fit.at.x[where][:-1] * effect.usual
    amplitudes = np.hypot(*waves.reshape(-1, 2).T)
    worst = float(amplitudes.max())
    rate_std = effect.rate_std * float(np.sqrt(fit.covariance[where, where][-1, -1]))
    which = "all arms" if len(effect.arms) > 1 else f"arm {effect.arms[0]}"
    if fit.model.nominal.mechanism.rates_are_of_turns:
        size = f"{worst / ARCMIN:.2g}′"
        period = f"{effect.rate:.4g} ± {COVERAGE * rate_std:.1g} periods a turn"
    else:
        length = 2.0 * np.pi / effect.rate
        size = f"{worst:.2g} mm"
        period = f"a period of {length:.4g} ± {COVERAGE * rate_std * length / effect.rate:.1g} mm"
    says = f"the drives of {which} ripple by up to {size} with {period}: the result is corrected"
    return Finding(PERIOD, says, None, {"rate": effect.rate, "amplitude": worst})


def change_findings(
    events: Sequence[Event], numbers: Sequence[int], joints: Sequence[Axis]
) -> Iterator[Finding]:
    """Yield a finding for each change of a part in time.

    `numbers` are the numbers of all shots in the order of time, `joints` the robot's.
    """
    for event in events:
        if event.kind == "change":
            yield _change_finding(event, numbers, joints)


# Single wrong shots have no weight and only are reported. Above a share they fail the result: so
# many mistakes have a cause of their own. So do shots left out that lie together.
def left_out_findings(
    events: Sequence[Event],
    sets: Sequence[Sequence[int]],
    pattern: Literal["series", "region"] | None,
) -> Iterator[Finding]:
    """Yield a finding for the shots left out, and what they have in common.

    `sets` are the numbers of the shots of each set: of none may too many be left out.
    """
    wrong = [event for event in events if event.kind == "wrong shot"]
    without = [event for event in events if event.kind == "no assembly"]
    if not wrong and not without:
        return
    left_out = {event.first for event in (*wrong, *without)}
    share = max(len(left_out & {*numbers}) / len(numbers) for numbers in sets if numbers)
    says = []
    if wrong:
        worst = max(event.size for event in wrong)
        says.append(
            f"left out: {_shots_words(wrong)} contradict{'s' * (len(wrong) == 1)} all others, by "
            f"{worst:.3f} mm at most"
        )
    if without:
        says.append(f"no assembly of the robot has the joints of {_shots_words(without)}")
    decision: Decision | None = None
    if share > MOST_WRONG_SHOTS:
        decision = "fail"
        limit = f"limit {100 * MOST_WRONG_SHOTS:.0f} %"
        says.append(f"{100 * share:.0f} % are no single mistakes ({limit})")
    if pattern == "series":
        says.append("they are a series of wrong shots: look for what happened then")
    elif pattern == "region":
        decision = "fail"
        says.append("they lie together in the workspace: the model fails there")
    if decision is None:
        says.append("measure again")
    numbers_of: dict[str, float | str] = {"count": float(len(left_out))}
    if pattern is not None:
        numbers_of["pattern"] = pattern
    yield Finding(WRONG_SHOTS, "; ".join(says), decision, numbers_of)


def _shots_words(events: Sequence[Event]) -> str:
    """Name some shots: `shot 7`, `shots 3, 7 and 12 more`."""
    numbers = sorted(event.first for event in events)
    if len(numbers) == 1:
        return f"shot {numbers[0]}"
    return f"shots {listed([*map(str, numbers)], MOST_NAMED)}"


def _change_finding(event: Event, numbers: Sequence[int], joints: Sequence[Axis]) -> Finding:
    """Say which parts changed between which shots, by how much, and what to do."""
    # A change that ends before the last shot was taken back: the shots within it are measured
    # again. One that stays divides the campaign: the robot of today is the one after it.
    first, last = event.first, event.last
    before = numbers[max(numbers.index(first) - 1, 0)]
    scale, _ = _unit_of(event, joints)
    parts = " or ".join(part_words(part) for part in event.parts)
    where = f"between shots {before} and {first}"
    if not event.is_lasting:
        where = f"from shot {first} to {last}"
    size = size_in_words(event, joints)
    says = f"{parts} changed {where}, by {size}: {remedy_of(event)}"
    numbers_of: dict[str, float | str] = {
        "part": event.parts[0], "after_shot": float(before), "before_shot": float(first),
        "size": scale * event.size, "U": COVERAGE * scale * event.std,
    }  # fmt: skip
    if not event.is_lasting:
        numbers_of["last_shot"] = float(last)
    return Finding(CHANGE, says, "fail", numbers_of)


def change_finding_of_rows(event: Event, what: str, joints: Sequence[Axis]) -> Finding:
    """Say which parts changed at which observation of another kind, with no shot behind it.

    `what` are those observations, such as heights of a bed, whose rows the event has.
    """
    scale, _ = _unit_of(event, joints)
    parts = " or ".join(part_words(part) for part in event.parts)
    where = f"before number {event.first} of the {what} (from 0)"
    if not event.is_lasting:
        where = f"from number {event.first} to {event.last} of the {what} (from 0)"
    remedy = "mend it, and measure again what was measured before"
    if event.parts[0] == FRAME:
        remedy = "measure these again, or as a session of their own"
    says = f"{parts} changed {where}, by {size_in_words(event, joints)}: {remedy}"
    numbers: dict[str, float | str] = {
        "part": event.parts[0], "before_observation": float(event.first),
        "size": scale * event.size, "U": COVERAGE * scale * event.std,
    }  # fmt: skip
    return Finding(CHANGE, says, "fail", numbers)


def _unit_of(event: Event, joints: Sequence[Axis]) -> tuple[float, str]:
    """Return the factor and the unit of an event's size in words: ° of an encoder, else mm."""
    is_angle = any(changes_by_angle(part, joints) for part in event.parts[:1])
    return (float(np.degrees(1.0)), "°") if is_angle else (1.0, " mm")


def size_in_words(event: Event, joints: Sequence[Axis]) -> str:
    """Return the size of an event with its U; a wrong shot is off without a sign."""
    scale, unit = _unit_of(event, joints)
    size, expanded = scale * event.size, COVERAGE * scale * event.std
    sign = "+" if event.kind == "change" else ""
    return f"{size:{sign}.3g} ± {expanded:.2g}{unit}"


def remedy_of(event: Event) -> str:
    """Return what to do about an event."""
    if event.kind != "change":
        return "measure again"
    if event.parts[0] != FRAME:
        return f"mend it, and identify from the shots after it alone, `--only-shots {event.first}-`"
    if event.is_lasting:
        return f"if it was between two sessions, `--sessions`; else `--only-shots {event.first}-`"
    return "measure these shots again"


def part_words(part: str) -> str:
    """Name a part for people: `arm 2's encoder`."""
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


def position_findings(
    region: Region | None, obstacle: str | None, *, was_asked: bool
) -> Iterator[Finding]:
    """Yield a finding where σ of positions lets nothing be decided, or much is extrapolated.

    `obstacle` says why σ of positions is too large; None if it is not. `was_asked`: whether there
    were poses at which to state it.
    """
    if obstacle is not None:
        says = f"nothing can be decided: {obstacle}; measure more shots"
        yield Finding(TOO_UNCERTAIN, says, "not decided")
    if region is None:
        yield Finding(
            NO_POSITIONS,
            "σ of positions is unknown: the identified robot cannot be assembled in too much of "
            "its workspace; look at units, joints and robot.yaml"
            if was_asked
            else "σ of positions was not asked for: give the workspace at which to state it",
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
