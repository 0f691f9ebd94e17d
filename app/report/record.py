"""Sections of the page for the record: item, tracker, incidents, instruments, versions, digests."""

from collections.abc import Iterator
from datetime import datetime

from app.report import figures, model_tables
from app.report.section import NO_JOURNAL, Section, moment
from campaigns.evaluation.campaign_verdict import Check
from campaigns.evaluation.time_series import TimeSeries, stated_uncertainty_mm, time_series
from campaigns.evidence import Evaluation, Evidence, Incident, JournalFacts
from campaigns.files.table import NOTHING, Column, Row, by_place, number, words
from campaigns.identification.result import (
    Excluded,
    Frame,
    IdentificationResult,
    RecordedIdentification,
)
from campaigns.journal.records import Event, Rejected, SeriesStarted
from campaigns.journal.views import Series
from campaigns.settings.sections import CertificateConfig
from campaigns.shots.import_export import imported_files
from drivers.values import Weather

Measured = tuple[TimeSeries, float | str, float | None]
"""Series, and the tracker's σ of a point as stated in it: median and largest."""
UNKNOWN = (None, None)
TRACKER: tuple[Column[Measured], ...] = (
    words("series", lambda row: row[0].name),
    Column("u of a point, median", lambda row: row[1], "mm", 4),
    Column("largest", lambda row: row[2], "mm", 4),
    Column("air from", lambda row: (row[0].air_range or UNKNOWN)[0], "°C", 2),
    Column("to", lambda row: (row[0].air_range or UNKNOWN)[1], "°C", 2),
    Column("drift pose moved", lambda row: row[0].moved_mm, "mm"),
)


def measured_rows(evidence: Evidence) -> Iterator[Measured]:
    """Yield a row for each series."""
    for name, measured in evidence.by_stage():
        stated_mm = stated_uncertainty_mm(measured.shots) or ("not stated", None)
        yield time_series(name, measured.shots), *stated_mm


def beam_losses(evidence: Evidence) -> int:
    """Return the number of shots lost with the beam."""
    records = [row.record for row in evidence.journal.incidents] if evidence.journal else []
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


def facts(evaluation: Evaluation) -> Iterator[Row]:
    """Yield name and text of each fact; the text is empty where campaign.yaml does not state it."""
    evidence = evaluation.evidence
    config, certificate = evidence.campaign.config, evidence.campaign.config.certificate
    series = evidence.journal.series if evidence.journal else ()
    robot = next((each.started.robot for each in reversed(series) if each.started.robot), None)
    tracker = next(
        (each.started.tracker for each in reversed(series) if each.started.tracker), None
    )
    identified, times = evidence.identification, _times_utc(evidence)
    yield from (
        ("customer", certificate.customer),
        ("laboratory", certificate.laboratory),
        ("item", " ".join(filter(None, (certificate.robot_type, evidence.campaign.robot.name)))),
        ("serial number", config.instruments.robot_serial),
        ("controller", "" if robot is None else str(robot)),
        ("tracker", "" if tracker is None else str(tracker)),
        ("tracker's certificate", _tracker_certificate(certificate)),
        ("reflector", f"{config.tracker.reflector} {config.instruments.reflector_serial}".strip()),
        ("tool", certificate.tool),
        ("payload", "" if certificate.payload_kg is None else f"{certificate.payload_kg:g} kg"),
        ("speed", f"{config.controller.speed_percent:g} % of full speed"),
        ("measured", f"{moment(times[0])} to {moment(times[-1])}" if times else ""),
        ("conditions", certificate.conditions),
        ("method", NOTHING if identified is None else _method(identified)),
    )


def _method(found: RecordedIdentification) -> str:
    fitted, held_out = found.fitted, found.unseen
    shots = f"{len(fitted.numbers)} {fitted.of}" if fitted else f"{found.shots} shots"
    proof = f", validated on {len(held_out.numbers)} pairs that were not fitted" if held_out else ""
    return (
        f"identification of {len(found.free)} parameters from {shots} (model {found.model}){proof}"
    )


def expiry_warning(evidence: Evidence) -> str:
    """Return a sentence if the tracker's certificate expired before the last shot, else ""."""
    certificate, times = evidence.campaign.config.certificate, _times_utc(evidence)
    if not times or not certificate.expired_on(datetime.fromisoformat(times[-1]).date()):
        return ""
    return (
        f"The tracker's certificate expired on {certificate.tracker.expires}, before the last shot "
        "was measured."
    )


