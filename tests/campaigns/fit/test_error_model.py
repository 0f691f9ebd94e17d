"""The model of measured points: unknowns and tolerances, predictions by parts, first frames."""

from dataclasses import replace

import numpy as np
import pytest
from small_fits import FRAME, model_of, observed

from campaigns.fit.effects import Lag, Ripple, Step, Walk
from campaigns.fit.error_model import (
    ErrorModel,
    Observations,
    first_frames,
    frame_columns,
    frames_of_shots,
    moved_frames,
    shift_points,
)
from campaigns.fit.error_sources import tolerance_of, tracker_columns
from campaigns.fit.rigid_transforms import Transform
from campaigns.kinematics.rotations import matrices_of

DEG = np.pi / 180.0


def drawn_x(model, size=0.2, seed=3):
    return size * np.random.default_rng(seed).standard_normal(model.size)


@pytest.mark.parametrize("name", ["par4-prototype", "delta", "linear-delta"])
def test_predicted_points_are_those_of_the_robot_in_its_frame_with_the_trackers_errors(name):
    model = model_of(name)
    observations = observed(model, 8)
    x = drawn_x(model)
    x[-3:] = [2.0, -1.5, 3.0]
    at = model.predict(x, (FRAME,), observations, observations.near)
    robot = model.kinematics(x)
    positions = robot.forward(observations.joints, observations.near).values_or_raise()[:, :3]
    columns = tracker_columns(observations.points)
    tolerance = dict(zip(model.names, model.tolerance, strict=True))
    expected = FRAME.apply(positions) - observations.points
    for source, value in (("constant", 2.0), ("transit", -1.5), ("scale", 3.0)):
        expected = expected + value * tolerance[source] * columns[source]
    assert at.residual == pytest.approx(expected, abs=1e-6)
    assert (at.x is x, at.frames) == (True, (FRAME,))
    assert at.by_joint is at.by_moves["joints"]


def test_a_robot_differs_from_nominal_by_its_unknowns_in_tolerances():
    model = model_of("delta")
    x = drawn_x(model)
    robot, nominal = model.kinematics(x), model.nominal
    for place, name in enumerate(model.parameters):
        if name in nominal.parameters:
            expected = nominal.parameters[name] + x[place] * model.file_tolerance[place]
            assert robot.parameters[name] == pytest.approx(expected, abs=1e-12)
    assert model.kinematics(np.zeros(len(model.names))).parameters == pytest.approx(
        nominal.parameters
    )


def test_each_shot_has_the_robot_of_its_moment_whatever_their_order():
    model = model_of("par4-prototype", "offsets", "lengths")
    observations = observed(model, 12)
    order = np.random.default_rng(4).permutation(12)
    observations = observations.rows(order)
    size = len(model.names)
    first = Step("arm 0", 3.0, 9.0, (0.5,), (0,), size)
    second = Step("forearm 1", 6.0, np.inf, (0.5, 1.0), (1, 4), size)
    changed = model.with_effects((first, second))
    x = drawn_x(changed)
    at = changed.predict(x, (FRAME,), observations, observations.near)
    for row in range(12):
        of_shot = x[:size].copy()
        if first.covers(observations.moment[row]):
            of_shot[0] += 0.5 * x[size]
        if second.covers(observations.moment[row]):
            of_shot[[1, 4]] += [0.5 * x[size + 1], x[size + 2]]
        alone = model.predict(of_shot, (FRAME,), observations.rows([row]), observations.near[[row]])
        assert at.residual[row] == pytest.approx(alone.residual[0], abs=1e-7)
        own = alone.jacobian[0][:, :size]
        assert at.jacobian[row][:, :size] == pytest.approx(own, rel=1e-5, abs=1e-7)
        assert at.by_joint[row] == pytest.approx(alone.by_joint[0], rel=1e-6, abs=1e-6)
        assert at.assembly.poses[row] == pytest.approx(alone.assembly.poses[0], abs=1e-6)
    assert at.assembly.is_solved.all()


