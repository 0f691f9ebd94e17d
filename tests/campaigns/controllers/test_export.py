"""The compensated robot file: what was identified, how well, and from what."""

import json
from pathlib import Path

import pytest
from par4_space import SPACE
from tested_journal import plain_journal

from campaigns import errors
from campaigns.controllers.export import compensated_robot, latest_identification, written_sets
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.journal.records import Finding
from campaigns.robots.robot import RobotDocument, find_robot, read_robot, with_ripples_per_turn
from campaigns.version import VERSION
from drivers.values import Identity

SPREAD = {"mean_abs": 1.0, "rms": 1.5, "max_abs": 3.0}
PROVENANCE = {
    "series": 1,
    "shots": 163,
    "plan_digest": "a" * 64,
    "journal_digest": "b" * 64,
    "journal_records": 500,
    "at_utc": "2026-03-02T08:00:00Z",
}


@pytest.fixture
def nominal(tmp_path: Path) -> RobotDocument:
    path = tmp_path / "robot.yaml"
    text = find_robot("par4-prototype").document.text
    path.write_text(text.replace("name: par4-prototype", "name: line-3"), encoding="utf-8")
    return read_robot(path)


def entry(name: str, old: float) -> dict[str, object]:
    free = name.endswith(("arm_mm", "plate_mm"))
    delta = 0.25 if free else 0.0
    std = 0.01 if free else None
    return {"nominal": old, "value": old + delta, "std": std, "free": free}


def body(nominal: RobotDocument, **changes: object) -> dict[str, object]:
    """Body of a finding that passed, as journals hold it."""
    found = {
        "schema": "pkmcal/identification/2",
        "model": "paper",
        "converged": True,
        "iterations": 9,
        "parameters": {n: entry(n, value) for n, value in nominal.robot.parameters.items()},
        "excluded": [],
        "residuals_mm": {"before": SPREAD, "after": SPREAD},
        "unseen_mm": {"before": SPREAD, "after": SPREAD},
        "verdict": "pass",
        "reasons": ["hold-out pairs: better"],
        "seconds": 0.1,
        "robot_digest": nominal.robot.digest(),
    }
    return found | PROVENANCE | changes


def finding(nominal: RobotDocument, **changes: object) -> RecordedIdentification:
    return read_identification(body(nominal, **changes))


def test_exported_parameters_and_deviations_are_read_back(
    tmp_path: Path, nominal: RobotDocument
) -> None:
    path = tmp_path / "out.yaml"
    path.write_text(
        compensated_robot("press 4", nominal, finding(nominal)).document.text, encoding="utf-8"
    )
    robot = read_robot(path).robot
    old = dict(nominal.robot.parameters)
    for name in SPACE.names:
        free = name.endswith(("arm_mm", "plate_mm"))
        assert robot.parameters[name] == old[name] + (0.25 if free else 0.0)
        assert (robot.parameters.std or {}).get(name) == (0.01 if free else None)
    assert robot.name == "line-3-compensated"
    assert robot.limits == nominal.robot.limits


def test_tilts_gear_errors_and_the_nominal_robots_ripple_rate_are_exported(
    nominal: RobotDocument,
) -> None:
    """An identification lists no rate, which is of the robot that it rests on."""
    geared = with_ripples_per_turn(nominal, 30.0)
    beyond = {"nominal": 0.0, "value": 0.02, "std": 0.001, "free": True}
    names = ("arm2.axis_tilt_deg", "arm2.backlash_deg", "arm2.ripple_cos_deg")
    parameters = body(geared)["parameters"] | dict.fromkeys(names, beyond)
    identification = finding(geared, parameters=parameters)
    robot = compensated_robot("press 4", geared, identification).robot
    assert {*names} <= {*robot.parameters.extended_by}
    for name in names:
        assert robot.parameters[name] == 0.02
        assert (robot.parameters.std or {})[name] == 0.001
    assert robot.parameters["ripples_per_turn"] == robot.mechanism.rate == 30.0
    assert identification.parameter_set(geared.robot.mechanism).digest() == robot.digest()
    other = with_ripples_per_turn(nominal, 29.0)
    again = compensated_robot("press 4", other, finding(other, parameters=parameters)).robot
    assert again.digest() != robot.digest()


