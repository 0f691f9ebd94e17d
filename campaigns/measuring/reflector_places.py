"""Places of reflectors on the platform, and where they are expected by a fit of the robot's own.

Objects of campaign.yaml may say that a reflector sits elsewhere on the platform: on the other half
of a plate, or beside the tool. Its point is that of its part by the same parameters, and beyond it
its place there, less the place of the robot's own reflector, which the tracker's frame has taken
up: as stated, and from the first shot on as its shots show it. The mean of them is taken with the
uncertainty of one prediction, since the errors of the robot that predicts them are theirs in
common.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.rigid_transforms import Transform
from campaigns.identification.objects import Object
from campaigns.journal.records import Outcome
from campaigns.kinematics.model import Kinematics
from drivers.values import Vector3, vector

UNKNOWN_MM = 1e3
"""1 σ of a place of which nothing is stated."""


def place_of(carrier: Object) -> tuple[Vector3, float]:
    """Return the place of a reflector on its part and 1 σ of each coordinate, mm.

    Raise `OptionsInvalid` for one that is stated without its σ.
    """
    place_mm, stds_mm = carrier.stated("place") or ((0.0, 0.0, 0.0), (UNKNOWN_MM,))
    return vector(place_mm), stds_mm[0]


def seen_at(nominal: Kinematics, carrier: Object) -> Kinematics:
    """Return a robot with the measured point on the part of a carrier, at the part's own point.

    Raise `ValueError` for a part that the platform does not have.
    """
    mechanism = nominal.mechanism.body(carrier.part)
    if carrier.part is None:
        mechanism = mechanism.placed(nominal.p, None, (0.0, 0.0, 0.0))
    return replace(nominal, mechanism=mechanism)


@dataclass(frozen=True, eq=False)
class PlacedReflector:
    """Reflector elsewhere on the platform, with what predicts it."""

    model: ErrorModel
    """Model of the robot's errors, of its own reflector."""
    carrier: Object
    """What carries it."""

    @cached_property
    def _of_part(self) -> ErrorModel:
        """Model with the same unknowns, of the point on its part."""
        return replace(self.model, nominal=seen_at(self.model.nominal, self.carrier))

    def place(
        self, x: Array, frame: Transform, covariance: Array, shots: Sequence[Outcome]
    ) -> tuple[Array, float]:
        """Return its place (3,) beyond the robot's own reflector's, and σ of a coordinate, mm.

        By unknowns `x` (P,), the frame and their covariance (P + 6, P + 6), and by its own shots.
        """
        stated_mm, variance = self._beyond_own(covariance)
        joints = np.array([shot.joints for shot in shots])
        at = self._on_part(x, frame, covariance, joints) if len(joints) else None
        if at is None or not at.is_solved.any():
            return stated_mm, float(np.sqrt(variance))
        away = np.array([shot.point_in_tracker_mm for shot in shots]) - at.points
        seen_mm = (away[:, None] @ at.axes)[at.is_solved, 0].mean(axis=0)
        by_shots = float(at.squares[at.is_solved].mean()) / len(stated_mm)
        share = variance / (variance + by_shots)
        return stated_mm + share * (seen_mm - stated_mm), float(np.sqrt(share * by_shots))

    # The frame that is fitted to shots of the robot's own reflector takes up its place on its part.
    def _beyond_own(self, covariance: Array) -> tuple[Array, float]:
        """Return the stated place beyond the robot's own (3,), and the variance of a coordinate."""
        nominal = self.model.nominal
        own_mm, by_own = nominal.mechanism.reflector_in_frames(nominal.whole_p)
        rows = self.model.columns_of(by_own[None])[0]
        of_own = rows @ covariance[: rows.shape[1], : rows.shape[1]] @ rows.T
        stated_mm, std_mm = place_of(self.carrier)
        place_mm = np.asarray(np.array(stated_mm) - own_mm)
        return place_mm, std_mm**2 + float(np.trace(of_own)) / len(place_mm)

    def predict(
        self,
        x: Array,
        frame: Transform,
        covariance: Array,
        place: tuple[Array, float],
        joints: tuple[float, ...],
    ) -> tuple[Array, float] | None:
        """Return its point (3,) at joints and the root of its summed variances, mm; None: nowhere.

        `place` is that of `place`, the other arguments as there.
        """
        at = self._on_part(x, frame, covariance, np.array([joints]))
        if not at.is_solved[0]:
            return None
        place_mm, std_mm = place
        square = float(at.squares[0]) + len(place_mm) * std_mm**2
        return np.asarray(at.points[0] + at.axes[0] @ place_mm), float(np.sqrt(square))

    def _on_part(self, x: Array, frame: Transform, covariance: Array, joints: Array) -> "_OnPart":
        """Predict the part's own point at joints (N, n)."""
        model = self._of_part
        with np.errstate(all="ignore"):  # at joints that no pose fits, the numbers overflow
            near = model.kinematics(x).forward(joints).values
            observations = Observations.unmeasured(joints, near)
            at = model.predict(x, (frame,), observations, near)
            squares = np.einsum("nij,jk,nik->n", at.jacobian, covariance, at.jacobian)
        axes = np.tile(np.eye(3), (len(joints), 1, 1))  # halves keep their orientation
        if self.carrier.part is None:
            axes = model.nominal.mechanism.tool_axes(at.assembly.poses)
        turned = np.asarray(frame.rotation @ axes)
        points = np.asarray(observations.points + at.residual)
        return _OnPart(points, turned, np.asarray(squares), at.assembly.is_solved)


@dataclass(frozen=True, slots=True, eq=False)
class _OnPart:
    """Part of the platform at N joint readings, in the tracker's frame."""

    points: Array
    """Its own point, (N, 3), mm."""
    axes: Array
    """Its axes, (N, 3, 3)."""
    squares: Array
    """Summed variances of the point's coordinates, (N,), mm²."""
    is_solved: Mask
