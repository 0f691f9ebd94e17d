"""Figures of an identification, for Python's users and for the report.

`plot` draws a result by a word. Some of its parts are drawn on the page too, beside what only a
campaign knows. Colours of before and after differ in brightness, so grey print keeps them apart.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from campaigns.arrays import Array
from campaigns.errors import OptionsInvalid, ShotsMissing
from campaigns.files.wording import suggestion

if TYPE_CHECKING:
    from campaigns.identification.result import (
        IdentificationResult,
        ParameterCovariance,
        ResidualTable,
    )

QUIET, BEFORE, AFTER = "#66727d", "#c98a3d", "#1f4e79"
LONGEST_ARROW = 1.0 / 8.0
"""Length of the longest arrow as a share of the larger side of the places that are drawn."""


def plot(result: "IdentificationResult", kind: str = "errors") -> Figure:
    """Return a figure of a result; raise `OptionsInvalid` or `ShotsMissing`.

    Args:
        result: The identification.
        kind: `"errors"`, the size of each error by number in the plan; `"space"`, errors as arrows
            in the workspace; `"correlations"` of the parameters; `"gain"`, the error of each pair
            before, after, and after on its own scale.
    """
    if kind not in FIGURES:
        raise OptionsInvalid(f"'{kind}' is no figure", remedy=suggestion(kind, FIGURES))
    return FIGURES[kind](result)


def draw_errors(result: "IdentificationResult") -> Figure:
    """Draw the errors of each shot and pair by the nominal and the identified robot, mm."""
    tables = ("fitted", result.residuals.fitted, "o"), ("hold-out", result.residuals.unseen, "x")
    figure = Figure(figsize=(8.0, 3.5), layout="constrained")
    axes = figure.add_subplot(yscale="log", ylabel="error, mm")
    for kind, table, marker in tables:
        if table is not None:
            for state, errors in (("before", table.before), ("after", table.after)):
                sizes, label = np.linalg.norm(errors, axis=1), f"{kind} {table.of}, {state}"
                axes.plot(table.numbers, sizes, marker, markersize=4, label=label)
    axes.set_xlabel("number in the plan")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def draw_space(result: "IdentificationResult") -> Figure:
    """Draw measured minus modelled positions of the fitted shots, in the base frame."""
    # Residuals are modelled minus measured in the tracker's axes, which may differ by session: row
    # by row they are turned into the axes of the base, and their sign is that of the page.
    fitted, modelled = result.residuals.fitted, result.residuals.modelled
    if fitted is None or modelled is None or fitted.of != "shots":
        raise ShotsMissing(
            "no positions were fitted", remedy="identify from shots, by the model 'full'"
        )
    poses = dict(zip(modelled.numbers, modelled.after, strict=True))
    places_mm = np.array([poses[number][:3] for number in fitted.numbers])
    turns = np.array([result.value.frame_of(n).rotation for n in fitted.numbers])
    figure = Figure(figsize=(8.0, 8.0), layout="constrained")
    for row, (stage, errors, colour) in enumerate(
        (("before", fitted.before, BEFORE), ("after", fitted.after, AFTER))
    ):
        errors_mm = -np.einsum("nij,ni->nj", turns, errors)
        factor = magnification(errors_mm, places_mm)
        for column, (view, axis) in enumerate((("from above", 1), ("from the side", 2)), start=1):
            axes = figure.add_subplot(2, 2, 2 * row + column)
            title = f"{stage}, {view}: arrows {factor:g} × error"
            axes.set(title=title, xlabel="x, mm", ylabel=f"{'xyz'[axis]}, mm")
            sides = [0, axis]
            draw_arrows(axes, places_mm[:, sides], factor * errors_mm[:, sides], colour)
    return figure


def draw_correlations(result: "IdentificationResult") -> Figure:
    """Draw |ρ| of every two lengths, places and offsets that the shots determine."""
    if (covariance := result.determined_covariance) is None:
        raise ShotsMissing(
            "fewer than two sizes of the robot were determined", remedy="free more of them"
        )
    figure = Figure(figsize=(6.0, 5.2))
    draw_correlation_map(figure, covariance)
    return figure


def draw_gain(result: "IdentificationResult") -> Figure:
    """Draw the error of every pair before and after, and after alone on its own scale, mm."""
    residuals = result.residuals
    tables = {"fitted": residuals.fitted, "hold-out": residuals.unseen}
    pairs = {name: table for name, table in tables.items() if table and table.of == "pairs"}
    if not pairs:
        raise ShotsMissing("no pairs were held out", remedy="give options={'hold_out': '20%'}")
    figure = Figure(figsize=(8.0, 3.5), layout="constrained")
    for place, title in enumerate(("before (open) and after (filled)", "after alone"), start=1):
        axes = figure.add_subplot(1, 2, place, title=title, xlabel="number of the pair")
        axes.axhline(0.0, color=QUIET, linewidth=0.7)
        for (name, table), marker in zip(pairs.items(), "oD", strict=False):
            if place == 1:
                _draw_pairs(axes, table, table.before, color=BEFORE, marker=marker, mfc="white")
            _draw_pairs(axes, table, table.after, color=AFTER, marker=marker, label=name)
        axes.set_ylabel("error of distance, mm")
    axes.legend()
    return figure


def _draw_pairs(axes: Axes, table: "ResidualTable", errors_mm: Array, **look: Any) -> None:
    axes.plot(table.numbers, errors_mm[:, 0], linestyle="", markersize=4, **look)


def draw_arrows(axes: Axes, starts: Array, lengths: Array, colour: str) -> None:
    """Draw arrows with starts and lengths (N, 2) on the scale of the axes, which have one scale."""
    look: Any = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.004}
    axes.quiver(*starts.T, *lengths.T, color=colour, **look)
    axes.plot(*starts.T, ".", color=QUIET, markersize=1.5)
    axes.plot(*(starts + lengths).T, alpha=0.0)  # axes make room for lines, not for arrows
    axes.set_aspect("equal", adjustable="datalim")


def magnification(errors_mm: Array, places_mm: Array) -> float:
    """Return the factor, of two digits, by which vectors (N, 3) at places (N, 3) are drawn.

    The longest becomes `LONGEST_ARROW` of the places' extent: so before and after fill their
    pictures alike, whatever their sizes.
    """
    longest_mm = float(np.linalg.norm(errors_mm, axis=1).max())
    extent_mm = float(np.ptp(places_mm, axis=0).max())
    if longest_mm == 0.0 or extent_mm == 0.0:
        return 1.0
    return float(f"{LONGEST_ARROW * extent_mm / longest_mm:.2g}")


def draw_correlation_map(figure: Figure, covariance: "ParameterCovariance") -> None:
    """Draw |ρ| of every two parameters as shades of grey."""
    # The sign of ρ depends on how two parameters are defined; its size shows whether the shots can
    # separate them, so the scale is 0 to 1. The matrix is symmetric with ones on its diagonal: only
    # the part below it is drawn. A parameter without variance has no correlation, hence `tiny`.
    # Labels shrink with the number of parameters, as each has a row.
    std = np.sqrt(np.diag(covariance.array))
    size = np.abs(covariance.array) / np.maximum(np.outer(std, std), np.finfo(np.float64).tiny)
    places = np.arange(len(covariance.names)) + 0.5
    letters = min(6.5, 260.0 / len(covariance.names))
    axes = figure.add_axes((0.22, 0.22, 0.65, 0.75), aspect="equal")
    shown = np.ma.masked_where(np.triu(np.ones_like(size)) > 0.0, size)
    shades = axes.pcolormesh(shown, cmap="Greys", vmin=0.0, vmax=1.0)
    axes.set_xticks(places, covariance.names, rotation=90, size=letters)
    axes.set_yticks(places, covariance.names, size=letters)
    axes.invert_yaxis()
    axes.grid(visible=False)
    figure.colorbar(shades, cax=figure.add_axes((0.9, 0.4, 0.02, 0.5)), label="|ρ|")


FIGURES: dict[str, Callable[["IdentificationResult"], Figure]] = {
    "errors": draw_errors,
    "space": draw_space,
    "correlations": draw_correlations,
    "gain": draw_gain,
}
