"""What cannot be a robot's shots is named by its cause, and what robots are like is not."""

import re
import time
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from any_axes import robot_file
from refusals import refusal
from scipy.spatial.transform import Rotation

from campaigns.errors import ShotsInvalid
from campaigns.evaluation import joint_maps, pieces, plausibility
from campaigns.identification.identify import require_answerable
from campaigns.identification.options import IdentificationOptions
from campaigns.kinematics.model import Kinematics
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.robots.robot import find_robot, pose_of, read_robot
from campaigns.robots.schema import Tolerance
from campaigns.shots.shots import shots_of_rows
from campaigns.shots.shots_csv import parse_shots
from campaigns.studies.study import planned_shots

ROBOTS = ("par4-prototype", "delta")
SHOTS = 40
TRACKER_MM = (2400.0, -300.0, -500.0)


@cache
def shots_of_plan(name):
    robot = find_robot(name).robot
    centre = robot.workspace_centre
    view = View(TRACKER_MM, tuple((np.array(TRACKER_MM) - centre[:3]).tolist()), np.radians(25.0))
    request = PlanRequest(SHOTS, 0, 0, pose_of(centre))
    return planned_shots(make_plan(robot, view, request, np.random.default_rng(2)))


def measured(name, seed=1, share=0.3, half=None):
    """Shots of a robot that is off by some share of the tolerance, in any frame.

    Its reflector is on a half of the plate, or where the controlled point is.
    """
    robot, planned = find_robot(name).robot, shots_of_plan(name)
    table, rng = robot.mechanism.parameters, np.random.default_rng(seed)
    limits = np.zeros(len(table.of_robot))
    for place, parameter in enumerate(table.names):
        if "azimuth" not in parameter:
            limits[place] = robot.tolerance.of(table[parameter]) * table.file_unit[place]
    errors = share * rng.uniform(-1, 1, len(limits)) * limits
    off = Kinematics(robot.mechanism.seen_from(half), robot.kinematics.p + errors)
    poses = off.forward(planned.joints)
    turn = Rotation.random(random_state=seed).as_matrix()
    points = poses.values[:, :3] @ turn.T + np.array([1500.0, -800.0, 300.0])
    return replace(planned, points_in_tracker_mm=points).rows(np.flatnonzero(poses.is_solved))


def on_half(name, half):
    """The nominal robot with its reflector on a half of the plate by its file."""
    nominal = find_robot(name).robot.kinematics
    return replace(nominal, mechanism=nominal.mechanism.seen_from(half))


def complaint(name, shots, place_mm=None, file_half=None, unit="mm"):
    check, nominal = plausibility.check_shots, on_half(name, file_half)
    return refusal(ShotsInvalid, check, nominal, shots, "shots.csv", place_mm, unit)


def on_station(name, *, half=1, columns=None):
    """Shots of the nominal robot from where the tracker stands, in any axes of its own."""
    robot, planned = find_robot(name).robot, shots_of_plan(name)
    poses = robot.kinematics.forward(planned.joints).values_or_raise()
    positions = poses[:, :3].copy()
    if half == 2:
        turn = poses[:, 3]
        apart = np.column_stack([-np.sin(turn), np.cos(turn)])
        positions[:, :2] += robot.parameters["plate_mm"] * apart
    points = (positions - np.array(TRACKER_MM)) @ Rotation.random(random_state=3).as_matrix().T
    joints = planned.joints if columns is None else planned.joints[:, columns]
    return replace(planned, points_in_tracker_mm=points, joints=joints)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("share", [0.1, 1.0])
def test_robots_within_their_tolerance_are_never_accused(name, share):
    nominal = find_robot(name).robot.kinematics
    for seed in range(2):
        plausibility.check_shots(nominal, measured(name, seed, share), "shots.csv")


MIRRORED = np.array([1.0, 1.0, -1.0])
RADIANS = np.radians(1.0)


