"""Options of an identification: how the shots are to be understood."""

from dataclasses import dataclass, field

from campaigns.arrays import Array
from campaigns.estimation.estimators import Estimator, Outliers
from campaigns.estimation.robust import Loss
from campaigns.estimation.tracker_noise import TrackerUncertainty


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class IdentificationOptions:
    """Estimator, treatment of outliers, and what stands in where the tracker stated nothing."""

    estimator: Estimator = Estimator.POINTS
    loss: Loss = field(default_factory=Loss)
    outliers: Outliers = Outliers.EXCLUDE
    instrument: TrackerUncertainty = field(default_factory=TrackerUncertainty)
    """Of shots of which the tracker stated nothing."""
    workspace: Array | None = None
    """Poses (N, t) at which the position's uncertainty is asked for."""
