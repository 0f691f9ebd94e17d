"""Tables and sentences on results, used by terminal and page, so that both state equal figures.

A table is a tuple of columns with head, unit and decimals; sentences are generators of texts
without capital and full stop, for each output adds its own. matplotlib is not imported here,
because commands that print tables must start quickly.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Literal

from campaigns.arrays import Array
from campaigns.assessment import Evaluation
from campaigns.evaluation.decision import COVERAGE, Requirement
from campaigns.evaluation.iso_figures import IsoRow
from campaigns.evaluation.measured_lengths import MeasuredLength
from campaigns.evaluation.summary import ErrorSummary, summary
from campaigns.evaluation.validation import RepeatabilityTest
from campaigns.evaluation.verdict import NO_CHANGE, Gain
from campaigns.files.table import NOTHING, Column, Row, decimals_by, number, two_digits, words
from campaigns.files.wording import listed
from campaigns.fit.error_sources import SOURCES, TRACKER_SOURCES
from campaigns.fit.events import Event
from campaigns.identification.determined import MOST_ASSUMED, ON_PLANE, Determined
from campaigns.identification.findings import (
    HOLD_OUT_LEVEL,
    Finding,
    HoldOut,
    part_words,
    remedy_of,
    size_in_words,
)
from campaigns.identification.result import (
    Correlation,
    IdentificationResult,
    IdentifiedParameter,
    RecordedIdentification,
)
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.parameters import ParameterTable
from campaigns.shots.observations_csv import ObservationRow
from campaigns.shots.shot_sets import ShotSet

LEAST_SHARE = 0.01
"""Share of the combined σ below which a row of a budget stands among the others."""

ALONE, COMBINATION = "by itself", "combination"
"""What parameters are that no shot determines, where no motion names them."""
MOST_IN_MOTION = 4
"""Number of parameters that are listed of a combination that has words."""
MOST_CORRELATIONS = 8
"""Number of correlations that are listed."""

Stage = Literal["before", "after"]
STAGES: tuple[Stage, Stage] = ("before", "after")


def limits(head: str) -> tuple[Column[Requirement], ...]:
    """Return the columns of requirements: what, error, U, limit, margin, decision."""
    return (
        words(head, lambda r: r.name),
        Column("e", lambda r: "not measured" if r.error is None else r.error, "mm"),
        Column("U", lambda r: r.expanded_uncertainty, "mm"),
        Column("limit", lambda r: "not specified" if r.limit is None else r.limit, "mm"),
        Column("margin", lambda r: r.margin, "mm", signed=True),
        words("decision", lambda r: r.decision or NOTHING),
    )


ERRORS: tuple[Column[tuple[str, str, ErrorSummary]], ...] = (
    words("errors", lambda row: row[0]),
    words("", lambda row: row[1]),
    Column("n", lambda row: row[2].n),
    Column("mean", lambda row: row[2].mean, "mm"),
    Column("σ", lambda row: row[2].sigma, "mm"),
    Column("max", lambda row: row[2].max, "mm"),
    Column("mean + 3σ", lambda row: row[2].mean_plus_3_sigma, "mm"),
    Column("P95", lambda row: row[2].p95, "mm"),
)
GAINS: tuple[Column[Gain], ...] = (
    words("", lambda gain: gain.name),
    Column("before", lambda gain: _mm(gain.before), "mm"),
    Column("after", lambda gain: _mm(gain.after), "mm"),
    words("gain", lambda gain: change(gain)),
    Column("U", lambda gain: gain.expanded_uncertainty_mm, "mm"),
)
IsoRows = tuple[IsoRow | None, IsoRow | None]
"""A figure of ISO 9283 before and after; at least one of the two is not None."""
ISO: tuple[Column[IsoRows], ...] = (
    words("figure", lambda both: _latest(both).name),
    Column("n", lambda both: _latest(both).n),
    Column("before", lambda both: _mm(_figure(both[0])), "mm"),
    Column("U", lambda both: _expanded(_figure(both[0])), "mm"),
    Column("after", lambda both: _mm(_figure(both[1])), "mm"),
    Column("U", lambda both: _expanded(_figure(both[1])), "mm"),
    words("tested here", lambda both: _latest(both).tested),
    words("in the standard", lambda both: _latest(both).asked),
)
CUBE: tuple[Column[tuple[str, str, RepeatabilityTest]], ...] = (
    words("", lambda row: row[0]),
    words("pose", lambda row: row[1]),
    Column("x", lambda row: float(row[2].commanded_mm[0]), "mm", decimals=0),
    Column("y", lambda row: float(row[2].commanded_mm[1]), "mm", decimals=0),
    Column("z", lambda row: float(row[2].commanded_mm[2]), "mm", decimals=0),
    Column("n", lambda row: len(row[2].points_mm)),
    Column("AP", lambda row: _mm(row[2].accuracy), "mm"),
    Column("U", lambda row: _expanded(row[2].accuracy), "mm"),
    Column("RP", lambda row: row[2].rp.value_mm, "mm"),
    Column("U", lambda row: _expanded(row[2].rp), "mm"),
)
"""Columns of ISO 9283's figures, pose by pose; rows are stage, name of the pose, visits."""