@pytest.mark.parametrize(
    ("points", "joints", "unit", "causes"),
    [
        (1e-3, 1.0, "mm", ["the points look like metres, not mm", "import with --unit m"]),
        (1e3, 1.0, "m", ["the points look like millimetres, not m", "import with --unit mm"]),
        (1e3 / 25.4, 1.0, "m", ["the points look like inches, not m", "import with --unit inch"]),
        (2.0, 1.0, "mm", ["distances between the points are 2 times"]),
        (MIRRORED, 1.0, "mm", ["the frame of the points is mirrored"]),
        (1e3 * MIRRORED, 1.0, "m", ["mirrored and the points look like", "z; import with --unit"]),
        (1.0, RADIANS, "mm", ["the joints look like radians"]),
        (1e-3, RADIANS, "mm", ["radians", "metres"]),
        (1.0, -1.0, "mm", ["all joints seem to have the other sign"]),
        (1.0, [1.0, -1.0, 1.0], "mm", ["the sign of q1 seems to be turned"]),
    ],
)
def test_shots_that_were_read_wrongly_are_refused_by_their_cause(points, joints, unit, causes):
    shots = measured("delta")
    points, joints = shots.points_in_tracker_mm * points, shots.joints * np.array(joints)
    said = complaint("delta", replace(shots, points_in_tracker_mm=points, joints=joints), unit=unit)
    assert said.startswith("shots.csv: ")
    assert all(cause in said for cause in causes)


def check_import(shots, name):
    """Check shots as `import` does."""
    nominal = find_robot(name).robot.kinematics
    plausibility.check_shots(nominal, shots, "shots.csv")
    plausibility.check_distances(nominal, shots, 60.0, "shots.csv")


def read_as(name, readings, shots=None):
    """The complaint about shots whose joints were written as readings of them."""
    shots = shots or measured(name)
    return refusal(ShotsInvalid, check_import, replace(shots, joints=readings(shots.joints)), name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "zeros_deg"),
    [
        ("delta", (40.0, 40.0, 40.0)),
        ("delta", (-90.0, -90.0, -90.0)),
        ("delta", (60.0, 45.0, 52.0)),
        ("par4-prototype", (-45.0, -45.0, -45.0, -45.0)),
    ],
)
def test_joints_that_count_from_another_zero_are_told_with_the_zero(name, zeros_deg):
    said = read_as(name, lambda joints: joints - np.radians(zeros_deg))
    cause, _, remedy = said.partition("→")
    stated = [float(zero) for zero in re.findall(r"([+-][\d.]+)°", cause)]
    assert "the joints seem to count from another zero" in cause
    assert stated == pytest.approx(zeros_deg, abs=3.0)
    assert f"write q0_deg {'+' if zeros_deg[0] > 0 else '-'} " in remedy


@pytest.mark.parametrize(
    ("name", "factor", "words"),
    [
        (
            "delta",
            1.0 / 36.0,
            "too small: steps, turns or another unit → multiply q0_deg, q1_deg, q2",
        ),
        (
            "delta",
            -2.5,
            "all joints seem to have the other sign → divide q0_deg, q1_deg, q2_deg by -2.5",
        ),
        ("linear-delta", 80.0, "times too large: steps, turns or another unit → divide q0_mm"),
        ("linear-delta", 0.04, "multiply q0_mm, q1_mm, q2_mm by 2"),
    ],
)
def test_joints_in_another_unit_are_told_with_the_factor(name, factor, words):
    assert words in read_as(name, lambda joints: factor * joints)


@pytest.mark.slow
def test_joints_in_another_unit_and_from_another_zero_are_told_by_the_line_to_write():
    said = read_as("delta", lambda joints: 0.2 * joints + 0.3)
    assert (
        " times too small: steps, turns or another unit and the joints seem to count from" in said
    )
    assert re.search(r"write (5\.0|4\.9)\d* \* q0_deg - 8[5-7]", said)


def with_column(joints, place, factor, zero=0.0):
    """Joints of which one is read by another factor and zero."""
    joints[:, place] = factor * joints[:, place] + zero
    return joints


