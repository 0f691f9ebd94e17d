"""The sections for the record: tracker, drift, what went wrong, environment, versions, digests."""

from collections.abc import Iterator

import numpy as np

from app.report.parts import (
    NOTHING,
    Column,
    Paragraph,
    Part,
    Row,
    Section,
    Table,
    moment,
    number,
    numbers,
    words,
)
from app.report.pictures import time_picture
from campaigns.arrays import Array
from campaigns.evaluation.integrity import Check
from campaigns.evaluation.time_series import time_series
from campaigns.evidence import Evaluation, Evidence, MeasuredSeries, SeriesFacts
from campaigns.journal.records import Event, Rejected
from drivers.values import Identity

NO_JOURNAL = "There is no journal: nothing was ever measured in this campaign."
FIELD_CHECK = (
    "The journal holds no field check of the tracker (two faces, scale bar): keep the record of "
    "the instrument's own check with this report."
)


def tracker_section(contents: Evaluation) -> Section:
    """What the instrument said of itself, the air and the drift."""
    parts: list[Part] = []
    rows = tuple(_tracker_rows(contents))
    if rows:
        columns = (
            *words("series"),
            *numbers("mm", ("u of a point, median", "largest")),
            *numbers("°C", ("air from", "to")),
            Column("drift pose moved", "mm"),
        )
        note = f"u: the tracker's statement, 1 σ in the worst direction. {_beam_losses(contents)}"
        parts.append(Table("Tracker, air and drift", columns, rows, note))
    picture = time_picture(contents)
    if picture is not None:
        parts.append(picture)
    else:
        parts.append(Paragraph("Neither temperature nor drift was recorded.", "missing"))
    return Section("tracker", "Tracker, drift, temperature", (*parts, Paragraph(FIELD_CHECK)))


def incidents_section(contents: Evaluation) -> Section:
    """What does not count, and why."""
    evidence = contents.evidence
    if evidence.journal is None:
        missing = Paragraph(NO_JOURNAL, "missing")
        return Section("incidents", "Excluded shots and events", (missing,))
    parts = (
        _left_out(evidence),
        _incident_table("Rejected shots and voided pairs", evidence, events=False),
        _incident_table("Events", evidence, events=True),
    )
    return Section("incidents", "Excluded shots and events", parts)


def provenance_section(contents: Evaluation) -> Section:
    """Who, with what, when; and that the files belong together."""
    return Section(
        "provenance", "Identities, versions, digests", tuple(_provenance_parts(contents))
    )


def _tracker_rows(contents: Evaluation) -> Iterator[Row]:
    for name, measured in contents.evidence.by_stage():
        air = time_series(name, measured.shots)
        moved = float(air.drift_mm.max()) if len(air.drift_mm) > 1 else None
        yield name, *_stated(measured), *_span(air.temperature_degC), number(moved)


def _stated(measured: MeasuredSeries) -> Row:
    """Median and largest of the shots' standard deviations in their worst direction."""
    stated = measured.shots.stated_covariance_mm2
    known = stated[~np.isnan(stated).any(axis=(1, 2))]
    if len(known) == 0:
        return "not stated", NOTHING
    largest = np.sqrt(np.linalg.eigvalsh(known)[:, -1])
    return number(float(np.median(largest)), 4), number(float(largest.max()), 4)


def _span(values: Array) -> Row:
    if len(values) == 0:
        return NOTHING, NOTHING
    return number(float(values.min()), 2), number(float(values.max()), 2)


def _beam_losses(contents: Evaluation) -> str:
    journal = contents.evidence.journal
    records = [incident.record for incident in journal.incidents] if journal else []
    lost = sum(isinstance(r, Rejected) and r.reason.startswith("beam broken") for r in records)
    return f"Shots lost with the beam: {lost}."


def _left_out(evidence: Evidence) -> Part:
    found = evidence.identification
    if found is None or not found.excluded:
        return Paragraph("The identification left out no shot and no pair.", "note")
    rows = tuple(
        (f"pair {left.pair}" if left.shot is None else f"shot {left.shot}", left.reason)
        for left in found.excluded
    )
    return Table("Left out of the identification", words("", "reason"), rows)


