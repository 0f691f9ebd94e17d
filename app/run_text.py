"""Result of a run, for people and as a document."""

from typing import TypeAlias

from app.console import BAD, GOOD, WARNING, Terminal
from app.progress import interval
from app.run_screen import certainty
from campaigns.campaign import Campaign
from campaigns.measuring.session import RunResult
from campaigns.measuring.stopping_rule import in_words
from campaigns.measuring.work import Work
from campaigns.workflow.running import RunPreview
from drivers.values import Identity

SCATTER_SHOWN_MM = 0.005
"""Scatter of the robot's point above which it is named as a cause of a missed goal."""
DeviceIdentities: TypeAlias = tuple[Identity, Identity]
"""Controller and tracker that answer at the addresses of a cell."""


def serials(devices: DeviceIdentities) -> str:
    """Return the serial numbers of both devices, in words."""
    return "controller {}, tracker {}".format(*(device.serial for device in devices))


def briefing(campaign: Campaign, work: Work, preview: RunPreview, devices: DeviceIdentities) -> str:
    """Return the sentence before anything moves: `138 shots, about 6 min, 30 % speed, …`."""
    speed = campaign.config.controller.speed_percent
    return f"{preview_line(preview, work)}, {speed:g} % speed, {serials(devices)}"


def show_run(terminal: Terminal, ran: RunResult) -> None:
    """Print what was measured and what was not, and whether the goal is met."""
    terminal.say(f"measured: series {ran.series} has {_count(ran)}")
    for shots, reason in ran.skipped.items():
        terminal.say(f"not measured: {in_words(shots)}: {reason}", WARNING)
    if ran.settling is not None:
        terminal.say(ran.settling.text, "" if ran.settling.shots else WARNING)
    if ran.uncertainty is not None:
        terminal.say(f"after {ran.uncertainty.shots} shots: {certainty(ran.uncertainty)}")
    if ran.changed:
        terminal.say(f"not good: {ran.changed}", BAD)
    if ran.goal_mm is None:
        return
    if ran.reaches_goal:
        terminal.say(f"good: goal {ran.goal_mm:g} mm is met: {_reached(ran)}", GOOD)
    else:
        terminal.say(
            f"not good: goal {ran.goal_mm:g} mm is not met: {_reached(ran)}{_why(ran)}", BAD
        )


def preview_line(preview: RunPreview, work: Work) -> str:
    """Return what a run is about to do: `138 shots, about 6 min`, or what a series lacks."""
    shots = f"{len(preview.pending)} shots"
    if preview.series is not None:
        shots = (
            f"series {preview.series} has {preview.measured} of {preview.shots} shots, "
            f"{len(preview.pending)} are left"
        )
    skipped = f", {in_words(preview.skipped)} left out" if preview.skipped else ""
    goal = (
        "" if work.goal_mm is None else f", fewer once positions are known to {work.goal_mm:g} mm"
    )
    return f"{shots}{skipped}{goal}, about {interval((preview.seconds, preview.seconds))}"


def _count(ran: RunResult) -> str:
    skipped = sum(map(len, ran.skipped))
    missing = [
        f"{count} of the plan {word}"
        for count, word in ((ran.left_out, "were left out"), (skipped, "were skipped"))
        if count
    ]
    return "; ".join([f"{ran.shots} shots", *missing]) if missing else f"all {ran.shots} shots"


def _reached(ran: RunResult) -> str:
    if ran.uncertainty is None:
        return "the shots to identify from are too few"
    return (
        f"positions to ±{ran.uncertainty.position_std_mm:.3g} mm by {ran.uncertainty.shots} shots"
    )


def _why(ran: RunResult) -> str:
    """Return why σ is larger than predicted; "" if the robot's scatter is no reason."""
    # the forecast assumes the tracker's noise alone, of a robot that repeats perfectly
    if ran.uncertainty is None or ran.uncertainty.scatter_mm < SCATTER_SHOWN_MM:
        return ""
    return f"; robot repeatability ±{ran.uncertainty.scatter_mm:.2g} mm per axis"