ZERO = np.radians(40.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "written", "cause", "remedy"),
    [
        (
            "par4-prototype",
            lambda joints: with_column(joints[:, [1, 0, 2, 3]], 2, -1.0),
            "order q1, q0, q2, q3 and the sign of q2 seems to be turned",
            "write q1_deg, q0_deg, -q2_deg as q0_deg, q1_deg, q2_deg",
        ),
        (
            "par4-prototype",
            lambda joints: np.radians(joints[:, [1, 0, 2, 3]]),
            "order q1, q0, q2, q3 and the joints look like radians",
            "write 57.2958 * q1_deg, 57.2958 * q0_deg",
        ),
        (
            "delta",
            lambda joints: with_column(joints[:, [1, 0, 2]], 0, -1.0),
            "the sign of q0 seems to be turned and the frame of the points is mirrored",
            "write -q0_deg as q0_deg; turn the sign of one coordinate",
        ),
        (
            "delta",
            lambda joints: joints[:, [1, 0, 2]] - ZERO,
            r"in the order q\d, q\d, q\d and the joints seem to count from another zero \(\+39",
            r"write q\d_deg \+ 39.",
        ),
        (
            "linear-delta",
            lambda joints: 80.0 * joints[:, [2, 1, 0]],
            r"in the order q\d, q\d, q\d and the joints seem to be 79.* times too large: steps",
            r"write 0.0125\d* \* q\d_mm",
        ),
        ("delta", lambda joints: np.radians(joints) - 0.02, "radians and .* zero", "57.2958 * q0"),
        ("delta", lambda joints: with_column(joints, 1, 1.0, -ZERO), "zero", "write q1_deg + 4"),
        (
            "par4-prototype",
            lambda joints: with_column(joints, 3, np.radians(1.0)),
            "q3_deg seems to be 5[78].* times too small",
            "write 5[78].* q3_deg as q3_deg",
        ),
    ],
)
def test_other_orders_signs_units_and_zeros_together_are_told_with_what_to_write(
    name, written, cause, remedy
):
    told = read_as(name, lambda joints: written(joints.copy())).partition("→")
    for words, said in ((cause, told[0]), (remedy, told[2])):
        assert words in said or re.search(words, said), said


A_COUNT = np.radians(1.0)  # read as a degree
TURN = 2.0 * np.pi


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "counts", "deg_per_count", "remedy"),
    [
        (
            "delta",
            lambda joints: A_COUNT * np.round(joints * 4096 / TURN),
            0.0879,
            "divide q0_deg, q1_deg, q2_deg by",
        ),
        (
            "delta",
            lambda joints: with_column(joints, 1, A_COUNT * 65536 / TURN),
            0.00549,
            "as q1_deg",
        ),
        (
            "delta",
            lambda joints: with_column(joints, 2, A_COUNT * 10000 / TURN, A_COUNT * 2500),
            0.036,
            "as q2_deg",
        ),
        (
            "delta",
            lambda joints: A_COUNT * np.round(joints * 4096 / TURN + np.array([2000, 1000, 3000])),
            0.0879,
            " - 1",
        ),
        (
            "delta",
            lambda joints: A_COUNT * np.round(-joints[:, [1, 0, 2]] * 4096 / TURN),
            0.0879,
            "write -0.087",
        ),
        (
            "par4-prototype",
            lambda joints: A_COUNT * np.round(joints * 8192 / TURN + 2048),
            0.0439,
            " - 90",
        ),
    ],
)
def test_counts_of_encoders_are_told_with_degrees_a_count(name, counts, deg_per_count, remedy):
    said = read_as(name, lambda joints: counts(joints.copy()))
    assert re.search("columns? q._deg.* seems? to hold counts of an encoder", said)
    (factor,) = re.findall(r"a factor of ([\d.]+)° a count", said)
    assert float(factor) == pytest.approx(deg_per_count, rel=0.02)
    assert remedy in said.partition("→")[2]


def test_a_single_angle_beyond_a_turn_is_a_wrong_row_and_no_count():
    said = read_as("delta", lambda joints: np.r_[100.0 * joints[:1], joints[1:]])
    assert "shot 0: joint q" in said
    assert "limit ± 360°" in said


def moved_at(shots, borders_mm):
    """Shots whose tracker stood elsewhere from each of some rows on, turned and moved by mm."""
    points = shots.points_in_tracker_mm.copy()
    for seed, (border, moved_mm) in enumerate(borders_mm.items(), 4):
        turn = Rotation.random(random_state=seed).as_matrix()
        points[border:] = points[border:] @ turn.T + moved_mm
    return replace(shots, points_in_tracker_mm=points)


