"""Events of a campaign: shots that went wrong, parts that changed, a stand that was bumped.

Theory of operation. A fit states the probability of each shot to be good (`fit.py`). What many
shots show together may be an effect instead: a part that changed at some shot, gears with a period,
joints read too late, an error in a region for which the model has no column. Hypotheses are sets of
effects, and are compared by their evidence (`log_evidence`), in which wrong shots, sizes, noise and
the odds of each effect are priced. So a change of some shots and a set of wrong shots compete.

1. Fit without effects, but for the slow motion of the stand, which is always in the model.
2. Propose effects from the one linear model of the best fit so far: nothing is assembled again. A
   change of a part is scanned for over all spans, with the stand's motion and with it held at 0, by
   the weights of the fit and, where it leaves out several shots, with all shots in it.
3. Fit each proposal. Take the one with the largest evidence, if it is larger than before, and go to
   2. A change of the same part at nearly the same shot is moved, not doubled.
4. Take out every change without which the evidence does not fall.

Several parts often explain one change nearly as well: all of them are reported, not the best alone.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.fit.effects import (
    ENCODER_RAD,
    FRAME,
    PARTS,
    STEP_MM,
    TURN_MRAD,
    Effect,
    Lag,
    Layer,
    RateError,
    StandSince,
    Step,
    Walk,
)
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.fit import (
    Fit,
    Prior,
    estimate_sizes_and_noise,
    falls_short,
    fit_model,
    log_evidence,
    log_factors_at_usual_size,
    refit,
    settle,
)
from campaigns.fit.layers import LAYERS, likely_layers
from campaigns.fit.periods import likely_ripples
from campaigns.fit.slots import Slot
from campaigns.kinematics.axes import Axis

ALARM = 0.01
"""Prior probability that anything changed during a campaign."""
FEWEST_SHOTS = 3
"""Least number of shots in a span: fewer are single wrong shots."""
INTERVAL_ENDS = 60
"""Shots at which a span of the frame may begin or end, spread over the campaign."""
MOST_EFFECTS = 12
"""Effects after which no more are looked for: by then nothing can be said of the robot."""
INDISTINCT = 4.0
"""Difference of log evidence within which parts explain a change as well as the best one."""
NEGLIGIBLE = 20.0
"""Difference of log evidence from which a part adds nothing to the spread over parts."""
MOVED_SHOTS = 3
"""Shots by which a change of the same part is the same change."""
USUAL_CHANGES = (1.0, 5.0, 25.0, 125.0)
"""Sizes of effects in usual sizes, alike likely: a belt that jumps a tooth is 5° off."""
LEFT_OUT = 3
"""Shots left out from which proposals with all shots are made: so many may be one change."""
STAND_HELD = 1e-4
"""Size of the stand's motion at which it has no influence."""
Kind = Literal["wrong shot", "change", "no assembly"]
Tell = Callable[[str], None]
"""What receives words on the progress."""


@dataclass(frozen=True, slots=True)
class Event:
    """Event: what happened to which shots, all parts that it may be of, and its size."""

    kind: Kind
    first: int
    """First shot concerned: its row in the fit, in a result its number."""
    last: int
    """Last shot concerned: row or number, as above."""
    parts: tuple[str, ...] = ()
    """Parts that explain a change nearly as well, the likeliest first."""
    size: float = 0.0
    """mm, or rad of an encoder; of a change the component that is largest in its 1 σ."""
    std: float = 0.0
    """1 σ of the size."""
    is_lasting: bool = False
    """Whether the robot or the stand of today has the change."""

    @property
    def leaves_out(self) -> bool:
        """Whether the shots concerned are left out."""
        return self.kind != "change"

    def of_shots(self, numbers: Sequence[int]) -> "Event":
        """Return the event with the numbers (N,) of the shots instead of their rows."""
        return replace(self, first=numbers[self.first], last=numbers[self.last])


