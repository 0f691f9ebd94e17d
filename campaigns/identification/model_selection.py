"""Model selection: whether the shots call for more parameters, by hold-out pairs and BIC.

A larger model always fits better; it is kept only where Schwarz's (1978) criterion says that its
gain is more than its parameters would make of chance, and pairs that it never saw do not say that
it knows less: where they are farther off, the criterion must gain more than they lose, and they
must not be worse beyond chance. Beside a robot's own scatter a few of them may have larger errors
with a model that leaves half.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.errors import CampaignError
from campaigns.estimation.estimators import Model
from campaigns.evaluation.diagnostics import CHANGE, LACK, Doubt, lack_doubt
from campaigns.identification.change import Tested
from campaigns.identification.identify import fitted, identify
from campaigns.identification.nests import compensated
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection, select_parameters
from campaigns.identification.result import ComparedModel, IdentificationResult
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.mechanisms.transmission import GAIN, TERMS, YIELDING
from campaigns.shots.shots import Shots
from campaigns.shots.warmth import FINER, Course, by_temperature, courses, finer

STANDARD, RODS, FULL = Model.STANDARD.value, Model.RODS.value, Model.FULL.value
SCALE = "ratio"
"""Cause of all joints' ratios together."""
MOST_TERMS = 8
"""Terms of the joints' transmission that are tried, one after the other."""
WORSE_BEYOND = 0.95
"""Chance that hold-out pairs of equal models stay below."""
FEWEST_PAIRS = 3
"""By which chance can be told; with fewer the mean counts."""
NO_SCATTER = 1e-12
"""Of whitened squares: below this only rounding is left, which no parameter explains."""


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """Parameters to look for, in which shots of which nominal robot and how; what came of it."""

    name: str
    known: ParameterSelection
    nominal: Kinematics
    """With the ripples' rate, where that was searched."""
    shots: Shots
    """As warm as each was, by the course of warmth."""
    options: IdentificationOptions
    found: IdentificationResult | None = None
    """What it is compared by; None where there is a problem."""
    tested: Callable[[], IdentificationResult] | None = None
    """Gives the same with all shots tested for causes, which only the best one is asked for."""
    shown: Callable[[], Tested] = Tested
    """Gives what these tests show, with what is worth a trial where nothing is significant."""
    problem: str = ""
    course: Course | None = None
    """Of warmth, by which it lets the robot grow."""
    added: tuple[tuple[str, frozenset[str]], ...] = ()
    """Causes whose terms were added to a model of the geometry, with the names of these."""
    alike: float = math.inf
    """Schwarz's criterion where pitches of carriages are off alike, averaged over the courses."""

    @property
    def space(self) -> ParameterSpace:
        return self.nominal.mechanism.parameters

    @property
    def parameters(self) -> int:
        return len(self.known.free)

    @property
    def bic(self) -> float | None:
        return None if self.found is None else bic(self.found)

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Those of its result, and what is worth a trial."""
        if self.tested is None:
            return ()
        possible = self.shown().possible
        more = () if possible is None else (lack_doubt(possible, self.space, limits_met=True),)
        return (*self.tested().doubts, *more)

    @property
    def unseen_rms_mm(self) -> float | None:
        unseen = self.found and self.found.unseen_mm
        return unseen.after.rms if unseen else None

    def instead(self, name: str, known: ParameterSelection) -> "_Candidate":
        """Another one of the same shots, identified."""
        other = replace(
            self, name=name, known=known, found=None, tested=None, problem="", alike=math.inf
        )
        backlash = {*known.free} & {*self.nominal.mechanism.parameters.backlashes}
        if backlash and not self.shots.knows_approach:
            return replace(other, problem="the shots do not say how their joints came")
        try:
            untested, tested, shown = fitted(self.nominal, self.shots, known, self.options)
            found = untested()
        except CampaignError as error:
            return replace(other, problem=error.problem)
        return replace(other, found=found, tested=tested, shown=shown)

    def adding(self, cause: str, names: Collection[str], terms: ParameterSelection) -> "_Candidate":
        """The same with the terms of a cause too, and with what is known of them before."""
        wanted = {*self.known.free, *names}
        of_terms = {name: std for name, std in terms.priors.items() if name in names}
        free = tuple(name for name in self.space.model if name in wanted)
        known = ParameterSelection(free, {**self.known.priors, **of_terms})
        other = self.instead(f"{self.name}+{cause}", known)
        return replace(other, added=(*self.added, (cause, frozenset(names))))

    def without(self, place: int) -> "_Candidate":
        """The same without the terms of one of its causes, but for those of the others."""
        _, names = self.added[place]
        added = self.added[:place] + self.added[place + 1 :]
        others = frozenset[str]().union(*(own for _, own in added))
        if names <= others:
            return self.named_by(added)
        known, space = _narrowed(self.known, {*self.known.free} - (names - others)), self.space
        yields = any(cause.startswith(YIELDING) for cause, _ in added)
        options = replace(self.options, yielding=yields)
        like = replace(self, options=options)
        if options.ripple_p is not None and not any(space[name].is_ripple for name in known.free):
            mechanism = self.nominal.mechanism.with_ripples(0.0)
            like = replace(
                like,
                nominal=replace(self.nominal, mechanism=mechanism),
                options=replace(options, ripple_p=None),
            )
        return like.instead(self.name, known).named_by(added)

    def named_by(self, added: tuple[tuple[str, frozenset[str]], ...]) -> "_Candidate":
        """The same by its model of the geometry and these causes."""
        causes = (cause for cause, _ in added)
        return replace(self, name="+".join([self.name.partition("+")[0], *causes]), added=added)

    def warmed(self, course: Course) -> "_Candidate":
        """The same with shots as warm as a course says."""
        shots = replace(self.shots, warmth=course.values)
        errors = () if course.errors is None else course.errors.tolist()
        errors_by_number = dict(zip(shots.numbers, errors, strict=False))
        options = replace(self.options, course_errors=errors_by_number)
        return replace(self, shots=shots, course=course, options=options)


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
    usual = select_parameters(space, freed, fixed, names=space.model).free
    whole = _whole(space, model, freed, fixed, priors)
    models = {STANDARD: (), **extensions(space, model)}
    return {name: _narrowed(whole, {*usual, *more}) for name, more in models.items()}


def terms_to_add(
    space: ParameterSpace,
    model: Model,
    freed: Sequence[str] = (),
    fixed: Sequence[str] = (),
    priors: Sequence[str] = (),
) -> ParameterSelection:
    """Terms of joints' transmission and of warmth that a choice may add; as `candidate_models`."""
    added = _added(space, model) - {*select_parameters(space, freed, fixed, names=space.model).free}
    return _narrowed(_whole(space, model, freed, fixed, priors), added)


