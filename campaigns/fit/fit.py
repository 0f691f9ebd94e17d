"""Fit of all unknowns at once: robot, tracker, effects, scatter, and which shots are wrong.

Theory of operation. Minimised is

    χ² = Σ w_i r_i' W_i r_i + (x - μ)' D (x - μ)

with residuals r = predicted - measured (mm), of points and of all other kinds of observation,
weights W_i = V_i⁻¹ of each one's noise, the probability w_i of it to be good, unknowns x in
tolerances, and the priors' mean μ and precision D. Everything else is unknown as well, and
estimated between the steps in the model as it is linearised there:

    noise      V = Σ φ_k V_k over its parts: what the tracker stated (φ = 1) or its data sheet along
               and across the beam, the scatter of the robot's point, and of its joints
    priors     a group g of unknowns has N(0, ρ_g²) in tolerances
    weights    w_i = P(good) by the fit without shot i (`wrong_shots.py`)

All φ and ρ follow from restricted maximum likelihood (REML) with a half-Cauchy prior on each size,
by the fixed point of geodesy's variance components (Helmert, Förstner): each variance is multiplied
by the squares that it explains over its redundancy, the number of unknowns or coordinates by which
the shots determine it,

    group of unknowns   squares Σ x²/ρ²               redundancy Σ (1 - C_jj/ρ²)
    part of the noise   squares φ Σ w v'W V_k W v     redundancy φ Σ tr V_k w (W - w W A C A' W)

with residuals v, derivatives A, posterior covariance C = (Σ w A'WA + D)⁻¹. As every source of error
has a prior, no parameter has to be held and no model to be chosen: what no shot determines stays at
nominal, with its tolerance as its σ.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy

from campaigns.arrays import Array, Index, Mask
from campaigns.fit import wrong_shots
from campaigns.fit.effects import Effect
from campaigns.fit.error_model import (
    BY_NAME,
    ErrorModel,
    Observations,
    Prediction,
    first_frames,
    frame_motion,
    moved_frames,
    places_by_tracker,
)
from campaigns.fit.error_sources import (
    SCATTER_TOLERANCE_MM,
    SOURCES,
    by_first_joint,
    scatter_tolerances,
)
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.rows import Rows, blocks_of

MOST_ROUNDS = 40
FAR_ROUNDS = 6
"""Rounds after which weights are estimated though steps are still large: with a third of the points
centimetres off they never become small before."""
SETTLED_GAIN = 1e-2
"""Gain in χ² of a step that ends the fit: a tenth of a standard deviation."""
NEAR_GAIN = 1.0
"""Gain of a step below which weights, sizes and noise are estimated: a standard deviation."""
LEAST_UPDATES = 2
"""Least number of estimates of weights, sizes and noise: the second is at the settled unknowns."""
LATER_RISE = 20.0
"""Log evidence that later rounds may add to what the linear model promises. In 150 fits from 21
situations it was below 1, and -5 where half of the promise was the limit."""
SETTLED_WEIGHT = 0.02
"""Change of a weight below which all are settled."""
ALLOWED_RISE = 0.02
"""Rise of χ² that is rounding of the assembly, not a step too far."""
NOISE_RANGE = (1e-7, 1e6)
"""Range of the noise's factors, far beyond any instrument or robot."""
SEED_OF_SIZES, BURNT_DRAWS, DRAWS = 1, 20, 150
"""Seed and number of the draws of sizes over which a result is averaged; the first are burnt."""
SMALLEST_SIZE = 0.4
"""Smallest size of a group of the table. A group of four parts, one of them bad, looks better than
it is by the directions that shots determine well: without a least size 6 of 40 robots at their
tolerances had a parameter more than 4 σ off, with it 1 of 80."""
LARGEST_SIZE = 10.0
"""Largest size that is drawn, over the likeliest one and over 1: shots determine a larger one."""
ROUNDS_OF_SIZES = 4
"""Rounds of the sizes of groups in each round of the noise, which costs far more: new weights need
new normal equations, new sizes only another inverse of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Results from before the shots, beside the tolerances."""

    mean: Array | None = None
    """Mean (P,) of a former result, in tolerances; None: nominal."""
    precision: Array | None = None
    """Precision (P, P) of a former result, instead of the tolerances; None: the tolerances hold.
    With a former frame (P + 6, P + 6), the frame's turns (mrad) and shifts (mm) last."""
    factors: Mapping[str, float] = field(default_factory=dict)
    """Factors of the noise's parts by a former result, which stay; empty: they are estimated."""
    lengths: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Value and 1 σ of a tracker's source that known lengths measured, instead of its tolerance, in
    the source's unit: mm, rad or a ratio."""
    frame: Transform | None = None
    """`tracker_from_base` of a former result; None: frames are flat."""


