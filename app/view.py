"""How the tracker sees the robot, as the campaign's settings say. Light: no engine is imported."""

from app.folder import Campaign
from campaigns.numerics.instrument import TrackerUncertainty
from campaigns.planning.plans import View
from campaigns.settings.config import CampaignConfig
from drivers.values import Pose, Vector3


def centre_of(campaign: Campaign) -> Pose:
    """The workspace's centre: where drift is watched and detours lead."""
    return Pose(*campaign.config.validation.centre_mm, theta_rad=0.0)


def view_of(campaign: Campaign) -> View:
    """How the tracker sees the reflector."""
    tracker = campaign.config.tracker
    centre = campaign.config.validation.centre_mm
    facing = tracker.reflector_facing or _towards(centre, tracker.place_mm)
    return View(tracker.place_mm, facing, tracker.acceptance_rad)


def tracker_uncertainty_of(config: CampaignConfig) -> TrackerUncertainty:
    """The tracker's standard uncertainty, by the limits that campaign.yaml has of its data sheet.

    For plans, and for shots of which the tracker itself stated none.
    """
    limits = config.tracker.uncertainty
    return TrackerUncertainty.of_limits(
        limits.along_um, limits.along_um_per_m, limits.across_um, limits.across_um_per_m
    )


def _towards(from_mm: Vector3, to_mm: Vector3) -> Vector3:
    x, y, z = (b - a for a, b in zip(from_mm, to_mm, strict=True))
    return x, y, z
