"""Style of every figure, and its way to a picture: matplotlib's objects, no pyplot, no state.

Colours keep apart in grey print; markers say the same again. Text stays text in SVG.
"""

import re
from collections.abc import Callable
from functools import wraps
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any, Literal, ParamSpec

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase

from campaigns.errors import WriteFailed

P = ParamSpec("P")

INK, QUIET, GRID = "#22303c", "#66727d", "#d9dee2"
BEFORE, AFTER = "#c98a3d", "#1f4e79"
"""Light and dark: 63 % and 29 % of white in grey."""
WIDTH_MM = 180.0
"""The text's width on A4."""
INCH_MM = 25.4

_STYLE: dict[Any, Any] = {  # matplotlib's own type lists every name there is
    "font.family": "DejaVu Sans",  # comes with matplotlib, and is wider than what pages show
    "font.size": 7.5,
    "axes.titlesize": 8.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.1,
    "lines.markersize": 3.6,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "legend.handletextpad": 0.4,
    "legend.columnspacing": 1.4,
    "svg.fonttype": "none",
    "svg.hashsalt": "pkmcal",
}
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


def in_house_style(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw with our settings, and leave matplotlib's as they were."""

    @wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with rc_context(_STYLE):
            return draw(*args, **kwargs)

    return styled


def new_figure(height_mm: float) -> Figure:
    """Empty figure of the page's width."""
    size = (WIDTH_MM / INCH_MM, height_mm / INCH_MM)
    return Figure(figsize=size, layout="constrained")


def svg_text(figure: Figure, name: str, title: str) -> str:
    """Figure as an SVG element for a page; `name` keeps its ids apart from other figures'."""
    text = StringIO()
    with rc_context(_STYLE):
        figure.savefig(text, format="svg", metadata=_NO_METADATA, transparent=True)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(url\(#|href="#)', rf"\g<1>{name}-", svg)
    svg = re.sub(r'(<svg\b[^>]*?) width="[^"]*" height="[^"]*"', r"\1", svg, count=1)
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(title)}"', 1).strip()


def save(figure: Figure, path: Path) -> None:
    """Write the picture in the format of the file's ending; raises `WriteFailed`."""
    try:
        with rc_context(_STYLE):
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


def zero_line(axes: Axes) -> None:
    """Line at zero, above the grid and below the data."""
    axes.axhline(0.0, color=QUIET, linewidth=0.8, zorder=1.5)


def say_instead(axes: Axes, text: str) -> None:
    """Words in the middle of a panel that has nothing to show."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", color=QUIET)


Above = Literal["outside upper left", "outside upper right"]


def legend_above(
    figure: FigureBase, axes: Axes, columns: int, loc: Above = "outside upper left"
) -> None:
    """One legend for the whole figure, over it, that names each label once."""
    handles, labels = axes.get_legend_handles_labels()
    first = dict(zip(labels[::-1], handles[::-1], strict=True))
    names = list(first)[::-1]
    figure.legend([first[name] for name in names], names, loc=loc, ncols=columns)