Named = tuple[str, IdentifiedParameter]
VALUES: tuple[Column[Named], ...] = (
    Column("nominal", lambda row: row[1].nominal, decimals=lambda row: decimals_by(row[1].std)),
    Column("identified", lambda row: row[1].value, decimals=lambda row: decimals_by(row[1].std)),
    Column(
        "Δ", lambda row: row[1].delta, decimals=lambda row: decimals_by(row[1].std), signed=True
    ),
    Column("σ", lambda row: row[1].std, decimals=lambda row: decimals_by(row[1].std)),
    words("", lambda row: _remark(row[1])),
)
FINDINGS: tuple[Column[Finding], ...] = (
    words("finding", lambda finding: finding.name),
    words("", lambda finding: finding.says),
    words("consequence", lambda finding: _consequence(finding)),
)


def events(joints: Sequence[Axis]) -> tuple[Column[Event], ...]:
    """Return the columns of events: kind, shots, part, size with U, remedy."""
    return (
        words("what", lambda event: event.kind),
        words("shots", _shots_of),
        words("part", lambda event: " or ".join(map(part_words, event.parts)) or NOTHING),
        words("size ± U", lambda event: size_of(event, joints)),
        words("remedy", remedy_of),
    )


BUDGET: tuple[Column[tuple[str, str, float]], ...] = (
    words("source", lambda row: row[0]),
    Column("σ", lambda row: row[2], "mm", lambda row: decimals_by(row[2])),
    words("type", lambda row: row[1]),
)


@dataclass(frozen=True, slots=True)
class Observed:
    """Imported observations of one kind at one object."""

    name: str
    kind: str
    rows: Sequence[ObservationRow]

    @property
    def held_out(self) -> int:
        """Number of those that the file marks as held out."""
        return sum(row.purpose is ShotSet.VALIDATION for row in self.rows)


DETERMINED: tuple[Column[Determined], ...] = (
    words("quantity", lambda row: row.name),
    Column("σ rms", lambda row: row.rms, decimals=lambda row: decimals_by(row.rms)),
    Column("largest", lambda row: row.max, decimals=lambda row: decimals_by(row.rms)),
    words("", lambda row: row.unit),
    Column("by tolerances, %", lambda row: 100.0 * row.assumed, decimals=0),
    words("determined", lambda row: "yes" if row.is_determined else "no"),
    words("tested", lambda row: "yes" if row.is_tested else "no"),
)
"""Columns of what observations determine."""
OBSERVED: tuple[Column[Observed], ...] = (
    words("object", lambda observed: observed.name),
    words("kind", lambda observed: observed.kind),
    Column("observations", lambda observed: len(observed.rows)),
    Column("held out by the file", lambda observed: observed.held_out),
    words("σ as stated", lambda observed: _span([row.std_mm for row in observed.rows])),
    words("files", lambda observed: ", ".join(dict.fromkeys(r.file for r in observed.rows))),
)
"""Columns of imported observations, by object and kind."""
TRACKER_ERRORS: tuple[Column[tuple[str, tuple[float, float]]], ...] = (
    words("error of the tracker", lambda row: SOURCES[row[0]].words),
    Column(
        "estimate", lambda row: row[1][0], decimals=lambda row: decimals_by(row[1][1]), signed=True
    ),
    Column("σ", lambda row: row[1][1], decimals=lambda row: decimals_by(row[1][1])),
    words("unit", lambda row: TRACKER_SOURCES[row[0]]),
)
CORRELATIONS: tuple[Column[Correlation], ...] = (
    words("", lambda pair: pair.first),
    words("", lambda pair: pair.second),
    Column("ρ", lambda pair: pair.value, decimals=2, signed=True),
)


