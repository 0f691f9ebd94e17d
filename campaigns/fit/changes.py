"""Changes in time: a part that moved, a stand that was bumped, a shot that went wrong.

A candidate is a part and a span of shots: its column over that span, with a normal prior of the
size that such a change usually has. All other unknowns are integrated out, so its Bayes factor
against "nothing changed" is

    log B = ½ s'(I + 1)⁻¹ s - ½ log |I + 1|,   s = Σ c'W r,   I = Σ c'W c - (Σ c'W A) C (Σ A'W c)

A step stays to the end; the frame may also be taken back (a stand that is bumped and put right).
By Markov's inequality the mean Bayes factor over all candidates exceeds 1 / α with at most the
probability α if nothing changed. A single wrong shot has its own alarm, the largest misfit of N;
where both alarm, the larger Bayes factor decides. What wins is added to the model, and the fit is
repeated, until nothing alarms. Later changes may explain what an earlier one was added for (an
interval before both of its steps were found): a change that the others make less likely than no
change is taken out, by its Bayes factor from prior and posterior at zero (Savage and Dickey).

Several parts often explain the same change nearly as well: the set of them is reported, not one.
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
"""Probability of a false alarm of a campaign in which nothing changed."""
FEWEST_SHOTS = 3
"""Shots of a span: fewer are single wrong shots."""
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
    """Change that was found: its likeliest part, its shots, and parts that explain it as well."""

    part: str
    since: int
    """Row of the first changed shot."""
    until: int
    """Row behind the last changed shot."""
    parts: tuple[str, ...]
    size: float
    """Its surest component: mm, of a frame at one of the points, or rad of an encoder."""
    std: float


Candidates = Mapping[str, tuple[Index, Array]]
"""Candidates by part: spans of rows (M, 2) and log Bayes factors (M,)."""


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
    while len(changes) < MOST_CHANGES and (change := _likeliest(result)) is not None:
        changes.append(change)
        result = _refitted(result, observations, prior, changes)
    while (place := _superfluous(result, changes)) is not None:
        del changes[place]
        result = _refitted(result, observations, prior, changes)
    return result, tuple(_sized(result, changes))


def _refitted(
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


def _places(posterior: Posterior, changes: Sequence[Change]) -> Iterator[tuple[int, slice]]:
    """Yield the number of each change that has columns, and the places of its unknowns."""
    columns, place = part_columns(posterior), len(posterior.model.names)
    for number, change in enumerate(changes):
        if change.part != SHOT:
            count = columns[change.part].shape[2]
            yield number, slice(place, place + count)
            place += count


def _superfluous(posterior: Posterior, changes: Sequence[Change]) -> int | None:
    """Return the number of the change that the others make least likely, None if all are likely."""
    log_factors = {}
    for number, places in _places(posterior, changes):
        x, covariance = posterior.at.x[places], posterior.covariance[places, places]
        misfit = x @ np.linalg.solve(covariance, x)
        log_factors[number] = 0.5 * misfit + 0.5 * np.linalg.slogdet(covariance)[1]
    unlikely = [number for number, value in log_factors.items() if value < 0.0]
    return min(unlikely, key=log_factors.__getitem__, default=None)


def part_columns(posterior: Posterior) -> dict[str, Array]:
    """Return how the points move by a usual change of each part, (N, 3, k) by its name."""
    model, jacobian = posterior.model, posterior.at.jacobian
    mechanism = model.nominal.mechanism
    table = mechanism.parameters
    count = len(jacobian)
    columns = {SHOT: np.broadcast_to(WRONG_SHOT_MM * np.eye(3), (count, 3, 3))}
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
                unit = STEP_MM / model.tolerance[places]
                columns[f"{part} {arm}"] = jacobian[..., places] * unit
    return columns


def misfits(posterior: Posterior) -> Array:
    """Return χ²(3) of every shot by its residual's own covariance, (N,), kept or not."""
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
    candidates = _scanned(posterior, {}, whole).items()
    return {
        part: float(log_factors[0])
        for part, (_, log_factors) in candidates
        if part not in (SHOT, FRAME)
    }


