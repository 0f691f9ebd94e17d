"""Selection of terms: of gears, drives and warmth, a cause after the other, by the same rules.

Stepwise: the cause that is most significant beside the best model is added, everything is fitted
anew, and what others do instead of is left out again.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import scipy

from campaigns.evaluation.diagnostics import CHANGE, LACK
from campaigns.identification.candidates import Candidate, likely_price_of, objection_to, price_of
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.mechanisms.transmission import GAIN, TERMS, YIELDING
from campaigns.shots.warmth import FINER, Course, by_temperature, courses, finer

SCALE = "ratio"
"""Cause of all joints' ratios together."""
MOST_TERMS = 8
"""Terms of the joints' transmission that are tried, one after the other."""


def with_terms(best: Candidate, terms: ParameterSelection, tried: list[Candidate]) -> Candidate:
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
            best = best if objection_to(warmed, cold) else warmed
        for warmed in _grown_alike(cold, best, terms):
            tried.append(warmed)
            best = best if objection_to(warmed, cold) else warmed
    for _ in range(MOST_TERMS):
        more = _lacking_terms(best, allowed, space) or _terms_of_others(best, allowed, space)
        if more is None:
            break
        cause, names = more
        if cause == SCALE and not begun and _hides_growth(best):
            begun = True
            if (grown := _with_late_growth(best, terms, tried)) is not best:
                return with_terms(grown, terms, tried)
        like = best
        if cause.startswith(YIELDING):
            like = replace(like, options=replace(like.options, yielding=True))
        tried.append(like.adding(cause, names, terms))
        allowed -= names
        best = best if objection_to(tried[-1], best) else _needed(tried[-1], best, tried)
    grown = best if begun else _with_late_growth(best, terms, tried)
    return best if grown is best else with_terms(grown, terms, tried)


def _needed(best: Candidate, before: Candidate, tried: list[Candidate]) -> Candidate:
    """The best without terms that its last ones do instead of, the cause that gains most first.

    It had been without the last ones `before`.
    """
    gains = [price_of(before) - likely_price_of(best)]
    for place in reversed(range(len(best.added) - 1)):
        smaller = best.without(place)
        if smaller.found is best.found:  # growth has these pitches too
            needed, gain = best.alike > price_of(best), math.inf
        else:
            tried.append(smaller)
            needed = smaller.found is None or not objection_to(best, smaller)
            gain = price_of(smaller) - price_of(best)
        if needed:
            gains.insert(0, gain)
        else:
            best = smaller
    order = sorted(range(len(gains)), key=lambda place: -gains[place])
    return best.named_by(tuple(best.added[place] for place in order))


def _with_late_growth(
    best: Candidate, terms: ParameterSelection, tried: list[Candidate]
) -> Candidate:
    """The best with growth that shows beside its terms, or that carriages' scale hides.

    Such a scale may as well be off all the time: the likelier of both is taken. Growth explains
    part of any step, and a scale part of a wrong reflector: what it leaves must show neither.
    """
    hidden = _hides_growth(best)
    others = [_with_pitches(best, terms)] if hidden else []
    grows = _grows(best) or best.shown().grows
    others += _with_warmth(best, terms) if hidden or grows else ()
    unexplained = {CHANGE, LACK} if hidden else {CHANGE}

    def explains(each: Candidate) -> bool:
        doubts = () if each.tested is None else each.tested().doubts
        return not unexplained & {doubt.name for doubt in doubts}

    worthy = [each for each in others if not objection_to(each, best) and explains(each)]
    chosen = min(worthy, key=price_of, default=best)
    if grows or (hidden and explains(others[0])):
        for grown in _grown_alike(best, chosen, terms):
            others.append(grown)
            chosen = grown if not objection_to(grown, best) and explains(grown) else chosen
    tried += others
    return best if chosen is best else _needed(chosen, best, tried)


def _grown_alike(
    best: Candidate, chosen: Candidate, terms: ParameterSelection
) -> Iterator[Candidate]:
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
        return min(map(price_of, added))

    coarse = courses(best.shots, best.options.reference_degC)
    prices = [alike(course.begun) for course in coarse]
    mean = scipy.special.logsumexp(-0.5 * np.array(prices)) - math.log(len(prices))
    price, steady = float(-2.0 * mean), alike(Course("time", np.ones(len(best.shots))))
    if price >= min(steady, price_of(chosen)):
        return
    least, course = min(zip(prices, coarse, strict=True), key=lambda each: each[0])
    for factor in FINER:
        for near in finer(best.shots, course, factor):
            if (found := alike(near.begun)) < least:
                least, course = found, near
    yield replace(best.warmed(course).adding("warmth", {*growing, *pitches}, terms), alike=price)


