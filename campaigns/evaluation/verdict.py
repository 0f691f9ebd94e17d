"""Verdicts on a validation and on a campaign, and the gains of calibration, each with its U.

The verdict on a campaign has four sources: the identification's own verdict, the acceptance limits
against the validation after loading, checks that the files belong together, and a comparison with
the validation before. Each is a list of decisions, and `decide_all` joins them. A missing limit is
kept apart from a missing proof: without any limit nothing is claimed ("no limits specified"),
unless something else is against a pass, which is then reported.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from campaigns.arrays import AXES
from campaigns.evaluation.decision import (
    NO_LIMIT,
    Decision,
    FigureChange,
    Requirement,
    Verdict,
    decide,
    decide_all,
)
from campaigns.evaluation.measured_lengths import Comparison, MeasuredLength
from campaigns.evaluation.summary import BeforeAfter
from campaigns.evaluation.validation import CUBE_FIGURES, ValidationResult
from campaigns.robots.reduced_form import ReducedForm
from campaigns.settings.sections import AcceptanceConfig

RULE = (
    "Decision rule (JCGM 106:2012, guarded acceptance and guarded rejection, guard band w = U): a "
    "limit is met if |e| + U ≤ limit, not met if |e| − U > limit; otherwise no decision is made. "
    "U = k u is the expanded uncertainty (about 95 %), k = 2 and more for few repeats and for the "
    "largest of several errors. The overall verdict is pass only if the identification passed, "
    "every specified limit is met, all files match and no later check has failed."
)
HEADLINES: Mapping[Verdict, str] = {
    "pass": "All specified limits are met, measurement uncertainty included.",
    "fail": "The calibration or the calibrated robot does not meet its requirements.",
    "not decided": "Conformity could be neither shown nor ruled out.",
    NO_LIMIT: "No acceptance limits are specified; no statement of conformity is made.",
}
OPPOSITES: Mapping[str, str] = {
    "is": "is not",
    "was": "was not",
    "were": "were not",
    "held": "did not hold",
    "says": "does not say",
    "states": "does not state",
    "contains": "does not contain",
    "belong": "do not belong",
}
"""Verbs of statements about the files, and of their opposites; the first one in it counts."""
NO_CHANGE: FigureChange = "no change shown"
JUDGED_FIGURE = "distances, mean error"
"""The figure that must not become worse by loading."""


@dataclass(frozen=True, slots=True)
class Gain:
    """Figure before and after; None: not measured in that stage.

    The uncertainties contain the robot's own scatter: the two stages are of different visits.
    """

    name: str
    before: MeasuredLength | None
    after: MeasuredLength | None

    @property
    def comparison(self) -> Comparison | None:
        """Comparison of both; None without both."""
        if self.before is None or self.after is None:
            return None
        return Comparison(self.before, self.after)

    @property
    def expanded_uncertainty_mm(self) -> float | None:
        """U of the difference; None without both."""
        comparison = self.comparison
        return None if comparison is None else comparison.expanded_uncertainty_mm

    @property
    def shown(self) -> bool | None:
        """Whether the difference is larger than its U; None without both."""
        comparison = self.comparison
        return None if comparison is None else comparison.change != NO_CHANGE

    def in_words(self) -> str:
        """Return the name, both values, and whether they differ."""
        values = [length.value_mm for length in (self.before, self.after) if length is not None]
        words = f"{self.name} {' → '.join(f'{value:.3f}' for value in values)} mm"
        return f"{words} ({NO_CHANGE})" if self.shown is False else words


def gains(before: ValidationResult | None, after: ValidationResult | None) -> tuple[Gain, ...]:
    """Return every figure that was measured in at least one stage."""
    old, new = (stage.comparable_figures() if stage else {} for stage in (before, after))
    names = {**new, **old}  # in the order of the figures
    all_gains = (Gain(name, old.get(name), new.get(name)) for name in names)
    return tuple(gain for gain in all_gains if gain.before or gain.after)


def compare_distances(
    before: ValidationResult | None, after: ValidationResult | None
) -> Comparison | None:
    """Compare the mean errors of distances, which must not become larger; None without both."""
    of_distances = (gain for gain in gains(before, after) if gain.name == JUDGED_FIGURE)
    return next((gain.comparison for gain in of_distances), None)


def worse_than_before(all_gains: Iterable[Gain]) -> Iterator[str]:
    """Say that the mean error of distances became larger, beyond its uncertainty."""
    for gain in all_gains:
        comparison = gain.comparison
        if gain.name == JUDGED_FIGURE and comparison and comparison.change == "larger":
            yield (
                f"{JUDGED_FIGURE} {comparison.after.value_mm:.3f} mm, before loading it was "
                f"{comparison.before.value_mm:.3f} mm (U of the difference: "
                f"{comparison.expanded_uncertainty_mm:.3f} mm)"
            )


def gained_in_words(all_gains: Iterable[Gain], unseen: BeforeAfter | None) -> str:
    """Return the gain in distances as commanded, or else of hold-out pairs by the model.

    Empty where neither was compared.
    """
    sentences = [gain.in_words() for gain in all_gains if gain.shown is not None]
    if sentences:
        return f"Measured before and after: {'; '.join(sentences[:2])}."
    if unseen is None:
        return ""
    return (
        "By the model, not yet by the commanded robot: distances of hold-out pairs, mean error "
        f"{unseen.before.mean_abs:.3f} → {unseen.after.mean_abs:.3f} mm, largest "
        f"{unseen.before.max_abs:.3f} → {unseen.after.max_abs:.3f} mm."
    )


@dataclass(frozen=True, slots=True)
class ValidationVerdict:
    """Verdict on a validation, and the decision on each limit."""

    decision: Verdict
    requirements: tuple[Requirement, ...]
    worse: tuple[str, ...]
    """Losses against before, in words."""
    beyond: tuple[str, ...] = ()
    """Limits that a reduced form breaks by itself somewhere in the workspace, in words."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons against a pass, or for leaving the verdict open, in words."""
        unmet = [
            requirement.in_words()
            for requirement in self.requirements
            if requirement.decision in ("fail", "not decided")
        ]
        return (*unmet, *self.beyond, *self.worse)