@pytest.mark.parametrize(
    ("name", "borders_mm"),
    [
        ("delta", {12: 400.0, 25: -900.0}),
        ("delta", {6: 300.0, 35: 700.0}),
        ("par4-prototype", {9: 150.0, 20: 300.0}),
        ("linear-delta", {10: 500.0, 20: -400.0, 30: 2000.0}),
    ],
)
def test_each_place_where_the_tracker_stood_is_told_with_its_session(name, borders_mm):
    shots = measured(name)
    said = refusal(ShotsInvalid, check_import, moved_at(shots, borders_mm), name)
    cause, _, remedy = said.partition("→")
    first = [shots.numbers[border] for border in borders_mm]
    assert f"{len(first) + 1} rigid pieces fit the points, one does not" in cause
    assert [int(number) for number in re.findall(r"from shot (\d+)", cause)] == first
    assert re.search(rf"{len(first) + 1} from shot {first[-1]} on, and identify --sess", remedy)


@pytest.mark.parametrize("seed", [5, 51, 52])
def test_a_robot_at_its_tolerances_that_pieces_fit_better_is_no_moved_tracker(seed):
    """A frame for each piece takes up a part of the robot's errors, too."""
    shots, said = measured("par4-prototype", seed, 1.0), ""
    try:
        check_import(shots, "par4-prototype")
    except ShotsInvalid as error:
        said = str(error)
    assert not said or "its point is" in said


def test_where_a_tracker_stood_is_found_in_thousands_of_shots_in_little_time():
    rng, shots = np.random.default_rng(1), 20000
    positions = rng.uniform(-200.0, 200.0, (shots, 3))
    points = positions + rng.normal(0.0, 1.0, positions.shape)
    points[4567:] = points[4567:] @ Rotation.random(random_state=1).as_matrix().T + 100.0
    points[15000:] += 40.0
    began_s = time.process_time()
    assert pieces.rigid_pieces(positions, points, 4.0) == [0, 4567, 15000]
    assert pieces.rigid_pieces(positions, rng.permutation(points), 4.0) == []
    # every border by a fit of its own takes minutes
    assert time.process_time() - began_s < 5.0


@pytest.mark.parametrize("name", ["delta", "linear-delta"])
@pytest.mark.parametrize(("border", "moved_mm"), [(12, 400.0), (25, -900.0), (33, 2000.0)])
def test_a_tracker_that_stood_elsewhere_is_told_with_the_first_shot(name, border, moved_mm):
    shots = measured(name)
    said = refusal(ShotsInvalid, check_import, moved_at(shots, {border: moved_mm}), name)
    first = shots.numbers[border]
    assert f"the tracker stood elsewhere from shot {first} on → add a column session, 1 up" in said
    assert "identify --sessions" in said


def test_identify_doubts_by_the_tolerance_that_the_robot_file_states():
    shots, nominal = measured("delta", share=0.0), find_robot("delta").robot.kinematics
    points = shots.points_in_tracker_mm.copy()
    points[20:] += 6.0
    moved = replace(shots, points_in_tracker_mm=points)
    stated = IdentificationOptions(tolerance=Tolerance(length_mm=0.2, angle_deg=0.1))
    require_answerable(nominal, moved, IdentificationOptions())
    first = shots.numbers[20]
    with pytest.raises(ShotsInvalid, match=f"the tracker stood elsewhere from shot {first} on"):
        require_answerable(nominal, moved, stated)


def test_one_wrong_point_of_many_is_no_tracker_that_stood_elsewhere():
    shots = measured("delta")
    many = shots.rows(np.tile(np.arange(len(shots)), 6))
    points = many.points_in_tracker_mm.copy()
    points[7] += 60.0
    said = refusal(ShotsInvalid, check_import, replace(many, points_in_tracker_mm=points), "delta")
    assert "shot 7: its point is 1" in said


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_what_no_simple_cause_explains_is_told_as_such(seed):
    shots, rng = measured("delta"), np.random.default_rng(seed)
    mixed = rng.permutation(shots.joints) if seed else rng.uniform(-1.0, 1.0, shots.joints.shape)
    said = complaint("delta", replace(shots, joints=mixed))
    assert "no simple cause explains them" in said
    assert "seem" not in said


