"""Whether the shots call for more than 22 parameters: models compared on unseen pairs and by BIC.

A larger model always fits better; it is kept only where pairs that it never saw say that it knows
more, and Schwarz's (1978) criterion says that its gain is more than its parameters would make of
chance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from campaigns.errors import CampaignError
from campaigns.estimation.estimators import Model
from campaigns.identification.identify import identify
from campaigns.identification.parameter_selection import ParameterSelection, select_parameters
from campaigns.identification.result import (
    ComparedModel,
    IdentificationRequest,
    IdentificationResult,
)
from campaigns.mechanisms.geometry import (
    BACKLASH_NAMES,
    FREE_BY_DEFAULT,
    FREE_IF_EXTENDED,
    MODEL_NAMES,
    Geometry,
)
from campaigns.shots.shots import Shots

STANDARD = Model.STANDARD.value
AXES = tuple(
    name for name in FREE_IF_EXTENDED if name not in FREE_BY_DEFAULT and name not in BACKLASH_NAMES
)
"""Azimuths and axis tilts: where the motors' axes point."""
EXTENSIONS: dict[str, tuple[str, ...]] = {
    "axes": AXES,
    "backlash": BACKLASH_NAMES,
    "axes+backlash": (*AXES, *BACKLASH_NAMES),
}
NO_SCATTER = 1e-12
"""Of whitened squares: below this only rounding is left, which no parameter explains."""


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    name: str
    parameters: int
    found: IdentificationResult | None
    problem: str = ""

    @property
    def bic(self) -> float | None:
        return None if self.found is None else bic(self.found)

    @property
    def unseen_rms_mm(self) -> float | None:
        unseen = self.found and self.found.unseen
        return unseen.after.rms if unseen else None


def candidate_models(
    model: Model,
    freed: Sequence[str] = (),
    fixed: Sequence[str] = (),
    priors: Sequence[str] = (),
) -> dict[str, ParameterSelection]:
    """What to compare, by name; raises `SelectionInvalid`."""
    if model is Model.EXTENDED:
        return extended_selection(freed, fixed, priors)
    return {STANDARD: select_parameters(freed, fixed, priors, names=MODEL_NAMES)}


def extended_selection(
    freed: Sequence[str] = (), fixed: Sequence[str] = (), priors: Sequence[str] = ()
) -> dict[str, ParameterSelection]:
    """What is known to each model, the standard one first; raises `SelectionInvalid`."""
    usual = select_parameters(freed, fixed, names=MODEL_NAMES).free
    full = select_parameters(freed, fixed, priors, names=MODEL_NAMES, by_default=FREE_IF_EXTENDED)
    models = {STANDARD: (), **EXTENSIONS}
    return {name: _narrowed(full, {*usual, *more}) for name, more in models.items()}


def select_model(
    nominal: Geometry,
    data: Shots,
    request: IdentificationRequest,
    models: dict[str, ParameterSelection],
) -> IdentificationResult:
    """Identify by each of the models, the first being the standard one, and keep the best.

    Raises as `identify` does for the standard model.
    """
    (name, known), *others = models.items()
    found = identify(nominal, data, replace(request, knowledge=known))
    if not others:
        return found
    standard = _Candidate(name, len(known.free), found)
    larger = [
        _candidate(name, nominal, data, replace(request, knowledge=known)) for name, known in others
    ]
    worthy = [each for each in larger if not _objection(each, standard)]
    best = min(worthy, key=_price, default=standard)
    assert best.found is not None, "what could not be fitted has an objection"
    compared = tuple(_compared(each, standard, best) for each in (standard, *larger))
    return replace(best.found, compared=compared)


def bic(found: IdentificationResult) -> float:
    """Schwarz's criterion for noise of known shape and unknown size; the least is best.

    Of all measurements of the fit: those that one model leaves out and another does not count by
    the scatter of the rest.
    """
    kept = found.fitted.after_mm.size
    outliers = sum(each.misfit is not None for each in found.excluded)
    measured = kept + found.fitted.after_mm.shape[1] * outliers
    scatter = max(found.noise.chi2 / kept, NO_SCATTER)
    return float(measured * math.log(scatter) + found.rank * math.log(measured))


def _narrowed(full: ParameterSelection, allowed: set[str]) -> ParameterSelection:
    return ParameterSelection(
        tuple(name for name in full.free if name in allowed),
        tuple(prior for prior in full.priors if prior.name in allowed),
    )


def _candidate(
    name: str, nominal: Geometry, data: Shots, request: IdentificationRequest
) -> _Candidate:
    parameters = len(request.knowledge.free)
    backlash = {*request.knowledge.free} & {*BACKLASH_NAMES}
    if backlash and not data.knows_approach:
        return _Candidate(name, parameters, None, "the shots do not say how their joints came")
    try:
        return _Candidate(name, parameters, identify(nominal, data, request))
    except CampaignError as error:
        return _Candidate(name, parameters, None, error.problem)


def _price(candidate: _Candidate) -> float:
    return math.inf if candidate.bic is None else candidate.bic


def _objection(candidate: _Candidate, standard: _Candidate) -> str:
    """Why a larger model is not kept; empty when nothing speaks against it."""
    found = candidate.found
    if candidate is standard:
        return ""
    if found is None:
        return candidate.problem
    if not found.converged:
        return found.explanation
    if found.unobservable:
        return f"the data cannot tell apart: {', '.join(found.unobservable[0])}"
    if candidate.unseen_rms_mm is None or standard.unseen_rms_mm is None:
        return "no unseen pairs speak for it"
    if candidate.unseen_rms_mm >= standard.unseen_rms_mm:
        return "unseen pairs are no better for it"
    if _price(candidate) >= _price(standard):
        return "its gain is not worth its parameters (BIC)"
    return ""


def _compared(each: _Candidate, standard: _Candidate, best: _Candidate) -> ComparedModel:
    kept = each is best
    outcome = "kept" if kept else _objection(each, standard) or "another model is better"
    return ComparedModel(each.name, each.parameters, each.bic, each.unseen_rms_mm, kept, outcome)