def explain(
    model: ErrorModel,
    observations: Observations,
    prior: Prior | None = None,
    tell: Tell = lambda _: None,
) -> Fit:
    """Fit, and add the effects that the evidence asks for; `tell` receives what is being done."""
    tell("fitting all sources of error")
    fit = fit_model(model, observations, prior)
    # A layer would take up a change, and costs many unknowns: layers come once nothing else is
    # left, and what else there is may show only beside them.
    for _ in LAYERS:
        fit = _with_effects(fit, _hypotheses, tell)
        tell("looking for errors by place and by angle")
        layered = _grown(fit, _layered, most=1)
        if layered is fit:
            return fit
        fit = _pruned(layered, tell)
    return _with_effects(fit, _hypotheses, tell)


def add_steps(fit: Fit, tell: Tell = lambda _: None) -> Fit:
    """Add the changes of parts that the evidence asks for; other effects stay as they are."""
    return _with_effects(fit, _changed, tell)


# Parts that explain a change nearly as well give other robots of today. Each counts by its
# evidence; the best stays the estimate, and σ carries how far the others are from it.
def spread_over_parts(fit: Fit) -> Array:
    """Return the covariance (P, P) of today's unknowns by which part it is that changed."""
    size = len(fit.model.names)
    today, best = fit.model.of_today @ fit.at.x, log_evidence(fit)
    covariance, total = np.zeros((size, size)), 1.0
    for step in steps_of(fit):
        for part in step.parts[1:]:
            other = candidate_parts(fit.model).get(part)
            if other is None:
                continue
            changed = replace(
                other, since=step.since, until=step.until, parts=step.parts, log_odds=step.log_odds
            )
            effects = tuple(changed if effect is step else effect for effect in fit.model.effects)
            if (trial := _fit_with(fit, effects, best - NEGLIGIBLE)) is None:
                continue
            weight = float(np.exp(min(trial[1] - best, 0.0)))
            away = trial[0].model.of_today @ trial[0].at.x - today
            covariance, total = covariance + weight * np.outer(away, away), total + weight
    return np.asarray(covariance / total)


def add_changes_since_prior(fit: Fit) -> Fit:
    """Add the parts that changed between a former result, the fit's prior, and all of its shots."""
    return _with_effects(fit, _changed_since_prior)


def with_steps_of(whole: Fit, fit: Fit) -> Fit:
    """Return a fit of some of the shots with the changes that all shots show."""
    steps = steps_of(whole)
    if {step.name for step in steps} == {step.name for step in steps_of(fit)}:
        return fit
    others = tuple(effect for effect in fit.model.effects if not isinstance(effect, Step))
    return refit(fit, fit.model.with_effects((*others, *steps)))


Hypotheses = Callable[[Fit], Iterable[tuple[Effect, ...]]]
"""Proposals of sets of effects, from a fit."""


def _with_effects(fit: Fit, hypotheses: Hypotheses, tell: Tell = lambda _: None) -> Fit:
    """Add effects as long as the evidence rises, and take out those that add nothing."""
    return _pruned(_grown(fit, hypotheses, tell), tell)


def _grown(
    fit: Fit, hypotheses: Hypotheses, tell: Tell = lambda _: None, *, most: int = MOST_EFFECTS
) -> Fit:
    """Add at most so many effects as long as the evidence rises."""
    evidence, count = log_evidence(fit), len(fit.model.effects)
    surroundings = sum(isinstance(effect, Slot) for effect in fit.model.effects)
    while len(fit.model.effects) < min(MOST_EFFECTS + surroundings, count + most):
        tell(f"looking for changes and periods: step {len(fit.model.effects) - count + 1}")
        best = _best_of(fit, hypotheses(fit), evidence)
        if best is None or best[1] <= evidence:
            break
        fit, evidence = best
    return fit


def _best_of(
    fit: Fit, hypotheses: Iterable[tuple[Effect, ...]], evidence: float
) -> tuple[Fit, float] | None:
    """Return the fit with the largest evidence, and that; None if none has as much as before."""
    best = None
    for effects in hypotheses:
        trial = _fit_with(fit, effects, evidence)
        if trial is not None and trial[1] >= evidence:
            best, evidence = trial, trial[1]
    return best


