"""A file that should not be loaded is refused with its reason, before anything is written."""

from dataclasses import replace

import pytest
from par4_space import with_values

from campaigns.controllers.issuer import Issuer
from campaigns.controllers.load_checks import (
    file_objections,
    held_objections,
    read_parameter_file,
    serial_objections,
)
from campaigns.errors import ConfigInvalid
from campaigns.robots.robot import RobotFile, find_robot, read_robot
from campaigns.robots.schema import Tolerance
from campaigns.workflow.exporting import issuer_of


@pytest.fixture(scope="module")
def nominal(exported_once) -> RobotFile:
    return exported_once.campaign.robot


@pytest.fixture(scope="module")
def exported(exported_once) -> RobotFile:
    return read_robot(exported_once.folder / "robot-compensated.yaml").robot


@pytest.fixture(scope="module")
def issuer(exported_once) -> Issuer:
    return issuer_of(exported_once.campaign)


def reasons(robot: RobotFile, issuer: Issuer, nominal: RobotFile) -> list[str]:
    return [objection.problem for objection in file_objections(robot, issuer, nominal)]


@pytest.mark.parametrize(
    ("stated", "reason"),
    [
        ({"nominal_digest": "0" * 64, "nominal_robot": "line-9"}, "rests on another nominal robot"),
        ({"campaign": "press 4"}, "is of the campaign 'press 4', this one is 'paper'"),
        ({"verdict": "fail"}, "verdict is 'fail', must be 'pass'"),
        (None, "it does not say where its parameters come from"),
    ],
)
def test_file_of_another_origin_is_objected_to(exported, issuer, nominal, stated, reason) -> None:
    provenance = stated and exported.provenance | stated
    (objection,) = reasons(replace(exported, provenance=provenance), issuer, nominal)
    assert reason in objection


def test_exported_and_nominal_set_are_welcome(exported, issuer, nominal) -> None:
    assert reasons(exported, issuer, nominal) == reasons(nominal, issuer, nominal) == []
    assert reasons(nominal, Issuer("paper", "nobody"), nominal) == []


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("arm2.arm_mm", 520.0, "arm2.arm_mm changed by +170 mm, tolerance ± 10 mm"),
        ("arm1.joint_offset_deg", 45.0, "arm1.joint_offset_deg changed by +45°, tolerance ± 5°"),
    ],
)
def test_change_beyond_the_tolerance_is_objected_to(
    exported, issuer, nominal, name, value, reason
) -> None:
    changed = with_values(exported, {name: value})
    other = "this campaign has identified and exported other parameters than the file's"
    assert reasons(changed, issuer, nominal) == [other, reason]
    known = replace(issuer, sets=frozenset({changed.digest()}), latest=changed.digest())
    assert reasons(changed, known, nominal) == [reason]
    (held,) = held_objections(nominal.parameters | {name: value}, nominal)
    assert held.problem == f"what the controller holds is far from nominal: {reason}"
    strict = replace(nominal, tolerance=Tolerance(length_mm=0.5, angle_deg=5.0))
    assert any("tolerance ± 0.5 mm" in reason for reason in reasons(exported, issuer, strict))


def test_rates_of_ripples_have_no_tolerance(nominal) -> None:
    ripple = {"arm0.ripple_sin_deg": 0.01, "ripples_per_turn": 30.0}
    held = nominal.parameters | ripple | {"ripples_per_turn": 90.0}
    assert list(held_objections(held, with_values(nominal, ripple))) == []


def test_serial_numbers_are_compared_where_both_are_known() -> None:
    assert [*serial_objections("R-2", "R-1")]
    for expected, connected in (("R-1", "R-1"), (None, "R-1"), ("", "R-1"), ("R-2", "")):
        assert not [*serial_objections(expected, connected)]


def test_missing_file_and_file_of_another_mechanism_are_refused(nominal, tmp_path) -> None:
    path = tmp_path / "delta.yaml"
    with pytest.raises(ConfigInvalid, match=r"there is no such file .*pkmcal export"):
        read_parameter_file(path, nominal)
    path.write_text(find_robot("delta").document.text, encoding="utf-8")
    with pytest.raises(ConfigInvalid, match="of a delta, this campaign's robot is a par4"):
        read_parameter_file(path, nominal)
