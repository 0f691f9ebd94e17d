"""Fit of all unknowns at once: the posterior of robot, tracker and scatter.

Theory of operation. Measured points go in with the joints read there, and the model of
`error_model.py`: a nominal robot with a prior for every source of error. Minimised is

    χ² = Σ r_i' W_i r_i + (x - μ)' D (x - μ)

with residuals r_i = predicted - measured point (mm), weights W_i (the inverse covariance of a
shot), unknowns x in units of their tolerances, and the priors' mean μ and precision D. The sizes of
the priors and the noise are unknown too: they are estimated between the steps.

Out come x, its covariance C = (Σ A'WA + D)⁻¹, sizes and noise. As every source of error has a
prior, no parameter has to be held and no model to be chosen: what no shot determines stays at
nominal, with its tolerance as its σ.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.fit.error_model import (
    ErrorModel,
    Linearised,
    Observations,
    first_frames,
    moved_frames,
)
from campaigns.fit.error_sources import SCATTER_TOLERANCE_MM, scatter_tolerance_of_joints
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.variance_components import Components, LinearModel, estimate_components

MOST_ROUNDS = 40
SETTLED_GAIN = 1e-2
"""Gain in χ² of a step that ends the fit: a tenth of a standard deviation."""
NEAR_GAIN = 1.0
"""Gain of a step below which sizes and noise are estimated: a standard deviation."""
LEAST_UPDATES = 2
"""Least number of estimates of sizes and noise: the second is at the settled unknowns."""
ALLOWED_RISE = 0.02
"""Rise of χ² that is rounding of the assembly, not a step too far."""


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Results from before the shots, beside the tolerances."""

    mean: Array | None = None
    """Mean (P,) of a former result, in tolerances; None: nominal."""
    precision: Array | None = None
    """Precision (P, P) of a former result, instead of the tolerances; None: the tolerances hold."""
    factors: Mapping[str, float] = field(default_factory=dict)
    """Factors of the noise's parts by a former result, which stay; empty: they are estimated."""
    lengths: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Value and 1 σ of a tracker's source that known lengths measured, instead of its tolerance, in
    the source's unit: mm, rad or a ratio."""


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Fitted model: estimates with covariance, sizes and noise, and the shots that counted."""

    model: ErrorModel
    observations: Observations
    at: Linearised
    """The model at the estimates."""
    covariance: Array
    """Covariance of unknowns in tolerances, of added changes and of frames, (Q, Q)."""
    prior: Array
    """Precision (Q, Q) of all priors."""
    components: Components
    noise: dict[str, Array]
    """Parts of the noise (N, 3, 3) by name, before their factors."""
    weights: Array
    """Inverse covariance of each shot, (N, 3, 3); zero where it did not count."""
    kept: Mask
    """Shots that counted, (N,)."""
    has_converged: bool
    """Whether the next step would gain less than 1 in χ²."""
    rounds: int
    measured: tuple[str, ...] = ()
    """Names of the tracker's sources that known lengths measured."""

    @property
    def x(self) -> Array:
        """Estimates of the model's unknowns in tolerances, (P,)."""
        return self.at.x[: len(self.model.names)]

    @property
    def model_covariance(self) -> Array:
        """Covariance of the model's unknowns in tolerances, (P, P)."""
        size = len(self.model.names)
        return self.covariance[:size, :size]

    @property
    def std(self) -> Array:
        """1 σ of the model's unknowns in tolerances, (P,)."""
        return np.sqrt(np.diag(self.model_covariance))

    @property
    def scatter(self) -> tuple[float, float]:
        """1 σ of the scatter of the robot's point an axis, mm, and of its joints, rad or mm."""
        # parts of the noise are stated at their tolerances, and factors multiply variances
        factors = self.components.factors
        revolute = self.model.nominal.mechanism.joints[0].is_revolute
        joint = scatter_tolerance_of_joints(revolute=revolute)
        return SCATTER_TOLERANCE_MM * factors["points"] ** 0.5, joint * factors["joints"] ** 0.5

    @property
    def total_noise(self) -> Array:
        """Covariance of each shot, (N, 3, 3)."""
        factors = self.components.factors
        return np.asarray(
            sum(factors[part] * covariance for part, covariance in self.noise.items())
        )


