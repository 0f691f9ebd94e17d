"""Page of ours laid out on A4 without a browser, by reportlab: plainer, with the same content.

Paragraphs, tables and pictures are read back from the page itself, so nothing is said twice.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from html import escape
from importlib.resources import files
from itertools import chain
from pathlib import Path
from typing import Any

from reportlab.graphics.shapes import Circle, Drawing, Group, Polygon, PolyLine, Rect, Shape, String
from reportlab.lib.colors import Color, HexColor
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.pdfbase.pdfmetrics import registerFont, registerFontFamily, stringWidth
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import KeepTogether, PageBreak, Paragraph, Spacer, Table
from reportlab.platypus.doctemplate import LayoutError, SimpleDocTemplate

from app.report.page_tree import Node, lines_of, page_tree, shapes
from campaigns.errors import WriteFailed

MM = 72.0 / 25.4
SIDE, HEAD, FOOT = 15.0 * MM, 16.0 * MM, 18.0 * MM
INSET = 6.0
"""Of what flows in its frame."""
WIDTH = A4[0] - 2.0 * SIDE
INK, QUIET, LINE, WASH = "#22303c", "#5d6973", "#c8ced3", "#f4f6f7"
TONES = {"pass": "#2c6a3f", "fail": "#98281f", "not-decided": "#8a6412"}
SIGNS = {"pass": "✓ ", "fail": "✕ ", "not-decided": "? "}
FONTS = {"": "DejaVuSans", "b": "DejaVuSans-Bold", "i": "DejaVuSans-Oblique", "m": "DejaVuSansMono"}
"""They come with matplotlib, and have the signs that PDF's own fonts lack: Greek letters, −, ✓."""
SIZE, SMALL = 7.8, 6.9
PADDING = 5.0
WORDS = 62.0
"""Least width of a column of words."""
PICTURES = {"robot-from-above": 260.0, "correlations": 380.0, "qr": 66.0}
"""Widths of pictures that do not take the page's."""
LEFT_OUT = frozenset({"nav", "script", "style"})
Block = list[Any]
"""What stays together on a page. Any: reportlab has no types."""


def print_without_browser(page: Path, pdf: Path) -> None:
    """Lay a page out on A4; raises `WriteFailed`."""
    for name in FONTS.values():
        source = files("matplotlib") / "mpl-data" / "fonts" / "ttf" / f"{name}.ttf"
        registerFont(TTFont(name, str(source)))
    registerFontFamily(FONTS[""], FONTS[""], FONTS["b"], FONTS["i"], FONTS["b"])
    tree = page_tree(page.read_text(encoding="utf-8"))
    try:
        count = _write(tree, pdf, of=0)
        _write(tree, pdf, of=count)
    except LayoutError as error:
        raise WriteFailed(
            f"{pdf}: something on {page} is larger than a sheet of A4",
            remedy="open it in a browser and print it from there",
        ) from error
    except OSError as error:
        raise WriteFailed(
            f"{pdf}: cannot be written ({(error.strerror or str(error)).lower()})",
            remedy="check that the folder exists and that this user may write there",
        ) from error


def _write(tree: Node, pdf: Path, *, of: int) -> int:
    """Write the document, `of` so many pages; gives how many there were."""
    style = " ".join(each.words for each in tree.find("style"))
    foot = re.search(r'@bottom-left { content: "(.*?)"', style)
    metas = {
        each.attributes.get("name"): each.attributes.get("content") for each in tree.find("meta")
    }
    document = SimpleDocTemplate(
        str(pdf),
        pagesize=A4,
        leftMargin=SIDE - INSET,
        rightMargin=SIDE - INSET,
        topMargin=HEAD,
        bottomMargin=FOOT,
        title=next(tree.find("title")).words,
        keywords=f"journal {metas.get('journal', '')}",
        creator=metas.get("generator"),
    )

    def footer(canvas: Any, _document: object) -> None:
        canvas.setFont(FONTS[""], SMALL)
        canvas.setFillColor(HexColor(QUIET))
        canvas.drawString(SIDE, FOOT / 2, foot[1] if foot else "")
        canvas.drawRightString(A4[0] - SIDE, FOOT / 2, f"{canvas.getPageNumber()} / {of}")

    story = [
        KeepTogether(block) if len(block) > 1 else block[0]
        for block in _titled(_blocks(next(tree.find("body"))))
    ]
    document.build(story, onFirstPage=footer, onLaterPages=footer)
    return int(document.page)