@dataclass(frozen=True, slots=True, eq=False)
class Whitened:
    """Residuals of a fit in units of their noise, and what its unknowns explain of further columns.

    With W = R'R and whitened columns c = R a, all unknowns integrated out, c'c - |K c|² is the
    information on the columns' own unknowns, with K = L⁻¹ (R A)' and A'WA + D = L L'.
    """

    root: Array
    """R, (N, r, r)."""
    residual: Array
    """(r N,)"""
    explained: Array
    """K, (Q, r N)."""

    def columns(self, columns: Array) -> Array:
        """Return columns (N, r, …) in units of the noise, (r N, k)."""
        flat = columns.reshape(*self.root.shape[:2], -1)
        return np.asarray((self.root @ flat).reshape(len(self.residual), -1))

    def information(self, columns: Array) -> Array:
        """Return the information (k, k) on the unknowns of whitened columns (r N, k)."""
        shared = self.explained @ columns
        return np.asarray(columns.T @ columns - shared.T @ shared)


@dataclass(frozen=True, eq=False)
class Fit:
    """Model fitted to observations: linearised at the estimates, with weights, sizes and noise."""

    model: ErrorModel
    observations: Observations
    prior: Prior
    at: Prediction
    """The model at the estimates."""
    noise: dict[str, Array]
    """Parts V_k of the noise, (N, 3, 3) by name, before their factors."""
    usable: Mask
    """Shots whose joints assemble, (N,)."""
    good: Array
    """Probability of each shot to be good, its weight in the fit, (N,)."""
    sizes: dict[str, float]
    """Size ρ of each group of unknowns, in tolerances."""
    factors: dict[str, float]
    """Factor φ of each part of the noise."""
    good_of_others: tuple[Array, ...] = ()
    """Probability of each observation of another kind to be good, (M,) of each block."""
    spread: Array | None = None
    """Covariance (Q, Q) beyond that at these sizes: by what the sizes may be."""
    rounds: int = 0
    """Linearisations so far."""
    updates: int = 0
    """Estimates of weights, sizes and noise since the start."""
    has_converged: bool = False
    """Whether the last step would gain less than 1 in χ², with sizes that have settled."""

    @property
    def x(self) -> Array:
        """Estimates of the model's own unknowns in tolerances, (P,)."""
        return self.at.x[: len(self.model.names)]

    @property
    def kept(self) -> Mask:
        """Shots that counted, (N,)."""
        return np.asarray(self.good >= 0.5)

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the tracker's sources that known lengths measured."""
        return tuple(self.prior.lengths)

    @cached_property
    def rows(self) -> tuple[Rows, ...]:
        """Points, then the other kinds of observation, block by block."""
        at = self.at
        points = Rows(at.residual, at.jacobian, self.noise, self.factors, self.usable, self.good)
        others = (
            Rows(r.residual, r.jacobian, r.noise, self.factors, np.ones(len(good), bool), good)
            for r, good in zip(at.others, self.good_of_others, strict=True)
        )
        return (points, *others)

    @property
    def total_noise(self) -> Array:
        """Covariance of each shot, (N, 3, 3)."""
        return self.rows[0].total_noise

    @property
    def inverse_noise(self) -> Array:
        """Inverse W of the covariance of each shot, (N, 3, 3)."""
        return self.rows[0].inverse_noise

    @property
    def weights(self) -> Array:
        """Weights w W of the shots, (N, 3, 3)."""
        return self.rows[0].weights

    @cached_property
    def normal(self) -> tuple[Array, Array]:
        """Normal equations of all observations: A'WA (Q, Q) and A'Wr (Q,)."""
        matrices, slopes = zip(*(rows.normal for rows in self.rows), strict=True)
        return np.asarray(sum(matrices)), np.asarray(sum(slopes))

    @cached_property
    def prior_terms(self) -> tuple[Array, Array]:
        """Precision (Q, Q) of the priors whose size is not learned; deviations (Q,) from means."""
        # A tolerance is a precision of 1. A length known to σ, of a source with tolerance τ, is the
        # precision (τ / σ)² about its value / τ. Frames have no prior, but for that of a former
        # result.
        model, prior, count = self.model, self.prior, len(self.model.names)
        size = self.at.jacobian.shape[2]
        deviation = np.concatenate([self.at.x, np.zeros(size - model.size)])
        precision = np.zeros((size, size))
        if prior.precision is not None and prior.mean is not None:
            former = [*range(count), *range(size)[size - len(prior.precision) + count :]]
            precision[np.ix_(former, former)] = prior.precision
            deviation[:count] -= prior.mean
            of_table = np.zeros(count)
            if prior.frame is not None:
                deviation[-6:] = frame_motion(prior.frame, self.at.frames[-1])
        else:
            of_table = np.ones(count)
        diagonal = np.concatenate(
            [of_table, np.ones(model.size - count), np.zeros(size - model.size)]
        )
        for places in self.groups.values():
            diagonal[places] = 0.0
        for source, (value, std) in prior.lengths.items():
            place = model.names.index(source)
            diagonal[place] = (model.tolerance[place] / std) ** 2
            deviation[place] = self.at.x[place] - value / model.tolerance[place]
        return precision + np.diag(diagonal), deviation

    @cached_property
    def groups(self) -> dict[str, Index]:
        """Places of the unknowns of each group whose size is learned."""
        # a former result replaces the tolerances, and with them the sizes of the table's groups
        # and a known length the tolerance of the tracker's source that it measured
        replaced = {*self.model.learned} if self.prior.precision is not None else set()
        replaced |= {BY_NAME + source for source in self.prior.lengths}
        return {g: places for g, places in self.model.sized_groups.items() if g not in replaced}

    def precision_with(self, sizes: Mapping[str, float]) -> Array:
        """Return the precision (Q, Q) of all priors with these sizes of the groups."""
        precision = self.prior_terms[0].copy()
        for group, places in self.groups.items():
            precision[places, places] = sizes[group] ** -2
        return precision

    @cached_property
    def precision(self) -> Array:
        """Precision (Q, Q) of all priors."""
        return self.precision_with(self.sizes)

    @cached_property
    def inverse(self) -> Array:
        """Posterior covariance (Q, Q) at these sizes and this noise."""
        return np.asarray(np.linalg.inv(self.normal[0] + self.precision))

    @property
    def whitened(self) -> "Whitened":
        """Residuals and derivatives of points in units of their noise."""
        return self.whitened_rows[0]

    @cached_property
    def whitened_rows(self) -> tuple["Whitened", ...]:
        """Those of points, then of the other kinds of observation, block by block."""
        factor = np.asarray(np.linalg.cholesky(self.normal[0] + self.precision))
        return tuple(self._whitened(rows, factor) for rows in self.rows)

    def _whitened(self, rows: Rows, factor: Array) -> "Whitened":
        width = rows.residual.shape[1]
        root = np.linalg.cholesky(rows.weights + 1e-30 * np.eye(width)).swapaxes(1, 2)
        jacobian = (root @ rows.jacobian).reshape(-1, rows.jacobian.shape[2])
        explained = scipy.linalg.solve_triangular(factor, jacobian.T, lower=True)
        residual = (root @ rows.after(self.step)[..., None]).ravel()
        return Whitened(np.asarray(root), residual, explained)

    # Rows of no moment are of today, and so behind all others.
    @cached_property
    def moments(self) -> Array:
        """Moments of points, then of the other kinds of observation, block by block."""
        blocks = self.observations.blocks
        return np.concatenate([self.observations.moment, *(block.moment for block in blocks)])

    def columns_of(self, effect: Effect) -> tuple[Array, ...]:
        """Return ∂residual/∂z of an effect, (N, r, k) of the rows of each kind."""
        points = self.at.columns_of(effect, self.observations)
        return (points, *(rows.columns_of(effect) for rows in self.at.others))

    @cached_property
    def covariance(self) -> Array:
        """Posterior covariance (Q, Q) of unknowns in tolerances, effects and frames."""
        return self.inverse if self.spread is None else self.inverse + self.spread

    @property
    def model_covariance(self) -> Array:
        """Covariance of the model's own unknowns in tolerances, (P, P)."""
        size = len(self.model.names)
        return self.covariance[:size, :size]

    @property
    def std(self) -> Array:
        """1 σ of the model's own unknowns in tolerances, (P,)."""
        return np.sqrt(np.diag(self.model_covariance))

    @cached_property
    def step(self) -> Array:
        """Gauss-Newton step to the minimum of the linearised model, (Q,)."""
        return np.asarray(-self.inverse @ self._slope)

    @cached_property
    def gain(self) -> float:
        """Fall of χ² by the step: 1 is a step of one standard deviation."""
        return float(-self._slope @ self.step)

    @cached_property
    def _slope(self) -> Array:
        """Half the gradient of χ²."""
        return self.normal[1] + self.precision @ self.prior_terms[1]

    @cached_property
    def residual(self) -> Array:
        """Residuals (N, 3) of points after the step, in the linearised model."""
        return self.rows[0].after(self.step)

    @property
    def by_unknowns(self) -> Array:
        """Covariance A C A' of each predicted point, (N, 3, 3)."""
        return self.rows[0].by_unknowns(self.inverse)

    @cached_property
    def cavities(self) -> tuple[tuple[Array, Array], ...]:
        """Residuals (M, r) and covariances (M, r, r) by the fit without each, of all rows."""
        return tuple(
            wrong_shots.cavity(
                rows.after(self.step), rows.by_unknowns(self.inverse), rows.total_noise, rows.good
            )
            for rows in self.rows
        )

    @property
    def cavity(self) -> tuple[Array, Array]:
        """Residuals (N, 3) of points and their covariances by the fit without each shot."""
        return self.cavities[0]

    def with_weights(self, weights: Sequence[Array]) -> "Fit":
        """Return the fit with these weights of the rows of each kind, (M,) each."""
        return replace(self, good=weights[0], good_of_others=tuple(weights[1:]))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise: all rows less the unknowns' share."""
        # Unknowns that the prior determines rather than the data use up less than one each:
        # tr(C D), the elementwise sum of two symmetric matrices, counts what is given back.
        used = len(self.inverse) - float((self.inverse * self.precision).sum())
        return sum(rows.count for rows in self.rows) - used

    @property
    def objective(self) -> float:
        """χ² of residuals and priors; infinite where a row that counts has no assembly."""
        deviation = self.prior_terms[1]
        value = sum(rows.chi2 for rows in self.rows)
        value += float(deviation @ self.precision @ deviation)
        return value if np.isfinite(value) else np.inf

    @property
    def scatter(self) -> tuple[float, float]:
        """1 σ of the scatter of the robot's point an axis, mm, and of its first joint, rad, mm."""
        # parts of the noise are stated at their tolerances, and factors multiply variances
        return SCATTER_TOLERANCE_MM * self.factors["points"] ** 0.5, float(self.joint_scatters[0])

    @property
    def joint_scatters(self) -> Array:
        """1 σ of the scatter of each joint, (n,), rad or mm: alike in parts of their tolerances."""
        joints = self.model.nominal.mechanism.joints
        return np.asarray(scatter_tolerances(joints) * self.factors["joints"] ** 0.5)


