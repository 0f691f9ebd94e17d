"""Options of an identification: how the shots are to be understood."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from campaigns.arrays import Array
from campaigns.estimation.estimators import Estimator, Outliers, Weights
from campaigns.estimation.robust import Loss
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.robots.robot import Tolerance


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class IdentificationOptions:
    """Estimator, treatment of outliers, and what stands in where the tracker stated nothing."""

    estimator: Estimator = Estimator.POINTS
    loss: Loss = field(default_factory=Loss)
    outliers: Outliers = Outliers.EXCLUDE
    instrument: TrackerUncertainty = field(default_factory=TrackerUncertainty)
    """Of shots of which the tracker stated nothing."""
    weights: Weights = Weights.STATED
    """Of distances; points are always weighed."""
    tolerance: Tolerance = field(default_factory=Tolerance)
    accepted: frozenset[str] = frozenset()
    """Names of doubts with which a result is taken all the same."""
    sessions: Mapping[int, int] | None = None
    """Session of each shot by its number, each with a frame of its own; None: one for all."""
    limits_mm: Mapping[str, float] = field(default_factory=dict)
    """Acceptance limits of distances, `mean` and `max`, as far as any are asked for."""
    workspace: Array | None = None
    """Poses (N, t) at which the position's uncertainty is asked for."""