def test_a_tilted_plate_of_some_shots_does_not_disturb_those_that_are_level():
    model = model_of("par4-prototype", "axes", "rods")
    observations = observed(model, 8)
    step = Step("rods", 4.0, np.inf, (3.0,), (0,), len(model.names))
    changed = model.with_effects((step,))
    x = np.r_[np.zeros(len(model.names)), 1.0]
    at = changed.predict(x, (FRAME,), observations, observations.near)
    level = model.predict(x[:-1], (FRAME,), observations, observations.near)
    tilted = model.predict(np.r_[3.0, x[1:-1]], (FRAME,), observations, observations.near)
    behind = np.arange(8)[:, None] >= 4
    assert at.residual == pytest.approx(np.where(behind, tilted.residual, level.residual), abs=1e-7)
    unknowns, of_level = at.assembly.unknowns, level.assembly.unknowns
    width = of_level.shape[1]
    assert unknowns[4:] == pytest.approx(tilted.assembly.unknowns[4:], abs=1e-6)
    assert unknowns[:4, :width] == pytest.approx(of_level[:4], abs=1e-6)
    assert not unknowns[:4, width:].any()
    again = changed.predict(x, (FRAME,), observations, at.assembly.unknowns)
    assert again.residual == pytest.approx(at.residual, abs=1e-7)


def test_the_robot_of_today_has_the_changes_that_last_and_no_others():
    model = model_of("delta", "offsets", "axes")
    size = len(model.names)
    effects = (
        Step("encoder 0", 3.0, 7.0, (0.5,), (0,), size),
        Walk(0),
        Step("mount 1", 5.0, np.inf, (0.3, 0.7), (1, 4), size),
        Step("frame", 5.0, np.inf, (1.0,) * 6, tuple(range(6)), 6),
        Step("encoder 1", 8.0, np.inf, (2.0,), (1,), size),
    )
    model = model.with_effects(effects)
    x = drawn_x(model)
    places = [x[where] for where in model.effect_places]
    expected = x[:size].copy()
    expected[[1, 4]] += places[2] * [0.3, 0.7]
    expected[1] += 2.0 * places[4][0]
    assert model.of_today @ x == pytest.approx(expected)
    assert model.of_today.shape == (size, model.size)


def test_rows_are_taken_of_every_column_and_of_the_noise():
    observations = observed(model_of("delta", "offsets"), 10, sessions=2)
    rows = np.array([7, 2, 2])
    taken = observations.rows(rows)
    assert len(taken) == 3
    placed, timed = ("joints", "approach", "near", "points", "frame"), ("warmth", "moment", "time")
    for name in (*placed, *timed, "former"):
        assert np.array_equal(getattr(taken, name), getattr(observations, name)[rows]), name
    assert np.array_equal(taken.noise["stated"], observations.noise["stated"][rows])
    assert np.array_equal(observations.rows(np.arange(10) > 4).moment, np.arange(5.0, 10.0))


def test_poses_that_are_not_measured_yet_are_of_today_and_without_noise():
    joints, poses = np.ones((4, 3)), np.arange(16.0).reshape(4, 4)
    planned = Observations.unmeasured(joints, poses)
    assert np.array_equal(planned.points, poses[:, :3])
    assert (planned.moment == np.inf).all()
    for column in (planned.frame, planned.time, planned.warmth):
        assert not column.any()
    assert (planned.former is joints, planned.noise) == (True, {})
    assert not planned.approach.any()
    assert Observations.unmeasured(joints, poses, -joints).approach.min() == -1.0