def _tracker_certificate(certificate: CertificateConfig) -> str:
    own = certificate.tracker
    dated = f"of {own.issued}" if own.issued else ""
    until = f"valid until {own.expires}" if own.expires else ""
    return ", ".join(filter(None, (f"{own.number} {dated}".strip(), own.laboratory, until)))


def _times_utc(evidence: Evidence) -> list[str]:
    """Return the times of all shots in their order."""
    every = evidence.journal.series if evidence.journal else ()
    return sorted(shot.measured_utc for series in every for shot in series.shots)


def item_section(evaluation: Evaluation) -> Section:
    """Return the section on item, people and instruments."""
    section = Section("item", "Item, people, instruments")
    section.facts(facts(evaluation))
    if warning := expiry_warning(evaluation.evidence):
        section.lack(warning)
    return section


def tracker_section(evaluation: Evaluation) -> Section:
    """Return the section on tracker, drift and temperature."""
    section = Section("tracker", "Tracker, drift, temperature")
    evidence, found = evaluation.evidence, evaluation.evidence.identification
    if rows := [*measured_rows(evidence)]:
        section.table(
            "Tracker, air and drift",
            TRACKER,
            rows,
            "u: the tracker's statement, 1 σ in the worst direction. Shots lost with the beam: "
            f"{beam_losses(evidence)}.",
        )
    if found and found.tracker:
        title = "Errors of the tracker, as identified"
        section.table(title, model_tables.TRACKER_ERRORS, found.tracker.items())
    if found and (frames := frame_rows(found)):
        section.table(
            "Robot's base in the tracker's frame",
            FRAMES,
            frames,
            "Translation, and the angles of the transform from base to tracker: rotations about z, "
            "y and x.",
        )
    if evaluation.time_series:
        section.figure(
            "over-time",
            "Air and drift while measuring",
            figures.over_time(evaluation.time_series),
            "The air's temperature at each shot, and how far the drift pose has moved since its "
            "first measurement.",
        )
    else:
        section.lack("Neither temperature nor drift was recorded.")
    section.text(
        "the journal holds no field check of the tracker (two faces, scale bar): keep the record "
        "of the instrument's own check with this report"
    )
    return section


def incidents_section(evaluation: Evaluation) -> Section:
    """Return the section on excluded shots and events."""
    section = Section("incidents", "Excluded shots and events")
    journal, found = evaluation.evidence.journal, evaluation.evidence.identification
    if journal is None:
        section.lack(NO_JOURNAL)
        return section
    if found is not None and found.excluded:
        section.table("Left out of the identification", EXCLUDED, found.excluded)
    else:
        section.note("The identification left out no shot and no pair.")
    for title, events, last in (
        ("Rejected shots and voided pairs", False, "reason"),
        ("Events", True, "text"),
    ):
        rows = [row for row in journal.incidents if isinstance(row.record, Event) is events]
        if rows:
            section.table(title, incidents(last), rows)
        else:
            section.note(f"{title}: none.")
    return section


def provenance_section(evaluation: Evaluation) -> Section:
    """Return the section on identities, versions and digests."""
    section = Section("provenance", "Identities, versions, digests")
    evidence, journal = evaluation.evidence, evaluation.evidence.journal
    section.table("Do the files belong together?", CHECKS, evaluation.checks)
    for problem in evidence.unreadable:
        section.lack(f"Cannot be read: {problem}.")
    if journal is None:
        section.lack(NO_JOURNAL)
        return section
    section.table("Series measured", SERIES, journal.series)
    for series in journal.series:
        if series.unstopped:
            section.lack(
                f"Series {series.number}: {series.unstopped} session(s) ended without a stop "
                "record, by a crash or a power cut (or one is still at work). What was measured "
                "until then is complete."
            )
    if rows := imported_rows(journal.series):
        section.table("Imported files", IMPORTED, rows)
    section.table("Instruments and air", INSTRUMENTS, instrument_rows(evidence, journal))
    section.table("Digests", DIGESTS, digest_rows(evidence, journal))
    section.note(
        "`pkmcal check-journal DIR --page FILE` says whether this page and a journal belong "
        "together, by the digest of all records."
    )
    return section
