"""The numbers a run keeps to, from the campaign's settings."""

from dataclasses import dataclass
from math import dist

from campaigns.settings.config import CampaignConfig

POLL_S = 0.02


@dataclass(frozen=True, slots=True)
class MotionRules:
    """How the robot is moved and when it counts as standing in place."""

    speed_fraction: float
    settle_s: float
    still_rad: float
    in_place_rad: float
    timeout_s: float
    poll_s: float = POLL_S


@dataclass(frozen=True, slots=True)
class GateRules:
    """What a shot must keep to count, and how often it may be tried."""

    distance_mm: float
    fitted_mm: float
    temperature_change_degC: float
    drift_mm: float
    attempts: int
    search_mm: float
    """How far from the tracker to search while the robot's place is not known to it."""
    look_back_s: float = 60.0
    """How long a reflector that was never seen at a pose is waited for there."""


def motion_rules(config: CampaignConfig) -> MotionRules:
    """From `controller` and `settle`."""
    return MotionRules(
        config.controller.speed_percent / 100.0,
        config.settle.time_s,
        config.settle.still_rad,
        config.settle.in_place_rad,
        config.settle.timeout_s,
    )


def gate_rules(config: CampaignConfig) -> GateRules:
    """From `gate` and `run`, and the rough places of tracker and workspace."""
    gate = config.gate
    return GateRules(
        gate.distance_mm,
        gate.fitted_mm,
        gate.temperature_change_degC,
        gate.drift_mm,
        gate.attempts,
        search_mm=dist(config.tracker.place_mm, config.validation.centre_mm),
        look_back_s=config.run.look_back_s,
    )