def _pruned(fit: Fit, tell: Tell = lambda _: None) -> Fit:
    """Take out effects, one by one, without which the evidence does not fall."""
    evidence = log_evidence(fit)
    for _ in fit.model.effects:
        tell("testing whether the shots need all that was found")
        simpler = _without_superfluous(fit, evidence)
        if simpler is None:
            break
        fit, evidence = simpler
    return fit


def _fit_with(
    fit: Fit, effects: tuple[Effect, ...], least: float = -np.inf
) -> tuple[Fit, float] | None:
    """Return the fit with these effects and its evidence; None if it is no number, or below."""
    # Shots of a change that is new were wrong without it: they begin with their whole weight, or
    # the change would have no shots to be estimated from.
    present = {effect.name for effect in fit.model.effects}
    weights = [rows.good for rows in fit.rows]
    moments = [fit.observations.moment, *(block.moment for block in fit.observations.blocks)]
    for effect in effects:
        if isinstance(effect, Step) and effect.name not in present:
            for place, (rows, moment) in enumerate(zip(fit.rows, moments, strict=True)):
                covered = effect.covers(moment) & rows.usable
                weights[place] = np.where(covered, 1.0, weights[place])
    start, model = fit.with_weights(weights), fit.model.with_effects(effects)
    result = refit(start, model, least_evidence=least)
    for _ in range(2):  # the rate of a ripple enters by a column: linearise it again
        if falls_short(result, least):
            return None
        tuned = _retuned(result)
        if tuned is result:
            break
        result = settle(tuned, tuned.model)
    evidence = log_evidence(result)
    return (result, evidence) if np.isfinite(evidence) else None


def _retuned(fit: Fit) -> Fit:
    """Return the fit with its effects linearised at their unknowns; itself if all are linear."""
    x, sizes, effects = fit.at.x.copy(), dict(fit.sizes), []
    for effect, where in zip(fit.model.effects, fit.model.effect_places, strict=True):
        tuned, x[where] = effect.retuned(x[where])
        effects.append(tuned)
        for (before, _), (now, _) in zip(effect.sizes_of, tuned.sizes_of, strict=True):
            if before != now:
                sizes[now] = sizes.pop(before)
    if all(new is old for new, old in zip(effects, fit.model.effects, strict=True)):
        return fit
    model = fit.model.with_effects(tuple(effects))
    return replace(fit, model=model, at=replace(fit.at, x=x), sizes=sizes)


def _without_superfluous(fit: Fit, evidence: float) -> tuple[Fit, float] | None:
    """Return the fit without the effect that later ones made superfluous; None if all count."""
    simpler = (
        tuple(effect for effect in fit.model.effects if effect is not spare)
        for spare in fit.model.effects
        if not isinstance(spare, (Walk, StandSince, Layer, RateError, Slot))
    )
    return _best_of(fit, simpler, evidence)


def steps_of(fit: Fit) -> tuple[Step, ...]:
    """Return the changes among a fit's effects."""
    return tuple(effect for effect in fit.model.effects if isinstance(effect, Step))


def _hypotheses(fit: Fit) -> Iterator[tuple[Effect, ...]]:
    """Yield the sets of effects that are worth a fit."""
    yield from _changed(fit)
    for effect in (*likely_ripples(fit), *_likely_lag(fit)):
        yield (*fit.model.effects, effect)


def _layered(fit: Fit) -> Iterator[tuple[Effect, ...]]:
    """Yield the effects with one layer more."""
    for layer in likely_layers(fit):
        yield (*fit.model.effects, layer)


