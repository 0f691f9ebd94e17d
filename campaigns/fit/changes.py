"""Changes in time: a part that moved, a stand that was bumped, a shot that went wrong.

Theory of operation. A fit goes in; a fit with the changes that its shots show comes out. A
candidate is a part and a span of shots: the part's column over that span, with a normal prior of
the size that such a change usually has.

1. Scan: the Bayes factor of every candidate against "nothing changed".
2. Alarm: by Markov's inequality the mean of these factors exceeds 1 / α with at most the
   probability α if nothing changed. A single wrong shot has its own alarm, the largest misfit of N.
3. Add the likeliest candidate to the model, fit again, and scan again, until nothing alarms.
4. Take out a change that later ones made less likely than no change.

Several parts often explain one change nearly as well: all of them are reported, not the best alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from campaigns.arrays import Array, Index, Mask
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.error_sources import DEG
from campaigns.fit.posterior import Posterior, Prior, fit

ALARM = 0.01
"""Probability α of a false alarm of a campaign in which nothing changed."""
FEWEST_SHOTS = 3
"""Least number of shots in a span: fewer are single wrong shots."""
INTERVAL_ENDS = 60
"""Shots at which an interval of the frame may begin or end, spread over the campaign."""
MOST_CHANGES = 12
INDISTINCT = 4.0
"""Difference of log Bayes factors within which parts explain a change as well as the best one."""
SHOT, FRAME = "shot", "frame"
STEP_MM = 0.2
"""Usual change of a place, a length or the frame, 1 σ."""
TURN_MRAD = STEP_MM / 3.0
ENCODER_RAD = 0.1 * DEG
WRONG_SHOT_MM = 0.3
PARTS: Mapping[str, tuple[str, ...]] = {
    "encoder": ("joint_offset",),
    "arm": ("arm",),
    "forearm": ("forearm",),
    "mount": ("x", "y", "z"),
}
"""Parts of an arm that may change, with the stems of the parameters that describe each."""


@dataclass(frozen=True, slots=True)
class Change:
    """Change: its likeliest part, its shots, and all parts that explain it nearly as well."""

    part: str
    since: int
    """Row of the first changed shot."""
    until: int
    """Row behind the last changed shot."""
    parts: tuple[str, ...]
    size: float
    """Component of the change that is largest in its 1 σ: mm, of a frame at one of the points, or
    rad of an encoder."""
    std: float
    """1 σ of the size, in its unit."""


Candidates = Mapping[str, tuple[Index, Array]]
"""Candidates by part: spans of rows (M, 2), first and behind the last, and log Bayes factors
(M,)."""


def fit_with_changes(
    model: ErrorModel,
    observations: Observations,
    prior: Prior | None = None,
    kept: Mask | None = None,
) -> tuple[Posterior, tuple[Change, ...]]:
    """Fit, and add the likeliest change as long as one alarms; return the posterior and changes.

    Wrong shots lose their weight, all other changes become columns of the model.
    """
    result = fit(model, observations, prior, kept)
    changes: list[Change] = []
    while len(changes) < MOST_CHANGES and (change := _likeliest_change(result)) is not None:
        changes.append(change)
        result = _fit_again(result, observations, prior, changes)
    while (number := _superfluous_change(result, changes)) is not None:
        del changes[number]
        result = _fit_again(result, observations, prior, changes)
    return result, tuple(_with_sizes(result, changes))


def _fit_again(
    before: Posterior, observations: Observations, prior: Prior | None, changes: Sequence[Change]
) -> Posterior:
    """Fit with a column for each change over its shots, and without the wrong shots."""
    kept = before.kept.copy()
    columns, steps = part_columns(before), []
    for change in changes:
        if change.part == SHOT:
            kept[change.since] = False
        else:
            inside = np.zeros((len(observations), 1, 1))
            inside[change.since : change.until] = 1.0
            steps.append(columns[change.part] * inside)
    stacked = np.concatenate(steps, axis=2) if steps else None
    return fit(before.model, observations, prior, kept, start=before, changes=stacked)


def _places_of_changes(
    posterior: Posterior, changes: Sequence[Change]
) -> Iterator[tuple[int, slice]]:
    """Yield the number of each change that has columns, and the places of its unknowns."""
    columns, place = part_columns(posterior), len(posterior.model.names)
    for number, change in enumerate(changes):
        if change.part != SHOT:
            count = columns[change.part].shape[2]
            yield number, slice(place, place + count)
            place += count


# Savage-Dickey ratio: the Bayes factor of a change is the prior's density at "no change" over the
# posterior's. With prior N(0, 1) and posterior N(x, C) that is log B = ½ x'C⁻¹x + ½ log |C|.
def _superfluous_change(posterior: Posterior, changes: Sequence[Change]) -> int | None:
    """Return the number of the change that the others make least likely, None if all are likely."""
    log_factors = {}
    for number, places in _places_of_changes(posterior, changes):
        x, covariance = posterior.at.x[places], posterior.covariance[places, places]
        misfit = x @ np.linalg.solve(covariance, x)
        log_factors[number] = 0.5 * misfit + 0.5 * np.linalg.slogdet(covariance)[1]
    unlikely = [number for number, value in log_factors.items() if value < 0.0]
    return min(unlikely, key=log_factors.__getitem__, default=None)


# Columns are per usual change, so that the prior of every candidate is N(0, 1).
def part_columns(posterior: Posterior) -> dict[str, Array]:
    """Return how the points move by a usual change of each part, (N, 3, k) mm by its name."""
    model, jacobian = posterior.model, posterior.at.jacobian
    mechanism = model.nominal.mechanism
    table = mechanism.parameters
    count = len(jacobian)
    columns = {SHOT: np.broadcast_to(WRONG_SHOT_MM * np.eye(3), (count, 3, 3))}
    # a shot has columns of its own session's frame alone: their sum is a bump of any session
    frames = range(len(posterior.at.x), jacobian.shape[2], 6)
    frame = sum(jacobian[..., first : first + 6] for first in frames)
    scale = np.array([TURN_MRAD] * 3 + [STEP_MM] * 3)
    columns[FRAME] = np.asarray(frame) * scale
    revolute = mechanism.joints[0].is_revolute
    for arm in range(table.arms):
        encoder = ENCODER_RAD if revolute else STEP_MM
        columns[f"encoder {arm}"] = posterior.at.by_joint[..., [arm]] * encoder
        for part in ("arm", "forearm", "mount"):
            places = [
                place
                for place, name in enumerate(model.parameters)
                if table[name].arm == arm and table[name].field.stem in PARTS[part]
            ]
            if places:
                columns[f"{part} {arm}"] = jacobian[..., places] * (
                    STEP_MM / model.tolerance[places]
                )
    return columns


# Covariance of a residual: V - A C A' of a shot that was fitted, for the fit has followed it, and
# V + A C A' of one that was not (data snooping, Baarda 1968).
def misfits(posterior: Posterior) -> Array:
    """Return χ²(3) of every shot by the covariance of its residual, (N,), kept or not."""
    jacobian = posterior.at.jacobian
    by_unknowns = jacobian @ posterior.covariance @ jacobian.swapaxes(1, 2)
    sign = np.where(posterior.kept, -1.0, 1.0)[:, None, None]
    total = posterior.total_noise + sign * by_unknowns
    residual = posterior.at.residual
    scaled = np.linalg.solve(total, residual[..., None])[..., 0]
    return np.asarray((residual * scaled).sum(axis=1))


def log_factors_since_prior(posterior: Posterior) -> dict[str, float]:
    """Return the log Bayes factor of a change of each part that all shots show.

    For shots fitted with a former result as prior: parts that changed since. The frame of a new
    stand is flat and shows no change.
    """
    whole = np.array([[0, len(posterior.kept)]])
    candidates = _scan(posterior, {}, whole).items()
    return {
        part: float(log_factors[0])
        for part, (_, log_factors) in candidates
        if part not in (SHOT, FRAME)
    }


# Linear Gaussian model: with the column c and its unknown z ~ N(0, 1) the residual has the
# covariance M + c c' instead of M, where M⁻¹ = W - W A C A' W has all other unknowns integrated
# out. With the fitted residuals r the logarithm of the ratio of both densities is
#
#     log B = ½ s'(I + 1)⁻¹ s - ½ log |I + 1|,   s = Σ c'W r,   I = Σ c'W c - (Σ c'W A) C (Σ A'W c)
#
# Sums over spans come from running sums, so that many spans cost little more than one.
def _scan(posterior: Posterior, spans_of: Mapping[str, Index], otherwise: Index) -> Candidates:
    """Return the candidates of each part over its spans, `otherwise` for parts without spans."""
    weighted_jacobian = posterior.weights @ posterior.at.jacobian
    weighted_residual = posterior.weights @ posterior.at.residual[..., None]
    candidates = {}
    for part, columns in part_columns(posterior).items():
        spans, transposed = spans_of.get(part, otherwise), columns.swapaxes(1, 2)
        score = _sum_over_spans(transposed @ weighted_residual, spans)  # s, (M, k, 1)
        shared = _sum_over_spans(transposed @ weighted_jacobian, spans)  # c'W A, (M, k, Q)
        alone = _sum_over_spans(transposed @ (posterior.weights @ columns), spans)  # c'W c
        information = alone - shared @ posterior.covariance @ shared.swapaxes(1, 2)  # I
        matrix = information + np.eye(columns.shape[2])
        gain = (score * np.linalg.solve(matrix, score))[..., 0].sum(axis=1)
        log_factors = 0.5 * gain - 0.5 * np.linalg.slogdet(matrix)[1]
        candidates[part] = spans, log_factors
    return candidates


def _sum_over_spans(rows: Array, spans: Index) -> Array:
    """Return the sums of rows (N, …) over spans (M, 2), as differences of running sums."""
    sums = np.concatenate([np.zeros((1, *rows.shape[1:])), np.cumsum(rows, axis=0)])
    return np.asarray(sums[spans[:, 1]] - sums[spans[:, 0]])


def _likeliest_change(posterior: Posterior) -> Change | None:
    """Return the likeliest change that alarms, without its size, or None."""
    count = len(posterior.kept)
    steps = _steps(count)
    shots = np.stack([np.arange(count), np.arange(count) + 1], axis=1)
    spans_of = {SHOT: shots, FRAME: np.concatenate([steps, _intervals(count)])}
    candidates = _scan(posterior, spans_of, steps)
    lasting = {part: factors for part, (_, factors) in candidates.items() if part != SHOT}
    misfit = np.where(posterior.kept, misfits(posterior), 0.0)

    alarming = list(lasting) if _is_alarm(np.concatenate([*lasting.values()])) else []
    if misfit.max() > scipy.special.chdtri(3, ALARM / count):  # Bonferroni
        alarming.insert(0, SHOT)
    if not alarming:
        return None

    best = max(alarming, key=lambda part: candidates[part][1].max())
    if best == SHOT:
        worst = int(misfit.argmax())
        return Change(SHOT, worst, worst + 1, (SHOT,), 0.0, 0.0)
    spans, log_factors = candidates[best]
    since, until = spans[log_factors.argmax()].tolist()
    # where the shot of the change is uncertain, the neighbouring spans count too
    evidence = {part: float(scipy.special.logsumexp(values)) for part, values in lasting.items()}
    return Change(best, since, until, likely_parts(evidence), 0.0, 0.0)


def _steps(count: int) -> Index:
    """Return the spans (M, 2) of changes that last from some shot to the last of `count`."""
    starts = np.arange(FEWEST_SHOTS, count - FEWEST_SHOTS + 1)
    return np.stack([starts, np.full(len(starts), count)], axis=1)


def _intervals(count: int) -> Index:
    """Return the spans (M, 2) of changes of the frame that were taken back: a stand put right."""
    ends = np.unique(np.linspace(FEWEST_SHOTS, count - FEWEST_SHOTS, INTERVAL_ENDS).astype(int))
    pairs = [(first, last) for first in ends for last in ends if last > first + FEWEST_SHOTS]
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)


def _is_alarm(log_factors: Array) -> bool:
    """Return whether the mean of Bayes factors (M,) is above 1 / α."""
    count = len(log_factors)
    return count > 0 and bool(scipy.special.logsumexp(log_factors) > np.log(count / ALARM))


def likely_parts(evidence: Mapping[str, float]) -> tuple[str, ...]:
    """Return the parts whose log evidence is close to the best part's, the best part first."""
    order = sorted(evidence, key=evidence.__getitem__, reverse=True)
    return tuple(part for part in order if evidence[part] > evidence[order[0]] - INDISTINCT)