def test_a_zero_that_identification_finds_is_no_reason_to_refuse_shots():
    shots, nominal = measured("delta"), find_robot("delta").robot.kinematics
    off = replace(shots, joints=shots.joints - np.radians(12.0))
    plausibility.check_shots(nominal, off, "shots.csv")


def test_swapped_joints_are_named_by_the_right_order():
    shots = measured("par4-prototype")
    said = complaint("par4-prototype", replace(shots, joints=shots.joints[:, [1, 0, 2, 3]]))
    assert "the joints seem to stand in the order q1, q0, q2, q3" in said


@pytest.mark.slow
def test_points_of_other_rows_follow_no_joints():
    shots = measured("delta")
    mixed = np.random.default_rng(3).permutation(shots.points_in_tracker_mm)
    said = complaint("delta", replace(shots, points_in_tracker_mm=mixed))
    assert "the points do not follow the joints" in said


def test_a_point_beyond_the_gate_is_refused_though_the_others_fit():
    shots, nominal = measured("par4-prototype"), find_robot("par4-prototype").robot.kinematics
    points = shots.points_in_tracker_mm.copy()
    points[7] += 300.0
    wrong = replace(shots, points_in_tracker_mm=points)
    plausibility.check_shots(nominal, wrong, "shots.csv")
    with pytest.raises(ShotsInvalid, match=r"shot 7: its point is 5[0-9][0-9] mm from where"):
        plausibility.check_distances(nominal, wrong, 60.0, "shots.csv")
    plausibility.check_distances(nominal, shots, 60.0, "shots.csv")


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("joints", [0.0, 7.0, 0.0, 0.0], "joint q1_deg is 401"),
        ("points_in_tracker_mm", 3e5, "its point's distance from the tracker"),
        ("temperature_degC", 300.0, "its air's temperature is 300 °C, must be -40 to 70"),
        ("stated_covariance_mm2", 1e6 * np.eye(3), "the stated σ of its point is 1732.05 mm"),
    ],
)
def test_values_beyond_reason_are_named_by_the_shot(name, value, said):
    shots = measured("par4-prototype")
    values = getattr(shots, name).copy()
    values[5] = value
    assert f"shot 5: {said}" in complaint("par4-prototype", replace(shots, **{name: values}))


ROUGHLY_MM = (2700.0, -600.0, -300.0)
"""The tracker's place as somebody sees it who has no rule."""


@pytest.mark.parametrize(
    ("columns", "cause", "remedy"),
    [
        (None, "the reflector seems to be on half 2 of the plate →", "half: 2"),
        ([2, 3, 0, 1], "the tracker is found at (-24", "half 2 of the plate and the"),
    ],
)
def test_reflector_on_half_2_is_told_from_swapped_columns_by_the_trackers_place(
    columns, cause, remedy
):
    """Whoever swaps columns instead gets points that fit, of a robot whose arms are swapped."""
    shots = on_station("par4-prototype", half=2, columns=columns)
    said = complaint("par4-prototype", shots, ROUGHLY_MM)
    assert cause in said
    assert remedy in said.partition("→")[2]


@pytest.mark.parametrize("half", [1, 2])
def test_reflector_on_a_half_of_an_h4_is_told_from_one_in_the_middle_of_its_crossbar(half):
    said = complaint("h4", measured("h4", share=0.5, half=half))
    assert f"half {half} of the plate → say reflector_half: {half} in" in said
    said = complaint("h4", measured("h4", share=0.5), file_half=half)
    assert "in the middle of the crossbar → delete reflector_half" in said


@pytest.mark.parametrize(
    ("name", "half"), [("par4-prototype", 2), ("h4", None), ("h4", 1), ("h4", 2)]
)
def test_reflector_that_is_where_the_robot_file_says_is_not_accused(name, half):
    plausibility.check_shots(on_half(name, half), measured(name, 0, 0.7, half), "shots.csv")