def _changed(fit: Fit) -> Iterator[tuple[Effect, ...]]:
    """Yield the effects with one change more, or with one moved to nearby shots."""
    effects = fit.model.effects
    proposed: dict[tuple[str, float, float], Step] = {}
    for variant in _variants(fit):
        step = _likeliest_step(variant)
        if step is not None:
            proposed.setdefault((step.part, step.since, step.until), step)
    present = {(step.part, step.since, step.until) for step in steps_of(fit)}
    for step in steps_of(fit):
        for moved in _widened(fit, step):
            yield tuple(moved if effect is step else effect for effect in effects)
    for key, step in proposed.items():
        if key in present:
            continue
        others = tuple(effect for effect in effects if not _is_same_change(effect, step))
        yield (*others, step)
        if len(others) < len(effects):
            yield (*effects, step)


def _widened(fit: Fit, step: Step) -> Iterator[Step]:
    """Yield a change with the shots left out just before it or behind it as its own."""
    moments = fit.observations.moment
    rows, wrong = np.flatnonzero(step.covers(moments)), fit.usable & ~fit.kept
    if not len(rows):
        return
    first, last = int(rows[0]), int(rows[-1])
    while first > FEWEST_SHOTS and wrong[first - 1]:
        first -= 1
    while last + 1 < len(wrong) and wrong[last + 1]:
        last += 1
    if first < rows[0]:
        yield replace(step, since=float(moments[first]))
    if last > rows[-1]:
        yield replace(step, until=float(moments[last]) + 0.5)


def _changed_since_prior(fit: Fit) -> Iterator[tuple[Effect, ...]]:
    """Yield the effects with one more part that changed before the first shot."""
    parts, present = candidate_parts(fit.model), {step.part for step in steps_of(fit)}
    proposed: dict[str, Step] = {}
    for variant in _variants(fit):
        evidence = log_factors_since_prior(variant)
        values = np.array(list(evidence.values()))
        if np.logaddexp.reduce(values) > np.log(len(values) / ALARM):
            likely = likely_parts(evidence)
            odds = float(np.log(ALARM / len(values)))
            proposed.setdefault(likely[0], replace(parts[likely[0]], parts=likely, log_odds=odds))
    for part, step in proposed.items():
        if part not in present:
            yield (*fit.model.effects, step)


def log_factors_since_prior(fit: Fit) -> dict[str, float]:
    """Return the log Bayes factor of a change of each part that all shots show.

    For shots fitted with a former result as prior. The frame of a new stand is flat and shows no
    change.
    """
    whole = np.array([[0, len(fit.moments)]])
    parts = [part for part in candidate_parts(fit.model) if part != FRAME]
    candidates = scan(fit, dict.fromkeys(parts, whole))
    return {part: float(of_part.log_factors[0]) for part, of_part in candidates.items()}


# A change z of one unknown with information I raises log B by ½ z² I less ½ log(1 + I): it is found
# once the mean over M parts exceeds 1 / α.
def visible_changes(fit: Fit) -> dict[tuple[str, bool], float]:
    """Return the smallest change of each kind of part that all shots would show, rad or mm.

    That is of any arm, and in any direction of a mount; by the part's word and whether it is an
    angle.
    """
    parts = {part: step for part, step in candidate_parts(fit.model).items() if part != FRAME}
    visible: dict[tuple[str, bool], float] = {}
    for part, step in parts.items():
        columns = fit.whitened.columns(fit.at.columns_of(step, fit.observations))
        information = fit.whitened.information(columns)
        least = max(float(np.linalg.eigvalsh(information)[0]), 1e-12)
        needed = np.log(len(parts) * len(USUAL_CHANGES) / ALARM) + 0.5 * np.log1p(least)
        word = part.split()[0]
        is_angle = changes_by_angle(part, fit.model.nominal.mechanism.joints)
        usual = ENCODER_RAD if is_angle else STEP_MM
        size = usual * float(np.sqrt(2.0 * needed / least))
        visible[word, is_angle] = max(visible.get((word, is_angle), 0.0), size)
    return visible


def _is_same_change(effect: Effect, step: Step) -> bool:
    """Return whether an effect is a change of the same part at nearly the same shot."""
    if not isinstance(effect, Step) or effect.part != step.part:
        return False
    return abs(effect.since - step.since) <= MOVED_SHOTS


