"""plan.csv: what is written is read again; what somebody broke is answered with its line."""

import math
from dataclasses import replace
from functools import partial

import pytest
from any_axes import robot_file
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal

from campaigns.errors import PlanInvalid, WriteFailed
from campaigns.kinematics.catalog import PAR4
from campaigns.planning import plan_file
from campaigns.robots.robot import read_robot
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

HEADER = "shot,set,pair,x_mm,y_mm,z_mm,theta_deg,q0_deg,q1_deg,q2_deg,q3_deg\n"
PLAN = HEADER + (
    "0,drift,,0,0,-575,0,10,10,10,10\n"
    "1,identification,0,100.5,-20,-600,15,1,2,3,4\n"
    "2,identification,0,-100,20,-700,-15,5,6,7,8\n"
    "3,validation,1,50,-20,-600,0,9,10,11,12\n"
    "4,validation,1,-50,20,-700,0,13,14,15,16\n"
)


def read(text):
    return plan_file.parse_plan(text, "plan.csv", PAR4)


def digest(shots):
    return plan_file.plan_digest(shots, PAR4)


complaint = partial(refusal, PlanInvalid, read, begins="plan.csv:")


def test_rows_are_read_in_their_order_with_angles_in_rad():
    shots = read(PLAN)
    assert [shot.shot for shot in shots] == [0, 1, 2, 3, 4]
    assert shots[0].purpose is plan_file.ShotSet.DRIFT
    assert shots[0].pair is None
    assert shots[1] == plan_file.PlannedShot(
        shot=1,
        purpose=plan_file.ShotSet.IDENTIFICATION,
        pair=0,
        pose=Pose(100.5, -20.0, -600.0, math.radians(15.0)),
        joints=tuple(math.radians(angle) for angle in (1.0, 2.0, 3.0, 4.0)),
    )


@pytest.mark.parametrize(
    "text",
    [
        PLAN.replace(",", ";").replace(".", ","),
        PLAN.replace(",", "\t").replace("\n", "\r\n"),
        "# for cell 7\n" + PLAN.replace("\n", ",,\n"),
        PLAN.replace("x_mm,y_mm,z_mm", "X [mm],Y [mm],Z [mm]"),
    ],
)
def test_a_plan_that_a_spreadsheet_wrote_is_the_same_plan(text):
    assert read(text) == read(PLAN)
    assert digest(read(text)) == digest(read(PLAN))


def test_columns_of_older_plans_are_read_past():
    first, *rows = PLAN.splitlines()
    older = "\n".join([f"{first},asked,model", *(f"{row},--fix 'arm1.*,full" for row in rows)])
    assert read(older) == read(PLAN)


def test_a_plan_names_where_the_reflector_sits_only_if_that_is_not_as_usual():
    shots = read(PLAN)
    moved = (*shots[:1], *(replace(shot, reflector="half 2") for shot in shots[1:]))
    text = plan_file.plan_text(moved, PAR4)
    assert text.splitlines()[0] == HEADER.strip() + ",reflector"
    assert [shot.reflector for shot in read(text)] == ["", *["half 2"] * 4]
    assert digest(moved) != digest(shots)
    assert digest(read(PLAN)) == digest(shots)


def test_a_nest_has_no_reflector_of_the_robot():
    text = HEADER.strip() + ",nest,reflector\n0,nest,,0,0,-575,0,10,10,10,10,A,half 2\n"
    assert "a shot for nest is of no reflector on the robot" in complaint(text)


def test_older_plans_are_kept_and_the_last_one_stays_if_a_new_one_cannot_be_written(
    tmp_path, monkeypatch
):
    path, plan = tmp_path / "plan.csv", read(PLAN)
    for shots in (plan, plan[:3], plan[:1]):
        plan_file.write_beside_older(path, shots, PAR4)
    assert path.read_text().startswith(HEADER)
    older = [tmp_path / f"plan-older-{number}.csv" for number in (1, 2)]
    assert [plan_file.read_plan(file, PAR4) for file in older] == [plan, plan[:3]]

    def write(path, shots, mechanism, options):
        raise WriteFailed(f"{path}: no space", remedy="free some")

    monkeypatch.setattr(plan_file, "write_plan", write)
    with pytest.raises(WriteFailed):
        plan_file.write_beside_older(path, plan, PAR4)
    assert plan_file.read_plan(path, PAR4) == plan[:1]
    assert sorted(tmp_path.iterdir()) == [*older, path]