def _style(name: str = "", **changes: Any) -> ParagraphStyle:
    size = changes.pop("size", SIZE)
    own = {"fontName": FONTS[name], "fontSize": size, "leading": 1.35 * size, "spaceAfter": 4.0}
    return ParagraphStyle("", **{"textColor": INK, **own, **changes})


HEADINGS = {
    "h1": _style("b", size=17.0, spaceAfter=8.0),
    "h2": _style("b", size=11.5, spaceBefore=10.0, spaceAfter=5.0),
}
KINDS: dict[str, dict[str, Any]] = {
    "decision": {"size": 16.0},
    "note": {"size": SMALL, "textColor": QUIET, "spaceBefore": 2.0},
    "kind": {"textColor": QUIET},
    "simulated": {"textColor": TONES["not-decided"]},
    "alarm": {"textColor": TONES["fail"]},
    "missing": {"backColor": WASH, "borderPadding": 3.0, "spaceBefore": 4.0},
}
"""Styles of paragraphs by their class."""


def _titled(blocks: Iterator[Block]) -> Iterator[Block]:
    """Blocks, each heading with the one below it."""
    headings: Block = []
    for block in blocks:
        if len(block) == 1 and getattr(block[0], "style", None) in HEADINGS.values():
            headings += block
        else:
            yield [*headings, *block]
            headings = []


def _blocks(node: Node, tone: str = "") -> Iterator[Block]:
    """What flows down the page, of an element's children."""
    for each in node.nodes:
        if each.tag in LEFT_OUT or each.is_a("turning"):
            continue
        if each.tag in HEADINGS:
            yield [Paragraph(_inline(each), HEADINGS[each.tag])]
        elif each.tag == "p":
            yield [_paragraph(each, tone)]
        elif each.tag == "svg":
            yield [_drawing(each, PICTURES["qr"])]
        elif made := {"ul": _items, "ol": _items, "dl": _facts, "figure": _figure}.get(each.tag):
            yield [*made(each)]
        elif each.is_a("table"):
            yield [*_table(each)]
        elif each.is_a("signatures"):
            yield [_signatures(each)]
        else:
            apart = [[PageBreak()]] if each.attributes.get("id") == "certificate" else []
            yield from chain(apart, _blocks(each, each.attributes.get("class", tone)), apart)


def _items(node: Node) -> Iterator[Any]:
    style = _style(leftIndent=12.0, bulletIndent=2.0)
    for number, item in enumerate(node.nodes, start=1):
        yield Paragraph(_inline(item), style, bulletText=f"{number}." if node.tag == "ol" else "•")


def _paragraph(node: Node, tone: str) -> Paragraph:
    changes: dict[str, Any] = {}
    for name, own in KINDS.items():
        changes |= own if node.is_a(name) else {}
    text = _inline(node)
    if node.is_a("decision"):
        changes["textColor"] = TONES.get(tone, INK)
        text = SIGNS.get(tone, "") + text
    bold = node.is_a("decision") or node.is_a("alarm")
    return Paragraph(text, _style("b" if bold else "", **changes))


def _inline(node: Node) -> str:
    """Words of an element in reportlab's own markup, escaped."""
    parts = []
    for each in node.children:
        if isinstance(each, str):
            parts.append(escape(re.sub(r"\s+", " ", each)))
        elif each.tag == "code":
            parts.append(f'<font name="{FONTS["m"]}">{_inline(each)}</font>')
        elif each.tag == "b":
            parts.append(f"<b>{_inline(each)}</b>")
        elif each.is_a("unit"):
            parts.append(f'<font color="{QUIET}">{_inline(each)}</font>')
        else:
            parts.append(_inline(each) + " " * each.is_a("count"))
    return "".join(parts)