@dataclass(frozen=True, slots=True, eq=False)
class PairGroup:
    """Errors of a group of pairs by stage, mm; a stage that was not measured is None."""

    name: str
    marker: str
    errors_mm: Mapping[Stage, Array | None]
    numbers: tuple[int, ...] = ()
    """Numbers of the pairs; empty if the two stages measured different pairs."""

    def __len__(self) -> int:
        return max(len(errors) for errors in self.errors_mm.values() if errors is not None)


def pair_groups(evaluation: Evaluation) -> list[PairGroup]:
    """Return fitted and hold-out pairs by the models, and the pairs that were commanded."""
    # 1. Fitted and hold-out pairs: the distance that the model gives at the measured joint angles.
    #    Before and after differ by the model alone, and both come from one series of shots.
    # 2. Commanded pairs: what the controller reached by itself. Before and after are two series,
    #    which need not have the same pairs.
    errors = evaluation.errors
    modelled = (
        ("fitted pairs", "o", errors.fitted if errors else None),
        ("hold-out pairs", "D", errors.unseen if errors else None),
    )
    groups = [
        PairGroup(name, marker, {"before": e.before_mm, "after": e.after_mm}, e.numbers)
        for name, marker, e in modelled
        if e is not None
    ]
    results = zip(STAGES, (evaluation.before, evaluation.after), strict=True)
    tests = {stage: result.distances if result else None for stage, result in results}
    numbers = {test.pairs for test in tests.values() if test}
    if numbers:
        commanded = {stage: test.errors_mm if test else None for stage, test in tests.items()}
        numbers_of_both = numbers.pop() if len(numbers) == 1 else ()
        groups.append(PairGroup("commanded pairs", "s", commanded, numbers_of_both))
    return groups


def error_rows(evaluation: Evaluation) -> Iterator[tuple[str, str, ErrorSummary]]:
    """Yield the errors before and after: of what, stage, summary."""
    identification = evaluation.evidence.identification
    fitted = identification.residuals.fitted if identification else None
    shots = fitted if fitted and fitted.of == "shots" else None
    results = evaluation.before, evaluation.after
    compared = {
        "fitted positions": (shots.before, shots.after) if shots else (),
        **{group.name: tuple(group.errors_mm.values()) for group in pair_groups(evaluation)},
        "commanded positions": tuple(r.absolute_mm if r else None for r in results),
    }
    for name, stages in compared.items():
        for stage, errors_mm in zip(STAGES, stages, strict=False):
            if errors_mm is not None:
                yield name, stage, summary(errors_mm)


def key_figure_rows(evaluation: Evaluation) -> list[Row]:
    """Return the figures of the commanded robot for readers who read no further.

    Mean and largest error of distance, rotation and the worst line: name, before, after with the
    U of its measurement, and whether a change is shown.
    """
    expanded_mm = {r.name: r.expanded_uncertainty for r in evaluation.verdict.requirements}
    names = ("distances, mean error", "distances, largest error", "rotation")
    chosen = [gain for gain in evaluation.gains if gain.name in names]
    lines = [gain for gain in evaluation.gains if gain.name.startswith("straightness")]
    chosen += sorted(lines, key=_largest_mm)[-1:]  # of three lines the worst
    return [
        (
            gain.name,
            number(_mm(gain.before)),
            number(_mm(gain.after)),
            number(expanded_mm.get(gain.name)) if gain.after else "",
            NO_CHANGE if gain.shown is False else "",
        )
        for gain in chosen
    ]


def _largest_mm(gain: Gain) -> float:
    return max(length.value_mm for length in (gain.before, gain.after) if length is not None)


def _mm(length: MeasuredLength | None) -> float | None:
    return None if length is None else length.value_mm


def _expanded(length: MeasuredLength | None) -> float | None:
    return None if length is None else length.expanded_uncertainty_mm


def _figure(row: IsoRow | None) -> MeasuredLength | None:
    return None if row is None else row.figure