def validation_verdict(
    result: ValidationResult | None,
    limits: AcceptanceConfig,
    worse: Iterable[str] = (),
    beyond: Iterable[str] = (),
    axes: Sequence[str] = AXES,
) -> ValidationVerdict:
    """Return the verdict by the limits, and by the figures that are `worse` than before loading.

    Limits that lie `beyond` the abilities of the controller's parameters cannot pass. `axes` are
    those along which the robot moves.
    """
    # A robot that became worse fails even without limits. A reduced form that loses more than a
    # limit somewhere may still have met it at the validated pairs: that leaves the verdict open.
    figures = {} if result is None else result.figures()
    requirements = tuple(_requirements(figures, limits, axes))
    decisions = [
        requirement.decision for requirement in requirements if requirement.decision is not None
    ]
    worse, beyond = tuple(worse), tuple(beyond)
    if worse:
        decisions.append("fail")
    if beyond:
        decisions.append("not decided")
    decision = decide_all(decisions) if decisions else NO_LIMIT
    return ValidationVerdict(decision, requirements, worse, beyond)


def lost_beyond(form: ReducedForm | None, limits: AcceptanceConfig) -> Iterator[str]:
    """Name the limits that a form breaks by itself somewhere in the workspace."""
    if form is None:
        return
    for figure, lost_mm, limit_mm in (
        ("mean", form.lost_mean_mm, limits.distance_mean_mm),
        ("largest", form.lost_max_mm, limits.distance_max_mm),
    ):
        # computed over the workspace, not measured: its U is 0
        if limit_mm is not None and decide(lost_mm, 0.0, limit_mm) == "fail":
            yield (
                f"the reduced set of the identified parameters ({form.name}) {form.loses} "
                f"of position over the workspace, limit for the {figure} distance {limit_mm:g} mm"
            )


def limits_by_figure(
    limits: AcceptanceConfig, axes: Sequence[str] = AXES
) -> Mapping[str, float | None]:
    """Return the limits by the names of `ValidationResult.figures`, of lines along these axes."""
    return {
        "distances, mean error": limits.distance_mean_mm,
        "distances, largest error": limits.distance_max_mm,
        "rotation": limits.rotation_mm,
        **{f"straightness along {axis}": limits.straightness_mm for axis in axes},
        "repeatability, radius of the sphere": limits.repeatability_mm,
        CUBE_FIGURES[0]: limits.pose_accuracy_mm,
        CUBE_FIGURES[1]: limits.pose_repeatability_mm,
    }


def _requirements(
    figures: Mapping[str, MeasuredLength | None], limits: AcceptanceConfig, axes: Sequence[str]
) -> Iterator[Requirement]:
    """Yield a requirement for each figure: also for one without a limit, or not measured."""
    for name, limit in limits_by_figure(limits, axes).items():
        length = figures.get(name)
        if length is not None:
            yield length.requirement(name, limit)
        elif limit is not None or name not in CUBE_FIGURES:  # the cube is measured on request only
            yield Requirement(name, None, limit)