def _facts(node: Node) -> Iterator[Any]:
    """Names and what they are, in two columns; the second of a key figure is a sentence."""
    rows = []
    for each in node.nodes:
        name, *values = each.nodes
        told = " · ".join(_inline(value) for value in values)
        rows.append([Paragraph(_inline(name), _style(textColor=QUIET)), Paragraph(told, _style())])
    if rows:
        yield _ruled(rows, [150.0, WIDTH - 150.0])
        yield Spacer(0.0, 6.0)


def _signatures(node: Node) -> Table:
    cells = [Paragraph(_inline(each), _style(textColor=QUIET)) for each in node.nodes]
    made = Table([cells], [WIDTH / len(cells)] * len(cells), spaceBefore=44.0)
    places = [("LINEABOVE", (n, 0), (n, 0), 0.8, HexColor(INK)) for n in range(len(cells))]
    made.setStyle([*places, ("RIGHTPADDING", (0, 0), (-1, -1), 18.0)])
    return made


def _ruled(rows: list[list[Any]], widths: Sequence[float], *, head: int = 0) -> Table:
    """Table with a line below each row; `head` rows stand on each of its pages."""
    made = Table(rows, widths, repeatRows=head, splitInRow=1, hAlign="LEFT")
    look: list[tuple[Any, ...]] = [
        ("LINEBELOW", (0, 0), (-1, -1), 0.5, HexColor(LINE)),
        ("VALIGN", (0, 0), (-1, -1), "TOP"),
        ("LEFTPADDING", (0, 0), (-1, -1), 0.0),
        ("RIGHTPADDING", (0, 0), (-1, -1), PADDING),
        ("TOPPADDING", (0, 0), (-1, -1), 1.5),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 0.5),
    ]
    if head:
        look.append(("LINEBELOW", (0, head - 1), (-1, head - 1), 0.9, HexColor(INK)))
    made.setStyle(look)
    return made


def _table(node: Node) -> Iterator[Any]:
    """Title, rows and note of a table."""
    [table] = (each for each in node.nodes if each.tag == "table")
    heads = [*next(table.find("thead")).find("th")]
    body = [[*row.find("td")] for row in next(table.find("tbody")).find("tr")]
    widths = _widths(heads, body)
    right = [not head.is_a("words") for head in heads]

    def cell(of: Node, place: int, name: str = "") -> Paragraph:
        mono, size = of.is_a("code"), SMALL - 0.4 * (len(heads) > 7)
        style = _style("m" if mono else name, size=size, alignment=2 * right[place], spaceAfter=1.0)
        return Paragraph(_inline(of), style)

    rows = [[cell(head, n, "b") for n, head in enumerate(heads)]]
    rows += [[cell(each, n) for n, each in enumerate(row)] for row in body]
    made = _ruled(rows, widths, head=1)
    notes = [_paragraph(each, "") for each in node.nodes if each.tag == "p"]
    title = next(table.find("caption"))
    titled = Paragraph(_inline(title), _style("b", spaceBefore=4.0))
    yield from (titled, made, *notes, Spacer(0.0, 5.0))


