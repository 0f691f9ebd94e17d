"""Check a calibration by a few new shots, and update it by them.

A check answers "is this still the robot that was identified?" with some eight shots instead of a
campaign: the posterior of the last identification is the prior of the new shots.

1. Widen that prior by the usual drift of each part until a later day (settling screws, homing).
2. Fit the new shots with it. Their frame is free, so the tracker may stand anywhere. If it turns
   out to be the former one but for some mm, the former frame is a prior as well, and the motion of
   the stand since is an unknown of learned size.
3. Let changes of parts and wrong shots compete by evidence, as `identify` does. Parts that explain
   a change nearly as well are named together; a wrong shot is to be measured again.
4. Where no part explains the shots, χ² still shows whether they contradict the last result.

For an update the parts that changed get a wide prior, and the same fit is the new result.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.errors import IdentificationRefused
from campaigns.evaluation.decision import Decision, coverage_factor, decide_change
from campaigns.fit.effects import ENCODER_RAD, PARTS, STEP_MM, StandSince
from campaigns.fit.error_model import ErrorModel
from campaigns.fit.error_sources import SOURCES, TRACKER_SOURCES
from campaigns.fit.events import (
    USUAL_CHANGES,
    add_changes_since_prior,
    log_factors_since_prior,
    steps_of,
    visible_changes,
)
from campaigns.fit.fit import Fit, Prior, fit_model, refit
from campaigns.fit.rigid_transforms import length_with_std
from campaigns.fit.uncertainty import NullDirections, directions_kept
from campaigns.identification.findings import part_words
from campaigns.identification.observations import error_model, observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import StoredPosterior
from campaigns.journal.records import read_body
from campaigns.kinematics.model import Kinematics
from campaigns.shots.shots import Shots

FEWEST_SHOTS = 6
"""Shots of a check: six coordinates place its frame, the others judge the robot."""
MISFIT_LEVEL = 1e-3
"""Probability of a larger χ² below which the shots contradict the former result."""
FLAT_SIZE = 1e5
"""Size of the stand's motion that is no prior: a metre."""
PART_OF = {stem: part for part, stems in PARTS.items() for stem in stems}
"""Part of an arm by the stem of its parameter."""


@dataclass(frozen=True, slots=True)
class Misfit:
    """χ² of new shots by a former result, its degrees of freedom, and the probability of more."""

    chi2: float
    dof: int
    p: float

    @property
    def is_significant(self) -> bool:
        """Whether chance does not explain the misfit: the shots contradict the former result."""
        return self.p < MISFIT_LEVEL

    def in_words(self) -> str:
        """Return the figures in brackets."""
        return f"(χ² {self.chi2:.1f} of {self.dof}, p = {self.p:.2g})"


@dataclass(frozen=True, slots=True)
class MeasuredMotion:
    """Largest of the motions of some shots' points, with its 1 σ, mm."""

    size: float
    std: float
    count: int

    def in_words(self) -> str:
        """Return whether it is shown, with U."""
        expanded = coverage_factor(count=self.count) * self.std
        if decide_change(self.size, self.std, count=self.count) == "larger":
            moved = f"{self.size:.2g} ± {expanded:.1g} mm"
            return f"the tracker's stand or the robot's base has moved by {moved}"
        return f"the tracker stands where it stood, within {self.size + expanded:.1g} mm"


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckResult:
    """Verdict on a stored calibration by a few shots."""

    decision: Decision
    says: str
    shots: int
    chi2: float
    dof: int
    p: float
    parts: tuple[str, ...] = ()
    """Parts that may have changed, the likeliest first; empty for an unchanged robot."""
    wrong: tuple[int, ...] = ()
    """Numbers of the shots that contradict all others."""
    log_factors: Mapping[str, float]
    """Log Bayes factor of a change of each part."""
    stand_moved_mm: float | None = None
    """Motion of points by the stand or the base since the identification, the largest; None: the
    tracker stands elsewhere, or an older version identified the robot."""
    stand_moved_std_mm: float | None = None
    """1 σ of it."""

    @property
    def is_of_shots_alone(self) -> bool:
        """Whether nothing but single wrong shots is against a pass: they show no changed robot."""
        is_misfit = Misfit(self.chi2, self.dof, self.p).is_significant
        return bool(self.wrong) and not (self.parts or is_misfit)


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedCheck(CheckResult):
    """Check with its series, parameters and time, as the journal holds it."""

    series: int
    of: str
    """Digest of the parameters that were checked."""
    at_utc: str
    """When it was recorded."""


def read_check(body: Mapping[str, JsonValue]) -> RecordedCheck:
    """Read a check from a journal's finding; raise `FindingUnreadable`."""
    remedy = "run `pkmcal check DIR` again: another version of the software wrote it"
    return read_body(body, RecordedCheck, "check", remedy)


def former_datum(former: StoredPosterior, fit: Fit) -> NullDirections:
    """Return the directions that priors alone determine in a former result; updates keep them."""
    order, scale = _places_in(former, fit.model)
    vectors = np.array(former.undetermined).reshape(-1, len(former.names)).T[order]
    # Tolerances may differ from the former ones: rescaled directions are no longer orthonormal.
    directions = np.linalg.qr(vectors * scale[:, None])[0]
    return directions_kept(fit, directions)