def test_of_many_orders_that_fit_a_symmetrical_robot_one_is_named():
    shots = measured("delta")
    said = complaint("delta", replace(shots, joints=shots.joints[:, [1, 0, 2]]))
    assert said.count("seem to stand in the order") == 1
    assert "and 2 more that fit as well" in said
    assert said.count("correct the header of the joints") == 1


@pytest.mark.long
def test_of_causes_that_fit_alike_the_remedy_says_how_to_tell_them_apart():
    """Another order of joints fits an i4r as well, or better, than its reflector's other half."""
    cause, _, remedy = complaint("i4r", measured("i4r"), file_half=2).partition("→")
    assert "seem to stand in the order q" in cause
    assert "on half 1 of the plate" in cause
    assert "correct tracker.place_mm, which decides; then say reflector_half: 1" in remedy


def test_arms_of_a_delta_that_are_named_from_another_are_told_by_the_trackers_place():
    shots = on_station("delta", columns=[1, 2, 0])
    said = complaint("delta", shots, ROUGHLY_MM)
    assert "the tracker is found at (" in said
    assert "if that is right, the joints seem to stand in the order q2, q0, q1: correct" in said
    plausibility.check_shots(find_robot("delta").robot.kinematics, shots, "shots.csv")


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("place_mm", [ROUGHLY_MM, (1500.0, 2500.0, 0.0)])
def test_a_place_that_is_wrong_otherwise_accuses_no_columns(name, place_mm):
    robot = find_robot(name).robot
    plausibility.check_shots(robot.kinematics, on_station(name), "shots.csv", place_mm)


SIX = np.arange(6)


@pytest.fixture(scope="module")
def hexapod(tmp_path_factory):
    """A hexapod, and shots of it."""
    folder = tmp_path_factory.mktemp("hexapod")
    robot = read_robot(robot_file(folder, "hexapod")).robot.kinematics
    rng = np.random.default_rng(1)
    poses = robot.mechanism.with_home(np.array([0.0, 0.0, -550.0, 0.0, 0.0, 0.0])).home_poses(
        np.zeros((24, 6))
    )
    poses = poses + rng.uniform(-1.0, 1.0, poses.shape) * [80.0, 80.0, 50.0, 0.1, 0.1, 0.1]
    joints = robot.inverse(poses).values_or_raise()
    lines = [",".join(["pair", *(f"q{leg}_mm" for leg in SIX), "x_mm", "y_mm", "z_mm"])]
    for shot, (row, pose) in enumerate(zip(joints.tolist(), poses.tolist(), strict=True)):
        lines.append(",".join(map(str, [shot // 2, *row, *pose[:3]])))
    rows = parse_shots("\n".join(lines), "f.csv", robot.mechanism)
    return robot, shots_of_rows(rows, robot)


@pytest.mark.parametrize(
    ("order", "signs", "said"),
    [
        ([1, 0, 2, 3, 4, 5], 1.0, "in the order q1, q0, q2, q3, q4, q5"),
        ([0, 1, 5, 3, 4, 2], 1.0, "in the order q0, q1, q5, q3, q4, q2"),
        ([5, 0, 1, 2, 3, 4], 1.0, "in the order q1, q2, q3, q4, q5, q0"),
        (SIX, [1.0, 1.0, -1.0, 1.0, -1.0, 1.0], "the sign of q2, q4 seems to be turned"),
    ],
)
def test_columns_of_six_joints_are_told_soon(hexapod, order, signs, said):
    robot, shots = hexapod
    written = replace(shots, joints=shots.joints[:, order] * np.array(signs))
    began_s = time.process_time()
    refused = refusal(ShotsInvalid, plausibility.check_shots, robot, written, "shots.csv")
    assert said in refused
    # all 720 orders take half a minute
    assert time.process_time() - began_s < 10.0


def test_every_order_of_four_joints_is_tried_and_few_of_six(hexapod):
    axes = find_robot("par4-prototype").robot.mechanism.joints
    assert len({*joint_maps._orders(axes)}) == 24
    assert len({*joint_maps._orders(hexapod[0].mechanism.joints)}) == 15 + 12
