"""Style of every figure, and its way to a picture: matplotlib's objects, no pyplot, no state.

Colours keep apart in grey print; markers say the same again. Text stays text in SVG.
"""

import re
from collections.abc import Callable
from functools import wraps
from html import escape
from io import StringIO
from pathlib import Path
from typing import Any, ParamSpec

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure, FigureBase
from matplotlib.patches import Circle, Polygon, Rectangle

from app.report.figures.picture import GRID, INK, QUIET, WIDTH_MM, Picture
from app.report.page_tree import line_of, page_tree, shapes
from campaigns.errors import WriteFailed

P = ParamSpec("P")

INCH_MM = 25.4
POINTS = 72.0
"""To the inch."""

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


def save(figure: Figure | Picture, path: Path) -> None:
    """Write the picture in the format of the file's ending; raises `WriteFailed`."""
    try:
        with rc_context(_STYLE):
            (_redrawn(figure) if isinstance(figure, Picture) else figure).savefig(path, dpi=200)
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


def _redrawn(picture: Picture) -> Figure:
    """Picture of ours as a figure of matplotlib, which writes other formats than SVG."""
    figure = Figure(figsize=(picture.width / POINTS, picture.height / POINTS))
    axes = figure.add_axes(
        (0.0, 0.0, 1.0, 1.0), xlim=(0.0, picture.width), ylim=(picture.height, 0.0)
    )
    axes.set_axis_off()
    [svg] = page_tree(picture.svg("")).nodes
    for shape in shapes(svg):
        of = shape.attributes
        look: dict[str, Any] = {
            "facecolor": to_rgba(of["fill"], float(of.get("fill-opacity", 1.0))),
            "edgecolor": of.get("stroke", "none"),
            "linewidth": float(of.get("stroke-width", 0.0)),
        }
        if "stroke-dasharray" in of:
            look["linestyle"] = (0.0, [*map(float, of["stroke-dasharray"].split())])
        if shape.tag == "text":
            axes.text(
                float(of["x"]),
                float(of["y"]),
                shape.words,
                fontsize=float(of["font-size"]),
                color=of["fill"],
                ha={"start": "left", "middle": "center", "end": "right"}[of["text-anchor"]],
                va="baseline",
                rotation=90.0 if "transform" in of else 0.0,
                rotation_mode="anchor",
                weight=of.get("font-weight", "normal"),
                style=of.get("font-style", "normal"),
            )
        elif shape.tag == "circle":
            axes.add_patch(Circle((float(of["cx"]), float(of["cy"])), float(of["r"]), **look))
        elif shape.tag == "rect":
            x, y, width, height = (float(of[name]) for name in ("x", "y", "width", "height"))
            axes.add_patch(Rectangle((x, y), width, height, **look))
        else:
            closed = shape.tag == "polygon"
            axes.add_patch(Polygon(line_of(shape), closed=closed, **look))
    return figure


def legend_above(figure: FigureBase, axes: Axes, columns: int) -> None:
    """One legend for the whole figure, over it, that names each label once."""
    handles, labels = axes.get_legend_handles_labels()
    first = dict(zip(labels[::-1], handles[::-1], strict=True))
    names = list(first)[::-1]
    figure.legend([first[name] for name in names], names, loc="outside upper left", ncols=columns)