def _variants(fit: Fit) -> Iterator[Fit]:
    """Yield the fits on the same linear model by which changes are proposed."""
    yield from _with_stand_held(fit)
    if sum(int((rows.usable & (rows.good < 0.5)).sum()) for rows in fit.rows) >= LEFT_OUT:
        # a change may be what looks like wrong shots: with all of them, by the noise of the good
        # ones and by that which all show together
        whole = fit.with_weights([rows.usable.astype(np.float64) for rows in fit.rows])
        for variant in (whole, estimate_sizes_and_noise(whole, 12)):
            yield from _with_stand_held(variant)


def _with_stand_held(fit: Fit) -> Iterator[Fit]:
    """Yield the fit, and without slow motion of the stand, which takes up steps of the frame."""
    yield fit
    if "stand" in fit.sizes:
        yield replace(fit, sizes={**fit.sizes, "stand": STAND_HELD})


def changes_by_angle(part: str, joints: Sequence[Axis]) -> bool:
    """Return whether a part, as `encoder 2`, changes by an angle: that of a joint that turns."""
    word, _, arm = part.partition(" ")
    return word == "encoder" and joints[int(arm)].is_revolute


# A part's usual change in tolerances of the unknowns that describe it.
def candidate_parts(model: ErrorModel) -> dict[str, Step]:
    """Return a change of each part that may change, over all shots, by the part's name."""
    usual = (TURN_MRAD,) * 3 + (STEP_MM,) * 3
    parts = {FRAME: Step(FRAME, -np.inf, np.inf, usual, tuple(range(6)), 6)}
    table, size = model.nominal.mechanism.parameters, len(model.names)
    by_field: dict[tuple[int | None, str], int] = {}
    for place, name in enumerate(model.parameters):
        by_field[table[name].arm, table[name].field.stem] = place
    for arm in range(table.arms):
        for word, stems in PARTS.items():
            of_part = ((arm, stem) for stem in stems)
            places = tuple(sorted(by_field[key] for key in of_part if key in by_field))
            name = f"{word} {arm}"
            is_angle = changes_by_angle(name, model.nominal.mechanism.joints)
            step = ENCODER_RAD if is_angle else STEP_MM
            changes = tuple((step / model.tolerance[list(places)]).tolist())
            if places:
                parts[name] = Step(name, -np.inf, np.inf, changes, places, size)
    return parts


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Changes of one part: its column over the spans, and their log Bayes factors."""

    spans: Index
    """Rows, first and behind the last, (M, 2)."""
    log_factors: Array
    """(M,)"""


# Linear Gaussian model: with the columns c and their unknowns z ~ N(0, s²) the residual has the
# covariance M + s² c c' instead of M, where M⁻¹ = W - W A C A' W has all other unknowns integrated
# out. With the residuals r at the minimum the logarithm of the ratio of both densities is
#
#     log B = ½ s² u'(s² I + 1)⁻¹ u - ½ log |s² I + 1|,   u = Σ c'W r,
#     I = Σ c'W c - (Σ c'W A) C (Σ A'W c)
#
# and the mean of B over the sizes s counts. Sums over spans come from running sums, so that many
# spans cost little more than one. Rows are those of all kinds, in the order of time.
def scan(fit: Fit, spans_of: Mapping[str, Index]) -> dict[str, Candidates]:
    """Return the candidates of each part that has spans (M, 2)."""
    order, candidates = np.argsort(fit.moments, kind="stable"), {}
    for part, step in candidate_parts(fit.model).items():
        if part not in spans_of:
            continue
        spans, products = spans_of[part], _products(fit, step)
        score, shared, alone = (
            _sum_over_spans(np.concatenate(of_kinds)[order], spans) for of_kinds in products
        )
        information = alone - shared @ shared.swapaxes(1, 2)
        candidates[part] = Candidates(spans, log_bayes_factors(score, information))
    return candidates


# M⁻¹ in units of the noise: Σ c'W A C A'W c is the square of the columns that K explains
def _products(fit: Fit, step: Step) -> Iterable[tuple[Array, ...]]:
    """Return c'W r, c'W A and c'W c of each observation, (N, k, …), of the rows of each kind."""
    products = []
    for white, by in zip(fit.whitened_rows, fit.columns_of(step), strict=True):
        (count, width, _), columns = white.root.shape, white.root @ by
        transposed = columns.swapaxes(1, 2)
        explained = white.explained.T.reshape(count, width, len(white.explained))
        residual = white.residual.reshape(count, width, 1)
        products.append((transposed @ residual, transposed @ explained, transposed @ columns))
    return zip(*products, strict=True)


