"""Result of a run, for people and as a document."""

from dataclasses import dataclass

from app.console import BAD, GOOD, Terminal
from app.progress import interval
from campaigns.campaign import Campaign
from campaigns.chain.running import ToMeasure
from campaigns.measuring.run_state import ParameterPrecision
from campaigns.measuring.session import RunResult, Work
from campaigns.planning.plan_check import CheckedPlan
from drivers.values import Identity


@dataclass(frozen=True, slots=True)
class DeviceIdentities:
    """Who answers at both addresses of a cell."""

    controller: Identity
    tracker: Identity

    def __str__(self) -> str:
        return f"controller {self.controller.serial}, tracker {self.tracker.serial}"


@dataclass(frozen=True, slots=True)
class Briefing:
    """What a run says before anything moves."""

    campaign: Campaign
    checked: CheckedPlan
    work: Work
    todo: ToMeasure

    def text(self, devices: DeviceIdentities) -> str:
        """Shots, time, speed and devices: `138 shots, about 6 min, 30 % speed, controller …`."""
        todo, total = self.todo, len(self.checked.shots)
        seconds = self.checked.seconds * todo.left / max(total, 1)
        shots = f"{todo.left} shots"
        if todo.series is not None:
            shots = f"series {todo.series} has {todo.there} of {total} shots, {todo.left} are left"
        goal = "" if self.work.goal is None else f", fewer once {self.work.goal} is met"
        return (
            f"{shots}{goal}, about {interval((seconds, seconds))}, "
            f"{self.campaign.config.controller.speed_percent:g} % speed, {devices}"
        )


def show_run(terminal: Terminal, ran: RunResult) -> None:
    """Say what was measured, and whether the goal is met."""
    terminal.say(f"measured: series {ran.series} has {_count(ran)}")
    if ran.goal is None:
        return
    if ran.good:
        terminal.say(f"good: goal {ran.goal} is met: {_reached(ran)}", GOOD)
    else:
        terminal.say(f"not good: goal {ran.goal} is not met: {_reached(ran)}{_why(ran)}", BAD)


def run_document(ran: RunResult) -> dict[str, object]:
    """What `--json` prints."""
    goal = ran.goal and {
        "std_mm": ran.goal.std_mm,
        "met": ran.good,
        "reached_mm": ran.known and ran.known.length_std_mm,
        "left_out": ran.left_out,
    }
    return {
        "series": ran.series,
        "shots": ran.shots,
        "goal": goal,
        "knowledge": ran.known and knowledge(ran.known),
    }


def knowledge(known: ParameterPrecision) -> dict[str, object]:
    """Precision of the parameters, as a part of a document."""
    return {
        "shots": known.shots,
        "weakest": known.weakest,
        "std": known.weakest_std,
        "unit": known.unit,
        "length_std_mm": known.length_std_mm,
        "position_std_mm": known.position_std_mm,
        "scatter": known.scatter,
        "scale": known.scale,
    }


def _count(ran: RunResult) -> str:
    if ran.left_out == 0:
        return f"all {ran.shots} shots"
    return f"{ran.shots} shots; {ran.left_out} of the plan were left out"


def _reached(ran: RunResult) -> str:
    if ran.known is None:
        return "the shots to identify from are too few, or cannot tell all parameters apart"
    std_mm, shots = ran.known.length_std_mm, ran.known.shots
    return f"the worst length is known to ±{std_mm:.3g} mm by {shots} shots"


def _why(ran: RunResult) -> str:
    """What made σ larger than it was predicted."""
    if ran.known is None or ran.known.scale <= 1.0:
        return ""
    return f", which scatter {ran.known.scatter:.2g} times what the tracker states"