def _drift(model: ErrorModel, changed: Sequence[str]) -> Array:
    """Return the usual change of each unknown since the former result, (P,), mm, rad or ratio."""
    table = model.nominal.mechanism.parameters
    drift = np.zeros(len(model.names))
    for place, (name, group) in enumerate(zip(model.names, model.groups, strict=True)):
        # The instrument is supposed to be the one of the former result: it does not drift.
        if name in TRACKER_SOURCES:
            continue
        parameter, source = table[name], SOURCES[group]
        is_length = parameter.unit == "mm"
        drift[place] = source.drift_of_lengths if is_length else source.drift_of_angles
        # Parts have the names of `events.candidate_parts`: "encoder 0", "forearm 2".
        part = f"{PART_OF.get(parameter.field.stem, '')} {parameter.arm}"
        if part in changed:
            drift[place] = STEP_MM if is_length else ENCODER_RAD
    return drift


def fit_with_former(
    nominal: Kinematics,
    shots: Shots,
    former: StoredPosterior,
    options: IdentificationOptions,
    changed: Sequence[str] = (),
) -> Fit:
    """Fit new shots with a former result as prior, widened by the usual drift of each part.

    The prior of `changed` parts is widened by the usual size of such a change instead. Parameters
    that the former result held stay held. Raise `IdentificationRefused` if the robot has other
    parameters than the former result.
    """
    table = nominal.mechanism.parameters
    if not {*former.names} <= {*table.select(), *TRACKER_SOURCES}:
        raise IdentificationRefused(
            "the last result has other unknowns than this robot",
            remedy="run `pkmcal identify DIR` again, and check by that result",
        )
    if former.rates:
        nominal = Kinematics(nominal.mechanism.with_ripples(former.rates), nominal.p)
    model = error_model(nominal, shots, options)
    # what was held then, and growth where the new shots have no temperatures, is held now
    new = set(model.names) - set(former.names)
    model = replace(model, held=frozenset(model.held) | new)
    near = nominal.forward(shots.joints, approach=shots.approach).values_or_raise()
    # The former covariance, in the order and the tolerances of now, plus the drift's variance: a
    # part of it is the covariance of those unknowns whatever the others are. Its inverse replaces
    # the tolerances as precision. The former noise factors are taken as they are, not estimated
    # again from a few shots.
    order, scale = _places_in(former, model)
    covariance = np.array(former.covariance)[np.ix_(order, order)] * np.outer(scale, scale)
    covariance = covariance + np.diag((_drift(model, changed) / model.tolerance) ** 2)
    precision = np.asarray(np.linalg.inv(covariance))
    mean = np.array(former.mean)[order] * scale
    return fit_model(
        model, observations_of(shots, near, options), Prior(mean, precision, former.factors)
    )


# A tracker that was moved to another place stands metres or degrees from where it stood. A frame
# that agrees with the former one within the largest change that is looked for is of a stand that
# was left alone or bumped. How far it moved is still unknown, and the size of its motion is
# learned: 5 mm free the frame from the former one.
def with_former_stand(fit: Fit, former: StoredPosterior) -> Fit:
    """Return a check's fit by the former frame as well, if the shots show the former stand.

    `fit` has a flat frame.
    """
    if former.frame is None or fit.prior.precision is None:
        return fit
    before, now = former.frame.tracker_from_base, fit.at.frames[-1]
    base_mm = now.inverted().apply(fit.observations.points[fit.kept])
    moved_mm = np.linalg.norm(now.apply(base_mm) - before.apply(base_mm), axis=1)
    if moved_mm.max() > STEP_MM * max(USUAL_CHANGES):
        return fit
    # The frame given the unknowns is normal about K x with the covariance S; the usual drift of
    # parts, which the prior has, moves no frame. A sum of squares stays positive where the inverse
    # of both covariances together would not: directions of 10 mm stand beside some of 1 µm.
    order, scale = _places_in(former, fit.model)
    of_frame = np.array(former.frame_covariance)
    shared = of_frame[:, order] * scale
    follows = shared @ fit.prior.precision
    given = of_frame[:, -6:] - follows @ shared.T
    residual = np.hstack([-follows, np.eye(6)])
    precision = residual.T @ np.linalg.solve(0.5 * (given + given.T), residual)
    precision[:-6, :-6] += fit.prior.precision
    prior = replace(fit.prior, precision=0.5 * (precision + precision.T), frame=before)
    return refit(replace(fit, prior=prior), fit.model.with_effects((StandSince(),)))


