"""Facts of the calibration: who, what, when, by which instruments."""

from collections.abc import Iterator
from datetime import datetime

from app.report.rendering import moment
from campaigns.evidence import Evaluation, Evidence
from campaigns.files.table import NOTHING, Row
from campaigns.identification.result import RecordedIdentification
from campaigns.settings.certificate import CertificateConfig


def facts(evaluation: Evaluation) -> Iterator[Row]:
    """Yield name and text of each fact; the text is empty where campaign.yaml does not state it."""
    evidence = evaluation.evidence
    config, certificate = evidence.campaign.config, evidence.campaign.config.certificate
    series = evidence.journal.series if evidence.journal else ()
    robot = next((each.started.robot for each in reversed(series) if each.started.robot), None)
    tracker = next(
        (each.started.tracker for each in reversed(series) if each.started.tracker), None
    )
    found = evidence.identification
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
        ("measured", " to ".join(_times(evidence))),
        ("conditions", certificate.conditions),
        ("method", NOTHING if found is None else _method(found)),
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
    certificate, times = evidence.campaign.config.certificate, [*_moments(evidence)]
    if not times or not certificate.expired_on(times[-1].date()):
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


def _moments(evidence: Evidence) -> Iterator[datetime]:
    every = evidence.journal.series if evidence.journal else ()
    times = [shot.measured_utc for series in every for shot in series.shots if shot.measured_utc]
    yield from (datetime.fromisoformat(text) for text in sorted(times))


def _times(evidence: Evidence) -> tuple[str, ...]:
    times = [each.isoformat() for each in _moments(evidence)]
    return (moment(times[0]), moment(times[-1])) if times else ()
