"""Stands of the tracker about the robot: what a plan's shots would tell from each of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.design.pose_sampling import incidence_rad
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.estimation.information import WorkspaceSample
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import View, poses_of
from campaigns.planning.predicted_uncertainty import EstimationSetup, predicted_uncertainty
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Vector3

DISTANCES_MM = (1500.0, 2000.0, 2500.0, 3000.0, 4000.0, 6000.0)
"""Of stands from the workspace's centre, along the ground."""
DIRECTIONS_DEG = tuple(range(0, 360, 15))
"""From the base's x axis to y."""


@dataclass(frozen=True, slots=True)
class Stand:
    """Stand of the tracker, and what the plan tells from there."""

    direction_deg: float
    distance_mm: float
    place_mm: Vector3
    unseen: int
    """Shots of the robot that cannot be seen from there: turned away, or behind a zone."""
    position_std_mm: float
    """Largest standard uncertainty of a position in the workspace by the shots that are seen."""


def compare_stands(
    shots: Sequence[PlannedShot],
    kinematics: Kinematics,
    view: View,
    places_mm: Array,
    facing: Vector3 | None,
    space: RestrictedSpace,
    setup: EstimationSetup,
    sample: WorkspaceSample,
    centre_mm: Array,
) -> tuple[Stand, ...]:
    """Stands at places (N, 3) in the base frame; `facing` None: the reflector is turned to each."""
    points = poses_of(shots)[:, :3]
    own = np.array([not shot.nest for shot in shots])
    found = []
    for place in places_mm:
        axis = np.array(facing) if facing else place - centre_mm
        seen = _seen(points, place, axis, view.acceptance_rad, space)
        pairs_left = _whole_pairs(shots, seen)
        std_mm = np.inf
        if any(shot.purpose is ShotSet.IDENTIFICATION for shot in pairs_left):
            predicted, _ = predicted_uncertainty(pairs_left, kinematics, place, setup)
            std_mm = float(predicted.of_positions(sample).max())
        x, y, z = place.tolist()
        away = place[:2] - centre_mm[:2]
        direction = float(np.round(np.degrees(np.arctan2(away[1], away[0])), 6) % 360.0)
        distance = float(np.linalg.norm(away))
        found.append(Stand(direction, distance, (x, y, z), int((own & ~seen).sum()), std_mm))
    return tuple(found)


def places_about(centre_mm: Array, height_mm: float) -> Array:
    """Places (N, 3) about the workspace's centre, by direction, then by distance."""
    angles, distances = (
        each.ravel()
        for each in np.meshgrid(np.radians(DIRECTIONS_DEG), DISTANCES_MM, indexing="ij")
    )
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1) * distances[:, None]
    return np.column_stack([centre_mm[:2] + along, np.full(len(along), height_mm)])


def best_stand(stands: Sequence[Stand]) -> Stand:
    """Stand of the fewest shots unseen, and of those of the least standard uncertainty."""
    return min(stands, key=lambda stand: (stand.unseen, stand.position_std_mm))


def _seen(
    points: Array, place: Array, facing: Array, acceptance_rad: float, space: RestrictedSpace
) -> Mask:
    """Mask (N,) of the points to which the beam comes, past the zones to keep out of."""
    turned = incidence_rad(points, place, facing / np.linalg.norm(facing)) <= acceptance_rad
    out = tuple(zone for zone in space.zones if not zone.keeps_in)
    bare = replace(space, zones=out, plate_radius_mm=0.0, margin_mm=0.0)
    clear = bare.line_clearance_mm(np.broadcast_to(place, points.shape), points) >= 0.0
    return np.asarray(turned & clear.all(axis=1))


def _whole_pairs(shots: Sequence[PlannedShot], seen: Mask) -> tuple[PlannedShot, ...]:
    """Shots that are seen, and whose partner is."""
    lost = {shot.pair for shot, is_seen in zip(shots, seen, strict=True) if not is_seen}
    return tuple(
        shot
        for shot, is_seen in zip(shots, seen, strict=True)
        if is_seen and (shot.pair is None or shot.pair not in lost)
    )
