"""Screen of a run: what the operator at the robot reads."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from statistics import median

from rich.console import Group
from rich.text import Text

from campaigns.measuring.run_state import EngineState, PositionUncertainty, Progress
from drivers.texts import printable

GOOD, BAD, OPEN, QUIET = "bold green", "bold red", "bold yellow", "dim"
KEYS = "p pause · s skip this shot · r the last again · k park · q stop"
GO_ON = "p goes on · q stop"
STOP_KEY = "q"
ANSWERS = {
    "p": "p: it pauses after this pair",
    "s": "s: this shot is skipped, unless it is measured already",
    "r": "r: the last shot, of a pair the pair, is measured again after this pair",
    "k": "k: it parks after this pair",
    STOP_KEY: "q: it stops",
}
ANSWERS_IN_PAUSE = {
    "p": "p: it goes on",
    "s": "s: no shot is being taken",
    STOP_KEY: ANSWERS[STOP_KEY],
}
LONGEST_BAR = 60
SKIP_AFTER_S = 10.0
"""Search for a reflector after which it is said how to leave the shot out."""
LARGE = 3.0
"""Times the usual residual from which one is named as large."""
FEWEST_RESIDUALS = 5
LONG_S = 120.0
WORDS = {
    EngineState.IDLE: "between two shots",
    EngineState.MOVING: "moving to",
    EngineState.SETTLING: "settling at",
    EngineState.MEASURING: "measuring",
    EngineState.SUSPENDED: "trying again:",
    EngineState.STOPPED: "stopped",
    EngineState.FINISHED: "finished",
}
WITHOUT_SHOT = {EngineState.IDLE, EngineState.STOPPED, EngineState.FINISHED}


def run_screen(
    title: str,
    progress: Progress | None,
    residuals_mm: Sequence[float],
    events: Sequence[str],
    now: datetime,
    size: tuple[int, int],
    answer: str = "",
) -> Group:
    """Screen of so many columns and rows: state, what is left, whether it is good, events.

    `answer` is to the key that was pressed last.
    """
    if progress is None:
        return Group(Text(f"{title}: connecting", OPEN))
    state, style = state_of(progress)
    lines = [
        Text(f"{title}: {state}", style),
        Text(shots_and_end(progress, now)),
        *(Text(text, QUIET) for text in figures(progress, residuals_mm)),
        *(Text(printable(text), OPEN) for text in what_to_do(progress)),
    ]
    width, height = size
    long = min(width, LONGEST_BAR)
    filled = long * progress.done // max(progress.total, 1)
    bar = Text.assemble(("━" * filled, "green"), ("━" * (long - filled), QUIET))
    keys = Text(GO_ON if progress.state is EngineState.PAUSED else KEYS, "reverse")
    left = max(height - len(lines) - 6, 0)
    news = [Text(printable(text), "yellow") for text in events[-left:]] if left else []
    return Group(lines[0], bar, *lines[1:], Text(), keys, Text(answer, OPEN), *news)


def answer_to(key: str, state: EngineState | None) -> str:
    """What comes of a key, said at once; what did come of it is an event."""
    paused = state is EngineState.PAUSED
    if paused and key in ANSWERS:
        return ANSWERS_IN_PAUSE.get(key, f"{key}: when it goes on")
    return ANSWERS.get(key, f"{printable(key)}: no such key")


def state_of(progress: Progress) -> tuple[str, str]:
    """State in words, and its colour."""
    if not progress.beam_locked:
        lost = f" {_lasted(progress.beam_lost_s)} ago" if progress.beam_lost_s else ""
        return f"the tracker lost the beam{lost}", BAD
    if progress.state is EngineState.PAUSED:
        return "paused, the robot stands still", OPEN
    words = WORDS[progress.state]
    if progress.state in WITHOUT_SHOT or progress.shot is None:
        return words, BAD if progress.state is EngineState.STOPPED else GOOD
    style = OPEN if progress.state is EngineState.SUSPENDED else GOOD
    return f"{words} shot {progress.shot} ({progress.purpose})", style


def shots_and_end(progress: Progress, now: datetime) -> str:
    """Shots and the end by the clock: `34 of 163 shots · 129 left · ends at 14:32`."""
    left = progress.total - progress.done
    told = f"{progress.done} of {progress.total} shots · {left} left"
    if progress.eta_s is None or not left:
        return told
    low, high = (f"{now + timedelta(seconds=s):%H:%M}" for s in progress.eta_s)
    return f"{told} · ends {f'at {low}' if low == high else f'between {low} and {high}'}"


def figures(progress: Progress, residuals_mm: Sequence[float]) -> Iterator[str]:
    """Yield the last residual and whether it is good, drift, uncertainty and the goal."""
    told = []
    if progress.residual_mm is not None:
        told.append(f"last residual {progress.residual_mm:.3f} mm{_judged(residuals_mm)}")
    if progress.drift_mm is not None:
        told.append(f"drift {progress.drift_mm:.3f} mm")
    if told:
        yield " · ".join(told)
    if progress.known is not None:
        yield certainty(progress.known)
    if progress.goal_mm is not None:
        known = progress.known
        reached = "not known yet" if known is None else f"±{known.position_std_mm:.3f} mm"
        yield f"goal: positions to ±{progress.goal_mm:g} mm, now {reached}"


def certainty(known: PositionUncertainty) -> str:
    """Return `positions ±0.006 mm (1 σ) · weakest length arm2.z_mm ±0.021 mm`."""
    positions = f"positions ±{known.position_std_mm:.3f} mm (1 σ)"
    if not known.weakest:
        return positions
    return f"{positions} · weakest length {known.weakest} ±{known.weakest_std_mm:.3f} mm"


def what_to_do(progress: Progress) -> Iterable[str]:
    """What the operator can do now; nothing while all is well."""
    if progress.beam_advice:
        yield progress.beam_advice
    if not progress.beam_locked and progress.beam_lost_s >= SKIP_AFTER_S:
        yield "s skips this shot"


def _judged(residuals_mm: Sequence[float]) -> str:
    """Whether the last residual is as the others are; nothing said of the first few."""
    *before, last = residuals_mm or (0.0,)
    if len(before) < FEWEST_RESIDUALS:
        return ""
    usual = median(before)
    return ": good" if last <= LARGE * usual else f": large, {usual:.3f} mm is usual"


def _lasted(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < LONG_S else f"{seconds / 60.0:.0f} min"