def test_provenance_says_where_everything_comes_from(nominal: RobotDocument) -> None:
    controller = Identity("Acme", "Par4", "R-1", "1.0", "robotline 1")
    robot = compensated_robot("press 4", nominal, finding(nominal), controller).robot
    provenance = robot.provenance
    assert provenance == {
        "campaign": "press 4",
        "software": f"pkmcal {VERSION}",
        "nominal_robot": "line-3",
        "nominal_digest": nominal.robot.digest(),
        "controller_serial": "R-1",
        "plan_digest": "a" * 64,
        "journal_digest": "b" * 64,
        "journal_records": 500,
        "model": "paper",
        "shots": 163,
        "residuals_mm": {"before": SPREAD, "after": SPREAD},
        "unseen_mm": {"before": SPREAD, "after": SPREAD},
        "verdict": "pass",
        "identified_utc": "2026-03-02T08:00:00Z",
    }
    assert json.dumps(provenance, allow_nan=False)


def test_unknown_serial_is_stated_as_unknown(nominal: RobotDocument) -> None:
    for controller in (None, Identity("LinuxCNC", "Par4", "", "1", "rsh")):
        robot = compensated_robot("press 4", nominal, finding(nominal), controller).robot
        assert (robot.provenance or {})["controller_serial"] is None


def test_result_that_did_not_pass_or_is_of_another_nominal_robot_is_not_exported(
    nominal: RobotDocument,
) -> None:
    failed = finding(nominal, verdict="not decided", reasons=["hold-out pairs worse", "rank lost"])
    with pytest.raises(errors.VerdictBad, match="'not decided': hold-out pairs worse; rank lost"):
        compensated_robot("press 4", nominal, failed)
    with pytest.raises(errors.VerdictBad, match="rests on another nominal robot"):
        compensated_robot("press 4", find_robot("par4-table1"), finding(nominal))


def test_latest_identification_counts_also_where_it_cannot_be_read(
    tmp_path: Path, nominal: RobotDocument
) -> None:
    with plain_journal(tmp_path) as journal:
        with pytest.raises(errors.ShotsMissing, match="nothing has been identified"):
            latest_identification(journal)
        for number in (1, 2):
            journal.append(Finding("identification", body(nominal, shots=number)))
        journal.append(Finding("load", {"source": "robot.yaml"}))
        assert latest_identification(journal) == finding(nominal, shots=2)
        journal.append(Finding("identification", {"verdict": "pass"}))
        with pytest.raises(errors.FindingUnreadable, match="identify DIR` again"):
            latest_identification(journal)


def test_expansions_are_stated_with_the_temperature_of_the_parameters(
    tmp_path: Path, nominal: RobotDocument
) -> None:
    grown = {"nominal": 0.0, "value": 20.0, "std": 2.0, "free": True}
    parameters = body(nominal)["parameters"] | {"arm_expansion_ppm": grown}
    found = finding(nominal, parameters=parameters, reference_degC=20.0)
    path = tmp_path / "out.yaml"
    path.write_text(compensated_robot("press 4", nominal, found).document.text, encoding="utf-8")
    robot = read_robot(path).robot
    assert robot.digest() == compensated_robot("press 4", nominal, finding(nominal)).robot.digest()
    assert (robot.expansions, robot.reference_degC) == ({"arm_expansion_ppm": 20.0}, 20.0)


def test_written_set_of_an_older_version_with_joint_tables_is_read(tmp_path: Path) -> None:
    written = {"file": "robot-joint-tables.yaml", "digest": "d", "wanted": {"plate_mm": 100.0}}
    with plain_journal(tmp_path) as journal:
        journal.append(Finding("export", written | {"tables": "linuxcnc"}))
        (found,) = written_sets(journal)
    assert (found.file, found.wanted) == ("robot-joint-tables.yaml", {"plate_mm": 100.0})