# The size of the motion is learned, and a stand that shots hardly place would seem to stay by its
# prior alone. So this is the motion without that prior, the difference of both frames.
def _stand_motion(fit: Fit) -> MeasuredMotion | None:
    """Return how far the stand moved the point of that shot which it moved farthest.

    None for a new stand.
    """
    for effect, where in zip(fit.model.effects, fit.model.effect_places, strict=True):
        if isinstance(effect, StandSince):
            flat = replace(fit, sizes={**fit.sizes, effect.name: FLAT_SIZE})
            moves = fit.at.columns_of(effect, fit.observations)
            motions = moves @ (fit.at.x[where] + flat.step[where])
            farthest = int(np.linalg.norm(motions, axis=1).argmax())
            covariance = moves[farthest] @ flat.inverse[where, where] @ moves[farthest].T
            return MeasuredMotion(*length_with_std(motions[farthest], covariance), len(moves))
    return None


def check(
    nominal: Kinematics, shots: Shots, former: StoredPosterior, options: IdentificationOptions
) -> CheckResult:
    """Judge whether a robot is still that of a former result, by new shots from any station."""
    if len(shots) < FEWEST_SHOTS:
        says = f"{len(shots)} shots are too few to judge by, limit {FEWEST_SHOTS}: measure more"
        return CheckResult(
            decision="not decided", says=says, shots=len(shots), chi2=0.0, dof=0, p=1.0,
            log_factors={},
        )  # fmt: skip
    unchanged = with_former_stand(fit_with_former(nominal, shots, former, options), former)
    fit = add_changes_since_prior(unchanged)
    parts = tuple(part for step in steps_of(fit) for part in step.parts)
    wrong = [shots.numbers[row] for row in np.flatnonzero(~fit.kept).tolist()]
    misfit = misfit_of(fit)
    decision: Decision = "fail"
    if parts:
        says = f"the robot has changed: most likely {' or '.join(map(part_words, parts))}"
    elif misfit.is_significant:
        says = "the shots contradict the last result, and no single part explains them"
    elif wrong:
        decision = "not decided" if len(wrong) == 1 else "fail"
        says = (
            f"{_shots_words(wrong)} all others: measure {'it' if len(wrong) == 1 else 'them'} again"
        )
    else:
        decision = "pass"
        says = "the robot is as it was identified, within what these shots show"
        seen = ", ".join(_visible_changes(fit))
        if seen:
            says += f": they would have shown {seen}"
    stand = _stand_motion(fit)
    says = f"{says} {misfit.in_words()}"
    return CheckResult(
        decision=decision,
        says=says if stand is None else f"{says}; {stand.in_words()}",
        shots=len(shots),
        chi2=misfit.chi2,
        dof=misfit.dof,
        p=misfit.p,
        parts=parts,
        wrong=tuple(wrong),
        log_factors=log_factors_since_prior(unchanged),
        stand_moved_mm=None if stand is None else stand.size,
        stand_moved_std_mm=None if stand is None else stand.std,
    )


def _shots_words(numbers: Sequence[int]) -> str:
    """Say which shots contradict: `shot 5 contradicts`, `shots 3 and 5 contradict`."""
    if len(numbers) == 1:
        return f"shot {numbers[0]} contradicts"
    return f"shots {', '.join(map(str, numbers[:-1]))} and {numbers[-1]} contradict"


def _visible_changes(fit: Fit) -> Iterator[str]:
    """Yield the smallest change of each kind of part that would have been found, of any arm."""
    for (word, in_degrees), size in visible_changes(fit).items():
        yield f"{word} {np.degrees(size):.2g}°" if in_degrees else f"{word} {size:.2g} mm"


def misfit_of(fit: Fit) -> Misfit:
    """Return the misfit of new shots and of the former result to each other."""
    # Both terms of the minimised sum count: residuals of the shots by their weights, and how far
    # the unknowns had to leave the former result, by its precision. The prior counts as one
    # observation for each unknown, so of the 3 N coordinates only the frame's six are used up, and
    # those of changes; of the stand's motion since the former result as many as shots determine.
    if fit.prior.mean is None:
        raise ValueError("the fit has no former result as prior")
    residual, size = fit.at.residual, len(fit.model.names)
    deviation = fit.prior_terms[1].copy()
    deviation[size : fit.model.size] = 0.0
    chi2 = float(np.einsum("ni,nij,nj->", residual, fit.weights, residual))
    chi2 += float(deviation @ fit.precision @ deviation)
    used = _freedom_of_stand(fit) + sum(step.count for step in steps_of(fit))
    dof = max(round(3 * int(fit.kept.sum()) - used), 1)
    return Misfit(chi2, dof, float(scipy.special.chdtrc(dof, chi2)))


def _freedom_of_stand(fit: Fit) -> float:
    """Return the number of coordinates that place the frame: six of a new stand, else fewer."""
    for effect, where in zip(fit.model.effects, fit.model.effect_places, strict=True):
        if isinstance(effect, StandSince):
            return 6.0 - float(np.trace(fit.inverse[where, where])) / fit.sizes[effect.name] ** 2
    return 6.0


def _places_in(former: StoredPosterior, model: ErrorModel) -> tuple[list[int], Array]:
    """Return the place of each unknown in a former result, and its former tolerance over now's."""
    # Unknowns are in tolerances: times this ratio, a former value is in the tolerances of now.
    order = [former.names.index(name) for name in model.names]
    return order, np.array(former.tolerances)[order] / model.tolerance
