"""Tables for the record: tracker, what went wrong, instruments, versions, digests."""

from collections.abc import Iterator

from app.report.rendering import moment
from campaigns.evaluation.campaign_verdict import Check
from campaigns.evaluation.time_series import stated_uncertainty_mm, time_series
from campaigns.evidence import Evidence, Incident, JournalFacts
from campaigns.files.table import NOTHING, Column, Row, by_place, number, words
from campaigns.identification.result import Excluded, Frame, IdentificationResult
from campaigns.journal.records import Event, Rejected, SeriesStarted
from campaigns.journal.views import Series
from campaigns.shots.import_export import imported_files
from campaigns.shots.shots import Shots
from drivers.values import Weather

Measured = tuple[str, Shots]


TRACKER: tuple[Column[Measured], ...] = (
    words("series", lambda row: row[0]),
    Column("u of a point, median", lambda row: _stated(row, 0) or "not stated", "mm", 4),
    Column("largest", lambda row: _stated(row, 1), "mm", 4),
    Column("air from", lambda row: _air_range(row, 0), "°C", 2),
    Column("to", lambda row: _air_range(row, 1), "°C", 2),
    Column("drift pose moved", lambda row: time_series(*row).moved_mm, "mm"),
)


def tracker_rows(evidence: Evidence) -> list[Measured]:
    """Shots of each series by its name."""
    return [(name, measured.shots) for name, measured in evidence.by_stage()]


def _stated(row: Measured, place: int) -> float | None:
    stated = stated_uncertainty_mm(row[1])
    return None if stated is None else stated[place]


def _air_range(row: Measured, place: int) -> float | None:
    air = time_series(*row).air_range
    return None if air is None else air[place]


def beam_losses(evidence: Evidence) -> int:
    """Number of shots lost with the beam."""
    records = [each.record for each in evidence.journal.incidents] if evidence.journal else []
    return sum(isinstance(r, Rejected) and r.reason.startswith("beam broken") for r in records)


Placed = tuple[str, Frame]
FRAMES: tuple[Column[Placed], ...] = (
    words("shots", lambda row: row[0]),
    Column("x", lambda row: row[1].x_mm, "mm"),
    Column("y", lambda row: row[1].y_mm, "mm"),
    Column("z", lambda row: row[1].z_mm, "mm"),
    Column("φ", lambda row: row[1].phi_deg, "°", 4),
    Column("γ", lambda row: row[1].gamma_deg, "°", 4),
    Column("ψ", lambda row: row[1].psi_deg, "°", 4),
)


def frame_rows(found: IdentificationResult) -> list[Placed]:
    """Return the fitted frames and the shots of each, a row for each session that has its own."""
    if not found.sessions:
        return [("all", found.frame)] if found.frame else []
    return [(_range(own.shots), own.frame) for own in found.sessions if own.frame]


def _range(shots: tuple[int, ...]) -> str:
    return f"{min(shots)} to {max(shots)}"


EXCLUDED: tuple[Column[Excluded], ...] = (
    words("", lambda left: left.what),
    words("reason", lambda left: left.reason),
)


def incidents(text: str) -> tuple[Column[Incident], ...]:
    """Columns of events, or of rejected shots and voided pairs."""
    return (
        words("time", lambda each: moment(each.at_utc)),
        words("series", lambda each: NOTHING if each.series is None else str(each.series)),
        words("what", lambda each: each.concerns),
        words(text, lambda each: each.text),
    )


def incidents_of(journal: JournalFacts, *, events: bool) -> list[Incident]:
    """Events, or rejected shots and voided pairs."""
    return [each for each in journal.incidents if isinstance(each.record, Event) is events]


CHECKS: tuple[Column[Check], ...] = (
    words("statement", lambda check: check.statement),
    words("", lambda check: {True: "yes", False: "no", None: NOTHING}[check.holds]),
    words("detail", lambda check: check.detail),
)

SERIES: tuple[Column[Series], ...] = (
    words("series", lambda series: str(series.number)),
    words("stage", lambda series: _stage(series.started)),
    words("begun", lambda series: moment(series.started_utc)),
    Column("shots", lambda series: len(series.shots)),
    words("state", lambda series: _state(series)),
    words("software", lambda series: f"pkmcal {series.started.software_version}"),
)

SHA256: Column[Row] = Column("sha256", lambda row: row[-1], kind="code")
IMPORTED = (*by_place("series", "file"), SHA256)
INSTRUMENTS = by_place("", "series", "")
DIGESTS = (*by_place(""), SHA256)


def imported_rows(every: tuple[Series, ...]) -> tuple[Row, ...]:
    """Imported files: series, name, sha256 of the file."""
    imports = [each for each in every if each.started.imported]
    return tuple(
        (str(series.number), *file) for series in imports for file in _files_of(series.started)
    )


def instrument_rows(evidence: Evidence, journal: JournalFacts) -> tuple[Row, ...]:
    """Instruments and air: what, series, which; each once, with all its series."""
    seen: dict[tuple[str, str], list[str]] = {}
    for each in journal.series:
        for name, text in _present(each):
            seen.setdefault((name, text), []).append(str(each.number))
    config = evidence.campaign.config
    reflector = (config.tracker.reflector, config.instruments.reflector_serial)
    return (
        *((name, ", ".join(series), text) for (name, text), series in seen.items()),
        ("reflector", "now", " ".join(filter(None, reflector))),
    )


def digest_rows(evidence: Evidence, journal: JournalFacts) -> Iterator[Row]:
    """Digests: of what, sha256."""
    run, found = evidence.run, evidence.identification
    yield f"journal, all {journal.records} records", journal.digest
    if found is not None:
        yield f"journal, first {found.journal_records} records", found.journal_digest
    if run is not None:
        started = run.series.started
        of = "imported shots, as shots.csv" if started.stage == "import" else "plan as measured"
        yield of, started.plan_digest
    yield "nominal robot's geometry", evidence.campaign.nominal.robot.digest()
    if evidence.parameter_file is not None:
        yield "compensated robot's geometry", evidence.parameter_file.digest()
    if evidence.loaded is not None:
        yield f"geometry loaded last ({evidence.loaded.source})", evidence.loaded.digest


def _stage(started: SeriesStarted) -> str:
    return f"{started.stage}, imported" if started.declared else started.stage


def _files_of(started: SeriesStarted) -> tuple[tuple[str, str], ...]:
    files = tuple((file.name, file.sha256) for file in imported_files(started))
    return files or (("not recorded by the software that imported them", NOTHING),)


def _state(series: Series) -> str:
    state = "finished" if series.finished else "unfinished"
    return f"{state}, {series.sessions} sessions" if series.sessions > 1 else state


def _present(series: Series) -> Iterator[tuple[str, str]]:
    for name, identity in (
        ("controller", series.started.robot),
        ("tracker", series.started.tracker),
    ):
        yield name, "none: imported" if identity is None else str(identity)
    air = series.started.weather
    if air is not None:
        yield "air at the start", _air(air)


def _air(air: Weather) -> str:
    return (
        f"{number(air.temperature_degC, 1)} °C, {number(air.pressure_hPa, 1)} hPa, "
        f"{number(air.humidity_percent, 0)} % humidity"
    )