def log_bayes_factors(score: Array, information: Array) -> Array:
    """Return log B (M,) of scores u (M, k, 1) and information I (M, k, k), the mean over sizes."""
    log_factors = [
        log_factors_at_usual_size(size * score, size**2 * information) for size in USUAL_CHANGES
    ]
    return np.asarray(np.logaddexp.reduce(log_factors, axis=0) - np.log(len(USUAL_CHANGES)))


def _sum_over_spans(rows: Array, spans: Index) -> Array:
    """Return the sums of rows (N, …) over spans (M, 2), as differences of running sums."""
    sums = np.concatenate([np.zeros((1, *rows.shape[1:])), np.cumsum(rows, axis=0)])
    return np.asarray(sums[spans[:, 1]] - sums[spans[:, 0]])


def _likeliest_step(fit: Fit) -> Step | None:
    """Return the likeliest change, if the mean Bayes factor of all makes any change likely."""
    moments, parts = np.sort(fit.moments), candidate_parts(fit.model)
    steps = _steps(moments)
    spans_of = dict.fromkeys(parts, steps)
    spans_of[FRAME] = np.concatenate([steps, _intervals(moments)])
    candidates = scan(fit, spans_of)
    values = np.concatenate([of_part.log_factors for of_part in candidates.values()])
    if not len(values) or np.logaddexp.reduce(values) <= np.log(len(values) / ALARM):
        return None
    best = max(candidates, key=lambda part: float(candidates[part].log_factors.max()))
    row = int(candidates[best].log_factors.argmax())
    since, until = candidates[best].spans[row].tolist()
    # where the shot of the change is uncertain, the neighbouring spans count too
    evidence = {
        part: float(np.logaddexp.reduce(of_part.log_factors))
        for part, of_part in candidates.items()
    }
    return replace(
        parts[best],
        since=float(moments[since]),
        until=float(moments[until]) if until < len(moments) else np.inf,
        parts=likely_parts(evidence),
        log_odds=float(np.log(ALARM / len(values))),
    )


def _steps(moments: Array) -> Index:
    """Return the spans (M, 2) of changes that last from some moment, of all (N,), to the last."""
    count = len(moments)
    starts = _begins(moments, np.arange(FEWEST_SHOTS, count - FEWEST_SHOTS + 1))
    return np.stack([starts, np.full(len(starts), count)], axis=1)


def _intervals(moments: Array) -> Index:
    """Return the spans (M, 2) of changes of the frame that were taken back: a stand put right."""
    last = len(moments) - FEWEST_SHOTS
    ends = np.unique(np.linspace(FEWEST_SHOTS, last, INTERVAL_ENDS).astype(int))
    ends = _begins(moments, ends[(ends > 0) & (ends < len(moments))])
    pairs = [(first, last) for first in ends for last in ends if last > first + FEWEST_SHOTS]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def _begins(moments: Array, rows: Index) -> Index:
    """Return those of these rows at which a change may begin: not of today, nor between equals."""
    return rows[np.isfinite(moments[rows]) & (moments[rows] > moments[rows - 1])]


def likely_parts(evidence: Mapping[str, float]) -> tuple[str, ...]:
    """Return the parts whose log evidence is close to the best part's, the best part first."""
    order = sorted(evidence, key=evidence.__getitem__, reverse=True)
    return tuple(part for part in order if evidence[part] > evidence[order[0]] - INDISTINCT)