# Gauss-Newton solves (A'WA + D) step = -(A'W r + D (x - μ)).
#
# 1. Begin at nominal with the best frames and without the shots that are far from it, or at an
#    earlier fit of these shots.
# 2. While gains are above 1, take steps alone, with all groups and the scatter at their tolerances:
#    sizes and noise estimated far from the minimum would be those of the misfit. Six rounds at the
#    most.
# 3. Then find robust weights from nothing, once (`_robust_start`).
# 4. From then on estimate weights, sizes and noise before every step, on the same linear model.
# 5. End when a step gains less than 0.01 and no weight moves by 0.02, or no step lowers χ².
def fit_model(model: ErrorModel, observations: Observations, prior: Prior | None = None) -> Fit:
    """Fit all unknowns to the observations.

    Raise `ValueError` where too few shots, or shots on a line, place no frame.
    """
    return _iterate(_from_nominal(model, observations, prior or Prior()), FAR_ROUNDS)


def refit(
    start: Fit,
    model: ErrorModel | None = None,
    observations: Observations | None = None,
    *,
    least_evidence: float = -np.inf,
) -> Fit:
    """Fit again from an earlier fit, with other effects or other observations in its frames.

    A fit that will have less than the least evidence ends early, with less than that.
    """
    return _iterate(_from(start, model or start.model, observations), 1, least_evidence)


