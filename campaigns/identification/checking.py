"""Check a calibration by a few new shots, and update it by them.

A check answers "is this still the robot that was identified?" with some eight shots instead of a
campaign: the posterior of the last identification is the prior of the new shots.

1. Widen that prior by the usual drift of each part until a later day (settling screws, homing).
2. Fit the new shots with it. Their frame is free, so the tracker may stand anywhere.
3. Ask for each part of each arm how much better a change of that part explains the shots than no
   change: its log Bayes factor. The robot has changed if the mean factor over all parts exceeds
   1 / `ALARM`, which by Markov's inequality happens to an unchanged robot with at most that
   probability. Parts that explain the change nearly as well are named together.
4. Where no part explains the shots, χ² still shows whether they contradict the last result.

For an update the parts that changed get a wide prior, and the same fit is the new result.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.errors import IdentificationRefused
from campaigns.evaluation.decision import Decision
from campaigns.fit.changes import (
    ALARM,
    ENCODER_RAD,
    PARTS,
    STEP_MM,
    likely_parts,
    log_factors_since_prior,
)
from campaigns.fit.error_model import ErrorModel
from campaigns.fit.error_sources import SOURCES, TRACKER_SOURCES
from campaigns.fit.posterior import Posterior, Prior, fit
from campaigns.fit.uncertainty import NullDirections
from campaigns.identification.observations import error_model, observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import StoredPosterior
from campaigns.journal.records import read_body
from campaigns.kinematics.mechanism import Kinematics
from campaigns.shots.shots import Shots

FEWEST_SHOTS = 6
"""Shots of a check: six coordinates place its frame, the others judge the robot."""
MISFIT_LEVEL = 1e-3
"""Probability of a larger χ² below which the shots contradict the former result."""
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
    log_factors: Mapping[str, float]
    """Log Bayes factor of a change of each part."""


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


def former_datum(former: StoredPosterior, model: ErrorModel) -> NullDirections:
    """Return the directions that stay at nominal in a former result: an update keeps its datum."""
    order, scale = _places_in(former, model)
    vectors = np.array(former.undetermined).reshape(-1, len(order)).T[order] * scale[:, None]
    # Tolerances may differ from the former ones: rescaled directions are no longer orthonormal.
    return NullDirections.spanned_by(np.linalg.qr(vectors)[0], model.names)


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
        # Parts have the names of `changes.part_columns`: "encoder 0", "forearm 2".
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
) -> Posterior:
    """Fit new shots with a former result as prior, widened by the usual drift of each part.

    The prior of `changed` parts is widened by the usual size of such a change instead. Raise
    `IdentificationRefused` if the former result has other unknowns.
    """
    model = error_model(nominal, shots, options)
    if set(former.names) != set(model.names):
        raise IdentificationRefused(
            "the last result has other unknowns than this robot",
            remedy="run `pkmcal identify DIR` again, without --fix, and check by that result",
        )
    near = nominal.forward(shots.joints, approach=shots.approach).values_or_raise()
    # The former covariance, in the order and the tolerances of now, plus the drift's variance.
    # Its inverse replaces the tolerances as precision. The former noise factors are taken as they
    # are, not estimated again from a few shots.
    order, scale = _places_in(former, model)
    covariance = np.array(former.covariance)[np.ix_(order, order)] * np.outer(scale, scale)
    covariance = covariance + np.diag((_drift(model, changed) / model.tolerance) ** 2)
    precision = np.asarray(np.linalg.inv(covariance))
    prior = Prior(_mean(former, model), precision, former.factors)
    return fit(model, observations_of(shots, near, options), prior)


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
    posterior = fit_with_former(nominal, shots, former, options)
    factors = log_factors_since_prior(posterior)
    # Mean of the Bayes factors, not of their logarithms: Markov's inequality is about the mean.
    values = np.array(list(factors.values()))
    log_mean = float(scipy.special.logsumexp(values) - np.log(len(values)))
    misfit = misfit_of(posterior, former)
    parts = likely_parts(factors)
    decision: Decision = "fail"
    if log_mean > -np.log(ALARM):
        says = f"the robot has changed: most likely {' or '.join(parts)}"
    elif misfit.is_significant:
        says = "the shots contradict the last result, and no single part explains them"
    else:
        decision = "pass"
        says = "the robot is as it was identified, within what these shots show"
    return CheckResult(
        decision=decision,
        says=f"{says} {misfit.in_words()}",
        shots=len(shots),
        chi2=misfit.chi2,
        dof=misfit.dof,
        p=misfit.p,
        parts=parts if decision == "fail" else (),
        log_factors=factors,
    )


def misfit_of(posterior: Posterior, former: StoredPosterior) -> Misfit:
    """Return the misfit of new shots and of the former result to each other."""
    # Both terms of the minimised sum count: residuals of the shots by their weights, and how far
    # the unknowns had to leave the former result, by its precision. The prior counts as one
    # observation for each unknown, so of the 3 N coordinates only the frame's six are used up.
    residual = posterior.at.residual
    deviation = posterior.x - _mean(former, posterior.model)
    chi2 = float(np.einsum("ni,nij,nj->", residual, posterior.weights, residual))
    size = len(deviation)
    chi2 += float(deviation @ posterior.prior[:size, :size] @ deviation)
    dof = 3 * len(residual) - 6
    return Misfit(chi2, dof, float(scipy.special.chdtrc(dof, chi2)))


def _mean(former: StoredPosterior, model: ErrorModel) -> Array:
    """Return a former result's mean (P,) in the model's order and tolerances."""
    order, scale = _places_in(former, model)
    return np.asarray(np.array(former.mean)[order] * scale)


def _places_in(former: StoredPosterior, model: ErrorModel) -> tuple[list[int], Array]:
    """Return the place of each unknown in a former result, and its former tolerance over now's."""
    # Unknowns are in tolerances: times this ratio, a former value is in the tolerances of now.
    order = [former.names.index(name) for name in model.names]
    return order, np.array(former.tolerances)[order] / model.tolerance