def test_a_tolerance_by_name_precedes_one_by_group_and_that_the_table():
    nominal = model_of("delta").nominal
    name = "arm1.axis_tilt_deg"
    model = ErrorModel(
        nominal, tolerances={name: 0.007}, group_tolerances={"axes_deg": 0.003, "scale": 2e-6}
    )
    tolerance = dict(zip(model.names, model.tolerance, strict=True))
    assert tolerance[name] == 0.007
    assert tolerance["arm0.axis_tilt_deg"] == 0.003
    assert tolerance["scale"] == 2e-6
    assert tolerance["constant"] == 0.02
    plain = tolerance["arm0.arm_mm"]
    assert plain == tolerance_of(nominal.mechanism.parameters["arm0.arm_mm"]) == 5.0
    assert model.names.index(name) not in model.learned["axes"]
    assert model.learned[f"tolerance of {name}"].tolist() == [model.names.index(name)]
    assert len(model.learned["axes"]) == 2
    in_file = dict(zip(model.names, model.file_tolerance, strict=True))
    assert in_file["arm0.axis_tilt_deg"] == pytest.approx(0.003 / DEG)
    assert in_file["scale"] == pytest.approx(2.0)
    assert in_file["arm0.arm_mm"] == pytest.approx(5.0)


def test_held_parameters_have_no_column_and_growth_only_with_temperatures():
    nominal = model_of("delta").nominal
    whole, warm = ErrorModel(nominal), ErrorModel(nominal, with_growth=True)
    assert "growth" not in whole.groups
    assert "growth" in warm.groups
    held = ErrorModel(nominal, held={"scale", "arm0.arm_mm"})
    assert {*whole.names} - {*held.names} == {"scale", "arm0.arm_mm"}
    assert held.parameters == tuple(
        name for name in held.names if name not in ("constant", "transit")
    )
    assert whole.names[-3:] == ("constant", "transit", "scale")
    assert "ripple" not in whole.groups


def test_groups_with_a_size_are_those_of_the_table_and_of_effects_that_learn_theirs():
    ripple = Ripple((0, 2), 40.0, 0.5, 1e-4, -3.0)
    model = model_of("delta", "offsets", "axes", effects=(Walk(0), ripple, Walk(1), Lag(3)))
    size = len(model.names)
    groups = model.sized_groups
    assert list(groups) == ["axes", "stand", ripple.name, "lag"]
    assert groups["stand"].tolist() == [*range(size, size + 24), *range(size + 29, size + 53)]
    assert groups[ripple.name].tolist() == list(range(size + 24, size + 28))
    assert groups["lag"].tolist() == list(range(size + 53, size + 56))
    assert model.size == size + 56
    assert [model.groups[place] for place in groups["axes"]] == ["axes"] * 3
    assert model.with_effects(()).sized_groups.keys() == {"axes"}


def test_warm_parts_grow_by_the_degrees_of_each_shot():
    whole = ErrorModel(model_of("delta").nominal, with_growth=True)
    groups = dict(zip(whole.names, whole.groups, strict=True))
    held = {name for name in whole.names if groups[name] not in ("offsets", "growth")}
    model = replace(whole, held=held)
    observations = replace(
        observed(model_of("delta", "offsets"), 6), warmth=np.linspace(0.0, 10.0, 6)
    )
    growth = [place for place, group in enumerate(model.groups) if group == "growth"]
    assert growth
    x = np.zeros(model.size)
    cold = model.predict(x, (FRAME,), observations, observations.near)
    x[growth] = 2.0
    warm = model.predict(x, (FRAME,), observations, observations.near)
    moved = warm.residual - cold.residual
    assert moved == pytest.approx(2.0 * cold.jacobian[..., growth].sum(axis=2), abs=1e-9)
    assert not moved[0].any()
    assert moved[5] != pytest.approx(np.zeros(3), abs=1e-3)
    doubled = replace(observations, warmth=2.0 * observations.warmth)
    assert model.predict(
        x, (FRAME,), doubled, doubled.near
    ).residual - cold.residual == pytest.approx(2.0 * moved)


