"""An identification on the terminal."""

from collections.abc import Iterator

from app.console import BAD, GOOD, OPEN, WARNING, Terminal
from app.terminal_picture import histogram_lines
from campaigns.estimation.estimators import Estimator
from campaigns.identification.result import IdentificationResult
from campaigns.mechanisms.geometry import AXIS_TILT_NAMES
from campaigns.robots.robot import NOT_FOR_CONTROLLERS

CORRELATIONS = 5
"""So many of the strongest are shown."""


def show(terminal: Terminal, found: IdentificationResult) -> None:
    """The result for people: parameters, errors, what is uncertain, the verdict last."""
    columns = ("", "nominal", "identified", "Δ", "σ")
    terminal.table("Parameters (mm, deg)", columns, list(_parameter_rows(found)))
    columns = ("", "mean before", "after", "max before", "after")
    terminal.table("Errors (mm)", columns, list(_error_rows(found)))
    if found.compared:
        columns = ("", "parameters", "BIC", "unseen rms", "")
        terminal.table("Models (mm)", columns, list(_model_rows(found)))
    terminal.say(_remaining(found), "bold")
    for line in histogram_lines(found.fitted.after_mm.ravel().tolist()):
        terminal.say(f"  {line}")
    terminal.say("")
    for line in _uncertainty_lines(found):
        terminal.say(line)
    for line in _warnings(found):
        terminal.say(line, WARNING)
    terminal.say(f"verdict: {found.verdict}", {"pass": GOOD, "fail": BAD}.get(found.verdict, OPEN))
    for reason in found.reasons:
        terminal.say(f"  {reason}")
    if {parameter.name for parameter in found.parameters if parameter.free} & {*AXIS_TILT_NAMES}:
        terminal.say(NOT_FOR_CONTROLLERS, WARNING)


def _remaining(found: IdentificationResult) -> str:
    if found.request.estimator is Estimator.DISTANCES:
        return "What the model leaves of each fitted distance"
    return "What the model leaves of each fitted coordinate"


def _parameter_rows(found: IdentificationResult) -> Iterator[tuple[str, ...]]:
    for parameter in found.parameters:
        if parameter.free:
            yield (
                parameter.name,
                f"{parameter.nominal:.4f}",
                f"{parameter.value:.4f}",
                f"{parameter.delta:+.4f}",
                "-" if parameter.std is None else f"{parameter.std:.4f}",
            )


def _error_rows(found: IdentificationResult) -> Iterator[tuple[str, ...]]:
    distances = found.request.estimator is Estimator.DISTANCES
    fitted = "distances of fitted pairs" if distances else "positions of fitted shots"
    for name, errors in ((fitted, found.residuals), ("distances of unseen pairs", found.unseen)):
        if errors is not None:
            before, after = errors.before, errors.after
            sizes = (before.mean_abs, after.mean_abs, before.max_abs, after.max_abs)
            yield name, *(f"{size:.3f}" for size in sizes)


def _model_rows(found: IdentificationResult) -> Iterator[tuple[str, ...]]:
    for model in found.compared:
        yield (
            model.name,
            str(model.parameters),
            "-" if model.bic is None else f"{model.bic:.0f}",
            "-" if model.unseen_rms_mm is None else f"{model.unseen_rms_mm:.4f}",
            model.outcome,
        )


def _uncertainty_lines(found: IdentificationResult) -> Iterator[str]:
    yield (
        f"{found.explanation}; rank {found.rank}, condition {found.condition:.0f}, "
        f"{found.dof} degrees of freedom"
    )
    yield found.noise_in_words
    if found.position_std is not None:
        yield (
            f"predicted error of position (1 σ): {found.position_std.mean:.4f} mm on average over "
            f"the workspace, {found.position_std.max:.4f} mm at most"
        )
    for each in found.covariance.strong_correlations()[:CORRELATIONS]:
        yield f"  correlated: {each.first} and {each.second}, {each.value:+.2f}"


def _warnings(found: IdentificationResult) -> Iterator[str]:
    for left in found.excluded:
        yield f"left out: {left.what}: {left.reason}"
    for names in found.by_priors_alone:
        yield f"known by the priors alone: {', '.join(names)}"