def settle(start: Fit, model: ErrorModel) -> Fit:
    """Fit again with the same effects, linearised elsewhere, from the weights that it has."""
    return _iterate(_from(start, model, None), 0, is_started=True)


# With a gain of χ² left, the linear model promises a rise by half of it. Four times that is allowed
# for what is not linear: a fit still far from its minimum never falls short.
def falls_short(fit: Fit, evidence: float) -> bool:
    """Return whether a fit that has not settled will not reach this log evidence."""
    return log_evidence(fit) + 2.0 * fit.gain + LATER_RISE < evidence


def _iterate(
    fit: Fit, far_rounds: int, least_evidence: float = -np.inf, *, is_started: bool = False
) -> Fit:
    """Take steps until the fit has settled; weights come after `far_rounds` at the latest."""
    change, rounds, before = 1.0, 1, np.inf
    while rounds < MOST_ROUNDS and not (
        fit.gain < SETTLED_GAIN and fit.updates >= LEAST_UPDATES and change < SETTLED_WEIGHT
    ):
        if is_started or fit.gain < NEAR_GAIN or rounds > far_rounds:
            if not is_started:
                fit, is_started = _robust_start(fit), True
            fit, change = update_weights(fit)
            fit = replace(fit, updates=fit.updates + 1)
            if least_evidence > -np.inf and falls_short(fit, least_evidence):
                break
        # Products of unknowns, such as tilts times places on the plate, may make steps overshoot to
        # and fro for ever: half a step ends that.
        share = 0.5 if is_started and fit.gain > 0.5 * before else 1.0
        before = fit.gain
        following, taken = _step(fit, MOST_ROUNDS - rounds, share)
        rounds += taken
        if following is None:
            break
        fit = following
    has_converged = fit.gain < NEAR_GAIN and fit.updates >= LEAST_UPDATES
    return replace(fit, rounds=rounds, has_converged=has_converged)


def _from_nominal(model: ErrorModel, observations: Observations, prior: Prior) -> Fit:
    """Return the fit before its first step: nominal or the prior's mean, in the best frames."""
    _, assembly = model.positions(np.zeros(len(model.names)), observations, observations.near)
    usable = assembly.is_solved
    seen = places_by_tracker(model, observations.blocks)
    frames, is_near = first_frames(observations, assembly.points, usable, tuple(seen.values()))
    observations = _with_substitutes(observations, usable)
    at = model.predict(np.zeros(model.size), frames, observations, observations.near)
    noise = noise_parts(model, observations, at.by_joint)
    factors = dict.fromkeys(_parts_of(noise, at), 1.0) | dict(prior.factors)
    sizes = dict.fromkeys(model.sized_groups, 1.0)
    counts = [len(usable), *map(len, seen.values())]
    good, *near = np.split(is_near.astype(np.float64), np.cumsum(counts)[:-1])
    of_seen = dict(zip(seen, near, strict=True))
    others = tuple(
        of_seen.get(row, np.ones(len(block))) for row, block in enumerate(observations.blocks)
    )
    return Fit(model, observations, prior, at, noise, usable, good, sizes, factors, others)


