"""A study's picture: errors against the normal distribution, ratios and coverage by parameter."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from app.report.drawing import AFTER, GRID, INK, new_figure, save
from campaigns.arrays import Array
from campaigns.studies.summary import CONFIDENCE, StudySummary

SCORES = np.linspace(-4.0, 4.0, 65)
"""Edges of the histogram of normal scores."""


def draw_study(path: Path, summary: StudySummary, scores: Array) -> None:
    """Draw a study with its errors over their stated σ, (C, F), into a file."""
    figure = new_figure(190.0)
    panels = figure.subplots(3, 1)
    _draw_scores(panels[0], scores)
    parameters, limits = summary.parameters, summary.chance
    names = [p.name for p in parameters]
    panels[1].set_title("σ found / σ stated (grey: what chance may do)")
    _draw_by_parameter(panels[1], [p.ratio for p in parameters], limits["ratio"], 1.0)
    panels[1].set_xticks(range(len(names)), [])
    panels[2].set_title("share of 95 % intervals that hold the truth (grey: what chance may do)")
    _draw_by_parameter(panels[2], [p.covered for p in parameters], limits["covered_95"], CONFIDENCE)
    panels[2].set_xticks(range(len(names)), names, rotation=90)
    save(figure, path)


def _draw_scores(axes: Axes, scores: Array) -> None:
    """Draw how often each error in stated σ occurred, all parameters together."""
    density, _ = np.histogram(scores, SCORES, density=True)
    axes.stairs(density, SCORES, color=AFTER)
    normal = np.exp(-0.5 * SCORES**2) / np.sqrt(2.0 * np.pi)
    axes.fill_between(SCORES, normal, color=GRID, zorder=0.5)
    axes.set_title("errors of all parameters, in stated σ")
    axes.set(xlabel="error / stated σ (grey: standard normal)", ylabel="density")


def _draw_by_parameter(
    axes: Axes, values: Sequence[float], limits: tuple[float, float], honest: float
) -> None:
    """Draw a mark a parameter, the limits of chance, and the value that is right."""
    axes.axhspan(*limits, color=GRID)
    axes.axhline(honest, color=INK, linewidth=0.6)
    axes.plot(range(len(values)), values, "o", color=AFTER, markersize=3.0)