def _hides_growth(best: Candidate) -> bool:
    """Whether what carriages are said to lack may be growth, of which they show the scale first.

    Beside a scale that is off all the time its change is no drift that a test would name.
    """
    on_rails = not best.nominal.mechanism.joints[0].is_revolute
    return on_rails and any(each.name == LACK for each in best.doubts)


def _with_pitches(best: Candidate, terms: ParameterSelection) -> Candidate:
    """Candidate that takes up a scale that is off without any growth."""
    return best.adding(SCALE, _pitches(best, terms), terms)


def _pitches(best: Candidate, terms: ParameterSelection) -> set[str]:
    """Terms of carriages' scales, which are right before rails grow; empty of cranks.

    Parameters are stated as the run ends, when rails have grown.
    """
    is_revolute = best.nominal.mechanism.joints[0].is_revolute
    return set() if is_revolute else {*terms.free} & {*best.space.of_field(GAIN.name)}


def with_more_parts(
    best: Candidate, models: dict[str, ParameterSelection], terms: ParameterSelection
) -> Iterator[Candidate]:
    """Candidates of more geometry with the best one's terms, beside which that shows after all.

    Errors of gears that no model held before hide what parts do, from hold-out pairs too.
    """
    _, _, added = best.name.partition("+")
    own = [name for name in best.known.free if name in terms.free]
    for name, model in models.items() if own else ():
        if {*best.known.free} < {*model.free, *own}:
            like = replace(best, name=name, known=model, added=())
            yield replace(like.adding(added, own, terms), added=best.added)


def _grows(best: Candidate) -> bool:
    """Whether the shots show a change that growth with warmth may be.

    A drift; or, where temperatures of the parts are known, a step, as from one day to the next.
    """
    kinds = {each.numbers.get("kind") for each in best.doubts if each.name == CHANGE}
    return "drift" in kinds or (bool(kinds) and by_temperature(best.shots))


def _with_warmth(best: Candidate, terms: ParameterSelection) -> Iterator[Candidate]:
    """Candidates that let arms, forearms and frame grow: that of the course that explains most.

    With less to tell where not all three can be told.
    """
    space, options = best.nominal.mechanism.parameters, best.options
    growing = [name for name in terms.free if name in space.thermal]
    pitches = _pitches(best, terms)
    for names in (growing, growing[:1]) if growing else ():

        def by(course: Course, names: list[str] = names) -> Candidate:
            return best.warmed(course).adding("warmth", [*names, *pitches], terms)

        cheapest = min(map(by, courses(best.shots, options.reference_degC)), key=price_of)
        for factor in FINER if not objection_to(cheapest, best) else ():
            near = finer(best.shots, cheapest.course, factor) if cheapest.course else ()
            cheapest = min((cheapest, *map(by, near)), key=price_of)
        yield cheapest
        if not objection_to(cheapest, best):
            return


def _lacking_terms(
    best: Candidate, allowed: set[str], space: ParameterSpace
) -> tuple[str, set[str]] | None:
    """First cause of a lack of fit that terms of the transmission take up.

    With their names.
    """
    for doubt in best.doubts:
        stems = TERMS.get(str(doubt.numbers.get("cause")), ())
        arm = int(doubt.numbers.get("arm", -1)) if doubt.numbers.get("alone") else None
        own = (space[name] for name in allowed)
        names = {each.name for each in own if each.field.stem in stems and arm in {None, each.arm}}
        if names:
            told = str(doubt.numbers["cause"]) + ("" if arm is None else str(arm))
            return told, names
    return None


def _terms_of_others(
    best: Candidate, allowed: set[str], space: ParameterSpace
) -> tuple[str, set[str]] | None:
    """Cause whose terms some arms have, and their names in the others: parts are alike.

    What is too small to be found in each of them puts the geometry out all the same.
    """
    own = {space[name].field.stem for name in {*best.known.free} & {*space.transmission}}
    for cause, stems in TERMS.items():
        if names := {name for name in allowed if space[name].field.stem in own & {*stems}}:
            return cause, names
    return None
