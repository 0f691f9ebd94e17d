"""Selection of terms: of gears and drives, a cause after the other, by the same rules.

Stepwise: the cause that is most significant beside the best model is added, everything is fitted
anew, and what others do instead of is left out again.
"""

from collections.abc import Iterator
from dataclasses import replace

from campaigns.identification.candidates import Candidate, objection_to, price_of
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.mechanisms.transmission import TERMS, YIELDING

MOST_TERMS = 8
"""Terms of the joints' transmission that are tried, one after the other."""


def with_terms(best: Candidate, terms: ParameterSelection, tried: list[Candidate]) -> Candidate:
    """The best with terms added, of the cause that is most significant beside it each time.

    Stepwise selection: what is objected to is not tried again, what is not is the next best, which
    then is tried without each of those before. All of them are appended to those that were tried.
    """
    space, allowed = best.nominal.mechanism.parameters, {*terms.free} - {*best.known.free}
    for _ in range(MOST_TERMS):
        more = _lacking_terms(best, allowed, space) or _terms_of_others(best, allowed, space)
        if more is None:
            break
        cause, names = more
        like = best
        if cause.startswith(YIELDING):
            like = replace(like, options=replace(like.options, yielding=True))
        tried.append(like.adding(cause, names, terms))
        allowed -= names
        best = best if objection_to(tried[-1], best) else _needed(tried[-1], best, tried)
    return best


def _needed(best: Candidate, before: Candidate, tried: list[Candidate]) -> Candidate:
    """The best without terms that its last ones do instead of, the cause that gains most first.

    It had been without the last ones `before`.
    """
    gains = [price_of(before) - price_of(best)]
    for place in reversed(range(len(best.added) - 1)):
        smaller = best.without(place)
        tried.append(smaller)
        if smaller.found is None or not objection_to(best, smaller):
            gains.insert(0, price_of(smaller) - price_of(best))
        else:
            best = smaller
    order = sorted(range(len(gains)), key=lambda place: -gains[place])
    return best.named_by(tuple(best.added[place] for place in order))


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
