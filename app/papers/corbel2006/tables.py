"""The comparison as tables of texts, the same on the terminal and on the page."""

from collections.abc import Iterable, Iterator, Sequence
from string import ascii_lowercase

from app.papers.corbel2006 import printed
from app.papers.corbel2006.comparison import ComparedGroup, Comparison, ParameterRow
from app.papers.corbel2006.comparison import Row as Compared
from app.papers.corbel2006.evidence import Evidence
from app.papers.corbel2006.floors import Floor
from app.papers.corbel2006.geometry_alone import GeometryAlone
from app.papers.corbel2006.misfit import Reach
from app.papers.corbel2006.quantities import Quantity
from app.papers.corbel2006.reasons import Reason
from app.papers.corbel2006.summary import HIGH, LOW, Distribution
from app.report.parts import NOTHING, Column, Row, Table, number, words

PASS, MISSED = "pass", "missed"
UNEXPLAINED = "?"
SIGNS = {"mm": "", "deg": "°", "%": " %"}
SPREAD = f"{LOW:g}–{HIGH:g} %"
PARAMETER_DECIMALS = 2


def comparison_tables(comparison: Comparison) -> Iterator[Table]:
    """One for each group of figures, in the paper's order."""
    for compared in comparison.groups:
        yield _group_table(compared, comparison.reasons)


def all_tables(comparison: Comparison, evidence: Evidence) -> Iterator[Table]:
    """Every table, in the paper's order, and then why figures differ."""
    yield from comparison_tables(comparison)
    few = (table_ii(comparison), floor_table(evidence), geometry_table(evidence))
    yield from (table for table in few if table is not None)
    yield reach_table(evidence)


def table_ii(comparison: Comparison) -> Table | None:
    """Every estimate; None without a seed of the prototype."""
    if not comparison.parameters:
        return None
    columns = (
        *words("parameter"),
        *(Column(title) for title in ("paper", "ours", SPREAD, "difference", "stated σ")),
    )
    return Table(
        "Table II: estimated errors of the parameters, mm or deg",
        columns,
        tuple(_parameter_cells(row) for row in comparison.parameters),
        "The paper's estimates are the simulated robot's truth, so ours should find them again. "
        "With this repeatability they are found to about 1 mm and 0.1°, as the paper says.",
    )


def floor_table(evidence: Evidence) -> Table:
    """What noise alone leaves."""
    titles = ("median", SPREAD, "paper")
    return Table(
        "What noise alone leaves on a robot that is perfectly known, mm",
        (*words("test", "noise"), *map(Column, titles)),
        tuple(_floor_cells(floor) for floor in evidence.floors),
        f"{len(evidence.floors[0].draws_mm)} draws each. On every coordinate the tracker's noise "
        "is normal, the robot's repeatability uniform; backlash is left out.",
    )


def geometry_table(evidence: Evidence) -> Table | None:
    """What wrong parameters alone leave; None without a seed of the prototype."""
    if not evidence.geometry_alone:
        return None
    rows = tuple(_geometry_cells(alone) for alone in evidence.geometry_alone)
    return Table(
        "What wrong parameters alone leave, mm",
        (*words("test"), *map(Column, ("before", "after", SPREAD, "with noise", SPREAD))),
        rows,
        "Commanded with the nominal, then with each seed's identified parameters; the true robot "
        "follows without noise. With noise: the repeatability of ± 0.4/√3 mm is drawn upon that, "
        "without backlash; what ours measures after should be like it.",
    )


def reach_table(evidence: Evidence) -> Table:
    """Table I as printed is no usable robot."""
    titles = ("points reached", "longest line x", "y", "z")
    needed = ("needed, section IV.E", "", *(f"{length:g}" for length in printed.LINES_MM))
    return Table(
        "What a robot reaches on a 25 mm grid over the whole space at θ = 0, mm",
        (*words("robot"), *map(Column, titles)),
        (*(_reach_cells(reach) for reach in evidence.reaches), needed),
    )


def reason_lines(reasons: Sequence[Reason]) -> dict[str, str]:
    """Each reason behind its letter."""
    return {_letter(reason, reasons): reason.value for reason in reasons}


def missed_lines(comparison: Comparison) -> Iterator[str]:
    """Every median that is not as asked."""
    for group, row in comparison.asked:
        if not row.passed:
            found = _figure(row.ours.median, row.quantity)
            why = _differs(row, comparison.reasons)
            line = f"{group.title}: {row.quantity.name} {found}, asked {_asked(row.quantity)}"
            yield f"{line}; why:\N{NO-BREAK SPACE}{why}" if why else line


def _group_table(compared: ComparedGroup, reasons: Sequence[Reason]) -> Table:
    titles = ("paper", "ours", SPREAD, "asked", "", "why")
    rows = tuple(_cells(row, reasons) for row in compared.rows)
    title = f"{compared.group.title} (mm, {_seeds(compared.rows)})"
    return Table(title, (*words(""), *map(Column, titles)), rows)


def _cells(row: Compared, reasons: Sequence[Reason]) -> Row:
    quantity = row.quantity
    return (
        quantity.name,
        quantity.printed.text + SIGNS[quantity.unit] if quantity.printed else NOTHING,
        _figure(row.ours.median, quantity),
        _range(row.ours, quantity.decimals),
        _asked(quantity),
        {True: PASS, False: MISSED, None: ""}[row.passed],
        _differs(row, reasons),
    )


def _differs(row: Compared, reasons: Sequence[Reason]) -> str:
    """The reason's letter; nothing where the paper's figure lies within our spread."""
    if row.agrees is not False:
        return ""
    return UNEXPLAINED if row.reason is None else _letter(row.reason, reasons)


def _letter(reason: Reason, reasons: Sequence[Reason]) -> str:
    return ascii_lowercase[reasons.index(reason)]


def _figure(value: float, quantity: Quantity) -> str:
    return number(value, quantity.decimals) + SIGNS[quantity.unit]


def _asked(quantity: Quantity) -> str:
    return "" if quantity.asked is None else f"{quantity.asked}{SIGNS[quantity.unit]}"


def _range(ours: Distribution, decimals: int, *, signed: bool = False) -> str:
    low, high = (number(value, decimals, signed=signed) for value in (ours.low, ours.high))
    return f"{low} … {high}"


def _seeds(rows: Iterable[Compared]) -> str:
    count = next(iter(rows)).ours.n
    return f"{count} seed{'' if count == 1 else 's'}"


def _parameter_cells(row: ParameterRow) -> Row:
    decimals = PARAMETER_DECIMALS
    return (
        row.name,
        number(row.printed, decimals, signed=True),
        number(row.ours.median, decimals, signed=True),
        _range(row.ours, decimals, signed=True),
        number(row.ours.median - row.printed, decimals, signed=True),
        number(row.std, decimals),
    )


def _floor_cells(floor: Floor) -> Row:
    paper = ", ".join(figure.text for figure in floor.paper)
    left = floor.left
    return floor.name, floor.noise, number(left.median), _range(left, 3), paper


def _geometry_cells(alone: GeometryAlone) -> Row:
    found = (alone.after, alone.noisy)
    after = (text for each in found for text in (number(each.median, 2), _range(each, 2)))
    return alone.name, number(alone.before_mm, 2), *after


def _reach_cells(reach: Reach) -> Row:
    lines = (f"{length:g}" for length in reach.lines_mm)
    return reach.name, str(len(reach.points_mm)), *lines