# `moves` (m, k) turns the unknowns of a change, in usual changes, into sizes in mm or rad; of a
# frame these are the shifts of its points. The size with the largest |size| / σ is reported.
def _with_sizes(posterior: Posterior, changes: Sequence[Change]) -> Iterator[Change]:
    """Yield the changes with their sizes: of a frame at its points, of shots as residuals."""
    columns, places_of = part_columns(posterior), dict(_places_of_changes(posterior, changes))
    revolute = posterior.model.nominal.mechanism.joints[0].is_revolute
    for number, change in enumerate(changes):
        if change.part == SHOT:
            size = float(np.linalg.norm(posterior.at.residual[change.since]))
            std = float(np.sqrt(np.trace(posterior.total_noise[change.since])))
            yield replace(change, size=size, std=std)
            continue
        places = places_of[number]
        x, covariance = posterior.at.x[places], posterior.covariance[places, places]
        if change.part == FRAME:  # a turn moves each point by another amount
            moves = columns[FRAME][change.since : change.until].reshape(-1, len(x))
        else:
            is_angle = change.part.startswith("encoder") and revolute
            moves = np.eye(len(x)) * (ENCODER_RAD if is_angle else STEP_MM)
        sizes, stds = moves @ x, np.sqrt(np.einsum("ij,jk,ik->i", moves, covariance, moves))
        surest = int((np.abs(sizes) / stds).argmax())
        yield replace(change, size=float(sizes[surest]), std=float(stds[surest]))