def _from(start: Fit, model: ErrorModel, observations: Observations | None) -> Fit:
    """Return an earlier fit with the effects of `model`; those that it had keep their values."""
    before = dict(zip(_names_of(start.model), start.model.effect_places, strict=True))
    values = [
        start.at.x[before[name]] if name in before else np.zeros(effect.count)
        for name, effect in zip(_names_of(model), model.effects, strict=True)
    ]
    by_name = dict(zip(start.model.names, start.x.tolist(), strict=True))
    x = np.concatenate([[by_name.get(name, 0.0) for name in model.names], *values])
    sizes = {group: start.sizes.get(group, 1.0) for group in model.sized_groups}
    fit = replace(start, model=model, sizes=sizes, spread=None, updates=0)
    if observations is None:
        return _predicted(fit, x, start.at.frames)
    _, assembly = model.positions(x, observations, observations.near)
    usable = assembly.is_solved
    observations = _with_substitutes(observations, usable)
    at = model.predict(x, start.at.frames, observations, observations.near)
    noise = noise_parts(model, observations, at.by_joint)
    factors = {part: start.factors.get(part, 1.0) for part in _parts_of(noise, at)}
    return replace(
        fit,
        observations=observations,
        at=at,
        noise=noise,
        usable=usable,
        good=usable.astype(np.float64),
        factors=factors,
    )


def _parts_of(noise: Mapping[str, Array], at: Prediction) -> tuple[str, ...]:
    """Return the names of the parts of the noise of points and of all other rows."""
    return tuple(dict.fromkeys([*noise, *(part for rows in at.others for part in rows.noise)]))


def _names_of(model: ErrorModel) -> list[tuple[str, int]]:
    """Return a key for each effect: its name, and its number among those of the same name."""
    names = [effect.name for effect in model.effects]
    return [(name, names[:place].count(name)) for place, name in enumerate(names)]


def _predicted(fit: Fit, x: Array, frames: tuple[Transform, ...]) -> Fit:
    """Return the fit linearised at other unknowns."""
    with np.errstate(all="ignore"):  # a step too far may lead to no assembly
        at = fit.model.predict(x, frames, fit.observations, fit.at.assembly.unknowns)
    return replace(fit, at=at, noise=noise_parts(fit.model, fit.observations, at.by_joint))


def _step(fit: Fit, most: int, share: float) -> tuple[Fit | None, int]:
    """Take a share of the step, or a quarter of that and so on, until χ² does not rise.

    Return None if no step lowers it, and the number of trials.
    """
    limit = fit.objective * (1.0 + 1e-6) + ALLOWED_RISE
    step, size = share * fit.step, fit.model.size
    for trial in range(most):
        frames = moved_frames(fit.at.frames, step[size:])
        following = _predicted(fit, fit.at.x + step[:size], frames)
        # a step that leads to no assembly has an infinite χ²
        if following.objective <= limit:
            return following, trial + 1
        step = step / 4.0
    return None, most


# At one linear model, nothing is assembled again: Cauchy weights, sizes and noise in turns, until
# no weight moves by 0.05 or six times; then three concentration steps.
def _robust_start(fit: Fit) -> Fit:
    """Return the fit with weights that do not rest on the scatter that all shots show together."""
    for _ in range(6):
        weights = [_cauchy_weights(fit, rows) for rows in fit.rows]
        change = _largest_change(fit, weights)
        fit = estimate_sizes_and_noise(fit.with_weights(weights), 3, is_cauchy=True)
        if change < 0.05:
            break
    for _ in range(3):
        cores: list[Array] = []
        for rows, (residual, covariance) in zip(fit.rows, fit.cavities, strict=True):
            scaled = np.linalg.solve(covariance, residual[..., None])[..., 0]
            share = wrong_shots.CORE_OF_OTHERS if cores else wrong_shots.CORE_SHARE
            cores.append(wrong_shots.core_of((residual * scaled).sum(axis=1), rows.usable, share))
        fit = estimate_sizes_and_noise(fit.with_weights(cores), 3)
    return fit


def _cauchy_weights(fit: Fit, rows: Rows) -> Array:
    """Return the weights (M,) of Cauchy-distributed errors after the step."""
    residual = rows.after(fit.step)
    expected = (rows.inverse_noise * rows.by_unknowns(fit.inverse)).sum(axis=(1, 2))
    chi2 = np.einsum("ni,nij,nj->n", residual, rows.inverse_noise, residual) + expected
    return np.asarray(wrong_shots.cauchy_weights(chi2, residual.shape[1]) * rows.usable)


def _largest_change(fit: Fit, weights: Sequence[Array]) -> float:
    """Return the largest change of a weight from a fit to these."""
    pairs = zip(fit.rows, weights, strict=True)
    return max(float(np.abs(now - rows.good).max(initial=0.0)) for rows, now in pairs)


