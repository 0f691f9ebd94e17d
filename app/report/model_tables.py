"""Tables and sentences on an identification, alike on the terminal and on the page.

Nothing here needs matplotlib.
"""

import math
from collections.abc import Iterator

from campaigns.evaluation.decision import COVERAGE
from campaigns.files.table import Column, words
from campaigns.fit.error_sources import SOURCES, TRACKER_SOURCES
from campaigns.identification.findings import Finding, HoldOut
from campaigns.identification.result import (
    Correlation,
    IdentificationResult,
    IdentifiedParameter,
    ParameterCovariance,
    RecordedIdentification,
)
from campaigns.kinematics.parameters import ParameterTable

DECIMALS = 4
"""Decimals of parameters and of shares in a budget."""
Named = tuple[str, IdentifiedParameter]

VALUES: tuple[Column[Named], ...] = (
    Column("nominal", lambda row: row[1].nominal, decimals=DECIMALS),
    Column("identified", lambda row: row[1].value, decimals=DECIMALS),
    Column("Δ", lambda row: row[1].delta, decimals=DECIMALS, signed=True),
    Column("σ", lambda row: row[1].std, decimals=DECIMALS),
    words("", lambda row: _remark(row[1])),
)


def parameters(table: ParameterTable) -> tuple[Column[Named], ...]:
    """Return the columns of parameters with their units."""
    return (
        words("parameter", lambda row: table[row[0]].label),
        words("unit", lambda row: table[row[0]].sign.strip()),
        *VALUES,
    )


def is_shown(parameter: IdentifiedParameter) -> bool:
    """Return whether a parameter differs from nominal by more than U (k = 2)."""
    std = parameter.std
    return std is not None and abs(parameter.delta) > COVERAGE * std


def _remark(parameter: IdentifiedParameter) -> str:
    if not parameter.free:
        return "held"
    if parameter.std is None:
        return "not determined"
    return "" if is_shown(parameter) else "within U"


FINDINGS: tuple[Column[Finding], ...] = (
    words("finding", lambda finding: finding.name),
    words("", lambda finding: finding.says),
    words("consequence", lambda finding: _consequence(finding)),
)


def _consequence(finding: Finding) -> str:
    if finding.accepted:
        return "accepted"
    return "reported only" if finding.decision is None else f"verdict: {finding.decision}"


BudgetRow = tuple[str, str, float]
"""Source, type A or B, and 1 σ of positions in mm."""
BUDGET: tuple[Column[BudgetRow], ...] = (
    words("source", lambda row: row[0]),
    Column("σ", lambda row: row[2], "mm", DECIMALS),
    words("type", lambda row: row[1]),
)


def budget_rows(found: IdentificationResult) -> tuple[BudgetRow, ...]:
    """Return the uncertainty budget of positions, the largest share first, and its combination."""
    shares = sorted(found.budget, key=lambda share: -share.mm)
    combined = math.sqrt(sum(share.mm**2 for share in shares))
    rows = [(share.words, share.kind, share.mm) for share in shares]
    return (*rows, ("combined", "", combined)) if rows else ()


TrackerError = tuple[str, tuple[float, float]]
TRACKER_ERRORS: tuple[Column[TrackerError], ...] = (
    words("error of the tracker", lambda row: SOURCES[row[0]].words),
    Column("estimate", lambda row: row[1][0], decimals=DECIMALS, signed=True),
    Column("σ", lambda row: row[1][1], decimals=DECIMALS),
    words("unit", lambda row: TRACKER_SOURCES[row[0]]),
)

CORRELATIONS: tuple[Column[Correlation], ...] = (
    words("", lambda own: own.first),
    words("", lambda own: own.second),
    Column("ρ", lambda own: own.value, decimals=2, signed=True),
)


UNDETERMINED: tuple[Column[tuple[str, ...]], ...] = (
    words("parameter, or combination of parameters", lambda names: ", ".join(names)),
)


def of_geometry(known: ParameterCovariance, table: ParameterTable) -> ParameterCovariance:
    """Return the covariance of the parameters that every robot file has."""
    places = [place for place, name in enumerate(known.names) if name in table.names]
    names = tuple(known.names[place] for place in places)
    rows = tuple(tuple(known.matrix[row][column] for column in places) for row in places)
    return ParameterCovariance(names, rows)


def positions_in_words(found: IdentificationResult) -> Iterator[str]:
    """Yield the uncertainty of positions and the region that it is valid for."""
    std = found.position_std_mm
    if std is not None:
        says = (
            f"predicted σ of positions over the workspace: {std.mean:.4f} mm on average, "
            f"{std.rms:.4f} mm rms, {std.max:.4f} mm at most"
        )
        if std.left_out:
            says += f", without {std.left_out} of its poses, which this robot cannot take"
        yield says
    if found.region is not None:
        yield found.region.says


def hold_out_in_words(test: HoldOut) -> str:
    """Return what the test of hold-out pairs showed."""
    verdict = "agrees with" if test.believable else "contradicts"
    return (
        f"{test.pairs} hold-out pairs are {test.ratio:.2f} times as far off as their σ predict "
        f"(χ² {test.chi2:.1f}, p = {test.p:.2g}): that {verdict} these σ"
    )


def undetermined_in_words(found: IdentificationResult) -> Iterator[str]:
    """Yield which parameters no shot determines, and how many combinations of others."""
    alone = [names[0] for names in found.undetermined if len(names) == 1]
    if alone:
        yield f"no shot determines {', '.join(alone)}: kept at nominal"
    together = len(found.undetermined) - len(alone)
    if together:
        yield (
            f"no shot determines {together} combinations of parameters, such as motions of the "
            "base frame: kept at nominal (the report lists them)"
        )


def in_words(found: RecordedIdentification) -> Iterator[str]:
    """Yield sentences on model, noise and origin, without capitals and full stops."""
    settled = "settled" if found.converged else "did not settle"
    yield f"model {found.model}: the fit {settled} after {found.iterations} rounds"
    if found.scatter is not None:
        yield found.scatter.says
    if found.reference_degC is not None:
        yield f"parameters are those at {found.reference_degC:g} °C"
    if found.pedigree is not None:
        before_mm = found.pedigree.position_std_before_mm
        before = "" if before_mm is None else f"; σ of positions was {before_mm:.4f} mm on average"
        series = ", ".join(map(str, found.pedigree.series))
        yield (
            f"made of the set {found.pedigree.updates[:12]} by {found.pedigree.shots} shots of a "
            f"check (series {series}){before}"
        )