def _added(space: ParameterSpace, model: Model) -> set[str]:
    if model is Model.AUTO:
        return {*space.transmission, *space.thermal}
    return {*space.thermal} if model is Model.EXTENDED else set()


def _whole(space: ParameterSpace, model: Model, *chosen: Sequence[str]) -> ParameterSelection:
    """Parameters of all that a model may end with."""
    more = {name for each in extensions(space, model).values() for name in each}
    more |= {*space.free_by_default} | _added(space, model)
    by_default = tuple(name for name in space.model if name in more)
    return select_parameters(space, *chosen, names=space.model, by_default=by_default)


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

    `terms`: of the joints' transmission and of warmth, that may be added to it, a cause after the
    other, as the shots show them and the same rules allow; None: those of warmth. The model that
    was `asked` for by name is kept whatever speaks against it. Raises as `identify` does for the
    standard model, or for that one.
    """
    options = options or IdentificationOptions()
    (name, known), *others = models.items()
    untested, tested, shown = fitted(nominal, shots, known, options)
    if not others:
        return tested()
    standard = _Candidate(name, known, nominal, shots, options, untested(), tested, shown)
    larger = [standard.instead(name, known) for name, known in others]
    if asked is None:
        worthy = [each for each in larger if not _objection(each, standard)]
        terms = terms or ParameterSelection(nominal.mechanism.parameters.thermal)
        best = _with_terms(min(worthy, key=_price, default=standard), terms, larger)
        wider = [*_with_more_parts(best, models, terms)]
        larger += wider
        if worthy := [each for each in wider if not _objection(each, best)]:
            best = _with_terms(min(worthy, key=_price), terms, larger)
    else:
        best = next(each for each in larger if each.name == asked)
    if best.tested is None:
        return identify(nominal, shots, best.known, options)
    named = (best if each.found is best.found else each for each in (standard, *larger))
    compared = tuple(_compared(each, standard, best) for each in named)
    warmth = None if best.course is None else best.course.told
    return replace(best.tested(), models=compared, warmth=warmth)


def _with_terms(best: _Candidate, terms: ParameterSelection, tried: list[_Candidate]) -> _Candidate:
    """The best with terms added, of the cause that is most significant beside it each time.

    Stepwise selection: what is objected to is not tried again, what is not is the next best, which
    then is tried without each of those before. All of them are appended to those that were tried.
    """
    space, allowed = best.nominal.mechanism.parameters, {*terms.free} - {*best.known.free}
    begun = best.course is not None or _grows(best)
    if best.course is None and begun:
        cold = best
        for warmed in _with_warmth(cold, terms):
            tried.append(warmed)
            best = best if _objection(warmed, cold) else warmed
        for warmed in _grown_alike(cold, best, terms):
            tried.append(warmed)
            best = best if _objection(warmed, cold) else warmed
    for _ in range(MOST_TERMS):
        more = _lacking_terms(best, allowed, space) or _terms_of_others(best, allowed, space)
        if more is None:
            break
        cause, names, numbers = more
        if cause == SCALE and not begun and _hides_growth(best):
            begun = True
            if (grown := _with_late_growth(best, terms, tried)) is not best:
                return _with_terms(grown, terms, tried)
        like, rate = best, numbers.get("per_turn", numbers.get("period_mm"))
        if rate is not None and not best.nominal.mechanism.rate:
            mechanism = best.nominal.mechanism.with_ripples(float(rate))
            options = replace(best.options, ripple_p=float(numbers["p"]))
            nominal = replace(best.nominal, mechanism=mechanism)
            like = replace(best, nominal=nominal, options=options)
        if cause.startswith(YIELDING):
            like = replace(like, options=replace(like.options, yielding=True))
        tried.append(like.adding(cause, names, terms))
        allowed -= names
        best = best if _objection(tried[-1], best) else _needed(tried[-1], best, tried)
    grown = best if begun else _with_late_growth(best, terms, tried)
    return best if grown is best else _with_terms(grown, terms, tried)


def _needed(best: _Candidate, before: _Candidate, tried: list[_Candidate]) -> _Candidate:
    """The best without terms that its last ones do instead of, the cause that gains most first.

    It had been without the last ones `before`.
    """
    gains = [_price(before) - _likely(best)]
    for place in reversed(range(len(best.added) - 1)):
        smaller = best.without(place)
        if smaller.found is best.found:  # growth has these pitches too
            needed, gain = best.alike > _price(best), math.inf
        else:
            tried.append(smaller)
            needed = smaller.found is None or not _objection(best, smaller)
            gain = _price(smaller) - _price(best)
        if needed:
            gains.insert(0, gain)
        else:
            best = smaller
    order = sorted(range(len(gains)), key=lambda place: -gains[place])
    return best.named_by(tuple(best.added[place] for place in order))


def _with_late_growth(
    best: _Candidate, terms: ParameterSelection, tried: list[_Candidate]
) -> _Candidate:
    """The best with growth that shows beside its terms, or that carriages' scale hides.

    Such a scale may as well be off all the time: the likelier of both is taken. Growth explains
    part of any step, and a scale part of a wrong reflector: what it leaves must show neither.
    """
    hidden = _hides_growth(best)
    others = [_with_pitches(best, terms)] if hidden else []
    grows = _grows(best) or best.shown().grows
    others += _with_warmth(best, terms) if hidden or grows else ()
    unexplained = {CHANGE, LACK} if hidden else {CHANGE}

    def explains(each: _Candidate) -> bool:
        doubts = () if each.tested is None else each.tested().doubts
        return not unexplained & {doubt.name for doubt in doubts}

    worthy = [each for each in others if not _objection(each, best) and explains(each)]
    chosen = min(worthy, key=_price, default=best)
    if hidden and explains(others[0]):
        for grown in _grown_alike(best, chosen, terms):
            others.append(grown)
            chosen = grown if not _objection(grown, best) and explains(grown) else chosen
    tried += others
    return best if chosen is best else _needed(chosen, best, tried)


def _grown_alike(
    best: _Candidate, chosen: _Candidate, terms: ParameterSelection
) -> Iterator[_Candidate]:
    """Candidate with growth by the course that explains most where pitches are off alike.

    None where a scale that is off all the time is likelier, or what was chosen: pitches that are
    off each by itself. Of the courses nobody knows which is true: their mean likelihood counts.
    """
    growing = [name for name in terms.free if name in best.space.thermal]
    pitches = _pitches(best, terms)
    if not growing or not pitches:
        return

    def alike(course: Course) -> float:
        """Criterion of pitches as robot.yaml says, but for growth of the rails by a course."""
        warmed = best.warmed(course)
        added = (warmed.adding("warmth", names, terms) for names in (growing, growing[:1]))
        return min(map(_price, added))

    on_stand = compensated(best.shots, best.options)[0]
    coarse = courses(on_stand, best.options.reference_degC)
    prices = [alike(course.begun) for course in coarse]
    mean = scipy.special.logsumexp(-0.5 * np.array(prices)) - math.log(len(prices))
    price, steady = float(-2.0 * mean), alike(Course("time", np.ones(len(best.shots))))
    if price >= min(steady, _price(chosen)):
        return
    least, course = min(zip(prices, coarse, strict=True), key=lambda each: each[0])
    for factor in FINER:
        for near in finer(on_stand, course, factor):
            if (found := alike(near.begun)) < least:
                least, course = found, near
    yield replace(best.warmed(course).adding("warmth", {*growing, *pitches}, terms), alike=price)


def _hides_growth(best: _Candidate) -> bool:
    """Whether what carriages are said to lack may be growth, of which they show the scale first.

    Beside a scale that is off all the time its change is no drift that a test would name.
    """
    on_rails = not best.nominal.mechanism.joints[0].is_revolute
    return on_rails and any(each.name == LACK for each in best.doubts)


def _with_pitches(best: _Candidate, terms: ParameterSelection) -> _Candidate:
    """Candidate that takes up a scale that is off without any growth."""
    return best.adding(SCALE, _pitches(best, terms), terms)


def _pitches(best: _Candidate, terms: ParameterSelection) -> set[str]:
    """Terms of carriages' scales, which are right before rails grow; empty of cranks.

    Parameters are stated as the run ends, when rails have grown.
    """
    is_revolute = best.nominal.mechanism.joints[0].is_revolute
    return set() if is_revolute else {*terms.free} & {*best.space.of_field(GAIN.name)}


def _with_more_parts(
    best: _Candidate, models: dict[str, ParameterSelection], terms: ParameterSelection
) -> Iterator[_Candidate]:
    """Candidates of more geometry with the best one's terms, beside which that shows after all.

    Errors of gears that no model held before hide what parts do, from hold-out pairs too.
    """
    _, _, added = best.name.partition("+")
    own = [name for name in best.known.free if name in terms.free]
    for name, model in models.items() if own else ():
        if {*best.known.free} < {*model.free, *own}:
            like = replace(best, name=name, known=model, added=())
            yield replace(like.adding(added, own, terms), added=best.added)


def _grows(best: _Candidate) -> bool:
    """Whether the shots show a change that growth with warmth may be.

    A drift; or, where temperatures of the parts are known, a step, as from one day to the next.
    """
    kinds = {each.numbers.get("kind") for each in best.doubts if each.name == CHANGE}
    return "drift" in kinds or (bool(kinds) and by_temperature(best.shots))


def _with_warmth(best: _Candidate, terms: ParameterSelection) -> Iterator[_Candidate]:
    """Candidates that let arms, forearms and frame grow: that of the course that explains most.

    With less to tell where not all three can be told.
    """
    space, options = best.nominal.mechanism.parameters, best.options
    growing = [name for name in terms.free if name in space.thermal]
    pitches = _pitches(best, terms)
    on_stand = compensated(best.shots, options)[0]
    for names in (growing, growing[:1]) if growing else ():

        def by(course: Course, names: list[str] = names) -> _Candidate:
            return best.warmed(course).adding("warmth", [*names, *pitches], terms)

        cheapest = min(map(by, courses(on_stand, options.reference_degC)), key=_price)
        for factor in FINER if not _objection(cheapest, best) else ():
            near = finer(on_stand, cheapest.course, factor) if cheapest.course else ()
            cheapest = min((cheapest, *map(by, near)), key=_price)
        yield cheapest
        if not _objection(cheapest, best):
            return


def _lacking_terms(
    best: _Candidate, allowed: set[str], space: ParameterSpace
) -> tuple[str, set[str], Mapping[str, float | str]] | None:
    """First cause of a lack of fit that terms of the transmission take up.

    With their names, and what the doubt says of it.
    """
    for doubt in best.doubts:
        stems = TERMS.get(str(doubt.numbers.get("cause")), ())
        arm = int(doubt.numbers.get("arm", -1)) if doubt.numbers.get("alone") else None
        own = (space[name] for name in allowed)
        names = {each.name for each in own if each.field.stem in stems and arm in {None, each.arm}}
        if names:
            told = str(doubt.numbers["cause"]) + ("" if arm is None else str(arm))
            return told, names, doubt.numbers
    return None


def _terms_of_others(
    best: _Candidate, allowed: set[str], space: ParameterSpace
) -> tuple[str, set[str], Mapping[str, float | str]] | None:
    """Cause whose terms some arms have, and their names in the others: parts are alike.

    What is too small to be found in each of them puts the geometry out all the same.
    """
    own = {space[name].field.stem for name in {*best.known.free} & {*space.transmission}}
    for cause, stems in TERMS.items():
        if names := {name for name in allowed if space[name].field.stem in own & {*stems}}:
            return cause, names, {}
    return None


def bic(found: IdentificationResult) -> float:
    """Schwarz's criterion for noise of known shape and unknown size; the least is best.

    Of all measurements of the fit: those that one model leaves out and another does not count by
    the scatter of the rest. Distances count alike, in mm: each model weighs them with the scatter
    that the robot has by it, beside which none would leave more than any other.
    """
    assert found.fitted is not None, "it was just made"
    assert found.chi2 is not None, "likewise"
    after = found.fitted.after
    outliers = sum(each.is_outlier for each in found.excluded)
    measured = after.size + after.shape[1] * outliers
    squares = found.chi2.value if found.fitted.of == "shots" else float(np.sum(after**2))
    scatter = max(squares / after.size, NO_SCATTER)
    searched = found.ripples is not None and found.ripples.std is not None
    return float(measured * math.log(scatter) + (found.rank + searched) * math.log(measured))


def _narrowed(full: ParameterSelection, allowed: set[str]) -> ParameterSelection:
    return ParameterSelection(
        tuple(name for name in full.free if name in allowed),
        {name: std for name, std in full.priors.items() if name in allowed},
    )


def _price(candidate: _Candidate) -> float:
    return math.inf if candidate.bic is None else candidate.bic


def _likely(candidate: _Candidate) -> float:
    """Price by what is known before: pitches are off each by itself, or alike."""
    return min(_price(candidate), candidate.alike)


def _objection(candidate: _Candidate, standard: _Candidate) -> str:
    """Why a larger model is not kept; empty when nothing speaks against it."""
    found = candidate.found
    if candidate is standard:
        return ""
    if found is None:
        return candidate.problem
    if not found.converged:
        return found.message
    if found.unobservable:
        return f"the data cannot tell apart: {', '.join(found.unobservable[0])}"
    if candidate.unseen_rms_mm is None or standard.unseen_rms_mm is None:
        return "no hold-out pairs to support it"
    price = _likely(candidate) if math.isinf(standard.alike) else _price(candidate)
    lost = _lost_unseen(candidate, standard)
    if lost >= 0.0 and price + lost >= _price(standard):
        return "hold-out pairs are no better with it"
    if _is_worse(candidate, standard):
        return "hold-out pairs are worse with it, beyond chance"
    if price >= _price(standard):
        return "its gain is not worth its parameters (BIC)"
    return ""


def _lost_unseen(candidate: _Candidate, standard: _Candidate) -> float:
    """χ² that hold-out pairs lose by a model; by their scatter where that is more than their σ."""
    squares, before = (_unseen_mm(each) ** 2 for each in (candidate, standard))
    told = candidate.found and candidate.found.hold_out
    chi2 = min(told.chi2, len(squares)) if told else len(squares)
    return float(chi2 * (1.0 - before.sum() / max(squares.sum(), NO_SCATTER)))


def _is_worse(candidate: _Candidate, standard: _Candidate) -> bool:
    """Whether hold-out pairs are worse for a model, pair by pair and beyond chance (Student's).

    And farther off than its own σ say: what they then show is that it is wrong.
    """
    squares = [_unseen_mm(each) ** 2 for each in (candidate, standard)]
    more = squares[0] - squares[1]
    count, mean = len(more), float(more.mean())
    if count < FEWEST_PAIRS:
        return mean >= 0.0
    told = candidate.found and candidate.found.hold_out
    if told and told.believable:
        return False  # few pairs cannot tell: they are as far off as the model says
    factor = float(scipy.special.stdtrit(count - 1, WORSE_BEYOND))
    return mean > factor * float(more.std(ddof=1)) / math.sqrt(count)


def _unseen_mm(candidate: _Candidate) -> Array:
    """Errors of hold-out pairs, (M,)."""
    assert candidate.found is not None, "compared with it"
    assert candidate.found.unseen is not None, "likewise"
    return candidate.found.unseen.after[:, 0]


def _compared(each: _Candidate, standard: _Candidate, best: _Candidate) -> ComparedModel:
    kept = each is best
    beside = _price(each) < _price(best) and _objection(each, best)
    outcome = "kept" if kept else _objection(each, standard) or beside or "another model is better"
    return ComparedModel(each.name, each.parameters, each.bic, each.unseen_rms_mm, kept, outcome)