def test_each_session_has_a_frame_and_columns_of_its_own():
    model = model_of("delta", "offsets")
    observations = observed(model, 15, sessions=3)
    shift_mm = np.array([100.0, -50.0, 20.0])
    frames = tuple(
        Transform(FRAME.rotation, FRAME.translation_mm + number * shift_mm) for number in range(3)
    )
    at = model.predict(np.zeros(model.size), frames, observations, observations.near)
    assert np.abs(at.residual).max() < 0.1
    expected = np.zeros((15, 3, 18))
    for number in range(3):
        rows, columns = slice(5 * number, 5 * number + 5), slice(6 * number, 6 * number + 6)
        expected[rows, :, columns] = at.by_moves["frame"][rows]
    assert at.jacobian[..., model.size :] == pytest.approx(expected)
    turns, shifts = frames_of_shots(frames, observations.frame)
    assert np.array_equal(turns, np.broadcast_to(FRAME.rotation, (15, 3, 3)))
    assert np.array_equal(shifts[[0, 7, 14]], [f.translation_mm for f in frames])


def test_a_moved_frame_moves_points_as_its_columns_do():
    step = np.r_[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, -1.0, 3.0, 0.1, 0.2, 0.3]
    same, moved = moved_frames((FRAME, FRAME), step)
    assert np.array_equal(same.rotation, FRAME.rotation)
    points = np.random.default_rng(1).uniform(-300.0, 300.0, (5, 3))
    turned = points @ FRAME.rotation.T
    difference = moved.apply(points) - FRAME.apply(points)
    assert difference == pytest.approx(frame_columns(turned) @ step[6:], abs=5e-3)
    assert moved.rotation == pytest.approx(matrices_of(1e-3 * step[6:9]) @ FRAME.rotation)


def test_points_are_shifted_and_tilts_stay():
    model = model_of("delta", "offsets")
    observations = observed(model, 4)
    _, assembly = model.positions(np.zeros(model.size), observations, observations.near)
    shifted = shift_points(assembly, np.ones((4, 3)))
    assert shifted.points == pytest.approx(assembly.points + 1.0)
    assert np.array_equal(shifted.poses, assembly.poses)
    assert shifted.unknowns is assembly.unknowns


@pytest.mark.parametrize("sessions", [1, 2])
def test_first_frames_do_not_follow_gross_points(sessions):
    model = model_of("delta", "offsets")
    observations = observed(model, 30, sessions=sessions)
    gross, near = np.array([2, 9, 17, 26]), np.array([5])
    points = observations.points.copy()
    points[gross] += [[30.0, 0, 0], [0, -400.0, 0], [0, 0, 20.0], [700.0, 0, 0]]
    points[near] += [0.9, 0.0, 0.0]
    is_solved = np.arange(30) != 12
    points[12] += 1e4
    positions = model.nominal.forward(observations.joints, observations.near).values[:, :3]
    frames, kept = first_frames(replace(observations, points=points), positions, is_solved)
    assert np.flatnonzero(~kept).tolist() == [2, 9, 12, 17, 26]
    assert len(frames) == sessions
    assert frames[0].rotation == pytest.approx(FRAME.rotation, abs=1e-3)
    assert frames[0].translation_mm == pytest.approx(FRAME.translation_mm, abs=0.5)


def test_shots_within_six_medians_are_near():
    model = model_of("delta", "offsets")
    observations = observed(model, 40, noise_mm=1.0)
    positions = model.nominal.forward(observations.joints, observations.near).values[:, :3]
    points = observations.points.copy()
    points[3] += [0.0, 7.0, 0.0]
    points[8] += [0.0, 0.0, 14.0]
    _, kept = first_frames(replace(observations, points=points), positions, np.ones(40, dtype=bool))
    assert np.flatnonzero(~kept).tolist() == [8]


def test_sessions_of_two_shots_place_no_frame():
    observations = observed(model_of("delta", "offsets"), 5)
    frame = np.array([0, 0, 0, 1, 1])
    with pytest.raises(ValueError, match="2 points"):
        first_frames(replace(observations, frame=frame), observations.near[:, :3], frame < 2)
