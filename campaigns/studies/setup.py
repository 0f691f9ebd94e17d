"""What goes into a study: shots, robots, noise; and what comes out of each of its campaigns."""

import hashlib
from dataclasses import dataclass

import numpy as np

from campaigns.estimators import Estimator
from campaigns.numerics.frames import Transform
from campaigns.numerics.geometry import Array, Geometry, Index
from campaigns.numerics.instrument import TrackerUncertainty
from campaigns.version import VERSION


@dataclass(frozen=True, slots=True, eq=False)
class PairedShots:
    """Joints (N, 4) of a plan's shots, and which rows are pairs, (M, 2)."""

    joints_rad: Array
    pairs: Index


@dataclass(frozen=True, slots=True, eq=False)
class StudySetup:
    """What all campaigns of a study share."""

    nominal: Geometry
    free: tuple[str, ...]
    estimator: Estimator
    fitted: PairedShots
    unseen: PairedShots
    tracker_from_base: Transform
    uncertainty: TrackerUncertainty
    seed: int

    @property
    def dof(self) -> int:
        """Numbers measured less numbers sought; of points three a shot, and a frame's six more."""
        if self.estimator is Estimator.POINTS:
            return 3 * len(self.fitted.joints_rad) - len(self.free) - 6
        return len(self.fitted.pairs) - len(self.free)

    def digest(self, truth: str) -> str:
        """Twelve characters that differ between studies; `truth` says how robots are drawn."""
        parts = [self.nominal.vector(), self.tracker_from_base.rotation]
        parts += [self.tracker_from_base.translation_mm]
        for shots in (self.fitted, self.unseen):
            parts += [shots.joints_rad, shots.pairs.astype(np.float64)]
        settings = (truth, self.free, self.estimator.value, self.uncertainty, self.seed)
        text = repr((*settings, VERSION))  # another version may find other numbers
        hashed = hashlib.sha256(text.encode("utf-8"))
        for part in parts:
            hashed.update(np.ascontiguousarray(part).tobytes())
        return hashed.hexdigest()[:12]


@dataclass(frozen=True, slots=True, eq=False)
class StudyTask:
    """Some campaigns of a study, and the true parameters of each as rows, mm and rad."""

    setup: StudySetup
    numbers: tuple[int, ...]
    truths: Array


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What one campaign found of the free parameters, in file units (mm, deg): it is to be read."""

    errors: Array
    """Identified minus true, (F,)."""
    std: Array
    """As the estimator states it, (F,)."""
    bound: Array
    """The least standard deviation that its data allow (Cramér and Rao), at the truth, (F,)."""
    unseen_mean_mm: float
    """Of the errors of distances never fitted, against the true robot; NaN without such pairs."""
    unseen_max_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class CampaignOutcome:
    """An estimate, or why there is none."""

    number: int
    estimate: Estimate | None
    failure: str