@dataclass(frozen=True, slots=True)
class Check:
    """Statement about the files, and whether it holds; None: there is nothing to compare."""

    statement: str
    holds: bool | None
    detail: str
    decides: bool = True
    """Whether the campaign cannot pass if the statement does not hold."""

    @property
    def denied(self) -> str:
        """The statement's opposite, in words."""
        words = self.statement.split(" ")
        verb = next(place for place, word in enumerate(words) if word in OPPOSITES)
        return " ".join([*words[:verb], OPPOSITES[words[verb]], *words[verb + 1 :]])


def same_digest(statement: str, digest: str | None, other: str | None) -> Check:
    """Check that two digests agree."""
    if not digest or not other:
        return Check(statement, None, "nothing to compare")
    if digest == other:
        return Check(statement, holds=True, detail=f"sha256 {digest[:16]}…")
    return Check(statement, holds=False, detail=f"sha256 {digest[:16]}… is not {other[:16]}…")


@dataclass(frozen=True, slots=True)
class IdentificationVerdict:
    """Decision on an identification, and its reasons."""

    decision: Decision
    reasons: tuple[str, ...]
    accepted: tuple[str, ...] = ()
    """Findings that somebody accepted, in words."""

    def __str__(self) -> str:
        words = "passed: " if self.decision == "pass" else f"is {self.decision}: "
        return f"The identification {words}{'; '.join(self.reasons)}."


@dataclass(frozen=True, slots=True)
class CampaignVerdict:
    """Verdict as a whole, and the reasons, a sentence each."""

    decision: Verdict
    headline: str
    reasons: tuple[str, ...]
    requirements: tuple[Requirement, ...]

    @property
    def says(self) -> str:
        """The verdict and its reasons."""
        return f"{self.decision}: {' '.join(self.reasons)}"


def campaign_verdict(
    identification: IdentificationVerdict | None,
    after: ValidationVerdict,
    checks: Sequence[Check],
    *,
    validated: bool,
    notes: tuple[str, ...] = (),
    gained: str = "",
) -> CampaignVerdict:
    """Pass only if the identification passed, all limits are met and the files agree.

    `validated`: whether the robot was measured after calibration. `notes`: sentences that a reader
    of the verdict needs. `gained`: gain of the calibration, stated where no limit is set.
    """
    broken = [check for check in checks if check.holds is False]
    decision = _decide(identification, after, broken)
    has_limits = any(requirement.limit is not None for requirement in after.requirements)
    headline = HEADLINES[decision]
    if not has_limits and decision != "fail":
        headline = f"{gained} {HEADLINES[NO_LIMIT]}".strip()
    reasons = (
        *_identification_reasons(identification),
        *_limit_reasons(after.requirements, validated=validated),
        *(f"Not shown: {reason}." for reason in after.beyond),
        *(f"Worse: {reason}." for reason in after.worse),
        *notes,
        *(f"{check.denied[:1].upper()}{check.denied[1:]} ({check.detail})." for check in broken),
    )
    return CampaignVerdict(decision, headline, reasons, after.requirements)


def _decide(
    identification: IdentificationVerdict | None, after: ValidationVerdict, broken: Sequence[Check]
) -> Verdict:
    """Decide a campaign; "no limits specified" only if nothing but a limit is missing."""
    decisions: list[Decision] = ["not decided" for check in broken if check.decides]
    decisions.append("not decided" if identification is None else identification.decision)
    if after.decision != NO_LIMIT:
        return decide_all([*decisions, after.decision])
    if set(decisions) == {"pass"}:
        return NO_LIMIT
    return decide_all([*decisions, "not decided"])


def _identification_reasons(identification: IdentificationVerdict | None) -> Iterator[str]:
    """Yield the verdict on the identification, and what was accepted in spite of a finding."""
    if identification is None:
        yield "Nothing has been identified yet."
        return
    yield str(identification)
    yield from (f"Accepted all the same: {finding}." for finding in identification.accepted)


def _limit_reasons(requirements: Sequence[Requirement], *, validated: bool) -> Iterator[str]:
    """Yield what is missing to judge by limits, or the figures by decision, the passed ones too."""
    limited = [requirement for requirement in requirements if requirement.limit is not None]
    if not validated:
        yield "The robot has not been validated after calibration."
    if not limited:
        yield "No limits are specified under `acceptance` in campaign.yaml."
    elif validated:
        for decision in ("fail", "not decided", "pass"):
            names = [figure.name for figure in limited if figure.decision == decision]
            if names:
                yield f"{decision.capitalize()}: {'; '.join(names)}."
