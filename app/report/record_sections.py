"""Rows of the tables for the record: tracker, what went wrong, instruments, versions, digests."""

from collections.abc import Iterator

from app.report.parts import moment
from campaigns.evaluation.integrity import Check
from campaigns.evaluation.time_series import stated_uncertainty_mm, time_series
from campaigns.evidence import Evidence, JournalFacts
from campaigns.files.table import NOTHING, Row, number
from campaigns.identification.result import Excluded
from campaigns.journal.records import Event, Rejected, SeriesStarted
from campaigns.journal.views import Series
from campaigns.shots.import_export import imported_files
from drivers.values import Weather


def tracker_rows(evidence: Evidence) -> tuple[Row, ...]:
    """Rows of series: name, u of a point, median and largest, air from, to, drift."""
    return tuple(
        (
            name,
            *_two(stated_uncertainty_mm(measured.shots), 4, "not stated"),
            *_two((series := time_series(name, measured.shots)).air_range, 2),
            number(series.moved_mm),
        )
        for name, measured in evidence.by_stage()
    )


def beam_losses(evidence: Evidence) -> int:
    """Number of shots lost with the beam."""
    records = [each.record for each in evidence.journal.incidents] if evidence.journal else []
    return sum(isinstance(r, Rejected) and r.reason.startswith("beam broken") for r in records)


def excluded_rows(excluded: tuple[Excluded, ...]) -> tuple[Row, ...]:
    """Rows of what the identification left out: what, reason."""
    return tuple((left.what, left.reason) for left in excluded)


def incident_rows(journal: JournalFacts, *, events: bool) -> tuple[Row, ...]:
    """Rows of events, or of rejected shots and voided pairs: time, series, what, text."""
    return tuple(
        (
            moment(each.at_utc),
            NOTHING if each.series is None else str(each.series),
            each.concerns,
            each.text,
        )
        for each in journal.incidents
        if isinstance(each.record, Event) is events
    )


def check_rows(checks: tuple[Check, ...]) -> tuple[Row, ...]:
    """Rows of checks: statement, whether it holds, detail."""
    answers = {True: "yes", False: "no", None: NOTHING}
    return tuple((check.statement, answers[check.holds], check.detail) for check in checks)


def series_rows(every: tuple[Series, ...]) -> tuple[Row, ...]:
    """Rows of series: number, stage, begun, shots, state, software."""
    return tuple(
        (
            str(series.number),
            series.started.stage,
            moment(series.started_utc),
            str(len(series.shots)),
            _state(series),
            f"pkmcal {series.started.software_version}",
        )
        for series in every
    )


def imported_rows(every: tuple[Series, ...]) -> tuple[Row, ...]:
    """Rows of imported files: series, name, sha256 of the file."""
    imports = [each for each in every if each.started.stage == "import"]
    return tuple(
        (str(series.number), *file) for series in imports for file in _files_of(series.started)
    )


def instrument_rows(evidence: Evidence, journal: JournalFacts) -> tuple[Row, ...]:
    """Rows of instruments and air: what, series, which; each once, with all its series."""
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
    """Rows of digests: of what, sha256."""
    run, found = evidence.run, evidence.identification
    yield f"journal, all {journal.records} records", journal.digest
    if found is not None:
        yield f"journal, first {found.journal_records} records", found.journal_digest
    if run is not None:
        started = run.series.started
        of = "shots taken in, as shots.csv" if started.stage == "import" else "plan as measured"
        yield of, started.plan_digest
    yield "nominal robot's geometry", evidence.campaign.nominal.robot.digest()
    if evidence.parameter_file is not None:
        yield "compensated robot's geometry", evidence.parameter_file.digest()
    if evidence.loaded is not None:
        yield f"geometry loaded last ({evidence.loaded.source})", evidence.loaded.digest


def _files_of(started: SeriesStarted) -> tuple[tuple[str, str], ...]:
    files = tuple((file.name, file.sha256) for file in imported_files(started))
    return files or (("not kept by the software that took them in", NOTHING),)


def _two(values: tuple[float, float] | None, decimals: int, otherwise: str = NOTHING) -> Row:
    if values is None:
        return otherwise, NOTHING
    return number(values[0], decimals), number(values[1], decimals)


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
