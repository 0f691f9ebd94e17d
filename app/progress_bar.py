"""A run on the terminal: shots k/N, time left, residual, beam, drift, what is known."""

from collections.abc import Callable
from types import TracebackType

from rich.console import Console, Group
from rich.text import Text

from app.live_picture import LivePicture, bar_row, interval
from campaigns.measuring.progress import EngineState, Known, Progress


class RunDisplay(LivePicture):
    """A live bar on a terminal; now and then a line where there is none. A `Watcher`.

    `verbose` tells every state of every shot.
    """

    def __init__(
        self, console: Console, title: str, *, now_s: Callable[[], float], verbose: bool
    ) -> None:
        super().__init__(console, now_s=now_s)
        self._title = title
        self._verbose = verbose
        self._progress: Progress | None = None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        super().__exit__(kind, error, trace)
        if self._progress is None:
            return
        for line in (summary(self._progress), *_known(self._progress)):
            self.say(f"{self._title}: {line}")

    def progress(self, progress: Progress) -> None:
        """The run has moved on."""
        self._progress = progress
        if self._verbose:
            self.say(f"{progress.done}/{progress.total} {news(progress)}")
        else:
            self.say_if_due(lambda: f"{self._title}: {_everything(progress)}")

    def event(self, text: str) -> None:
        """Something happened that the operator should read."""
        self.say(f"! {text}", "yellow")

    def _picture(self) -> Group | Text:
        """The bar, and lines below it that are cut rather than wrapped."""
        progress = self._progress
        if progress is None:
            return Text(f"{self._title}: connecting", style="dim")
        row = bar_row(self._title, progress.done, progress.total, counted(progress))
        style = "dim" if progress.beam_locked else "bold red"
        below = [(news(progress), style), *((line, "dim") for line in _knowledge(progress))]
        lines = [Text(text, style, no_wrap=True, overflow="ellipsis") for text, style in below]
        return Group(row, *lines)


def counted(progress: Progress) -> str:
    """How far it is: `97/163 · 3–5 min left`."""
    left = [] if progress.eta_s is None else [f"{interval(progress.eta_s)} left"]
    return " · ".join([f"{progress.done}/{progress.total}", *left])


def news(progress: Progress) -> str:
    """What goes on: state, last residual, drift, beam."""
    return " · ".join([_state(progress), *_figures(progress), _beam(progress)])


def summary(progress: Progress) -> str:
    """What was reached, when it is over."""
    shots = f"{progress.done} of {progress.total} shots"
    return " · ".join([shots, progress.state.value, *_figures(progress)])


def certainty(known: Known) -> str:
    """How surely the parameters are known: `weakest arm2.z_mm ±0.021 mm · position ±0.006 mm`."""
    std = f"{known.weakest_std:.3f} mm" if known.unit == "mm" else f"{known.weakest_std:.4f}°"
    return f"weakest {known.weakest} ±{std} · position ±{known.position_std_mm:.3f} mm"


def _everything(progress: Progress) -> str:
    return " · ".join([counted(progress), news(progress), *_knowledge(progress)])


def _figures(progress: Progress) -> list[str]:
    figures = (("residual", progress.residual_mm), ("drift", progress.drift_mm))
    return [f"{name} {value:.3f} mm" for name, value in figures if value is not None]


def _knowledge(progress: Progress) -> list[str]:
    """A line of what shall be known and what is; none where there is nothing to say of it."""
    told = [*_goal(progress), *_known(progress)]
    return [" · ".join(told)] if told else []


def _known(progress: Progress) -> list[str]:
    return [] if progress.known is None else [certainty(progress.known)]


def _goal(progress: Progress) -> list[str]:
    if progress.goal_mm is None:
        return []
    now = "not yet known" if progress.known is None else f"{progress.known.length_std_mm:.3g}"
    return [f"goal σ={progress.goal_mm:g}: {now}"]


def _beam(progress: Progress) -> str:
    return "beam ok" if progress.beam_locked else "BEAM LOST"


def _state(progress: Progress) -> str:
    if progress.shot is None or progress.state in (EngineState.FINISHED, EngineState.STOPPED):
        return progress.state.value
    return f"{progress.state.value} {progress.purpose} {progress.shot}"