def _incident_table(title: str, evidence: Evidence, *, events: bool) -> Part:
    assert evidence.journal is not None, "asked for only when there is one"
    rows = tuple(
        (moment(each.at_utc), _series_name(each.series), each.concerns, each.text)
        for each in evidence.journal.incidents
        if isinstance(each.record, Event) is events
    )
    if not rows:
        return Paragraph(f"{title}: none.", "note")
    return Table(title, words("time", "series", "what", "reason" if not events else "text"), rows)


def _series_name(series: int | None) -> str:
    return NOTHING if series is None else str(series)


def _provenance_parts(contents: Evaluation) -> Iterator[Part]:
    evidence = contents.evidence
    rows = tuple(_check_row(check) for check in contents.checks)
    yield Table("Do the files belong together?", words("statement", "", "detail"), rows)
    for text in evidence.unreadable:
        yield Paragraph(f"Cannot be read: {text}.", "missing")
    if evidence.journal is None:
        yield Paragraph(NO_JOURNAL, "missing")
        return
    yield Table(
        "Series measured",
        (*words("series", "stage", "begun"), Column("shots"), *words("state", "software")),
        tuple(_series_row(facts) for facts in evidence.journal.series),
    )
    yield from _crashes(evidence.journal.series)
    yield Table("Instruments and air", words("", "series", ""), tuple(_identity_rows(evidence)))
    columns = (*words(""), Column("sha256", kind="code"))
    yield Table("Digests", columns, tuple(_digest_rows(evidence)))


def _check_row(check: Check) -> Row:
    answer = {True: "yes", False: "no", None: NOTHING}[check.holds]
    return check.statement, answer, check.detail


def _series_row(facts: SeriesFacts) -> Row:
    series = facts.series
    state = "finished" if series.finished else "unfinished"
    if facts.sessions > 1:
        state += f", {facts.sessions} sessions"
    return (
        str(series.number),
        series.started.stage,
        moment(series.started_utc),
        str(facts.accepted),
        state,
        f"pkmcal {series.started.software_version}",
    )


def _crashes(every: tuple[SeriesFacts, ...]) -> Iterator[Paragraph]:
    for facts in every:
        if facts.unstopped:
            yield Paragraph(
                f"Series {facts.series.number}: {facts.unstopped} session(s) ended without a stop "
                "record, by a crash or a power cut (or one is still at work). What was measured "
                "until then is complete.",
                "missing",
            )


def _identity_rows(evidence: Evidence) -> Iterator[Row]:
    """Each identity once, with the series it was there for."""
    assert evidence.journal is not None, "asked for only when there is one"
    seen: dict[tuple[str, str], list[str]] = {}
    for facts in evidence.journal.series:
        for name, identity in (("controller", facts.robot), ("tracker", facts.tracker)):
            seen.setdefault((name, _identity(identity)), []).append(str(facts.series.number))
        air = facts.series.started.weather
        if air is not None:
            text = (
                f"{number(air.temperature_degC, 1)} °C, {number(air.pressure_hPa, 1)} hPa, "
                f"{number(air.humidity_percent, 0)} % humidity"
            )
            seen.setdefault(("air at the start", text), []).append(str(facts.series.number))
    for (name, text), series in seen.items():
        yield name, ", ".join(series), text
    config = evidence.campaign.config
    yield (
        "reflector",
        "now",
        " ".join(filter(None, (config.tracker.reflector, config.instruments.reflector_serial))),
    )


def _identity(identity: Identity | None) -> str:
    return "none: imported" if identity is None else str(identity)


def _digest_rows(evidence: Evidence) -> Iterator[Row]:
    assert evidence.journal is not None, "asked for only when there is one"
    run, found = evidence.run, evidence.identification
    yield f"journal, all {evidence.journal.records} records", evidence.journal.digest
    if found is not None:
        yield f"journal, first {found.journal_records} records", found.journal_digest
    if run is not None:
        yield "plan as measured", run.series.started.plan_digest
    yield "nominal robot's geometry", evidence.campaign.nominal.robot.digest()
    if evidence.parameter_file is not None:
        yield "compensated robot's geometry", evidence.parameter_file.digest()
    if evidence.loaded is not None:
        yield f"geometry loaded last ({evidence.loaded.source})", evidence.loaded.digest