def update_weights(fit: Fit) -> tuple[Fit, float]:
    """Estimate weights, sizes and noise three times; return the last change of a weight, too."""
    change = 1.0
    for _ in range(3):
        weights = []
        for rows, cavity in zip(fit.rows, fit.cavities, strict=True):
            share = wrong_shots.share_of_wrong(rows.good, rows.usable)
            good, wrong = wrong_shots.log_densities(*cavity)
            weights.append(wrong_shots.probabilities_of_good(good, wrong, share, rows.usable))
        change = _largest_change(fit, weights)
        fit = estimate_sizes_and_noise(fit.with_weights(weights), 3)
        if change < SETTLED_WEIGHT:
            break
    return fit, change


# In each round sizes come first, four times with the same weights, then the noise. Squares are of
# residuals and unknowns at the minimum of the linearised model. Changes in a round are limited, for
# far from the fixed point ratios may be absurd. Rounds end when no size changes by 1 %, and no
# noticeable part of the noise by 5 % of its variance.
def estimate_sizes_and_noise(fit: Fit, rounds: int, *, is_cauchy: bool = False) -> Fit:
    """Iterate the fixed point of sizes and noise at most `rounds` times."""
    for _ in range(rounds):
        before = fit.sizes
        fit = _with_sizes(fit)
        ratios = _noise_ratios(fit, is_cauchy=is_cauchy)
        factors = dict(fit.factors)
        for part, ratio in ratios.items():
            factors[part] = float(
                np.clip(factors[part] * np.clip(ratio, 0.01, 100.0), *NOISE_RANGE)
            )
        noise_changes = [abs(np.log(r)) for part, r in ratios.items() if factors[part] > 1e-4]
        size_changes = [abs(np.log(fit.sizes[group] / before[group])) for group in fit.groups]
        fit = replace(fit, factors=factors)
        if max(noise_changes, default=0.0) < 0.05 and max(size_changes, default=0.0) < 0.01:
            break
    return fit


def _with_sizes(fit: Fit) -> Fit:
    """Return the fit after rounds of the sizes of groups with the same normal equations."""
    if not fit.groups:
        return fit
    reduced, floors = _reduced(fit, fit.groups), smallest_sizes(fit.model)
    least = np.array(
        [SMALLEST_SIZE if group in SOURCES else floors.get(group, 0.0) for group in fit.groups]
    )
    size2 = np.array([fit.sizes[group] ** 2 for group in fit.groups])
    for _ in range(ROUNDS_OF_SIZES):
        inverse = np.linalg.inv(reduced.precision_with(size2))
        x = inverse @ reduced.right
        squares = reduced.sums(x**2) / size2
        redundancy = np.maximum(reduced.counts - reduced.sums(np.diag(inverse)) / size2, 0.0)
        ratio = np.clip(_ratio_with_prior(squares, redundancy, size2), 0.1, 10.0)
        size2 = np.maximum(size2 * ratio, least**2)
    sizes = dict(zip(fit.groups, np.sqrt(size2).tolist(), strict=True))
    solved = replace(fit, sizes={**fit.sizes, **sizes})
    for kept in ("rows", "normal", "prior_terms"):  # of the same weights
        solved.__dict__[kept] = getattr(fit, kept)
    return solved


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """Normal equations of the unknowns of some groups, all others eliminated (Schur).

    With the priors of sizes ρ, (M + diag ρ⁻²) x = m. The others follow: x_o = offset - link x.
    """

    places: Index
    """Places of the unknowns among all, one group after the other, (k,)."""
    others: Index
    """Places of those eliminated, (o,)."""
    counts: Index
    """Unknowns of each group, (G,)."""
    information: Array
    """M, (k, k)."""
    right: Array
    """m, (k,)."""
    inverse: Array
    """Covariance of the others at given x, (o, o)."""
    link: Array
    """(o, k)"""
    offset: Array
    """(o,)"""

    def sums(self, rows: Array) -> Array:
        """Return the sums of rows (k,) over each group, (G,)."""
        return np.asarray(np.add.reduceat(rows, np.cumsum(self.counts) - self.counts))

    def precision_with(self, size2: Array) -> Array:
        """Return M + diag ρ⁻² (k, k) at squares ρ² of the groups' sizes, (G,)."""
        return self.information + np.diag(np.repeat(1.0 / size2, self.counts))


# Frame and geometry may lie within rounding of each other: M and m are differences of squares, by a
# root of the block of the others, scaled to a diagonal of 1.
def _reduced(fit: Fit, groups: Mapping[str, Index]) -> Reduced:
    """Return the normal equations of the unknowns of these groups, without their own priors."""
    places = np.concatenate(list(groups.values()))
    others = np.setdiff1d(np.arange(fit.at.jacobian.shape[2]), places)
    (matrix, slope), deviation = fit.normal, fit.prior_terms[1]
    right = matrix @ deviation - slope
    whole = matrix + fit.precision
    whole[places, places] -= fit.precision[places, places]
    block = whole[np.ix_(others, others)]
    scale = 1.0 / np.sqrt(np.diag(block))
    root = np.linalg.cholesky(scale[:, None] * block * scale)
    lower = scipy.linalg.solve_triangular(root, np.diag(scale), lower=True)  # block⁻¹ = L'L
    across, aside = lower @ whole[np.ix_(others, places)], lower @ right[others]
    return Reduced(
        places,
        others,
        np.array([len(of_group) for of_group in groups.values()]),
        whole[np.ix_(places, places)] - across.T @ across,
        right[places] - across.T @ aside,
        lower.T @ lower,
        lower.T @ across,
        lower.T @ aside,
    )


