"""Check and update: a few new shots judged by the last result, which is their prior.

The posterior of the last identification, widened by the usual drift of each part, is the prior of
the new shots, whose frame is free: the tracker may stand elsewhere. If the robot is unchanged, a
Bayes factor for a change of each part stays low. The same fit, taken as it is, is the updated set.
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
    """Check with what it rests on, as the journal holds it."""

    series: int
    of: str
    """Digest of the parameters that were checked."""
    at_utc: str


def read_check(body: Mapping[str, JsonValue]) -> RecordedCheck:
    """Read the check of a journal's finding; raise `FindingUnreadable`."""
    remedy = "run `pkmcal check DIR` again: another version of the software wrote it"
    return read_body(body, RecordedCheck, "check", remedy)


def former_datum(former: StoredPosterior, model: ErrorModel) -> NullDirections:
    """Return the directions that stay at nominal in a former result: an update keeps its datum."""
    order, scale = _places_in(former, model)
    vectors = np.array(former.undetermined).reshape(-1, len(order)).T[order] * scale[:, None]
    return NullDirections.spanned_by(np.linalg.qr(vectors)[0], model.names)


def _drift(model: ErrorModel, changed: Sequence[str]) -> Array:
    """Return the usual change of each unknown since the former result, (P,), mm, rad or ratio."""
    table = model.nominal.mechanism.parameters
    drift = np.zeros(len(model.names))
    for place, (name, group) in enumerate(zip(model.names, model.groups, strict=True)):
        if name in TRACKER_SOURCES:
            continue
        parameter, source = table[name], SOURCES[group]
        in_mm = parameter.unit == "mm"
        drift[place] = source.drift_of_lengths if in_mm else source.drift_of_angles
        part = f"{PART_OF.get(parameter.field.stem, '')} {parameter.arm}"
        if part in changed:
            drift[place] = STEP_MM if in_mm else ENCODER_RAD
    return drift


def fit_with_former(
    nominal: Kinematics,
    shots: Shots,
    former: StoredPosterior,
    options: IdentificationOptions,
    changed: Sequence[str] = (),
) -> Posterior:
    """Fit new shots with a former result as prior, widened by the usual drift of each part.

    Parts that a check found `changed` may have changed by as much as such parts do. Raise
    `IdentificationRefused` if it was found with other unknowns.
    """
    model = error_model(nominal, shots, options)
    if set(former.names) != set(model.names):
        raise IdentificationRefused(
            "the last result has other unknowns than this robot",
            remedy="run `pkmcal identify DIR` again, without --fix, and check by that result",
        )
    near = nominal.forward(shots.joints, approach=shots.approach).values_or_raise()
    order, scale = _places_in(former, model)
    covariance = np.array(former.covariance)[np.ix_(order, order)] * np.outer(scale, scale)
    covariance = covariance + np.diag((_drift(model, changed) / model.tolerance) ** 2)
    precision = np.asarray(np.linalg.inv(covariance))
    prior = Prior(_mean(former, model), precision, former.factors)
    return fit(model, observations_of(shots, near, options), prior)


def check(
    nominal: Kinematics, shots: Shots, former: StoredPosterior, options: IdentificationOptions
) -> CheckResult:
    """Judge whether a robot is still the one of a former result, by new shots at any stand."""
    if len(shots) < FEWEST_SHOTS:
        says = f"{len(shots)} shots are too few to judge by, limit {FEWEST_SHOTS}: measure more"
        return CheckResult(
            decision="not decided", says=says, shots=len(shots), chi2=0.0, dof=0, p=1.0,
            log_factors={},
        )  # fmt: skip
    posterior = fit_with_former(nominal, shots, former, options)
    factors = log_factors_since_prior(posterior)
    values = np.array(list(factors.values()))
    log_mean = float(scipy.special.logsumexp(values) - np.log(len(values)))
    chi2, dof, p = goodness(posterior, former)
    parts = likely_parts(factors)
    decision: Decision = "fail"
    if log_mean > -np.log(ALARM):
        says = f"the robot has changed: most likely {' or '.join(parts)}"
    elif p < MISFIT_LEVEL:
        says = "the shots contradict the last result, and no single part explains them"
    else:
        decision = "pass"
        says = "the robot is as it was identified, within what these shots show"
    return CheckResult(
        decision=decision,
        says=f"{says} (χ² {chi2:.1f} of {dof}, p = {p:.2g})",
        shots=len(shots),
        chi2=chi2,
        dof=dof,
        p=p,
        parts=parts if decision == "fail" else (),
        log_factors=factors,
    )


def goodness(posterior: Posterior, former: StoredPosterior) -> tuple[float, int, float]:
    """Return χ² of the shots and of the former result together, its dof, and its probability."""
    residual = posterior.at.residual
    deviation = posterior.x - _mean(former, posterior.model)
    chi2 = float(np.einsum("ni,nij,nj->", residual, posterior.weights, residual))
    size = len(deviation)
    chi2 += float(deviation @ posterior.prior[:size, :size] @ deviation)
    dof = 3 * len(residual) - 6
    return chi2, dof, float(scipy.special.chdtrc(dof, chi2))


def _mean(former: StoredPosterior, model: ErrorModel) -> Array:
    """Return a former result's mean (P,) in the model's order and tolerances."""
    order, scale = _places_in(former, model)
    return np.asarray(np.array(former.mean)[order] * scale)


def _places_in(former: StoredPosterior, model: ErrorModel) -> tuple[list[int], Array]:
    """Return the place of each unknown in a former result, and its tolerance then over now."""
    order = [former.names.index(name) for name in model.names]
    return order, np.array(former.tolerances)[order] / model.tolerance
