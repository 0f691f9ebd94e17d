"""Sections of the page for the record: item, tracker, incidents, instruments, versions, digests.

These sections say what was measured, by whom, with which instruments, and what went wrong. Facts of
devices come from the journal, where the devices stated them; facts that no device states come from
campaign.yaml. A page becomes a certificate if campaign.yaml asks for one and nothing is missing
(`certificate_lacks`). Traceability to the SI metre is stated only by a real tracker's certificate
that was valid for the last shot. Digests tie the page to the journal, the plan and the geometry.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from app.report import figures, tables
from app.report.section import Section
from campaigns.assessment import Evaluation
from campaigns.chain import sources_of
from campaigns.evaluation.stated_sources import restated_observations
from campaigns.evaluation.time_series import TimeSeries, time_series, worst_std_mm
from campaigns.evaluation.verdict import Check
from campaigns.evidence import Evidence, Incident, JournalFacts, MeasuredSeries
from campaigns.files.table import NOTHING, Column, Row, by_place, number, words
from campaigns.identification.result import Frame, RecordedIdentification
from campaigns.journal.records import Event, Rejected, SeriesStarted
from campaigns.journal.views import Series
from campaigns.measuring.stability_check import drift_mm
from campaigns.settings.instrument import StatedInstrument
from campaigns.settings.sections import CertificateConfig
from campaigns.shots.import_export import imported_files
from campaigns.shots.observations_csv import ObservationRow, default_in_words
from campaigns.shots.shots import Shots
from drivers.texts import moment
from drivers.values import Identity


@dataclass(frozen=True, slots=True, eq=False)
class TrackerRow:
    """Series with its air and drift, and the tracker's uncertainty at its points."""

    course: TimeSeries
    median_mm: float
    """Median u of a point."""
    largest_mm: float
    source: str
    """Source of u, in words."""


@dataclass(frozen=True, slots=True)
class Gauge:
    """Observations of a file that have one kind, one σ and one source of it."""

    file: str
    kind: str
    std_mm: float
    source: str
    count: int


