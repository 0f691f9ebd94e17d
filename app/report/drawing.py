"""House style of pictures drawn by matplotlib, and their way into pages and files.

A picture must be readable in a printed certificate, on a phone, and in grey: so the colours of
before and after differ in brightness, markers or dashes repeat what colours show, and a panel is
small enough for two side by side on A4. In SVG text stays text, to be searched and read aloud, and
nothing depends on chance or on the time, so that equal data give equal files.
"""

import re
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any

from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from campaigns.errors import WriteFailed
from campaigns.identification import pictures

INK, GRID = "#22303c", "#d9dee2"
QUIET, BEFORE, AFTER = pictures.QUIET, pictures.BEFORE, pictures.AFTER
WIDTH_MM = 180.0
"""Width of the text on A4."""
PANEL_MM = (88.0, 68.0)
"""Width and height of a panel: two stand side by side on A4, one fills the width of a phone."""
PANEL_AXES = (0.15, 0.15, 0.82, 0.65)
"""Left, bottom, width and height of the axes as shares of a panel: panels in a row line up."""
INCH_MM = 25.4

rcParams.update(
    {
        "font.family": "DejaVu Sans",  # wider than what pages show, so no text meets another
        "font.size": 7.0,
        "axes.titlesize": 8.0,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "axes.edgecolor": QUIET,
        "axes.labelcolor": INK,
        "axes.linewidth": 0.6,
        "axes.grid": True,
        "axes.grid.axis": "y",
        "axes.axisbelow": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "text.color": INK,
        "xtick.color": QUIET,
        "ytick.color": QUIET,
        "xtick.labelcolor": INK,
        "ytick.labelcolor": INK,
        "xtick.major.size": 2.5,
        "ytick.left": False,
        "grid.color": GRID,
        "grid.linewidth": 0.5,
        "lines.linewidth": 1.0,
        "lines.markersize": 3.4,
        "lines.markeredgewidth": 0.8,
        "legend.frameon": False,
        "legend.fontsize": 6.5,
        "legend.handletextpad": 0.3,
        "legend.columnspacing": 1.0,
        "legend.labelspacing": 0.3,
        "svg.fonttype": "none",  # text, not outlines of letters
        "svg.hashsalt": "pkmcal",  # ids are random without it
    }
)


def new_figure(height_mm: float) -> Figure:
    """Return an empty figure of the page's width."""
    return Figure(figsize=(WIDTH_MM / INCH_MM, height_mm / INCH_MM), layout="constrained")


def new_panel(title: str, x: str = "", y: str = "") -> Axes:
    """Return the axes of a new panel, with room for a title and a legend above them."""
    figure = Figure(figsize=(PANEL_MM[0] / INCH_MM, PANEL_MM[1] / INCH_MM))
    figure.text(0.015, 0.945, title, weight="bold", size=8.0)
    axes = figure.add_axes(PANEL_AXES, xlabel=x, ylabel=y)
    axes.locator_params(nbins=6)
    return axes


def legend_above(axes: Axes, columns: int) -> None:
    """Draw the legend above the axes, each label once."""
    handles, labels = axes.get_legend_handles_labels()
    by_name = dict(zip(labels, handles, strict=True))
    place: Any = {"loc": "lower left", "bbox_to_anchor": (-0.1, 1.0), "ncols": columns}
    axes.legend(by_name.values(), by_name.keys(), **place)


def show_nothing(axes: Axes, words: str) -> None:
    """Write into the middle of empty axes why they are empty."""
    axes.set(xticks=[], yticks=[])
    axes.text(0.5, 0.5, words, color=QUIET, ha="center", transform=axes.transAxes)


# matplotlib's SVG is a file of its own; four changes make it a part of a page:
# 1. no date and no creator, so that the same figure is the same text;
# 2. nothing before <svg>, for an XML head may not stand inside HTML;
# 3. ids, and the references to them, begin with `name`: a page has one space for the ids of all;
# 4. no width and height, so that the style sheet scales it, and a title for screen readers.
def svg_text(figure: Figure, name: str, title: str) -> str:
    """Return a figure as an SVG element for a page, its ids beginning with `name`."""
    text = StringIO()
    metadata: Any = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    figure.savefig(text, format="svg", metadata=metadata, transparent=True)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(url\(#|href="#)', rf"\g<1>{name}-", svg)
    svg = re.sub(r'(<svg\b[^>]*?) width="[^"]*" height="[^"]*"', r"\1", svg, count=1)
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(title)}"', 1).strip()


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format that the file's suffix names; raise `WriteFailed`."""
    try:
        figure.savefig(path, dpi=200)
    except ValueError as error:
        raise WriteFailed(
            f"{path}: no picture can be written in the format '{path.suffix}'",
            remedy="let the name end in .svg, .png or .pdf",
        ) from error
    except OSError as error:
        raise WriteFailed(
            f"{path}: cannot be written ({(error.strerror or str(error)).lower()})",
            remedy="check that the folder exists and that this user may write there",
        ) from error