def smallest_sizes(model: ErrorModel) -> dict[str, float]:
    """Return the floors of the sizes of effects that have one."""
    return {group: effect.smallest_size for effect in model.effects for group, _ in effect.sizes_of}


# By λ = log ρ² the derivative of -2 log likelihood is redundancy - squares. The half-Cauchy density
# 1 / (1 + ρ²) of a size is ρ / (1 + ρ²) as a density of log ρ; -2 log of it is 2 log(1 + ρ²) - λ,
# with the derivative 2 ρ² / (1 + ρ²) - 1. Both derivatives cancel at the posterior's maximum, where
# this ratio is 1. For a part of the noise φ is its ρ², for its scale is a tolerance too.
def _ratio_with_prior(
    squares: Array | float, redundancy: Array | float, size2: Array | float
) -> Array:
    """Return squares over redundancy, each with the share of the half-Cauchy prior on the size."""
    return np.asarray((squares + 1.0) / (redundancy + 2.0 * size2 / (1.0 + size2)))


# With u = W v of the residuals v after the step, squares are φ Σ w u'V_k u. The covariance of v is
# V / w - A C A' if the model holds, and the redundancy what these squares are expected to be. A
# Cauchy weight is a property of the shot's error, not of its design: there the expected squares
# are those of weight 1.
def _noise_ratios(fit: Fit, *, is_cauchy: bool) -> dict[str, float]:
    """Return by how much the variance of each estimated part of the noise must be multiplied."""
    explained = []
    for rows in fit.rows:
        u = (rows.inverse_noise @ rows.after(fit.step)[..., None])[..., 0]
        expected = rows.weights - blocks_of(rows.weighted_jacobian, fit.inverse)
        if is_cauchy:
            expected = expected / np.maximum(rows.good, 1e-9)[:, None, None]
        explained.append((rows, u, expected))
    ratios = {}
    for part, factor in fit.factors.items():
        if part == "stated" or part in fit.prior.factors:
            continue
        squares = redundancy = 0.0
        for rows, u, expected in explained:
            if part not in rows.noise:
                continue
            covariance = rows.noise[part]
            squares += factor * np.einsum("n,ni,nij,nj->", rows.good, u, covariance, u)
            redundancy += factor * float((covariance * expected).sum())
        ratios[part] = float(_ratio_with_prior(squares, max(redundancy, 0.0), factor))
    return ratios


# Parts V_k of a shot's covariance: the tracker's; s² 1 for the scatter of the robot's point, alike
# in all directions; J Q J' for the scatter of its joints, with J = ∂point/∂joints and their
# variances Q.
def noise_parts(model: ErrorModel, observations: Observations, by_joint: Array) -> dict[str, Array]:
    """Return the parts of the noise (N, 3, 3): the tracker's, the robot's at its tolerances."""
    joints = model.nominal.mechanism.joints
    by_scatter, joint = by_first_joint(joints, by_joint), scatter_tolerances(joints)[0]
    point = np.broadcast_to(SCATTER_TOLERANCE_MM**2 * np.eye(3), (len(observations), 3, 3))
    of_joints = joint**2 * by_scatter @ by_scatter.swapaxes(1, 2)
    return {**observations.noise, "points": point, "joints": of_joints}


def _with_substitutes(observations: Observations, usable: Mask) -> Observations:
    """Return observations whose unusable rows have another row's joints, so that all assemble."""
    # the weight of these rows is 0, but a NaN times 0 would be NaN
    if usable.all():
        return observations
    rows = np.where(usable, np.arange(len(usable)), int(np.argmax(usable)))
    return replace(observations, joints=observations.joints[rows], near=observations.near[rows])


# Laplace's approximation: the density of the shots at the estimates, times the prior's there, times
# the volume of the posterior over that of the prior. Wrong shots count by the density of their
# cavity residuals, their number by the Beta-binomial, effects by their odds.
def log_evidence(fit: Fit) -> float:
    """Return the log evidence of the model, up to a constant of the shots."""
    used = [(rows.good >= 0.5) & rows.usable for rows in fit.rows]
    counted = fit.with_weights([mask.astype(np.float64) for mask in used])
    # a flat frame has no prior density, and its volume is the same for all hypotheses
    size = fit.model.size if fit.prior.frame is None else len(fit.precision)
    value = 0.0
    for rows, mask in zip(fit.rows, used, strict=True):
        residual = rows.residual[mask]
        chi2 = np.einsum("ni,nij,nj->", residual, rows.inverse_noise[mask], residual)
        value += -0.5 * (chi2 + np.linalg.slogdet(rows.total_noise[mask])[1].sum())
    deviation, precision = fit.prior_terms[1][:size], fit.precision[:size, :size]
    value += 0.5 * (np.linalg.slogdet(precision)[1] - deviation @ precision @ deviation)
    value -= 0.5 * np.linalg.slogdet(counted.normal[0] + fit.precision)[1]
    for group in fit.groups:
        value += np.log(fit.sizes[group]) - np.log1p(fit.sizes[group] ** 2)
    for part, factor in fit.factors.items():
        if part != "stated":
            value += 0.5 * np.log(factor) - np.log1p(factor)
    for rows, cavity, mask in zip(fit.rows, counted.cavities, used, strict=True):
        _, wrong = wrong_shots.log_densities(*cavity)
        value += wrong[rows.usable & ~mask].sum()
        value += wrong_shots.log_prior_of_count(int((~mask).sum()), len(mask))
    return float(value + sum(effect.log_odds for effect in fit.model.effects))