def change(gain: Gain) -> str:
    """Return the factor of a change in two digits, unless the difference is within its U."""
    # The factor is larger value / smaller value. If U reaches the smaller value, this value could
    # be 0 and the factor any number; what the data support is the bound larger / (smaller + U). The
    # bound is cut to two digits and not rounded, so that it stays a bound.
    if gain.before is None or gain.after is None:
        return NOTHING
    if not gain.shown:
        return NO_CHANGE
    least, most = sorted((gain.before.value_mm, gain.after.value_mm))
    word = "less" if gain.after.value_mm < gain.before.value_mm else "more"
    expanded_mm = gain.expanded_uncertainty_mm or 0.0
    if least > 0.0 and expanded_mm < least:
        return f"{float(f'{most / least:.2g}'):g} × {word}"
    bound = most / (least + expanded_mm)
    step = 10.0 ** (math.floor(math.log10(bound)) - 1)
    return f"> {math.floor(bound / step) * step:.6g} × {word}"


def _latest(both: IsoRows) -> IsoRow:
    """Return the row whose n and test are stated: after calibration, if its figure was measured."""
    before, after = both
    if after and (after.figure or before is None):
        return after
    assert before is not None, "a row is of one stage at least"
    return before


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
    return "" if is_shown(parameter) else "≤ U"


def _consequence(finding: Finding) -> str:
    if finding.accepted:
        return "accepted"
    return "reported only" if finding.decision is None else f"verdict: {finding.decision}"


def part_of(event: Event) -> str:
    """Name the likeliest part of a change, and count the others that explain it nearly as well."""
    others = len(event.parts) - 1
    return part_words(event.parts[0]) + (f" (or {others} more)" if others > 0 else "")


def size_of(event: Event, joints: Sequence[Axis]) -> str:
    """Return the size of an event with U, by the robot's joints; a dash where it has none."""
    if event.kind == "no assembly":
        return NOTHING
    return size_in_words(event, joints).replace("-", "−")


def _shots_of(event: Event) -> str:
    if event.first == event.last:
        return str(event.first)
    return f"from {event.first} on" if event.is_lasting else f"{event.first} to {event.last}"


def budget_rows(identification: IdentificationResult) -> list[tuple[str, str, float]]:
    """Return source, type and 1 σ of positions, the largest first, and their combination."""
    # The shares are independent, so they add up in squares (GUM 5.1.2). Those that hardly count
    # together have one row: in squares they are a ten-thousandth of the whole, each.
    shares = sorted(identification.uncertainty.budget, key=lambda share: -share.mm)
    combined = math.hypot(*(share.mm for share in shares))
    least = LEAST_SHARE * combined
    rows = [(share.words, str(share.kind), share.mm) for share in shares if share.mm >= least]
    if small := [share.mm for share in shares if share.mm < least]:
        rows.append((f"{len(small)} others", "", math.hypot(*small)))
    return [*rows, ("combined", "", combined)]


def positions_in_words(identification: IdentificationResult) -> Iterator[str]:
    """Yield the uncertainty of positions and the region that it is valid for."""
    std = identification.uncertainty.position_std_mm
    if std is not None:
        sentence = (
            f"predicted σ of positions over the workspace: {two_digits(std.mean)} mm on average, "
            f"{two_digits(std.rms)} mm rms, {two_digits(std.max)} mm at most"
        )
        if std.left_out:
            sentence += f", without {std.left_out} of its poses, which this robot cannot take"
        yield sentence
    if (region := identification.uncertainty.region) is not None:
        yield region.says
    for quantity in _in_sentences(identification):
        if quantity.name == "rotation":
            yield (
                f"predicted σ of the tool's rotation: {two_digits(quantity.mean)}° on average, "
                f"{two_digits(quantity.rms)}° rms, {two_digits(quantity.max)}° at most"
            )
        yield determined_in_words(quantity)


def determined_rows(identification: IdentificationResult) -> tuple[Determined, ...]:
    """Return the quantities of a table of what observations determine; () for shots alone."""
    quantities = identification.uncertainty.determined
    return quantities if any(quantity.name in ON_PLANE for quantity in quantities) else ()


def _in_sentences(identification: IdentificationResult) -> tuple[Determined, ...]:
    """Return the quantities that no table has, which sentences state."""
    listed = determined_rows(identification)
    return () if listed else identification.uncertainty.determined