def _likely_lag(fit: Fit) -> Iterator[Lag]:
    """Yield a lag of the joints, if its Bayes factor is above 1."""
    lag = Lag(fit.observations.joints.shape[1])
    if any(isinstance(effect, Lag) for effect in fit.model.effects):
        return
    columns = fit.at.columns_of(lag, fit.observations)
    if columns.any() and whole_log_factor(fit, columns) > 0.0:
        yield lag


def whole_log_factor(fit: Fit, columns: Array) -> float:
    """Return the log Bayes factor of columns (N, 3, k) over all shots."""
    whitened = fit.whitened.columns(columns)
    score = (whitened.T @ fit.whitened.residual)[None, :, None]
    return float(log_bayes_factors(score, fit.whitened.information(whitened)[None])[0])


def events_of(fit: Fit) -> tuple[Event, ...]:
    """Return everything that happened, in the order of time."""
    events = [*_changes(fit), *_wrong_shots(fit)]
    return tuple(sorted(events, key=lambda event: event.first))


def _wrong_shots(fit: Fit) -> Iterator[Event]:
    """Yield the shots without an assembly, and those that contradict all others."""
    residual, covariance = fit.cavity
    for row in np.flatnonzero(~fit.kept).tolist():
        if not fit.usable[row]:
            yield Event("no assembly", row, row)
            continue
        size = float(np.linalg.norm(residual[row]))
        along = residual[row] / max(size, 1e-12)
        std = float(np.sqrt(along @ covariance[row] @ along))
        yield Event("wrong shot", row, row, size=size, std=std)


# `moves` turn the unknowns of a change into sizes in mm or rad; of a frame these are the shifts of
# its points. The size with the largest |size| / σ is reported.
def _changes(fit: Fit) -> Iterator[Event]:
    """Yield the changes of parts with their sizes: of a frame the motion of its points."""
    moments = fit.observations.moment
    for step in steps_of(fit):
        rows = np.flatnonzero(step.covers(moments))
        if not len(rows):  # a change that only other shots show
            continue
        size, std = _size_of(fit, step, fit.at.columns_of(step, fit.observations)[rows])
        first, last = int(rows[0]), int(rows[-1])
        yield Event("change", first, last, step.parts, size, std, step.is_lasting)


def _size_of(fit: Fit, step: Step, columns: Array) -> tuple[float, float]:
    """Return the size of a change and its 1 σ; of a frame by its columns (M, r, k) of rows."""
    where = fit.model.effect_places[fit.model.effects.index(step)]
    z, covariance = fit.at.x[where], fit.covariance[where, where]
    if step.part == FRAME:  # a turn moves each point by another amount
        moves = columns.reshape(-1, len(z))
    else:
        is_angle = changes_by_angle(step.part, fit.model.nominal.mechanism.joints)
        moves = np.eye(len(z)) * (ENCODER_RAD if is_angle else STEP_MM)
    sizes, stds = moves @ z, np.sqrt(np.einsum("ij,jk,ik->i", moves, covariance, moves))
    surest = int((np.abs(sizes) / stds).argmax())
    return float(sizes[surest]), float(stds[surest])


# Rows of other kinds that stand at the change, or of the first ones behind it.
def changes_without_points(fit: Fit) -> Iterator[tuple[Event, int]]:
    """Yield changes that no point is behind, as events by the rows of the block named beside."""
    for step in steps_of(fit):
        if step.covers(fit.observations.moment).any():
            continue
        firsts = []
        for number, block in enumerate(fit.observations.blocks):
            rows = np.flatnonzero(step.covers(block.moment))
            if len(rows):
                firsts.append((float(block.moment[rows].min()), number, rows))
        if not firsts:
            continue
        _, number, rows = min(firsts, key=lambda first: first[:2])
        columns = fit.at.others[number].columns_of(step)[rows]
        size, std = _size_of(fit, step, columns)
        order = rows[np.argsort(fit.observations.blocks[number].moment[rows], kind="stable")]
        first, last = int(order[0]), int(order[-1])
        yield Event("change", first, last, step.parts, size, std, step.is_lasting), number
