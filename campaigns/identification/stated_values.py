"""Values and σ that a result states of a fit, whatever was observed."""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.effects import RateError
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.fit import Fit
from campaigns.fit.uncertainty import NullDirections
from campaigns.identification import findings
from campaigns.identification.result import (
    IdentifiedParameter,
    ParameterCovariance,
    Scatter,
    identified_parameters,
)
from campaigns.kinematics.model import Kinematics


@dataclass(frozen=True, slots=True, eq=False)
class StatedValues:
    """Nominal robot, from which the values of a fit are stated."""

    nominal: Kinematics

    def parameters(
        self, fit: Fit, null: NullDirections, stated: Array
    ) -> dict[str, IdentifiedParameter]:
        """Return the parameters by name, stated (P,) in tolerances, with σ in the datum."""
        # Unknowns are deviations from nominal in tolerances; file_tolerance makes them mm, deg or
        # ppm. A variance of nothing but rounding is a parameter that is undetermined by itself.
        model, old = fit.model, self.nominal.parameters
        variances = np.diag(self.stated_covariance(fit, null)).tolist()
        deviations = (stated * model.file_tolerance).tolist()
        fitted = {}
        for place, name in enumerate(model.parameters):
            std = max(variances[place], 0.0) ** 0.5 * float(model.file_tolerance[place])
            value = old.get(name, 0.0) + deviations[place]
            fitted[name] = (value, std if variances[place] > 1e-12 else None)
        return identified_parameters(self.nominal, fitted)

    def rates(self, fit: Fit) -> dict[str, IdentifiedParameter]:
        """Return the rates of periodic errors that were found, where the robot file states none."""
        mechanism, nominal = fit.model.nominal.mechanism, self.nominal.mechanism
        if mechanism.rates == nominal.rates:
            return {}
        std: dict[int, float] = {}
        for effect, where in zip(fit.model.effects, fit.model.effect_places, strict=True):
            if isinstance(effect, RateError):
                relative = effect.rate_std * fit.covariance[where, where][0, 0] ** 0.5 / effect.rate
                std |= {arm: float(relative) * mechanism.rates[arm] for arm in effect.arms}
        table, before = mechanism.parameters, nominal.parameters.named_rates(nominal.rates)
        arms = {name: arm for arm, name in enumerate(table.rates)}
        return {
            name: IdentifiedParameter(
                nominal=before.get(name, 0.0),
                value=rate,
                std=std.get(arms.get(name, min(std, default=0))),
                free=True,
                group="ripple",
            )
            for name, rate in table.named_rates(mechanism.rates).items()
        }

    def stated_covariance(self, fit: Fit, null: NullDirections) -> Array:
        """Return the covariance (P, P) of the robot of today, in tolerances and the datum."""
        matrix, size = fit.model.of_today, fit.model.size
        return null.transform_covariance(matrix @ fit.covariance[:size, :size] @ matrix.T)

    def covariance(self, fit: Fit, null: NullDirections, ratio: float) -> ParameterCovariance:
        """Return the covariance of the robot's parameters in the units of files, in the datum."""
        model, table = fit.model, self.nominal.mechanism.parameters
        places = [n for n, name in enumerate(model.names) if name in table.of_robot]
        names = tuple(model.names[place] for place in places)
        tolerance = model.file_tolerance[places]
        matrix = self.stated_covariance(fit, null)[np.ix_(places, places)]
        matrix = matrix * np.outer(tolerance, tolerance)
        return ParameterCovariance(names, tuple(map(tuple, matrix.tolist())), ratio)

    def tracker(self, fit: Fit) -> dict[str, tuple[float, float]]:
        """Return value and 1 σ of each of the tracker's errors, in the unit it is shown in."""
        values = (fit.model.file_tolerance * fit.x).tolist()
        std = (fit.model.file_tolerance * fit.std).tolist()
        rows = zip(fit.model.names, values, std, strict=True)
        return {name: (value, sigma) for name, value, sigma in rows if name in TRACKER_SOURCES}

    def scatter(self, fit: Fit) -> Scatter:
        """Return the scatter of the robot's point and joints, and of the instrument."""
        # Factors multiply variances: their roots multiply σ of the data sheet.
        factors, joints = fit.factors, self.nominal.mechanism.joints
        point, joint = fit.scatter
        joint = joints[0].to_file(joint)
        of_instrument: dict[str, float] = {
            part: factors[part] ** 0.5 for part in ("along", "across") if part in factors
        }
        shown = findings.scatter_in_words(fit)
        says = (
            f"robot repeatability: {point:.3g} mm per axis, {shown} per joint (1 σ), included in σ"
        )
        if of_instrument:
            values = ", ".join(f"{value:.2g} × {part}" for part, value in of_instrument.items())
            says = (
                f"the file states no σ of points: noise estimated, {values} the beam of the data "
                f"sheet's; robot repeatability {point:.3g} mm per axis, {shown} per joint (1 σ)"
            )
        return Scatter(point, joint, of_instrument, says)