TRACKER: tuple[Column[TrackerRow], ...] = (
    words("series", lambda row: row.course.name),
    Column("median u", lambda row: row.median_mm, "mm", 4),
    Column("largest u", lambda row: row.largest_mm, "mm", 4),
    words("u from", lambda row: row.source),
    Column("air from", lambda row: (row.course.air_range or (None,))[0], "°C", 2),
    Column("to", lambda row: (row.course.air_range or (None,))[-1], "°C", 2),
    Column("drift pose moved", lambda row: row.course.moved_mm, "mm"),
)
INSTRUMENT: tuple[Column[Row], ...] = by_place("series", "of what", "limits", "source")
GAUGES: tuple[Column[Gauge], ...] = (
    words("file", lambda row: row.file),
    words("kind", lambda row: row.kind),
    Column("observations", lambda row: row.count),
    Column("σ", lambda row: row.std_mm, "mm", 4),
    words("source of σ", lambda row: row.source),
)
FRAMES: tuple[Column[tuple[str, Frame]], ...] = (
    words("shots", lambda row: row[0]),
    Column("x", lambda row: row[1].x_mm, "mm"),
    Column("y", lambda row: row[1].y_mm, "mm"),
    Column("z", lambda row: row[1].z_mm, "mm"),
    Column("φ", lambda row: row[1].phi_deg, "°", 4),
    Column("γ", lambda row: row[1].gamma_deg, "°", 4),
    Column("ψ", lambda row: row[1].psi_deg, "°", 4),
)
INCIDENTS: tuple[Column[Incident], ...] = (
    words("time", lambda incident: moment(incident.at_utc)),
    words("series", lambda incident: str(incident.series or NOTHING)),
    words("what", lambda incident: incident.concerns),
    words("text", lambda incident: incident.text),
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


def item_section(evaluation: Evaluation) -> Section:
    """Return the section on item, people and instruments."""
    section = Section("item", "Item, people, instruments")
    section.facts(facts(evaluation))
    return section


def facts(evaluation: Evaluation) -> Iterator[Row]:
    """Yield name and text of each fact; the text is empty where campaign.yaml does not state it."""
    evidence = evaluation.evidence
    config, certificate = evidence.campaign.config, evidence.campaign.config.certificate
    # the latest series counts in which a device stated who it is: imported series have no devices
    started = [s.started for s in reversed(evidence.journal.series)] if evidence.journal else []
    robot = next((start.robot for start in started if start.robot), "")
    identification, times = evidence.identification, _times_utc(evidence)
    yield from (
        ("controller", str(robot)),
        ("tracker", tracker_in_words(evidence)),
        ("tracker's certificate", _tracker_certificate(certificate)),
        ("reflector", evidence.named_instruments.reflector),
        ("tool", certificate.tool),
        ("payload", "" if certificate.payload_kg is None else f"{certificate.payload_kg:g} kg"),
        ("speed", f"{config.controller.speed_percent:g} % of full speed"),
        ("measured", f"{moment(times[0])} to {moment(times[-1])}" if times else ""),
        ("conditions", certificate.conditions),
        ("authorised by", certificate.authorised_by),
        ("method", NOTHING if identification is None else _method(identification)),
    )


def _method(identification: RecordedIdentification) -> str:
    residuals, provenance = identification.residuals, identification.provenance
    fitted, held_out = residuals.fitted, residuals.unseen
    shots = f"{len(fitted.numbers)} {fitted.of}" if fitted else f"{provenance.shots} shots"
    proof = f", validated on {len(held_out.numbers)} pairs that were not fitted" if held_out else ""
    parameters = f"{len(identification.value.free)} parameters"
    return f"identification of {parameters} from {shots} (model {provenance.model}){proof}"


def certificate_lacks(evaluation: Evaluation) -> list[str] | None:
    """Return what keeps the page from being a certificate; None if campaign.yaml asks for none."""
    # Any of number, customer and laboratory asks for a certificate. It needs all facts that
    # identify item, place and people, a validation after calibration, and lengths that are
    # traceable.
    evidence, config = evaluation.evidence, evaluation.evidence.campaign.config
    certificate = config.certificate
    if not certificate.is_asked:
        return None
    needed = {
        "certificate.number": certificate.number,
        "certificate.customer": certificate.customer,
        "certificate.laboratory": certificate.laboratory,
        "instruments.robot_serial": evidence.named_instruments.names["instruments.robot_serial"],
        "people.site": config.people.site,
        "people.operator": config.people.operator,
        "certificate.authorised_by": certificate.authorised_by,
        "certificate.robot_type": certificate.robot_type,
        **_tracker_named(evidence),
    }
    empty = ", ".join(f"`{key}`" for key, value in needed.items() if not value)
    lacks = [f"{empty} in campaign.yaml"] if empty else []
    if not (certificate.conditions or _has_air(evaluation)):
        lacks.append(
            "the environment: temperatures of the air, or `certificate.conditions` in campaign.yaml"
        )
    if evaluation.after is None:
        lacks.append("a validation after calibration")
    if evidence.simulated:
        lacks.append("a real cell: this one is simulated")
    elif why_untraceable(evidence):
        lacks.append("a valid certificate of the tracker")
    lacks += why_unstated(evidence)
    return lacks


def _tracker_named(evidence: Evidence) -> dict[str, str]:
    """Return maker with model, and serial number of the tracker, by their keys in campaign.yaml.

    What the device stated counts, or else what campaign.yaml did when the series was measured.
    """
    identity, names = _stated_tracker(evidence), evidence.named_instruments.names
    model = f"{identity.vendor} {identity.model}".strip() if identity else ""
    return {
        "instruments.tracker": model or names["instruments.tracker"],
        "tracker.serial": (identity.serial if identity else "") or names["tracker.serial"],
    }


def tracker_in_words(evidence: Evidence) -> str:
    """Return the tracker as it stated itself, or else by campaign.yaml; "" if neither does."""
    stated = _stated_tracker(evidence)
    return str(stated) if stated else " ".join(filter(None, _tracker_named(evidence).values()))


def _stated_tracker(evidence: Evidence) -> Identity | None:
    """Return what the tracker stated to be, in the latest series with a device; None without."""
    series = evidence.journal.series if evidence.journal else ()
    return next((s.started.tracker for s in reversed(series) if s.started.tracker), None)


def _has_air(evaluation: Evaluation) -> bool:
    """Return whether the air was recorded, at the start of a series or with its shots."""
    journal = evaluation.evidence.journal
    at_start = any(s.started.weather is not None for s in (journal.series if journal else ()))
    return at_start or any(len(course.temperature_degC) for course in evaluation.time_series)


def traceability(evidence: Evidence) -> str:
    """Return the sentence on traceability; empty if lengths are not traceable."""
    if why_untraceable(evidence):
        return ""
    stated = _tracker_certificate(evidence.campaign.config.certificate)
    return f"Lengths are traceable to the SI metre by the tracker's certificate {stated}."


def why_untraceable(evidence: Evidence) -> str:
    """Return why lengths are not traceable to the SI; empty if they are."""
    tracker, times = evidence.campaign.config.certificate.tracker, _times_utc(evidence)
    if evidence.simulated or not times:
        return "no real tracker has measured"
    if tracker.expires is None or not (tracker.number and tracker.laboratory):
        return (
            "number, laboratory and last day of the tracker's certificate are not all stated "
            "(`certificate.tracker` in campaign.yaml)"
        )
    # the last shot counts: a certificate that expired during the work covers only a part of it
    if tracker.expires < datetime.fromisoformat(times[-1]).date():
        return (
            f"the tracker's certificate expired on {tracker.expires}, before the last shot was "
            "measured"
        )
    return ""


def faults(evaluation: Evaluation) -> Iterator[str]:
    """Yield what a certificate lacks, unreadable files, and sessions without an end."""
    evidence = evaluation.evidence
    if lacks := certificate_lacks(evaluation):
        yield f"As a calibration certificate this report lacks {'; '.join(lacks)}."
    if not evidence.simulated and evidence.journal and (why := why_untraceable(evidence)):
        yield f"No traceability to the SI is stated: {why}."
    for problem in evidence.unreadable:
        yield f"Cannot be read: {problem}."
    for series in evidence.journal.series if evidence.journal else ():
        if series.unstopped:
            yield (
                f"Series {series.number}: {series.unstopped} session(s) ended without a stop "
                "record, by a crash or a power cut (or one is still at work). What was measured "
                "until then is complete."
            )


def _tracker_certificate(certificate: CertificateConfig) -> str:
    tracker = certificate.tracker
    dated = f"of {tracker.issued}" if tracker.issued else ""
    until = f"valid until {tracker.expires}" if tracker.expires else ""
    return ", ".join(filter(None, (f"{tracker.number} {dated}".strip(), tracker.laboratory, until)))


def _times_utc(evidence: Evidence) -> list[str]:
    """Return the times of all shots, the earliest first."""
    journal = evidence.journal
    return sorted(s.measured_utc for row in (journal.series if journal else ()) for s in row.shots)


def tracker_section(evaluation: Evaluation) -> Section:
    """Return the section on tracker, drift and temperature."""
    section = Section("tracker", "Tracker, drift, temperature")
    evidence, identification = evaluation.evidence, evaluation.evidence.identification
    incidents = evidence.journal.incidents if evidence.journal else ()
    rejected = [i.record.reason for i in incidents if isinstance(i.record, Rejected)]
    section.table(
        "Tracker, air and drift",
        TRACKER,
        [_tracker_row(evidence, name, item) for name, item in evidence.by_stage()],
        "u: 1 σ in the worst direction, from each point's statement, or else from the limits "
        "below. Shots lost with the beam: "
        f"{sum(reason.startswith('beam broken') for reason in rejected)}.",
    )
    section.table(
        "Limits (MPE) of the tracker, as stated when the series were measured or imported",
        INSTRUMENT,
        _instruments_stated(evidence),
        "What campaign.yaml said then counts, whatever it says now. Limits over √3 are 1 σ. Those "
        "of what all shots have in common are in U whatever each point states.",
    )
    section.table(
        "σ of observations without a tracker, as recorded when they were measured or imported",
        GAUGES,
        _gauges(evidence.observations.rows),
        "As the column std_source of observations.csv states it: `default` is what is usual of "
        "such instruments; without a word the file's own figures, typed by its author, count.",
    )
    if identification is not None:
        title = "Errors of the tracker, as identified"
        section.table(title, tables.TRACKER_ERRORS, identification.value.tracker.items())
        section.table(
            "Robot's base in the tracker's frame",
            FRAMES,
            _frames(identification),
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
    section.text(
        "the journal holds no field check of the tracker (two faces, scale bar): keep the record "
        "of the instrument's own check with this report"
    )
    return section


def _tracker_row(evidence: Evidence, name: str, item: MeasuredSeries) -> TrackerRow:
    """Return a series' row, whose u is each point's own or by the limits that count for it."""
    shots, stated = item.shots, evidence.campaign.instrument_of(item.series.started)
    median_mm, largest_mm = worst_std_mm(shots.covariance_mm2(stated.uncertainty))
    source = "each point's own statement"
    if count := _without_statement(shots):
        all_or_some = "" if count == len(shots) else f", for {count} of {len(shots)}"
        source = f"limits: {stated.of_shot.source}{all_or_some}"
    return TrackerRow(time_series(name, shots), median_mm, largest_mm, source)


def points_source(evidence: Evidence) -> str:
    """Return a sentence on the source of the validated points' uncertainty; "" without points."""
    sources = dict[str, None]()  # in their order, each once
    for item in evidence.counted():
        if item is evidence.run:
            continue
        count, shots = _without_statement(item.shots), len(item.shots)
        if count:
            stated = evidence.campaign.instrument_of(item.series.started)
            sources[f"the tracker's limits ({stated.of_shot.source_in_words})"] = None
        if count < shots:
            sources["each point's own statement"] = None
    return f"Its instrument's part is from {' and '.join(sources)}." if sources else ""


def _without_statement(shots: Shots) -> int:
    """Return the number of shots without an uncertainty of their own."""
    return int(np.isnan(shots.stated_covariance_mm2).any(axis=(1, 2)).sum())


def _instruments_stated(evidence: Evidence) -> Iterator[Row]:
    """Yield the limits of the tracker as recorded, each once, with the numbers of all its series.

    Series that count no more are among them: limits that were changed show here.
    """
    seen: dict[StatedInstrument, list[str]] = {}
    for series in evidence.journal.series if evidence.journal else ():
        stated = evidence.campaign.instrument_of(series.started)
        seen.setdefault(stated, []).append(str(series.number))
    for stated, numbers in seen.items():
        along, across, of_all = stated.limits_in_words
        source = stated.of_shot.source_in_words
        yield ", ".join(numbers), "along the beam", along, source
        yield "", "across it", across, source
        yield "", "scale, axes, reflector", of_all, stated.of_all.source_in_words


def _gauges(rows: Iterable[ObservationRow]) -> list[Gauge]:
    """Return observations by file, kind, σ and source of σ, with the number of each."""
    counts = Counter((row.file, row.kind, row.std_mm, row.std_source_in_words) for row in rows)
    return [Gauge(*alike, count) for alike, count in counts.items()]


def why_unstated(evidence: Evidence) -> Iterator[str]:
    """Yield what a certificate lacks of the source of uncertainties."""
    of_shots, of_all = dict[str, list[str]](), dict[str, list[str]]()
    for item in evidence.counted():
        stated, number = evidence.campaign.instrument_of(item.series.started), item.series.number
        if _without_statement(item.shots):
            of_shots.setdefault(stated.of_shot.source, []).append(str(number))
        of_all.setdefault(stated.of_all.source, []).append(str(number))
    sections = {"tracker.uncertainty": of_shots, "tracker.common": of_all}
    for section, by_source in sections.items():
        if numbers := ", ".join(by_source.get("default", ())):
            yield (
                f"the tracker's data sheet: U of series {numbers} rests on default limits (state "
                f"`{section}` with data_sheet and typed_by, and measure anew)"
            )
        if numbers := ", ".join(by_source.get("not recorded", ())):
            yield (
                f"the source of the tracker's uncertainty: U of series {numbers} rests on limits "
                f"of `{section}` whose source the journal does not record (import or measure anew)"
            )
    rows = evidence.observations.rows
    if by_default := default_in_words(rows):
        yield f"the data sheets of other instruments: {by_default}"
    if count := sum(row.std_source is None for row in rows):
        yield (
            f"the source of σ of {count} of {len(rows)} observations: the journal does not record "
            "it (import them anew)"
        )
    sources = sources_of(evidence)
    restated = (*sources.restated(), *restated_observations(evidence.observations.restated))
    yield from (f"that {check.statement}: {check.detail}" for check in restated)


def _frames(identification: RecordedIdentification) -> list[tuple[str, Frame]]:
    """Return the fitted frames and the shots of each, one row for each session with a frame."""
    value = identification.value
    if not value.sessions:
        return [("all", value.frame)] if value.frame else []
    return [
        (f"{min(session.shots)} to {max(session.shots)}", session.frame)
        for session in value.sessions
        if session.frame
    ]


def incidents_section(evaluation: Evaluation) -> Section:
    """Return the section on excluded shots and events."""
    section = Section("incidents", "Excluded shots and events")
    journal, identification = evaluation.evidence.journal, evaluation.evidence.identification
    excluded = identification.judgement.excluded if identification else ()
    events = identification.judgement.events if identification else ()
    of_course = {event.first for event in events if event.leaves_out}
    others = [row for row in excluded if row.shot not in of_course]
    rows_left_out = [(row.what, row.reason) for row in others]
    section.table("Left out of the identification", by_place("", "reason"), rows_left_out)
    if of_course:
        section.note(
            f"Shots that the identification left out, {len(of_course)}: see Course of the campaign."
        )
    elif not others:
        section.note("The identification left out no shot and no pair.")
    for title, is_event in (("Rejected shots and voided pairs", False), ("Events", True)):
        rows = [
            incident
            for incident in (journal.incidents if journal else ())
            if isinstance(incident.record, Event) is is_event
        ]
        if rows:
            section.table(title, INCIDENTS, [*_with_largest_drift(rows)])
        else:
            section.note(f"{title}: none.")
    return section


# A run visits its drift pose every few minutes, always with the same words: the largest counts.
def _with_largest_drift(incidents: Sequence[Incident]) -> Iterator[Incident]:
    """Yield incidents, of the visits to the drift pose only the largest drift of each series."""
    visits: dict[int | None, list[Incident]] = {}
    for incident in incidents:
        if _drift_mm(incident) is not None:
            visits.setdefault(incident.series, []).append(incident)
    largest = {
        series: max(of, key=lambda visit: _drift_mm(visit) or 0.0) for series, of in visits.items()
    }
    for incident in incidents:
        if _drift_mm(incident) is None:
            yield incident
        elif incident is largest[incident.series]:
            count = len(visits[incident.series])
            words_of_count = f"largest of {count} drifts: " if count > 1 else ""
            event = Event("drift check", f"{words_of_count}{incident.text}")
            yield replace(incident, record=event)


def _drift_mm(incident: Incident) -> float | None:
    """Return by how far a visit found the drift pose moved; None for all other incidents."""
    return drift_mm(incident.text) if isinstance(incident.record, Event) else None


def provenance_section(evaluation: Evaluation) -> Section:
    """Return the section on identities, versions and digests."""
    section = Section("provenance", "Identities, versions, digests")
    evidence, journal = evaluation.evidence, evaluation.evidence.journal
    section.table("Do the files belong together?", CHECKS, evaluation.checks)
    if journal is None:
        return section
    section.table("Series measured", SERIES, journal.series)
    imported = [
        (str(series.number), *file)
        for series in journal.series
        if series.started.imported
        for file in _files_of(series.started)
    ]
    imported += [(NOTHING, file.name, file.sha256) for file in evidence.observations.files]
    section.table("Imported files", (*by_place("series", "file"), SHA256), imported)
    instruments = _instruments(evidence, journal)
    section.table("Instruments and air", by_place("", "series", ""), instruments)
    section.table("Digests", (*by_place(""), SHA256), _digests(evidence, journal))
    section.note(
        "`pkmcal check-journal DIR --page FILE` says whether this page and a journal belong "
        "together, by the digest of all records."
    )
    return section


def _stage(started: SeriesStarted) -> str:
    return f"{started.stage}, imported" if started.declared else started.stage


def _state(series: Series) -> str:
    state = "finished" if series.finished else "unfinished"
    return f"{state}, {series.sessions} sessions" if series.sessions > 1 else state


def _files_of(started: SeriesStarted) -> list[tuple[str, str]]:
    """Return the imported files, with the sha256 of each."""
    files = [(file.name, file.sha256) for file in imported_files(started)]
    return files or [("not recorded by the software that imported them", NOTHING)]


def _instruments(evidence: Evidence, journal: JournalFacts) -> Iterator[Row]:
    """Yield instruments and air: name, series, text; each text once, with all its series."""
    # A campaign of ten series with one tracker has one row; a second serial number shows at once.
    seen: dict[tuple[str, str], list[str]] = {}
    for series in journal.series:
        started, air = series.started, series.started.weather
        present = {"controller": started.robot, "tracker": started.tracker}
        texts = {name: str(identity or "none: imported") for name, identity in present.items()}
        if air is not None:
            texts["air at the start"] = (
                f"{number(air.temperature_degC, 1)} °C, {number(air.pressure_hPa, 1)} hPa, "
                f"{number(air.humidity_percent, 0)} % humidity"
            )
        for named in texts.items():
            seen.setdefault(named, []).append(str(series.number))
    for (name, text), numbers in seen.items():
        yield name, ", ".join(numbers), text
    yield "reflector", "as recorded", evidence.named_instruments.reflector


def _digests(evidence: Evidence, journal: JournalFacts) -> Iterator[Row]:
    """Yield digests as name and sha256."""
    # the journal has two: as it is now, and as it was when the identification read it
    run, identification = evidence.run, evidence.identification
    yield f"journal, all {journal.records} records", journal.digest
    if identification is not None:
        yield (
            f"journal, first {identification.provenance.journal_records} records",
            identification.provenance.journal_digest,
        )
    if run is not None:
        started = run.series.started
        of = "imported shots, as shots.csv" if started.stage == "import" else "plan as measured"
        yield of, started.plan_digest
    for item in evidence.after:
        started = item.series.started
        if started.stage == "after by targets" and not started.declared:
            yield f"series {item.series.number}, poses wanted of the targets", started.plan_digest
    yield "nominal robot's geometry", evidence.campaign.nominal.robot.digest()
    if evidence.parameter_file is not None:
        yield "compensated robot's geometry", evidence.parameter_file.digest()
    if evidence.loaded is not None:
        yield f"geometry loaded last ({evidence.loaded.source})", evidence.loaded.digest