# Gauss-Newton solves (A'WA + D) step = -(A'W r + D (x - μ)) with the derivatives A of the
# residuals. The gain of a step is what χ² falls by it in the linearised model, slope' C slope: 1 is
# a step of one standard deviation, so that gains measure progress in units of the uncertainty.
#
# 1. Begin at nominal with the best frames, or at an earlier posterior of these shots.
# 2. While gains are above 1, take steps alone, with all groups and the scatter at their tolerances:
#    sizes and noise estimated far from the minimum would be those of the misfit.
# 3. Then estimate sizes and noise before every step, the first time in more rounds.
# 4. End when a step gains less than 0.01, after two estimates at least, or cannot lower χ².
def fit(
    model: ErrorModel,
    observations: Observations,
    prior: Prior | None = None,
    kept: Mask | None = None,
    start: Posterior | None = None,
    changes: Array | None = None,
) -> Posterior:
    """Fit all unknowns to the observations and return their posterior.

    Shots that are not `kept` (N,) have no weight. `start` is an earlier posterior of these
    shots, `changes` (N, 3, k) are further columns with prior N(0, 1). Raise `ValueError` where too
    few shots, or shots on a line, place no frame.
    """
    prior = prior or Prior()
    kept = np.ones(len(observations), dtype=bool) if kept is None else kept
    size = len(model.names) + (0 if changes is None else changes.shape[2])
    if start is None:
        frames, kept = first_frames(model, observations, kept)
        observations = _with_substitutes(observations, kept)
        x, near = np.zeros(size), observations.near
        components = None
    else:
        frames, near, components = start.at.frames, start.at.assembly.unknowns, start.components
        observations = start.observations
        # the earlier posterior may have had other changes: theirs are no more than starting values
        x = np.concatenate([start.at.x, np.zeros(size)])[:size]

    def linear_at(x: Array, frames: tuple[Transform, ...], near: Array) -> LinearModel:
        with np.errstate(all="ignore"):
            at = model.linearise(observations, x, frames, near, changes)
        fixed, deviation = _fixed_prior(model, x, 6 * len(frames), prior)
        noise = noise_parts(model, observations, at.by_joint)
        # a former result replaces the tolerances, and with them the sizes to be estimated
        groups = {} if prior.precision is not None else model.learned
        return LinearModel(at, noise, kept, deviation, fixed, groups)

    state = linear_at(x, frames, near)
    if components is None:
        factors = dict.fromkeys(state.noise, 1.0) | dict(prior.factors)
        components = Components(dict.fromkeys(model.learned, 1.0), factors)
    solution = state.solve_with(components)
    updates, rounds, learn_sizes = 0, 1, prior.precision is None
    while rounds < MOST_ROUNDS and not (solution.gain < SETTLED_GAIN and updates >= LEAST_UPDATES):
        if solution.gain < NEAR_GAIN or updates:
            most = 3 if updates else 12
            components = estimate_components(state, components, most, learn_sizes=learn_sizes)
            components = replace(components, factors={**components.factors, **prior.factors})
            updates += 1
            solution = state.solve_with(components)
        trials = _shortened_steps(state, solution.step, MOST_ROUNDS - rounds, linear_at)
        limit = state.objective(components) * (1.0 + 1e-6) + ALLOWED_RISE
        for trial in trials:
            rounds += 1
            # a step that leads to no assembly has an infinite χ²
            if trial.objective(components) <= limit:
                state, solution = trial, trial.solve_with(components)
                break
    return Posterior(
        model=model,
        observations=observations,
        at=state.at,
        covariance=solution.covariance,
        prior=state.precision(components.sizes),
        components=components,
        noise=state.noise,
        weights=state.weights(components.factors),
        kept=kept,
        has_converged=solution.gain < NEAR_GAIN,
        rounds=rounds,
        measured=tuple(prior.lengths),
    )


def _shortened_steps(
    state: LinearModel,
    step: Array,
    most: int,
    linear_at: Callable[[Array, tuple[Transform, ...], Array], LinearModel],
) -> Iterator[LinearModel]:
    """Yield the models after a step (Q,), after a quarter of it, and so on, at most `most`."""
    at = state.at
    size = len(at.x)
    for _ in range(most):
        frames = moved_frames(at.frames, step[size:])
        yield linear_at(at.x + step[:size], frames, at.assembly.unknowns)
        step = step / 4.0


# A tolerance is a precision of 1. Learned groups get theirs from their size, and frames have none.
# A length known to σ, of a source with tolerance τ, is the precision (τ / σ)² about its value / τ.
def _fixed_prior(
    model: ErrorModel, x: Array, frame_unknowns: int, prior: Prior
) -> tuple[Array, Array]:
    """Return the precision (Q, Q) of priors that are not learned, and all deviations (Q,)."""
    size, count = len(model.names), len(x)
    deviation = np.concatenate([x, np.zeros(frame_unknowns)])
    precision = np.zeros((len(deviation), len(deviation)))
    if prior.precision is not None and prior.mean is not None:
        precision[:size, :size] = prior.precision
        deviation[:size] -= prior.mean
    else:
        learned = {place for places in model.learned.values() for place in places.tolist()}
        others = [place for place in range(size) if place not in learned]
        precision[others, others] = 1.0
    changes = np.arange(size, count)
    precision[changes, changes] = 1.0
    for source, (value, std) in prior.lengths.items():
        place = model.names.index(source)
        tolerance = model.tolerance[place]
        precision[place, place] = (tolerance / std) ** 2
        deviation[place] = x[place] - value / tolerance
    return precision, deviation


# Parts V_k of a shot's covariance: the tracker's; s² 1 for the scatter of the robot's point, alike
# in all directions; σ_q² J J' for the scatter of its joints, with J = ∂point/∂joints.
def noise_parts(model: ErrorModel, observations: Observations, by_joint: Array) -> dict[str, Array]:
    """Return the parts of the noise (N, 3, 3): the tracker's, the robot's at its tolerances."""
    revolute = model.nominal.mechanism.joints[0].is_revolute
    joint = scatter_tolerance_of_joints(revolute=revolute)
    point = np.broadcast_to(SCATTER_TOLERANCE_MM**2 * np.eye(3), (len(observations), 3, 3))
    of_joints = joint**2 * by_joint @ by_joint.swapaxes(1, 2)
    return {**observations.noise, "points": point, "joints": of_joints}


def _with_substitutes(observations: Observations, kept: Mask) -> Observations:
    """Return observations whose unusable rows have another row's joints, so that all assemble."""
    # the weight of these rows is 0, but a NaN times 0 would be NaN
    if kept.all():
        return observations
    rows = np.where(kept, np.arange(len(kept)), int(np.argmax(kept)))
    return replace(observations, joints=observations.joints[rows], near=observations.near[rows])
