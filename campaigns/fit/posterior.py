"""Fit of all unknowns at once: the posterior of robot, tracker and scatter.

1. Gauss-Newton with all groups at their tolerances, until steps are below the uncertainty: with
   the scatter at its tolerance nothing tears the geometry at first.
2. Sizes of the groups and factors of the noise (`variance_components.py`), in the linearised model.
3. Gauss-Newton again; 2 and 3 alternate until both rest.

A step that raises the objective, or leads to no assembly, is taken back and quartered.
"""

from collections.abc import Mapping
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
SIZE_UPDATES = 2
"""Estimates of sizes and noise at least: the second is at the settled unknowns."""
ALLOWED_RISE = 0.02
"""Rise of χ² that is rounding of the assembly, not a step too far."""


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Knowledge from before the shots, beside the tolerances."""

    mean: Array | None = None
    """Mean (P,) of a former result, in tolerances; None: nominal."""
    precision: Array | None = None
    """Precision (P, P) that replaces the tolerances; None: these hold."""
    factors: Mapping[str, float] = field(default_factory=dict)
    """Factors of the noise's parts by a former result, which stay; empty: they are estimated."""
    lengths: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Source of the tracker as known lengths measured it, instead of its tolerance: value and 1 σ,
    in its own unit."""


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """The fitted model: estimates with their covariance, sizes, noise, and which shots counted."""

    model: ErrorModel
    observations: Observations
    at: Linearised
    covariance: Array
    """Of unknowns in tolerances, added changes and frames, (Q, Q)."""
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
    rounds: int
    measured: tuple[str, ...] = ()
    """Sources of the tracker that known lengths measured."""

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
        """1 σ of the scatter of the robot's point, mm, and of its joints, rad or mm."""
        factors = self.components.factors
        revolute = self.model.nominal.mechanism.joints[0].is_revolute
        joint = scatter_tolerance_of_joints(revolute=revolute)
        return SCATTER_TOLERANCE_MM * factors["points"] ** 0.5, joint * factors["joints"] ** 0.5

    @property
    def total_noise(self) -> Array:
        """Covariance of each shot, (N, 3, 3)."""
        factors = self.components.factors
        return np.asarray(sum(factors[part] * own for part, own in self.noise.items()))


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
    count = 0 if changes is None else changes.shape[2]
    if start is None:
        frames, kept = first_frames(model, observations, kept)
        observations = _with_substitutes(observations, kept)
        x, near = np.zeros(len(model.names) + count), observations.near
        components = None
    else:
        frames, near, components = start.at.frames, start.at.assembly.unknowns, start.components
        observations = start.observations
        x = np.concatenate([start.at.x, np.zeros(count)])[: len(model.names) + count]

    def linear_at(x: Array, frames: tuple[Transform, ...], near: Array) -> LinearModel:
        with np.errstate(all="ignore"):
            at = model.linearise(observations, x, frames, near, changes)
        fixed, deviation = _fixed_prior(model, x, 6 * len(frames), prior)
        noise = noise_parts(model, observations, at.by_joint)
        groups = {} if prior.precision is not None else model.learned
        return LinearModel(at, noise, kept, deviation, fixed, groups)

    state = linear_at(x, frames, near)
    if components is None:
        factors = dict.fromkeys(state.noise, 1.0) | dict(prior.factors)
        components = Components(dict.fromkeys(model.learned, 1.0), factors)
    covariance, step, gain = _step(state, components)
    updates, rounds = 0, 1
    while rounds < MOST_ROUNDS and not (gain < SETTLED_GAIN and updates >= SIZE_UPDATES):
        if gain < NEAR_GAIN or updates:
            first = 12 if not updates else 3
            components = estimate_components(
                state, components, first, learn_sizes=prior.precision is None
            )
            components = replace(components, factors={**components.factors, **prior.factors})
            updates += 1
            covariance, step, gain = _step(state, components)
        before = state.objective(components)
        trial = linear_at(*_moved(state.at, step))
        while not trial.objective(components) <= before * (1.0 + 1e-6) + ALLOWED_RISE:
            rounds += 1
            if rounds >= MOST_ROUNDS:
                break
            step = step / 4.0
            trial = linear_at(*_moved(state.at, step))
        else:
            state = trial
            covariance, step, gain = _step(state, components)
        rounds += 1
    return Posterior(
        model=model,
        observations=observations,
        at=state.at,
        covariance=covariance,
        prior=state.precision(components.sizes),
        components=components,
        noise=state.noise,
        weights=state.weights(components.factors),
        kept=kept,
        has_converged=gain < NEAR_GAIN,
        rounds=rounds,
        measured=tuple(prior.lengths),
    )


def _step(state: LinearModel, components: Components) -> tuple[Array, Array, float]:
    """Return the posterior covariance, the Gauss-Newton step and its gain in χ²."""
    return state.solve(state.normal_equations(state.weights(components.factors)), components.sizes)


def _moved(at: Linearised, step: Array) -> tuple[Array, tuple[Transform, ...], Array]:
    """Return unknowns, frames and poses near by after a step (Q,)."""
    count = len(at.x)
    return at.x + step[:count], moved_frames(at.frames, step[count:]), at.assembly.unknowns


def _fixed_prior(
    model: ErrorModel, x: Array, frame_unknowns: int, prior: Prior
) -> tuple[Array, Array]:
    """Return the precision (Q, Q) of what is not learned, and the deviations (Q,) from its mean."""
    size, count = len(model.names), len(x)
    deviation = np.concatenate([x, np.zeros(frame_unknowns)])
    precision = np.zeros((len(deviation), len(deviation)))
    if prior.precision is not None and prior.mean is not None:
        precision[:size, :size] = prior.precision
        deviation[:size] -= prior.mean
    else:
        learned = {place for places in model.learned.values() for place in places.tolist()}
        free = [place for place in range(size) if place not in learned]
        precision[free, free] = 1.0
    changes = np.arange(size, count)
    precision[changes, changes] = 1.0
    for source, (value, std) in prior.lengths.items():
        place = model.names.index(source)
        tolerance = model.tolerance[place]
        precision[place, place] = (tolerance / std) ** 2
        deviation[place] = x[place] - value / tolerance
    return precision, deviation


def noise_parts(model: ErrorModel, observations: Observations, by_joint: Array) -> dict[str, Array]:
    """Return the parts of the noise: the tracker's, and the robot's scatter at its tolerance."""
    revolute = model.nominal.mechanism.joints[0].is_revolute
    joint = scatter_tolerance_of_joints(revolute=revolute)
    point = np.broadcast_to(SCATTER_TOLERANCE_MM**2 * np.eye(3), (len(observations), 3, 3))
    of_joints = joint**2 * by_joint @ by_joint.swapaxes(1, 2)
    return {**observations.noise, "points": point, "joints": of_joints}


def _with_substitutes(observations: Observations, kept: Mask) -> Observations:
    """Return observations whose unusable rows have another row's joints, so that all assemble."""
    if kept.all():
        return observations
    rows = np.where(kept, np.arange(len(kept)), int(np.argmax(kept)))
    return replace(observations, joints=observations.joints[rows], near=observations.near[rows])
