"""Facts of the calibration (who, what, when, by which instruments) and the uncertainty budget."""

from collections.abc import Iterator
from datetime import datetime

import numpy as np

from app.report.rendering import moment
from campaigns.evaluation.uncertainty_budget import Contribution, uncertainty_budget
from campaigns.evidence import Evaluation, Evidence
from campaigns.files.table import NOTHING, Column, Row, words
from campaigns.identification.result import RecordedIdentification, RobotScatter
from campaigns.settings.certificate import CertificateConfig
from campaigns.shots.shots import Shots

BUDGET: tuple[Column[Contribution], ...] = (
    words("source", lambda each: each.source),
    Column("u", lambda each: each.u_mm, "mm", 4),
    words("type", lambda each: each.evaluated),
    words("counts", lambda each: "" if each.counts else "no"),
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
        f"identification of {len(found.free)} parameters from {shots} "
        f"(estimator {found.estimator.value}, model {found.model or 'standard'}){proof}"
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


def budget_rows(evaluation: Evaluation) -> tuple[Contribution, ...]:
    """Uncertainty budget of positions; () where the identification tells none."""
    evidence, found = evaluation.evidence, evaluation.evidence.identification
    known = found.position_std_mm if found else None
    if found is None or known is None or known.total_mean is None or evidence.run is None:
        return ()
    shots = evidence.run.shots
    air = next((each.air_range for each in reversed(evaluation.time_series)), None)
    points = shots.points_in_tracker_mm
    return tuple(
        uncertainty_budget(
            random_mm=known.mean,
            common_mm=known.common,
            total_mm=known.total_mean,
            tracker_share=_tracker_share(evidence, shots, found.robot_scatter),
            air_change_degC=None if air is None else air[1] - air[0],
            reach_mm=float(np.linalg.norm(points - points.mean(axis=0), axis=1).max()),
        )
    )


def _tracker_share(evidence: Evidence, shots: Shots, scatter: RobotScatter | None) -> float:
    """Part of the variance of points that the tracker states; the rest is the robot's scatter."""
    if scatter is None:
        return 1.0
    nominal, joint = evidence.campaign.robot.kinematics, evidence.campaign.robot.mechanism.joints[0]
    poses = nominal.forward(shots.joints)
    by_joints = nominal.joint_jacobian(shots.joints[poses.found], poses.values[poses.found])[:, :3]
    stated_mm2 = shots.covariance_mm2(evidence.campaign.instrument)[poses.found]
    with_robot_mm2 = scatter.components(joint).covariance_mm2(stated_mm2, by_joints)
    return float(np.einsum("nii->", stated_mm2) / np.einsum("nii->", with_robot_mm2))


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