def _widths(heads: list[Node], body: list[list[Node]]) -> list[float]:
    """Widths of columns: as their words need; if that is too much, columns of words give way."""
    needed = []
    for n, head in enumerate(heads):
        texts = [(head.words, FONTS["b"]), *((row[n].words, FONTS[""]) for row in body)]
        longest = max(stringWidth(words, font, SMALL) for words, font in texts)
        needed.append(longest + PADDING + 3.0)
    over = sum(needed) - WIDTH
    flexible = [n for n, head in enumerate(heads) if head.is_a("words") or needed[n] > WIDTH / 3]
    flexible = flexible or [*range(len(heads))]
    if over <= 0.0:
        words = [n for n, head in enumerate(heads) if head.is_a("words")]
        for n in words[-1:] if heads[-1].is_a("words") else words[:1]:
            needed[n] -= over
        return needed
    spare = {n: max(needed[n] - WORDS, 0.0) for n in flexible}
    share = min(1.0, over / (sum(spare.values()) or 1.0))
    needed = [width - share * spare.get(n, 0.0) for n, width in enumerate(needed)]
    return [width * min(1.0, WIDTH / sum(needed)) for width in needed]


def _figure(node: Node) -> Iterator[Any]:
    for each in node.nodes:
        if each.tag == "svg":
            yield _drawing(each, PICTURES.get(node.attributes.get("id", ""), WIDTH))
        elif each.tag == "figcaption":
            yield Paragraph(_inline(each), _style(textColor=QUIET, spaceBefore=3.0, spaceAfter=9.0))


def _drawing(svg: Node, width: float) -> Drawing:
    """Picture of the page, so wide."""
    _, _, wide, high = map(float, svg.attributes["viewbox"].split())
    scale = width / wide
    drawing = Drawing(width, scale * high, hAlign="LEFT")

    def at(x: float | str, y: float | str) -> tuple[float, float]:
        return scale * float(x), scale * (high - float(y))

    for shape in shapes(svg):
        for drawn in _drawn(shape, at, scale):
            drawing.add(drawn)
    return drawing


def _drawn(
    shape: Node, at: Callable[[float | str, float | str], tuple[float, float]], scale: float
) -> Iterator[Shape]:
    of = shape.attributes
    look: dict[str, Any] = {
        "fillColor": _colour(of.get("fill", "#000"), of.get("fill-opacity", "1")),
        "strokeColor": _colour(of.get("stroke", "none")),
        "strokeWidth": scale * float(of.get("stroke-width", 1.0)),
    }
    if "stroke-dasharray" in of:
        look["strokeDashArray"] = [scale * float(each) for each in of["stroke-dasharray"].split()]
    if shape.tag == "text":
        yield _string(shape, *at(of["x"], of["y"]), scale)
    elif shape.tag == "circle":
        yield Circle(*at(of["cx"], of["cy"]), scale * float(of["r"]), **look)
    elif shape.tag == "rect":
        x, y = at(of["x"], float(of["y"]) + float(of["height"]))
        yield Rect(x, y, scale * float(of["width"]), scale * float(of["height"]), **look)
    elif shape.tag in {"polyline", "polygon", "path"}:
        for line in lines_of(shape):
            flat = [each for place in line for each in at(*place)]
            if shape.tag == "polygon" or (look["fillColor"] and len(line) > 2):
                yield Polygon(flat, **look)
            else:
                yield PolyLine(flat, **{**look, "fillColor": None})


def _string(shape: Node, x: float, y: float, scale: float) -> Shape:
    of = shape.attributes
    bold, oblique = of.get("font-weight") == "bold", of.get("font-style") == "italic"
    string = String(
        0.0,
        0.0,
        shape.words,
        fontName=FONTS["b" if bold else "i" if oblique else ""],
        fontSize=scale * float(of.get("font-size", 8.0)),
        fillColor=_colour(of.get("fill", "#000")),
        textAnchor=of.get("text-anchor", "start"),
    )
    placed = Group(string)
    placed.translate(x, y)
    if "transform" in of:
        placed.rotate(90)  # upwards, the only way in which our pictures turn words
    return placed


def _colour(name: str, opacity: str = "1") -> Color | None:
    """Colour of #rgb or #rrggbb; None for none."""
    if not name.startswith("#"):
        return None
    digits = name[1:] if len(name) > 4 else "".join(2 * each for each in name[1:])
    red, green, blue = (int(digits[n : n + 2], 16) / 255.0 for n in (0, 2, 4))
    return Color(red, green, blue, alpha=float(opacity))
