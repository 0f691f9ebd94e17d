"""Model selection: which parameters each model looks for, and which model the shots call for.

By hold-out pairs and BIC, as `candidates` says.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from campaigns.estimation.estimators import Model
from campaigns.identification.candidates import Candidate, narrowed, objection_to, price_of
from campaigns.identification.identify import fitted, identify
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection, select_parameters
from campaigns.identification.result import ComparedModel, IdentificationResult
from campaigns.identification.term_selection import with_more_parts, with_terms
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.shots.shots import Shots, between, held_out

HOLD_OUT_SEED = 1
"""The same pairs are held out for every identification of the same shots."""
STANDARD, RODS, FULL = Model.STANDARD.value, Model.RODS.value, Model.FULL.value


def select_geometry(
    space: ParameterSpace, model: Model, freed: Sequence[str] = (), fixed: Sequence[str] = ()
) -> tuple[str, ...]:
    """Names of the geometry's parameters that a model looks for, in the order of the vector.

    What a choice of models may end with is looked for whole. Raises `OptionsInvalid`.
    """
    by_default = space.free_in_full
    if model in {Model.PAPER, Model.STANDARD}:
        by_default = space.free_by_default
    elif model is Model.RODS:
        by_default = (*space.free_by_default, *space.skews)
    names = space.geometry
    return select_parameters(space, freed, fixed, names=names, by_default=by_default).free


def candidate_models(
    space: ParameterSpace,
    model: Model,
    freed: Sequence[str] = (),
    fixed: Sequence[str] = (),
    priors: Sequence[str] = (),
) -> dict[str, ParameterSelection]:
    """Parameters of each model to compare, the standard one first; raises `OptionsInvalid`."""
    usual = select_parameters(space, freed, fixed, names=space.of_robot).free
    whole = _whole(space, model, freed, fixed, priors)
    models = {STANDARD: (), **extensions(space, model)}
    return {name: narrowed(whole, {*usual, *more}) for name, more in models.items()}


def terms_to_add(
    space: ParameterSpace,
    model: Model,
    freed: Sequence[str] = (),
    fixed: Sequence[str] = (),
    priors: Sequence[str] = (),
) -> ParameterSelection:
    """Terms of joints' transmission that a choice may add; raises as `candidate_models`."""
    added = _added(space, model) - {
        *select_parameters(space, freed, fixed, names=space.of_robot).free
    }
    return narrowed(_whole(space, model, freed, fixed, priors), added)


def _added(space: ParameterSpace, model: Model) -> set[str]:
    return {*space.transmission} if model is Model.AUTO else set()


def _whole(space: ParameterSpace, model: Model, *chosen: Sequence[str]) -> ParameterSelection:
    """Parameters of all that a model may end with."""
    more = {name for each in extensions(space, model).values() for name in each}
    more |= {*space.free_by_default} | _added(space, model)
    by_default = tuple(name for name in space.of_robot if name in more)
    return select_parameters(space, *chosen, names=space.of_robot, by_default=by_default)


def asked_of(model: Model) -> str | None:
    """Name of the model that is kept whatever speaks against it, where one is asked for."""
    return model.value if model in {Model.RODS, Model.FULL} else None


def extensions(space: ParameterSpace, model: Model) -> dict[str, tuple[str, ...]]:
    """Parameters beyond the usual ones of each larger model to compare, the fewest first.

    Rods: differences of a forearm's two rods. Full: tilted axes too. Axes: where all axes point.
    Backlash: what gears lose. Auto adds the terms of the joints' transmission that shots show.
    """
    beyond = [name for name in space.free_if_extended if name not in space.free_by_default]
    axes = tuple(name for name in beyond if name not in space.backlashes)
    full = tuple(name for name in space.free_in_full if name in beyond)
    rods = space.skews
    gears = space.backlashes
    match model:
        case Model.PAPER | Model.STANDARD:
            return {}
        case Model.RODS:
            return {RODS: rods}
        case Model.FULL:
            return {RODS: rods, FULL: full}
        case Model.AUTO:
            # where carriages have no azimuths to tell, axes are the full model
            wider = {"axes": axes} if set(axes) != set(full) else {}
            return {RODS: rods, FULL: full, **wider}
        case Model.EXTENDED:
            return {"axes": axes, "backlash": gears, "axes+backlash": (*axes, *gears)}


def asked_shots(shots: Shots, options: IdentificationOptions) -> Shots:
    """Return the shots in the range of the options, the share to hold out being for validation."""
    inside = between(shots, *options.shots)
    return held_out(inside, options.hold_out, np.random.default_rng(HOLD_OUT_SEED))


def identify_model(
    nominal: Kinematics, shots: Shots, options: IdentificationOptions
) -> IdentificationResult:
    """Identify by the model of the options, or `auto`, and by their patterns and priors.

    Raises `OptionsInvalid`, `ShotsMissing` and `ShotsInvalid`.
    """
    space, model = nominal.mechanism.parameters, options.model or Model.AUTO
    chosen = options.free, options.fix, options.prior
    models = candidate_models(space, model, *chosen)
    terms = terms_to_add(space, model, *chosen)
    return select_model(nominal, shots, models, options, asked=asked_of(model), terms=terms)


def select_model(
    nominal: Kinematics,
    shots: Shots,
    models: dict[str, ParameterSelection],
    options: IdentificationOptions | None = None,
    *,
    asked: str | None = None,
    terms: ParameterSelection | None = None,
) -> IdentificationResult:
    """Identify by each of the models, the first being the standard one, and keep the best.

    `terms`: of the joints' transmission, that may be added to it, a cause after the other, as the
    shots show them and the same rules allow. The model that was `asked` for by name is kept
    whatever speaks against it. Raises as `identify` does for the
    standard model, or for that one.
    """
    options = options or IdentificationOptions()
    (name, known), *others = models.items()
    untested, tested, shown = fitted(nominal, shots, known, options)
    if not others:
        return tested()
    standard = Candidate(name, known, nominal, shots, options, untested(), tested, shown)
    larger = [standard.instead(name, known) for name, known in others]
    if asked is None:
        worthy = [each for each in larger if not objection_to(each, standard)]
        terms = terms or ParameterSelection(())
        best = with_terms(min(worthy, key=price_of, default=standard), terms, larger)
        wider = [*with_more_parts(best, models, terms)]
        larger += wider
        if worthy := [each for each in wider if not objection_to(each, best)]:
            best = with_terms(min(worthy, key=price_of), terms, larger)
    else:
        best = next(each for each in larger if each.name == asked)
    if best.tested is None:
        return identify(nominal, shots, best.known, options)
    named = (best if each.found is best.found else each for each in (standard, *larger))
    compared = tuple(_compared(each, standard, best) for each in named)
    return replace(best.tested(), models=compared)


def _compared(each: Candidate, standard: Candidate, best: Candidate) -> ComparedModel:
    kept = each is best
    beside = price_of(each) < price_of(best) and objection_to(each, best)
    outcome = (
        "kept" if kept else objection_to(each, standard) or beside or "another model is better"
    )
    return ComparedModel(each.name, each.parameters, each.bic, each.unseen_rms_mm, kept, outcome)