def test_missing_and_empty_plans_are_refused(tmp_path):
    assert "holds no shots" in complaint(HEADER)
    with pytest.raises(PlanInvalid, match="make one with `pkmcal plan DIR`"):
        plan_file.read_plan(tmp_path / "plan.csv", PAR4)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("theta_deg,", "", 1, "column theta_deg is missing"),
        ("100.5", "far", 3, "x_mm is 'far', must be a number"),
        ("2,identification", "1,identification", 4, "shot 1 stands twice"),
        ("4,validation", "4,validatoin", 6, "unknown set 'validatoin' → did you mean validation?"),
        ("4,validation,1", "4,validation,2", 5, "pair 1 has one shot, must have two"),
        ("drift,,", "drift,0,", 2, "a shot for drift has no pair"),
        ("15,1,2,3,4", "15,1,2,3,4000", 3, "q3_deg is '4000', must be a number within ±360"),
    ],
)
def test_broken_row_is_answered_with_its_line(old, new, line, words):
    assert old in PLAN
    said = complaint(PLAN.replace(old, new, 1))
    assert said.startswith(f"plan.csv:{line}: ")
    assert words in said
    assert " → " in said


def test_columns_order_and_layout_count_neither_for_shots_nor_digest_but_their_order_does():
    turned = "\n".join(",".join(reversed(line.split(","))) for line in PLAN.splitlines())
    assert read(turned) == read(PLAN)
    laid_out = PLAN.replace(",", " , ").replace("\n", "\r\n\r\n").replace("100.5", "+1.005e2")
    assert digest(read(laid_out)) == digest(read(PLAN))
    shots = read(PLAN)
    assert digest(shots[::-1]) != digest(shots)


@pytest.mark.parametrize(
    ("old", "new"), [("100.5", "100.50000000001"), ("3,4\n", "3,4.00000001\n")]
)
def test_digest_tells_the_smallest_edit(old, new):
    assert digest(read(PLAN.replace(old, new, 1))) != digest(read(PLAN))


angles_rad = st.floats(min_value=-6.28, max_value=6.28)
lengths_mm = st.floats(min_value=-1e6, max_value=1e6)
poses = st.builds(Pose, lengths_mm, lengths_mm, lengths_mm, angles_rad)
joints = st.tuples(angles_rad, angles_rad, angles_rad, angles_rad)


@given(st.lists(st.tuples(poses, joints), min_size=5, max_size=5))
def test_any_plan_is_the_same_plan_after_writing_and_reading(values):
    plan = tuple(
        replace(shot, pose=pose, joints=angles)
        for shot, (pose, angles) in zip(read(PLAN), values, strict=True)
    )
    again = read(plan_file.plan_text(plan, PAR4))
    assert digest(again) == digest(plan)
    for shot, back in zip(plan, again, strict=True):
        position = (shot.pose.x_mm, shot.pose.y_mm, shot.pose.z_mm)
        assert (back.pose.x_mm, back.pose.y_mm, back.pose.z_mm) == position
        assert back.joints == pytest.approx(shot.joints, rel=0.0, abs=2e-14)
        assert back.pose.theta_rad == pytest.approx(shot.pose.theta_rad, rel=0.0, abs=2e-14)


def test_plan_in_a_plane_has_no_height_and_one_of_six_axes_its_rotation_vector(tmp_path):
    turned = Pose(1.0, 2.0, -550.0, rotation_rad=(0.1, -0.2, 0.3))
    for name, pose, columns in (
        ("five-bar", Pose(10.0, 300.0, 0.0), "x_mm,y_mm,q0_deg,q1_deg"),
        ("hexapod", turned, "x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg,q0_mm,q1_mm,q2_mm"),
    ):
        mechanism = read_robot(robot_file(tmp_path, name)).robot.mechanism
        joints = tuple(0.1 * (1.0 + arm) for arm in range(len(mechanism.joints)))
        shot = plan_file.PlannedShot(0, ShotSet.DRIFT, None, pose, joints)
        text = plan_file.plan_text([shot], mechanism)
        assert text.startswith(f"shot,set,pair,{columns}")
        (read,) = plan_file.parse_plan(text, "plan.csv", mechanism)
        assert read.joints == pytest.approx(joints)
        assert read.pose.coordinates == pytest.approx(pose.coordinates)
