"""Tree of a page of ours, read back from its HTML, and the shapes of the pictures in it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = frozenset({"br", "img", "input", "link", "meta"})


@dataclass(frozen=True, slots=True)
class Node:
    """Element with its attributes, and what is in it in order."""

    tag: str
    attributes: Mapping[str, str] = field(default_factory=dict)
    children: "list[Node | str]" = field(default_factory=list)

    @property
    def nodes(self) -> "Iterator[Node]":
        """Elements in it."""
        return (each for each in self.children if isinstance(each, Node))

    @property
    def words(self) -> str:
        """Text of it and of all in it, on one line."""
        parts = (each.words if isinstance(each, Node) else each for each in self.children)
        return " ".join("".join(parts).split())

    def find(self, tag: str) -> "Iterator[Node]":
        """All elements of a kind in it, at any depth."""
        for each in self.nodes:
            if each.tag == tag:
                yield each
            yield from each.find(tag)


class _Reader(HTMLParser):
    """Builder of the tree; pages of ours close what they open."""

    def __init__(self) -> None:
        super().__init__()
        self.open = [Node("page")]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            [*_, made] = self.open[-1].nodes
            self.open.append(made)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open[-1].children.append(Node(tag, {name: value or "" for name, value in attrs}))

    def handle_endtag(self, tag: str) -> None:
        if any(each.tag == tag for each in self.open[1:]):
            while self.open.pop().tag != tag:
                pass

    def handle_data(self, data: str) -> None:
        self.open[-1].children.append(data)


def page_tree(html: str) -> Node:
    """Tree of a page or of a part of one."""
    reader = _Reader()
    reader.feed(html)
    reader.close()
    return reader.open[0]


def shapes(svg: Node) -> Iterator[Node]:
    """Shapes of a picture, each with the attributes that it inherits, in the order of drawing."""
    for each in svg.nodes:
        own = Node(each.tag, {**svg.attributes, **each.attributes}, each.children)
        if each.tag == "g":
            yield from shapes(own)
        else:
            yield own


def line_of(shape: Node) -> list[tuple[float, float]]:
    """Return the points of a polyline or polygon."""
    pairs = (pair.split(",") for pair in shape.attributes["points"].split())
    return [(float(x), float(y)) for x, y in pairs]
