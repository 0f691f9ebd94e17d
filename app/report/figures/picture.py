"""Picture drawn as SVG by hand: panels with axes, marks, lines, bars and a legend.

No plotting library is loaded for it: starting one takes longer than a whole page. Lengths are
points, 72 to the inch, y downwards. Elements are g, line, polyline, polygon, rect, circle and text
alone, so that every reader of the page can draw them anew.
"""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import chain, zip_longest
from math import ceil, cos, floor, log10, radians, sin
from typing import NamedTuple

import numpy as np

from campaigns.arrays import Array

INK, QUIET, GRID = "#22303c", "#66727d", "#d9dee2"
BEFORE, AFTER = "#c98a3d", "#1f4e79"
"""Light and dark: 63 % and 29 % of white in grey."""
WIDTH_MM = 180.0
"""The text's width on A4."""
POINTS_PER_MM = 72.0 / 25.4
WIDTH = WIDTH_MM * POINTS_PER_MM
FONTS = "DejaVu Sans, Arial, sans-serif"
SIZE, TITLE_SIZE, SMALL_SIZE = 7.5, 8.0, 6.5
LETTER = 0.58
"""Mean width of a letter in its size."""
MARK = 1.8
LEFT, BOTTOM, TOP, GAP, EDGE = 40.0, 28.0, 15.0, 12.0, 6.0
"""Room for numbers and name of an axis, for a title, between panels, and at the right."""
LEGEND = 16.0
X_TICKS, Y_TICKS = 30.0, 15.0
"""Least distance of two ticks."""
STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
ROOM = 0.05
MARKS = {
    "s": ((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
    "D": ((0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)),
    "^": ((0.0, -1.1), (1.1, 0.9), (-1.1, 0.9)),
}
"""Corners of markers in their size; "o" is a circle."""
AZIMUTH_DEG, ELEVATION_DEG = -58.0, 22.0
"""Where space is looked at from: x to the right, y away, z up."""
ARROW_HEAD = 0.25
Range = tuple[float, float]


class Look(NamedTuple):
    """How a series looks: in which colour, by which marker and line."""

    colour: str
    marker: str = ""
    filled: bool = True
    dash: str | None = None
    """Lengths of dashes; "" is a line without gaps, None none at all."""
    size: float = MARK


class Picture:
    """Picture of the page's width, filled by its panels."""

    def __init__(self, height_mm: float) -> None:
        self.width, self.height = WIDTH, height_mm * POINTS_PER_MM
        self.parts: list[str] = []

    def svg(self, title: str) -> str:
        """Picture as an SVG element for a page."""
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" role="img" aria-label="{escape(title)}" '
            f'viewBox="0 0 {WIDTH:.1f} {self.height:.1f}" font-family="{FONTS}" '
            f'font-size="{SIZE}" fill="{INK}" stroke-linejoin="round">{"".join(self.parts)}</svg>'
        )

    def text(
        self,
        x: float,
        y: float,
        words: str,
        *,
        size: float = SIZE,
        anchor: str = "start",
        style: str = "",
        upwards: bool = False,
    ) -> None:
        """Words, their line's foot at (x, y). `style`: further attributes."""
        turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if upwards else ""
        place = f'x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}"'
        self.parts.append(f"<text {place}{turn} {style}>{escape(words)}</text>")

    def line(self, points: Iterable[Iterable[float]], look: Look, width: float = 1.1) -> None:
        """Open line through points (N, 2) of the picture."""
        dash = f' stroke-dasharray="{look.dash}"' if look.dash else ""
        stroke = f'fill="none" stroke="{look.colour}" stroke-width="{width}"{dash}'
        self.parts.append(f'<polyline {stroke} points="{_joined(points)}"/>')

    def area(self, points: Iterable[Iterable[float]], fill: str) -> None:
        """Filled polygon."""
        self.parts.append(f'<polygon fill="{fill}" points="{_joined(points)}"/>')

    def marks(self, points: Array, look: Look, names: Sequence[str] = ()) -> None:
        """A marker at each of points (N, 2) of the picture. `names`: shown under the cursor."""
        fill = look.colour if look.filled else "#fff"
        self.parts.append(f'<g fill="{fill}" stroke="{look.colour}" stroke-width="0.9">')
        for (x, y), name in zip_longest(points.tolist(), names):
            if look.marker == "o":
                mark = f'circle cx="{x:.1f}" cy="{y:.1f}" r="{look.size:g}"'
            else:
                own = ((x + look.size * u, y + look.size * v) for u, v in MARKS[look.marker])
                mark = f'polygon points="{_joined(own)}"'
            told = f"><title>{escape(name)}</title></{mark.split()[0]}>" if name else "/>"
            self.parts.append(f"<{mark}{told}")
        self.parts.append("</g>")

    def series(self, points: Array, look: Look, names: Sequence[str] = ()) -> None:
        """Line and markers of a series, as it looks."""
        if look.dash is not None:
            self.line(points.tolist(), look)
        if look.marker:
            self.marks(points, look, names)

    def cell(self, x: float, y: float, width: float, height: float, shade: float) -> None:
        """Area in grey from white, 0, to black, 1."""
        grey = f"{round(255 * (1.0 - shade)):02x}"
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
        self.area(corners, f"#{grey * 3}")

    def legend(self, names: Iterable[tuple[str, Look]], *, right: bool = False) -> None:
        """Names of series in a row above the panels, each once."""
        once = dict(names)
        widths = [26.0 + LETTER * SIZE * len(name) + 8.0 for name in once]
        x = WIDTH - EDGE - sum(widths) if right else EDGE
        for (name, look), width in zip(once.items(), widths, strict=True):
            sample = [[x, 6.5], [x + 18.0, 6.5]]
            if look.marker and look.dash is None:
                sample = [[x + 9.0, 6.5]]
            if look.dash is not None:
                self.line(sample, look)
                sample = [[x + 9.0, 6.5]]
            if look.marker:
                self.marks(np.array(sample), look)
            self.text(x + 23.0, 9.2, name)
            x += width

    def shades(self, names: Iterable[tuple[str, str, float]]) -> None:
        """Legend of areas: name, colour, opacity."""
        x = EDGE
        for name, colour, opacity in names:
            self.parts.append(_rect(x, 3.0, 18.0, 7.0, colour, opacity))
            self.text(x + 23.0, 9.2, name)
            x += 34.0 + LETTER * SIZE * len(name)

    def panels(
        self,
        rows: int,
        columns: int,
        *,
        legend: bool = True,
        title: bool = True,
        shared: bool = False,
        between: float = BOTTOM,
        foot: float = BOTTOM,
    ) -> list[list["Panel"]]:
        """Grid of panels. `shared`: one axis upwards for all of a row.

        `between`, `foot`: room for the axis across below a row and below the last one.
        """
        first = LEGEND * legend
        left = EDGE if shared else LEFT
        width = (WIDTH - LEFT - EDGE - (columns - 1) * (left + GAP)) / columns
        high = (self.height - first - foot + between) / rows
        return [
            [
                Panel(
                    self,
                    LEFT + column * (width + left + GAP),
                    first + row * high + TOP * title,
                    width,
                    high - between - TOP * title,
                )
                for column in range(columns)
            ]
            for row in range(rows)
        ]


class Panel:
    """Rectangle of a picture with two axes; what is drawn is in their units."""

    def __init__(
        self, picture: Picture, left: float, top: float, width: float, height: float
    ) -> None:
        self.picture = picture
        self.left, self.top, self.width, self.height = left, top, width, height
        self.x: Range = (0.0, 1.0)
        self.y: Range = (0.0, 1.0)

    def axes(
        self,
        x: Range,
        y: Range,
        *,
        names: tuple[str, str] = ("", ""),
        x_ticks: bool = True,
        x_numbers: bool = True,
        y_numbers: bool = True,
        square: bool = False,
    ) -> None:
        """Draw grid, axes, numbers and names of both axes. `square`: both to one scale."""
        self.x, self.y = _one_scale(x, y, self.width, self.height) if square else (x, y)
        right, foot = self.left + self.width, self.top + self.height
        grid, edge = Look(GRID, dash=""), Look(QUIET, dash="")
        for value, words in ticks(self.y, self.height / Y_TICKS):
            _, at = self.place(0.0, value)
            self.picture.line([(self.left, at), (right, at)], grid, 0.5)
            self.picture.line([(self.left - 2.5, at), (self.left, at)], edge, 0.6)
            if y_numbers:
                self.picture.text(self.left - 4.5, at + 2.7, words, anchor="end")
        for value, words in ticks(self.x, self.width / X_TICKS) if x_ticks else ():
            at, _ = self.place(value, 0.0)
            self.picture.line([(at, self.top), (at, foot)], grid, 0.5)
            self.picture.line([(at, foot), (at, foot + 2.5)], edge, 0.6)
            if x_numbers:
                self.picture.text(at, foot + 10.5, words, anchor="middle")
        self.picture.line([(self.left, self.top), (self.left, foot), (right, foot)], edge, 0.6)
        below = 20.5 if x_ticks else 10.5
        if names[0]:
            self.picture.text(self.left + self.width / 2, foot + below, names[0], anchor="middle")
        if names[1]:
            at = self.left - LEFT + 8.0
            middle = self.top + self.height / 2
            self.picture.text(at, middle, names[1], anchor="middle", upwards=True)

    def title(self, words: str) -> None:
        """Title over the panel."""
        bold = 'font-weight="bold"'
        self.picture.text(self.left, self.top - 5.0, words, size=TITLE_SIZE, style=bold)

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Where a point is in the picture."""
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        up = (y - self.y[0]) / (self.y[1] - self.y[0])
        return self.left + across * self.width, self.top + (1.0 - up) * self.height

    def places(self, x: Array, y: Array) -> Array:
        """The same of many, (N, 2)."""
        return np.column_stack(self.place(x, y))  # type: ignore[arg-type]  # arrays like numbers

    def plot(self, x: Array, y: Array, look: Look, names: Sequence[str] = ()) -> None:
        """Draw a series. `names`: shown under the cursor."""
        self.picture.series(self.places(x, y), look, names)

    def level(self, y: float = 0.0) -> None:
        """Line across, if it is in sight."""
        if self.y[0] <= y <= self.y[1]:
            self.picture.line(
                [self.place(self.x[0], y), self.place(self.x[1], y)], Look(QUIET, dash=""), 0.8
            )

    def upright(self, x: float, width: float = 0.8) -> None:
        """Line upwards, if it is in sight."""
        if self.x[0] <= x <= self.x[1]:
            self.picture.line(
                [self.place(x, self.y[0]), self.place(x, self.y[1])], Look(QUIET, dash=""), width
            )

    def bar(self, x: Range, y: Range, colour: str, opacity: float) -> None:
        """Filled bar with an edge."""
        (left, foot), (right, top) = self.place(x[0], y[0]), self.place(x[1], y[1])
        self.picture.parts.append(_rect(left, top, right - left, foot - top, colour, opacity))

    def arrows(self, x: Array, y: Array, along: Array, up: Array, colour: str) -> None:
        """Arrows from places (N,) by vectors of the same units."""
        ends = zip(self.places(x, y), self.places(x + along, y + up), strict=True)
        for start, end in ends:
            arrow(self.picture, start, end, colour)

    def circle(self, radius: float, look: Look) -> None:
        """Circle about the origin, of a panel whose axes have one scale."""
        (x, y), (edge, _) = self.place(0.0, 0.0), self.place(radius, 0.0)
        dash = f' stroke-dasharray="{look.dash}"' if look.dash else ""
        self.picture.parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{edge - x:.1f}" fill="none" '
            f'stroke="{look.colour}" stroke-width="1"{dash}/>'
        )

    def instead(self, words: str) -> None:
        """Words in the middle of a panel that has nothing to show."""
        x, y = self.left + self.width / 2, self.top + self.height / 2
        self.picture.text(x, y, words, anchor="middle", style=f'fill="{QUIET}"')


def arrow(picture: Picture, start: Array, end: Array, colour: str) -> None:
    """Arrow between two points of the picture, with a head of a quarter of its length."""
    back = ARROW_HEAD * (start - end)
    wings = [
        end + np.array([c * back[0] - s * back[1], s * back[0] + c * back[1]]) for c, s in _WINGS
    ]
    look = Look(colour, dash="")
    picture.line([start.tolist(), end.tolist()], look, 0.8)
    picture.line([wings[0].tolist(), end.tolist(), wings[1].tolist()], look, 0.8)


_WINGS = tuple((cos(radians(turn)), sin(radians(turn))) for turn in (-25.0, 25.0))


class Space:
    """Points in space, (N, 3), seen from one side inside a rectangle; to one scale, in mm."""

    def __init__(self, panel: Panel, points: Array) -> None:
        self.panel = panel
        self.low = points.min(axis=0)
        self.high = self.low + np.maximum(np.ptp(points, axis=0), 1.0)
        turn, lift = radians(AZIMUTH_DEG), radians(ELEVATION_DEG)
        self._seen = np.array(
            [
                [-sin(turn), cos(turn), 0.0],
                [sin(lift) * cos(turn), sin(lift) * sin(turn), -cos(lift)],
            ]
        )
        """Rows: to the right and downwards on paper."""
        corners = self._seen @ np.array(
            np.meshgrid(*zip(self.low, self.high, strict=True))
        ).reshape(3, 8)
        extent = np.ptp(corners, axis=1)
        self._scale = min((panel.width - 10.0) / extent[0], (panel.height - 20.0) / extent[1])
        middle = np.array([panel.left + panel.width / 2 - 22.0, panel.top + panel.height / 2 - 3.0])
        self._origin = middle - self._scale * (corners.min(axis=1) + extent / 2)
        self._draw_box()

    def seen(self, points: Array) -> Array:
        """Places of points (N, 3) in the picture, (N, 2)."""
        return np.asarray(self._origin + self._scale * points @ self._seen.T)

    def _draw_box(self) -> None:
        """The three sides at the back with their grid, and numbers at the outer edges."""
        (x0, y0, z0), (x1, y1, z1) = self.low.tolist(), self.high.tolist()
        line, picture = Look(GRID, dash=""), self.panel.picture
        x, y, z = (ticks((low, high), 4) for low, high in ((x0, x1), (y0, y1), (z0, z1)))
        grid = [
            *([(v, y0, z0), (v, y1, z0), (v, y1, z1)] for v, _ in x),
            *([(x1, v, z0), (x0, v, z0), (x0, v, z1)] for v, _ in y),
            *([(x0, y0, v), (x0, y1, v), (x1, y1, v)] for v, _ in z),
            [(x0, y0, z1), (x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x1, y1, z1)],
        ]
        for loop in grid:
            picture.line(self.seen(np.array(loop)).tolist(), line, 0.5)
        beside = (
            *(((v, y0, z0), words, (-4.0, 9.0)) for v, words in x),
            *(((x1, v, z0), words, (10.0, 8.0)) for v, words in y),
            *(((x1, y1, v), words, (13.0, 2.0)) for v, words in z),
        )
        for place, words, (along, down) in beside:
            u, v = self.seen(np.array([place]))[0]
            picture.text(u + along, v + down, words, size=SMALL_SIZE, anchor="middle")
        quiet = f'fill="{QUIET}" font-style="italic"'
        named = (
            ("x", (0.5 * (x0 + x1), y0, z0), (-12.0, 17.0)),
            ("y", (x1, 0.5 * (y0 + y1), z0), (22.0, 14.0)),
            ("z", (x1, y1, 0.5 * (z0 + z1)), (29.0, 2.0)),
        )
        for name, place, (along, down) in named:
            u, v = self.seen(np.array([place]))[0]
            picture.text(u + along, v + down, name, anchor="middle", style=quiet)


def span(*values: Array | None, room: float = ROOM, zero: bool = False) -> Range:
    """Range of an axis that shows all values, with room at both ends."""
    every = [*chain.from_iterable(np.ravel(v).tolist() for v in values if v is not None)]
    every += [0.0] if zero or not every else []
    low, high = min(every), max(every)
    more = room * (high - low) or 0.05 * abs(high) or 1.0
    return low - more, high + more


def ticks(shown: Range, most: float) -> list[tuple[float, str]]:
    """Round values inside a range, about so many at most, with their words."""
    low, high = shown
    wanted = (high - low) / max(most, 1.0)
    power = 10.0 ** floor(log10(wanted))
    step = next(s * power for s in STEPS if s * power >= wanted * (1.0 - 1e-9))
    decimals = max(0, -floor(log10(step) + 1e-9))
    if abs(step * 10.0**decimals - round(step * 10.0**decimals)) > 1e-6:
        decimals += 1
    counts = range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)
    words = (f"{n * step:.{decimals}f}".replace("-", "−") for n in counts)
    return [(n * step, word) for n, word in zip(counts, words, strict=True)]


def _one_scale(x: Range, y: Range, width: float, height: float) -> tuple[Range, Range]:
    """Ranges widened so that a mm is as long in both directions."""
    scale = max((x[1] - x[0]) / width, (y[1] - y[0]) / height)

    def widened(old: Range, length: float) -> Range:
        middle, half = 0.5 * (old[0] + old[1]), 0.5 * scale * length
        return middle - half, middle + half

    return widened(x, width), widened(y, height)


def _joined(points: Iterable[Iterable[float]]) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


def _rect(x: float, y: float, width: float, height: float, fill: str, opacity: float) -> str:
    return (
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="{fill}" '
        f'fill-opacity="{opacity:g}" stroke="{INK}" stroke-width="0.4"/>'
    )
