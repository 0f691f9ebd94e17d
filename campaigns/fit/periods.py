"""Periodic errors of drives: a scan over their periods, and what is found in the robot.

Theory of operation. A gear or screw repeats its error with a period, which may be unknown. The
scan asks at each rate how much likelier the shots are with a sine and a cosine of it, of one rate
in all joints or of a rate in one joint alone. What is likelier than no period becomes an effect
with its rate as an unknown (`effects.Ripple`). A robot file has ripples too: in the end the rates
that were found are the robot's own, and the amplitudes its parameters, so that all who use the
parameters correct for them.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.effects import Effect, RateError, Ripple
from campaigns.fit.error_model import ErrorModel
from campaigns.fit.error_sources import ARCSEC
from campaigns.fit.fit import Fit, log_factors_at_usual_size, settle
from campaigns.kinematics.model import Kinematics


@dataclass(frozen=True, slots=True, eq=False)
class PeriodScan:
    """Scan over the periods of drives: the log Bayes factor of each rate."""

    rates: Array
    """rad per rad or per mm of the joints, (R,)."""
    log_factors: Array
    """(R, 1 + k): of one rate in all arms that ripple, then of a rate in each of them alone."""

    @property
    def log_mean(self) -> float:
        """Log mean factor: half for a rate that all arms have, half for rates of single arms."""
        means = np.logaddexp.reduce(self.log_factors, axis=0) - np.log(len(self.rates))
        alone = np.logaddexp.reduce(means[1:]) - np.log(len(means) - 1)
        return float(np.logaddexp(means[0], alone) - np.log(2.0))


# Rates from 6 to 250 periods a turn of cranks, from 80 to 3 mm a period of carriages, so close that
# neighbouring rates differ by a quarter period over the joints' motion.
def scan_periods(fit: Fit) -> PeriodScan:
    """Return the factors of periodic errors of the joints by their rate."""
    mechanism = fit.model.nominal.mechanism
    if not len(mechanism.rippling):
        return PeriodScan(np.empty(0), np.empty((0, 1)))
    joints, low, high = fit.observations.joints[:, mechanism.rippling], 6.0, 250.0
    if not mechanism.rates_are_of_turns:
        low, high = 2.0 * np.pi / 80.0, 2.0 * np.pi / 3.0
    rates = np.arange(low, high, 0.5 * np.pi / np.ptp(joints, axis=0).max())
    return PeriodScan(rates, _factors_of_rates(fit, rates))


def _factors_of_rates(fit: Fit, rates: Array) -> Array:
    """Return the log Bayes factors (R, 1 + k) of sine and cosine of each rate."""
    rippling, white = fit.model.nominal.mechanism.rippling, fit.whitened
    joints = fit.observations.joints[:, rippling]
    count, arms, shots = len(rates), joints.shape[1], len(joints)
    by_joint = white.root @ (ripple_tolerance(fit.model) * fit.at.by_joint[..., rippling])
    explained = white.explained.T.reshape(shots, 3, -1)
    columns = np.empty((count, 2 * arms, 3 * shots))
    shared = np.empty((count, 2 * arms, explained.shape[2]))
    for arm in range(arms):
        phases = rates[:, None] * joints[:, arm]
        waves = np.stack([np.sin(phases), np.cos(phases)], axis=1)  # (R, 2, N)
        rows = slice(2 * arm, 2 * arm + 2)
        columns[:, rows] = (waves[..., None] * by_joint[:, :, arm]).reshape(count, 2, -1)
        by_unknowns = (by_joint[:, None, :, arm] @ explained)[:, 0]
        shared[:, rows] = (waves.reshape(-1, shots) @ by_unknowns).reshape(count, 2, -1)
    score = columns @ white.residual[:, None]
    information = columns @ columns.swapaxes(1, 2) - shared @ shared.swapaxes(1, 2)
    log_factors = [log_factors_at_usual_size(score, information)]
    for arm in range(arms):
        rows = slice(2 * arm, 2 * arm + 2)
        log_factors.append(log_factors_at_usual_size(score[:, rows], information[:, rows, rows]))
    return np.stack(log_factors, axis=1)


def ripple_tolerance(model: ErrorModel) -> float:
    """Return the usual amplitude of a ripple, rad or mm."""
    return 20 * ARCSEC if model.nominal.mechanism.rates_are_of_turns else 0.02


def likely_ripples(fit: Fit) -> Iterator[Ripple]:
    """Yield the likeliest periodic error, if any period is likelier than none."""
    result, rippling = scan_periods(fit), fit.model.nominal.mechanism.rippling.tolist()
    if not rippling or result.log_mean <= 0.0:
        return
    rates, arms = result.rates, len(rippling)
    means = np.logaddexp.reduce(result.log_factors, axis=0)
    means[1:] -= np.log(arms)
    best = int(means.argmax())
    step = float(rates[1] - rates[0])
    # the peak lies between the rates of the grid: look closer, and estimate the rate in the fit
    peak = float(rates[result.log_factors[:, best].argmax()])
    fine = peak + step * np.linspace(-1.0, 1.0, 21)
    rate = float(fine[_factors_of_rates(fit, fine)[:, best].argmax()])
    moved = tuple(rippling) if best == 0 else (rippling[best - 1],)
    odds = -np.log(2.0 * len(rates) * (1 if best == 0 else arms))
    yield Ripple(moved, rate, step, ripple_tolerance(fit.model), float(odds))


# Twice, since the rate is linearised at the amplitudes and the rate of the fit before.
def with_periods_of_robot(fit: Fit) -> Fit:
    """Return the fit of a robot that has the periods found as its own, with amplitudes to fit.

    A joint whose robot file states a rate keeps it: its second period stays an effect.
    """
    for _ in range(2):
        effects = tuple(_as_rate_errors(fit))
        of_robot = [effect for effect in effects if isinstance(effect, RateError)]
        if not of_robot:
            return fit
        mechanism = fit.model.nominal.mechanism
        rates = list(mechanism.rates)
        for effect in of_robot:
            for arm in effect.arms:
                rates[arm] = rate_in_file(effect.rate, is_revolute=mechanism.rates_are_of_turns)
        robot = Kinematics(mechanism.with_ripples(rates), fit.model.nominal.p)
        fit = settle(fit, fit.model.with_robot(robot, effects))
    return fit


def _as_rate_errors(fit: Fit) -> Iterator[Effect]:
    """Yield the effects, those periods that can be the robot's own as errors of their rates."""
    taken = {arm for arm, rate in enumerate(fit.model.nominal.mechanism.rates) if rate}
    for effect, where in zip(fit.model.effects, fit.model.effect_places, strict=True):
        z = fit.at.x[where]
        if isinstance(effect, Ripple) and not taken & {*effect.arms}:
            taken |= {*effect.arms}
            amplitudes = tuple((effect.usual * z[:-1]).tolist())
            rate = effect.rate + effect.rate_std * float(z[-1])
            yield RateError(effect.arms, rate, effect.rate_std, amplitudes, effect.log_odds)
        elif isinstance(effect, RateError):
            rate = effect.rate + effect.rate_std * float(z[0])
            yield replace(effect, rate=rate, amplitudes=_amplitudes(fit, effect.arms))
        else:
            yield effect


def _amplitudes(fit: Fit, arms: tuple[int, ...]) -> tuple[float, ...]:
    """Return sine and cosine of the ripples of these arms, rad or mm."""
    values = fit.x * fit.model.tolerance
    return tuple(values[places_of_ripples(fit.model, arms)].tolist())


def places_of_ripples(model: ErrorModel, arms: tuple[int, ...]) -> list[int]:
    """Return the places of sine and cosine of the ripples of these arms among the unknowns."""
    unit = "deg" if model.nominal.mechanism.rates_are_of_turns else "mm"
    names = (f"arm{arm}.ripple_{wave}_{unit}" for arm in arms for wave in ("sin", "cos"))
    return [model.names.index(name) for name in names]


def rate_in_file(rate: float, *, is_revolute: bool) -> float:
    """Return a rate in the unit of robot files: periods a turn of cranks, mm a period of rails."""
    return rate if is_revolute else 2.0 * float(np.pi) / rate