def quantity_in_words(quantity: Determined) -> str:
    """Return what observations alone determine of a quantity, in words."""
    state = "determined" if quantity.is_determined else "NOT determined"
    tested = "tested" if quantity.is_tested else "not tested"
    return f"{quantity.name}: σ {two_digits(quantity.rms)} {quantity.unit} rms, {state}, {tested}"


def observed_rows(rows: Iterable[ObservationRow]) -> Iterator[Observed]:
    """Yield the observations by object and kind."""
    groups: dict[tuple[str, str], list[ObservationRow]] = {}
    for row in rows:
        groups.setdefault((row.object, row.kind), []).append(row)
    yield from (Observed(name, kind, group) for (name, kind), group in groups.items())


def _span(values: Sequence[float]) -> str:
    """Return the range of values in mm, or the one that they all are."""
    low, high = min(values), max(values)
    return f"{low:g} mm" if low == high else f"{low:g} to {high:g} mm"


def determined_in_words(quantity: Determined) -> str:
    """Return whether shots determine and test a quantity, in words."""
    state = "determined" if quantity.is_determined else "NOT determined"
    tested = "tested by shots never fitted" if quantity.is_tested else "not tested"
    return (
        f"{quantity.name}: {state}, {100.0 * quantity.assumed:.0f} % of its variance comes from "
        f"tolerances (limit {100.0 * MOST_ASSUMED:.0f} %); {tested}"
    )


def hold_out_in_words(test: HoldOut) -> str:
    """Return the result of the hold-out test in words, with its statistic, p and α."""
    verdict = "agrees with" if test.believable else "contradicts"
    return (
        f"{test.pairs} hold-out pairs are {test.ratio:.2f} times as far off as their σ predict "
        f"(χ² {test.chi2:.1f}, p = {test.p:.2g}, α = {HOLD_OUT_LEVEL:g}): that {verdict} these σ"
    )


def undetermined_in_words(identification: IdentificationResult) -> Iterator[str]:
    """Yield which parameters and motions no shot determines, and how many other combinations."""
    rows = [*undetermined_rows(identification)]
    if alone := [names for what, names in rows if what == ALONE]:
        yield f"not observable: {', '.join(alone)}: kept at nominal"
    motions = [what for what, _ in rows if what not in {ALONE, COMBINATION}]
    if motions:
        yield f"not observable: {'; '.join(motions)}: kept at nominal"
    if together := sum(what == COMBINATION for what, _ in rows):
        word = "combination is" if together == 1 else "combinations are"
        yield (
            f"{together} parameter {word} not observable: kept at nominal (the report lists them)"
        )


def undetermined_rows(identification: IdentificationResult) -> Iterator[tuple[str, str]]:
    """Yield what each undetermined combination of parameters does, and its parameters."""
    # A motion is said in words: of the parameters that it moves, a list says no more.
    value = identification.value
    for names, motion in zip_longest(value.undetermined, value.motions, fillvalue=""):
        others = ALONE if len(names) == 1 else COMBINATION
        yield motion or others, listed([*names], MOST_IN_MOTION if motion else len(names))


def correlations(identification: IdentificationResult) -> list[Correlation]:
    """Return the strongest correlations of what the shots determine."""
    determined = identification.determined_covariance
    return determined.strongest(MOST_CORRELATIONS) if determined else []


def in_words(identification: RecordedIdentification) -> Iterator[str]:
    """Yield sentences on model, scatter, reference temperature and origin."""
    if identification.is_by_older_model:
        yield (
            "identified by an older model: run `pkmcal identify DIR` again for what this version's "
            "model shows"
        )
    provenance = identification.provenance
    converged = "converged" if provenance.converged else "did not converge"
    yield f"model {provenance.model}: the fit {converged} in {provenance.iterations} iterations"
    if (scatter := identification.uncertainty.scatter) is not None:
        yield scatter.says
    if (reference_degC := identification.value.reference_degC) is not None:
        yield f"parameters are those at {reference_degC:g} °C"
    if (pedigree := provenance.pedigree) is not None:
        before_mm = pedigree.position_std_before_mm
        before = "" if before_mm is None else f"; σ of positions was {before_mm:.4f} mm on average"
        series = ", ".join(map(str, pedigree.series))
        yield (
            f"made of the set {pedigree.updates[:12]} by {pedigree.shots} shots of a "
            f"check (series {series}){before}"
        )