def with_spread(fit: Fit, covariance: Array) -> Fit:
    """Return the fit with further covariance (P, P) of the model's own unknowns."""
    spread = np.zeros_like(fit.inverse) if fit.spread is None else fit.spread.copy()
    spread[: len(covariance), : len(covariance)] += covariance
    return replace(fit, spread=spread)


# Gibbs sampling in the linear model, the noise as it is. With the normal equations (N + D) x = h of
# deviations x from the priors' means, and all unknowns without a learned size eliminated (Schur),
#
#     x | ρ    is normal with the covariance C(ρ) = (M + diag ρ⁻²)⁻¹ and the mean C(ρ) m
#     ρ² | x   is inverse-gamma ((k + 1)/2, 1/a + Σ x²/2) of a group of k unknowns, and
#     a | ρ²   inverse-gamma (1, 1 + 1/ρ²): a half-Cauchy size (Makalic and Schmidt 2016)
#
# The mean of C(ρ) m, and of C(ρ) with the spread of these means, are averages over the draws.
# Effects keep their likeliest size, and so does a tolerance that somebody stated by name.
def integrate_sizes(fit: Fit) -> Fit:
    """Return the fit with estimates and covariance averaged over what the sizes may be.

    One size for each group, the likeliest, would state σ as if it were sure. The draws have a seed
    of their own: the same shots give the same figures.
    """
    drawn = {g: p for g, p in fit.groups.items() if g == "stand" or g in SOURCES}
    if not drawn:
        return fit
    reduced = _reduced(fit, drawn)
    places, others, link = reduced.places, reduced.others, reduced.link
    mean, covariance = _draw_sizes(reduced, np.array([fit.sizes[group] ** 2 for group in drawn]))
    total = np.zeros_like(fit.inverse)
    total[np.ix_(places, places)] = covariance
    total[np.ix_(others, places)] = -link @ covariance
    total[np.ix_(places, others)] = -(link @ covariance).T
    total[np.ix_(others, others)] = reduced.inverse + link @ covariance @ link.T
    averaged = np.zeros(len(total))
    averaged[places], averaged[others] = mean, reduced.offset - link @ mean
    step = averaged - fit.prior_terms[1]
    frames = moved_frames(fit.at.frames, step[fit.model.size :])
    moved = _predicted(fit, fit.at.x + step[: fit.model.size], frames)
    return replace(moved, spread=0.5 * (total + total.T) - moved.inverse)


def _draw_sizes(reduced: Reduced, likeliest: Array) -> tuple[Array, Array]:
    """Return mean (k,) and covariance (k, k) of the unknowns of groups over draws of their sizes.

    `likeliest` (G,) are the squares of the likeliest sizes, at which the draws begin.
    """
    rng, count = np.random.default_rng(SEED_OF_SIZES), len(reduced.right)
    variances, largest = likeliest, LARGEST_SIZE**2 * np.maximum(likeliest, 1.0)
    # of each group in turn: 1/a of its half-Cauchy, then its size
    shapes = np.stack([np.ones(len(variances)), 0.5 * (reduced.counts + 1)], axis=1)
    means, covariance = [], np.zeros((count, count))
    for draw in range(BURNT_DRAWS + DRAWS):
        inverse = np.linalg.inv(reduced.precision_with(variances))
        mean = inverse @ reduced.right
        if draw >= BURNT_DRAWS:
            means.append(mean)
            covariance += inverse / DRAWS
        root = np.linalg.cholesky(0.5 * (inverse + inverse.T) + 1e-15 * np.eye(count))
        x = mean + root @ rng.standard_normal(count)
        of_scale, of_size = rng.standard_gamma(shapes).T
        squares = of_scale / (1.0 + 1.0 / variances) + 0.5 * reduced.sums(x**2)
        variances = np.clip(squares / of_size, SMALLEST_SIZE**2, largest)
    spread = np.cov(np.array(means).T, bias=True)
    return np.mean(means, axis=0), covariance + spread


def log_factors_at_usual_size(score: Array, information: Array) -> Array:
    """Return log B (M,) of scores u (M, k, 1) and information I (M, k, k) at the usual size."""
    matrix = information + np.eye(information.shape[-1])
    gain = (score * np.linalg.solve(matrix, score))[..., 0].sum(axis=-1)
    return np.asarray(0.5 * gain - 0.5 * np.linalg.slogdet(matrix)[1])
