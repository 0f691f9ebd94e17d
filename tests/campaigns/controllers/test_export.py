"""The compensated robot file: what was identified, how well, and from what."""

from dataclasses import replace
from pathlib import Path

import pytest
from changed_results import with_fields
from paper_campaign import CONTROLLER, NOMINAL, PaperCampaign
from tested_journal import plain_journal

from campaigns import errors
from campaigns.controllers.export import compensated_robot, latest_identification, written_sets
from campaigns.identification.result import IdentifiedParameter, RecordedIdentification
from campaigns.journal.records import Finding
from campaigns.robots.robot import RobotFile, find_robot, parse_robot, with_ripples_per_turn
from campaigns.version import VERSION


@pytest.fixture(scope="module")
def identification(exported_once: PaperCampaign) -> RecordedIdentification:
    with exported_once.campaign.journal_reader() as journal:
        return latest_identification(journal)


def with_parameters(
    identification: RecordedIdentification, names: tuple[str, ...], value: float
) -> RecordedIdentification:
    """The identification with further free parameters of this value."""
    free = IdentifiedParameter(nominal=0.0, value=value, std=0.1 * value, free=True)
    parameters = {**identification.value.parameters, **dict.fromkeys(names, free)}
    return with_fields(identification, parameters=parameters)


def exported(identification: RecordedIdentification) -> RobotFile:
    """The exported file, read back."""
    document = compensated_robot({"campaign": "press 4"}, NOMINAL, identification).document
    return parse_robot(document.text, "out.yaml").robot


def test_exported_parameters_and_deviations_are_read_back(identification) -> None:
    robot = exported(identification)
    assert robot.digest() == identification.value.parameter_set(NOMINAL.robot.mechanism).digest()
    for name in NOMINAL.robot.parameters:
        assert robot.parameters[name] == identification.value.parameters[name].value
        assert robot.parameters.std.get(name) == identification.value.parameters[name].std
    assert robot.name == "par4-prototype-compensated"
    assert robot.limits == NOMINAL.robot.limits


def test_tilts_gear_errors_and_the_nominal_robots_ripple_rate_are_exported(identification) -> None:
    """An identification lists no rate, which is of the robot that it rests on."""
    names = ("arm2.axis_tilt_deg", "arm2.backlash_deg", "arm2.ripple_cos_deg")
    digests = set()
    for rate in (29.0, 30.0):
        nominal = with_ripples_per_turn(NOMINAL, rate)
        further = with_parameters(identification, names, 0.02)
        geared = with_fields(further, robot_digest=nominal.robot.digest())
        robot = compensated_robot({"campaign": "press 4"}, nominal, geared).robot
        for name in names:
            assert robot.parameters[name] == 0.02
            assert robot.parameters.std[name] == pytest.approx(0.002)
        assert robot.parameters["ripples_per_turn"] == robot.mechanism.rate == rate
        assert geared.value.parameter_set(nominal.robot.mechanism).digest() == robot.digest()
        digests.add(robot.digest())
    assert len(digests) == 2


def test_expansions_are_stated_with_the_temperature_of_the_parameters(identification) -> None:
    grown = with_parameters(identification, ("arm_expansion_ppm",), 20.0)
    robot = exported(with_fields(grown, reference_degC=20.0))
    assert robot.digest() == exported(identification).digest()
    assert (robot.expansions, robot.reference_degC) == ({"arm_expansion_ppm": 20.0}, 20.0)


@pytest.mark.parametrize(("serial", "stated"), [("R-1", "R-1"), ("", None)])
def test_provenance_says_where_everything_comes_from(identification, serial, stated) -> None:
    controller = replace(CONTROLLER, serial=serial)
    robot = compensated_robot({"campaign": "press 4"}, NOMINAL, identification, controller).robot
    document = identification.document()
    copied = ("plan_digest", "journal_digest", "journal_records", "model", "shots", "verdict")
    assert robot.provenance == {
        "campaign": "press 4",
        "software": f"pkmcal {VERSION}",
        "nominal_robot": "par4-prototype",
        "nominal_digest": NOMINAL.robot.digest(),
        "controller_serial": stated,
        "identified_utc": identification.provenance.at_utc,
        **{key: document[key] for key in (*copied, "residuals_mm", "unseen_mm")},
    }


def test_result_that_did_not_pass_or_is_of_another_nominal_robot_is_not_exported(
    identification,
) -> None:
    failed = with_fields(
        identification, verdict="not decided", reasons=("pairs worse", "rank lost")
    )
    with pytest.raises(errors.VerdictBad, match="'not decided': pairs worse; rank lost"):
        compensated_robot({"campaign": "press 4"}, NOMINAL, failed)
    with pytest.raises(errors.VerdictBad, match="rests on another nominal robot"):
        compensated_robot({"campaign": "press 4"}, find_robot("par4-table1"), identification)


def test_latest_identification_counts_also_where_it_cannot_be_read(
    tmp_path: Path, identification
) -> None:
    with plain_journal(tmp_path) as journal:
        with pytest.raises(errors.ShotsMissing, match="nothing has been identified"):
            latest_identification(journal)
        for shots in (1, 2):
            recorded = with_fields(identification, shots=shots)
            journal.append(Finding("identification", recorded.document()))
        journal.append(Finding("load", {"source": "robot.yaml"}))
        assert latest_identification(journal).provenance.shots == 2
        journal.append(Finding("identification", {"verdict": "pass"}))
        with pytest.raises(errors.FindingUnreadable, match="identify DIR` again"):
            latest_identification(journal)


def test_written_set_of_an_older_version_with_joint_tables_is_read(tmp_path: Path) -> None:
    written = {"file": "robot-joint-tables.yaml", "digest": "d", "wanted": {"plate_mm": 100.0}}
    with plain_journal(tmp_path) as journal:
        journal.append(Finding("export", written | {"tables": "linuxcnc"}))
        (read_back,) = written_sets(journal)
    assert (read_back.file, read_back.wanted) == ("robot-joint-tables.yaml", {"plate_mm": 100.0})