def _scanned(posterior: Posterior, spans_of: Mapping[str, Index], otherwise: Index) -> Candidates:
    """Return the candidates of each part over its spans, `otherwise` those of all others."""
    weighted = posterior.weights @ posterior.at.jacobian
    pulls = posterior.weights @ posterior.at.residual[..., None]
    candidates = {}
    for part, columns in part_columns(posterior).items():
        spans, transposed = spans_of.get(part, otherwise), columns.swapaxes(1, 2)
        score = _over_spans(transposed @ pulls, spans)
        shared = _over_spans(transposed @ weighted, spans)
        alone = _over_spans(transposed @ (posterior.weights @ columns), spans)
        scatter = alone - shared @ posterior.covariance @ shared.swapaxes(1, 2)
        matrix = scatter + np.eye(columns.shape[2])
        gain = (score * np.linalg.solve(matrix, score))[..., 0].sum(axis=1)
        log_factors = 0.5 * gain - 0.5 * np.linalg.slogdet(matrix)[1]
        candidates[part] = spans, log_factors
    return candidates


def _over_spans(rows: Array, spans: Index) -> Array:
    """Return the sums of rows (N, …) over spans (M, 2), as differences of running sums."""
    sums = np.concatenate([np.zeros((1, *rows.shape[1:])), np.cumsum(rows, axis=0)])
    return np.asarray(sums[spans[:, 1]] - sums[spans[:, 0]])


def _likeliest(posterior: Posterior) -> Change | None:
    """Return the likeliest change that alarms, or None."""
    count = len(posterior.kept)
    starts = np.arange(FEWEST_SHOTS, count - FEWEST_SHOTS + 1)
    steps = np.stack([starts, np.full(len(starts), count)], axis=1)
    ends = np.unique(np.linspace(FEWEST_SHOTS, count - FEWEST_SHOTS, INTERVAL_ENDS).astype(int))
    pairs = [(first, last) for first in ends for last in ends if last > first + FEWEST_SHOTS]
    intervals = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    shots = np.stack([np.arange(count), np.arange(count) + 1], axis=1)
    spans_of = {SHOT: shots, FRAME: np.concatenate([steps, intervals])}
    candidates = _scanned(posterior, spans_of, steps)
    by_part = {part: log_factors for part, (_, log_factors) in candidates.items()}
    lasting = np.concatenate([by_part[part] for part in by_part if part != SHOT])
    steps_alarm = (
        scipy.special.logsumexp(lasting) > np.log(len(lasting) / ALARM) if len(lasting) else False
    )
    misfit = np.where(posterior.kept, misfits(posterior), 0.0)
    shot_alarms = misfit.max() > scipy.special.chdtri(3, ALARM / len(misfit))
    allowed = [part for part in by_part if (shot_alarms if part == SHOT else steps_alarm)]
    if not allowed:
        return None
    best = max(allowed, key=lambda part: by_part[part].max())
    if best == SHOT:
        worst = int(misfit.argmax())
        return Change(SHOT, worst, worst + 1, (SHOT,), 0.0, 0.0)
    since, until = candidates[best][0][by_part[best].argmax()].tolist()
    evidence = {
        part: float(scipy.special.logsumexp(log_factors))
        for part, log_factors in by_part.items()
        if part != SHOT
    }
    return Change(best, since, until, likely_parts(evidence), 0.0, 0.0)


def likely_parts(evidence: Mapping[str, float]) -> tuple[str, ...]:
    """Return the parts whose log evidence comes close to the best one's, that one first."""
    order = sorted(evidence, key=evidence.__getitem__, reverse=True)
    return tuple(part for part in order if evidence[part] > evidence[order[0]] - INDISTINCT)


def _sized(posterior: Posterior, changes: Sequence[Change]) -> Iterator[Change]:
    """Yield the changes with their sizes: of a frame at its points, of shots as residuals."""
    columns, places_of = part_columns(posterior), dict(_places(posterior, changes))
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
