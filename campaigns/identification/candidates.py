"""Candidates of a choice of models: what each finds, its price, and what speaks against it.

A larger model always fits better; it is kept only where Schwarz's (1978) criterion says that its
gain is more than its parameters would make of chance, and pairs that it never saw do not say that
it knows less: where they are farther off, the criterion must gain more than they lose, and they
must not be worse beyond chance. Beside a robot's own scatter a few of them may have larger errors
with a model that leaves half.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import CampaignError
from campaigns.evaluation.diagnostics import Doubt, lack_doubt
from campaigns.evaluation.identification import worse_beyond_chance
from campaigns.identification.change import Tested
from campaigns.identification.identify import fitted
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import IdentificationResult
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.mechanisms.transmission import YIELDING
from campaigns.shots.shots import Shots

NO_SCATTER = 1e-12
"""Of whitened squares: below this only rounding is left, which no parameter explains."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """Parameters to look for, in which shots of which nominal robot and how; what came of it."""

    name: str
    known: ParameterSelection
    nominal: Kinematics
    shots: Shots
    options: IdentificationOptions
    found: IdentificationResult | None = None
    """What it is compared by; None where there is a problem."""
    tested: Callable[[], IdentificationResult] | None = None
    """Gives the same with all shots tested for causes, which only the best one is asked for."""
    shown: Callable[[], Tested] = Tested
    """Gives what these tests show, with what is worth a trial where nothing is significant."""
    problem: str = ""
    added: tuple[tuple[str, frozenset[str]], ...] = ()
    """Causes whose terms were added to a model of the geometry, with the names of these."""

    @property
    def space(self) -> ParameterSpace:
        """Parameters of its mechanism."""
        return self.nominal.mechanism.parameters

    @property
    def parameters(self) -> int:
        """Number of those that are looked for."""
        return len(self.known.free)

    @property
    def bic(self) -> float | None:
        """Schwarz's criterion; None where there is a problem."""
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
        """Error of the hold-out pairs; None without any."""
        unseen = self.found and self.found.unseen_mm
        return unseen.after.rms if unseen else None

    def instead(self, name: str, known: ParameterSelection) -> "Candidate":
        """Another one of the same shots, identified."""
        other = replace(self, name=name, known=known, found=None, tested=None, problem="")
        backlash = {*known.free} & {*self.nominal.mechanism.parameters.backlashes}
        if backlash and not self.shots.knows_approach:
            return replace(other, problem="the shots do not say how their joints came")
        try:
            untested, tested, shown = fitted(self.nominal, self.shots, known, self.options)
            found = untested()
        except CampaignError as error:
            return replace(other, problem=error.problem)
        return replace(other, found=found, tested=tested, shown=shown)

    def adding(self, cause: str, names: Collection[str], terms: ParameterSelection) -> "Candidate":
        """The same with the terms of a cause too, and with what is known of them before."""
        wanted = {*self.known.free, *names}
        of_terms = {name: std for name, std in terms.priors.items() if name in names}
        free = tuple(name for name in self.space.of_robot if name in wanted)
        known = ParameterSelection(free, {**self.known.priors, **of_terms})
        other = self.instead(f"{self.name}+{cause}", known)
        return replace(other, added=(*self.added, (cause, frozenset(names))))

    def without(self, place: int) -> "Candidate":
        """The same without the terms of one of its causes."""
        _, names = self.added[place]
        added = self.added[:place] + self.added[place + 1 :]
        known = narrowed(self.known, {*self.known.free} - names)
        yields = any(cause.startswith(YIELDING) for cause, _ in added)
        options = replace(self.options, yielding=yields)
        like = replace(self, options=options)
        return like.instead(self.name, known).named_by(added)

    def named_by(self, added: tuple[tuple[str, frozenset[str]], ...]) -> "Candidate":
        """The same by its model of the geometry and these causes."""
        causes = (cause for cause, _ in added)
        return replace(self, name="+".join([self.name.partition("+")[0], *causes]), added=added)


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
    return float(measured * math.log(scatter) + found.rank * math.log(measured))


def narrowed(full: ParameterSelection, allowed: set[str]) -> ParameterSelection:
    """Selection without what is not allowed."""
    return ParameterSelection(
        tuple(name for name in full.free if name in allowed),
        {name: std for name, std in full.priors.items() if name in allowed},
    )


def price_of(candidate: Candidate) -> float:
    """Schwarz's criterion, infinite where there is a problem."""
    return math.inf if candidate.bic is None else candidate.bic


def objection_to(candidate: Candidate, standard: Candidate) -> str:
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
    price = price_of(candidate)
    lost = _lost_unseen(candidate, standard)
    if lost >= 0.0 and price + lost >= price_of(standard):
        return "hold-out pairs are no better with it"
    if worse_beyond_chance(_unseen_mm(standard), _unseen_mm(candidate), found.hold_out):
        return "hold-out pairs are worse with it, beyond chance"
    if price >= price_of(standard):
        return "its gain is not worth its parameters (BIC)"
    return ""


def _lost_unseen(candidate: Candidate, standard: Candidate) -> float:
    """χ² that hold-out pairs lose by a model; by their scatter where that is more than their σ."""
    squares, before = (_unseen_mm(each) ** 2 for each in (candidate, standard))
    told = candidate.found and candidate.found.hold_out
    chi2 = min(told.chi2, len(squares)) if told else len(squares)
    return float(chi2 * (1.0 - before.sum() / max(squares.sum(), NO_SCATTER)))


def _unseen_mm(candidate: Candidate) -> Array:
    """Errors of hold-out pairs, (M,)."""
    assert candidate.found is not None, "compared with it"
    assert candidate.found.unseen is not None, "likewise"
    return candidate.found.unseen.after[:, 0]
