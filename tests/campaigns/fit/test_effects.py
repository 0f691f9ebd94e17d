"""Effects: derivatives by differences, kernels at the shots, and what they are defined to be."""

from dataclasses import replace

import numpy as np
import pytest
from small_fits import FRAME, model_of, observed

from campaigns.fit.effects import (
    STAND_MM,
    TURN_MRAD,
    Lag,
    Layer,
    Ripple,
    Step,
    Walk,
    place_coordinates,
)
from campaigns.fit.error_model import Observations, moved_frames
from campaigns.fit.events import candidate_parts
from campaigns.fit.rigid_transforms import Transform
from campaigns.kinematics.rotations import matrices_of

USUAL_RAD = 1e-3


def layers(observations):
    places = place_coordinates(observations.near, 100.0)
    angles = tuple(joint[:, None] for joint in observations.joints.T)
    return (
        Layer.over("place", (places[:, :2],), 80.0, 0.5, 100.0),
        Layer.over("place", (places,), 150.0, 0.5, 100.0),
        Layer.over("arms", angles, 0.4, USUAL_RAD),
    )


def effects_of(name):
    """One effect of each kind, with a step of each part, for a robot of this name."""
    model = model_of(name)
    observations = observed(model, 7)
    parts = candidate_parts(model)
    steps = [
        replace(parts[part], since=1.0 + number, until=until)
        for number, (part, until) in enumerate(
            [("frame", np.inf), ("encoder 1", 5.0), ("forearm 0", np.inf), ("mount 2", 6.5)]
        )
    ]
    if "arm 1" in parts:
        steps.append(replace(parts["arm 1"], since=5.0))
    joints = observations.joints.shape[1]
    rate = 30.0 if model.nominal.mechanism.joints[0].is_revolute else 0.5
    ripple = Ripple((0, 2), rate, 0.01 * rate, 1e-4, -3.0, (0.5, -1.0, 2.0, 0.3))
    effects = (*steps, Walk(0), ripple, Lag(joints), *layers(observations))
    return model.with_effects(effects), observations


@pytest.mark.slow
@pytest.mark.parametrize("name", ["delta", "linear-delta"])
def test_derivatives_by_all_unknowns_are_those_by_differences(name):
    model, observations = effects_of(name)
    rng = np.random.default_rng(1)
    x, frames = 0.02 * rng.standard_normal(model.size), (FRAME,)
    at = model.predict(x, frames, observations, observations.near)
    blocks = (slice(len(model.names)), *model.effect_places, slice(model.size, model.size + 6))
    for place in np.concatenate([rng.permutation(np.r_[block])[:3] for block in blocks]):
        step = np.zeros(model.size + 6)
        step[place] = 1e-4 if place < model.size else 1e-3
        moved = moved_frames(frames, step[model.size :])
        ahead = model.predict(x + step[: model.size], moved, observations, at.assembly.unknowns)
        expected = (ahead.residual - at.residual) / step[place]
        column = at.jacobian[:, :, place]
        largest = np.abs(expected).max()
        assert column == pytest.approx(expected, abs=2e-3 * largest + 1e-8), place
    for effect, where in zip(model.effects, model.effect_places, strict=True):
        assert at.columns_of(effect, observations) == pytest.approx(
            at.jacobian[:, :, where], rel=1e-9, abs=1e-12
        )


@pytest.mark.parametrize("part", ["encoder 1", "arm 1", "forearm 1", "mount 1"])
def test_a_changed_part_is_the_robot_with_that_parameter_changed(part):
    model = model_of("delta")
    observations = observed(model, 10)
    step = replace(candidate_parts(model)[part], since=4.0, until=8.0)
    changed = model.with_effects((step,))
    z = np.arange(1.0, 1.0 + step.count)
    x = np.zeros(len(model.names))
    predicted = changed.predict(np.r_[x, z], (FRAME,), observations, observations.near).residual
    x[list(step.places)] = np.array(step.usual) * z
    within = model.predict(x, (FRAME,), observations, observations.near).residual
    without = model.predict(0.0 * x, (FRAME,), observations, observations.near).residual
    is_within = ((np.arange(10) >= 4) & (np.arange(10) < 8))[:, None]
    assert predicted == pytest.approx(np.where(is_within, within, without), abs=1e-7)
    stems = {"encoder": ("joint_offset",), "arm": ("arm",), "forearm": ("forearm",)}
    expected = {f"arm1.{stem}" for stem in stems.get(part.split()[0], ("x", "y", "z"))}
    assert {model.names[p].rsplit("_", 1)[0] for p in step.places} == expected
    usual = np.radians(0.1) if part == "encoder 1" else 0.2
    assert np.array(step.usual) * model.tolerance[list(step.places)] == pytest.approx(usual)


def test_arms_of_a_ripple_are_zero_where_they_have_none_and_rates_are_named():
    observations = observed(model_of("delta", "offsets"), 6)
    ripple = Ripple((2,), 40.0, 0.5, 1e-4, -3.0)
    basis = ripple.basis(observations)
    assert basis.shape == (6, 3, 3)
    assert not basis[:, :2].any()
    expected = 1e-4 * np.sin(40.0 * observations.joints[:, 2])
    assert basis[:, 2, 0] == pytest.approx(expected)
    assert ripple.name == "ripple of 2 near 80"


def test_a_bump_of_the_frame_turns_and_shifts_the_points_behind_it():
    model = model_of("delta", "offsets")
    observations = observed(model, 10)
    step = replace(candidate_parts(model)["frame"], since=4.0)
    changed = model.with_effects((step,))
    x, z = np.zeros(len(model.names)), np.array([3.0, 0.0, -2.0, 5.0, 1.0, 0.0])
    predicted = changed.predict(np.r_[x, z], (FRAME,), observations, observations.near).residual
    turn = matrices_of(1e-3 * TURN_MRAD * z[:3])
    frame = Transform(turn @ FRAME.rotation, FRAME.translation_mm + 0.2 * z[3:])
    behind = model.predict(x, (frame,), observations, observations.near).residual
    before = model.predict(x, (FRAME,), observations, observations.near).residual
    assert predicted == pytest.approx(
        np.where(np.arange(10)[:, None] >= 4, behind, before), abs=1e-7
    )
    assert (step.moves, step.count, step.is_lasting) == ("frame", 6, True)
    assert not replace(step, until=9.0).is_lasting


def test_steps_cover_their_first_shot_and_not_that_behind_them():
    step = Step("encoder 0", 3.0, 6.0, (1.0,), (0,), 4)
    assert step.covers(np.arange(8.0)).tolist() == [False] * 3 + [True] * 3 + [False] * 2
    lasting = replace(step, until=np.inf)
    assert lasting.covers(np.array([2.0, 1e9, np.inf])).tolist() == [False, True, True]
    assert not step.covers(np.array([np.inf])).any()  # today's robot has what lasts
    assert step.name != replace(step, until=7.0).name
    assert step.name != replace(step, since=4.0).name
    assert step.smallest_size == 1.0


def session(count, frame=None, time=None):
    observations = Observations.unmeasured(np.zeros((count, 3)), np.zeros((count, 3)))
    time = np.linspace(0.0, 1.0, count) if time is None else time
    frame = np.zeros(count, dtype=int) if frame is None else frame
    return replace(observations, time=time, frame=frame)


def test_modes_of_the_stand_are_those_of_a_random_walk_less_its_mean():
    """Covariance min(s, t) less means over s and t, the part of it that four modes hold."""
    time = (np.arange(100) + 0.5) / 100.0
    basis = Walk(0).basis(session(100, time=time))
    walk = STAND_MM**2 * np.minimum(time[:, None], time)
    centre = np.eye(100) - 1.0 / 100.0
    covariance = centre @ walk @ centre
    values, vectors = np.linalg.eigh(covariance)
    four = (vectors[:, -4:] * values[-4:]) @ vectors[:, -4:].T
    for axis in range(3, 6):
        rows = basis[:, axis]
        assert rows @ rows.T == pytest.approx(four, abs=5e-3 * covariance.max())
        assert (rows**2).sum() == pytest.approx(values[-4:].sum(), rel=5e-3)
        assert (rows**2).sum() > 0.85 * np.trace(covariance)
    # its turns show as that walk at a stand 3 m away
    assert 3000.0 * 1e-3 * basis[:, :3] @ basis[:, 3:].swapaxes(1, 2) == pytest.approx(
        0.0 * basis[:, :3, :3]
    )
    assert 3000.0 * 1e-3 * basis[:, 0, :].max() == pytest.approx(basis[:, 3, :].max())


def test_a_stand_moves_in_its_own_session_alone():
    frame = np.repeat([0, 1], 5)
    basis = Walk(1).basis(session(10, frame))
    assert not basis[:5].any()
    assert basis[5:].any()
    assert basis.shape == (10, 6, Walk(1).count)
    assert Walk(0).name == Walk(1).name


def waves(ripple, observations, rate_change=0.0):
    amplitudes = np.reshape(ripple.amplitudes, (-1, 2))
    motion = np.zeros_like(observations.joints)
    for arm, (sine, cosine) in zip(ripple.arms, amplitudes, strict=True):
        phase = (ripple.rate + rate_change) * observations.joints[:, arm]
        motion[:, arm] = ripple.usual * (sine * np.sin(phase) + cosine * np.cos(phase))
    return motion


def test_a_ripple_is_sine_and_cosine_and_its_last_column_the_change_by_its_rate():
    observations = observed(model_of("delta", "offsets"), 10)
    ripple = Ripple((0, 2), 40.0, 0.5, 1e-4, -3.0, (0.5, -1.0, 2.0, 0.3))
    basis = ripple.basis(observations)
    assert ripple.moves == "joints"
    assert basis @ np.r_[ripple.amplitudes, 0.0] == pytest.approx(waves(ripple, observations))
    ends = [waves(ripple, observations, change) for change in (0.5e-3, -0.5e-3)]
    assert basis[:, :, -1] == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=1e-5, abs=1e-10)
    assert not replace(ripple, amplitudes=()).basis(observations)[:, :, -1].any()
    assert ripple.sizes_of == ((ripple.name, 4), ("", 1))
    assert ripple.log_odds == -3.0


def test_a_retuned_ripple_has_the_estimated_rate_and_amplitudes_and_its_old_name():
    ripple = Ripple((1,), 40.0, 0.5, 1e-4, -3.0)
    tuned, z = ripple.retuned(np.array([2.0, -1.0, 0.4]))
    assert z.tolist() == [2.0, -1.0, 0.0]
    assert tuned.rate == pytest.approx(40.2)
    assert tuned.amplitudes == (2.0, -1.0)
    assert tuned.name == ripple.name
    assert Lag(3).retuned(np.ones(3))[0] == Lag(3)
    assert Lag(3).retuned(np.ones(3))[1].tolist() == [1.0, 1.0, 1.0]


def test_a_lag_is_a_thousandth_of_each_joints_way_from_the_shot_before():
    observations = observed(model_of("delta", "offsets"), 6)
    motion = Lag(3).basis(observations) @ np.array([1.0, 2.0, 3.0])
    way = np.r_[np.zeros((1, 3)), -np.diff(observations.joints, axis=0)]
    assert motion == pytest.approx(1e-3 * way * [1.0, 2.0, 3.0])
    assert (Lag(3).moves, Lag(3).count, Lag(3).log_odds) == ("joints", 3, 0.0)


def matern(distance):
    return (1.0 + 3.0**0.5 * distance) * np.exp(-(3.0**0.5) * distance)


def test_functions_of_a_layer_over_places_reproduce_its_kernel_at_the_shots():
    observations = observed(model_of("par4-prototype", "offsets"), 30)
    plane, space, _ = layers(observations)
    poses = observations.near * np.r_[np.ones(3), 100.0]
    for layer, columns, length in ((plane, 2, 80.0), (space, 4, 150.0)):
        assert layer.moves == "point"
        basis = layer.basis(observations) / layer.usual
        distance = np.linalg.norm(poses[:, None, :columns] - poses[None, :, :columns], axis=2)
        for axis in range(3):
            rows = basis[:, axis]
            assert rows @ rows.T == pytest.approx(matern(distance / length), abs=0.03)
            assert (rows**2).sum() == pytest.approx(30.0, rel=1.1e-3)
            assert not (rows @ basis[:, (axis + 1) % 3].T).any()
        counts = [count for _, count in layer.sizes_of]
        assert (sum(counts), len({*counts})) == (layer.count, 1)
        assert [name[-2:] for name, _ in layer.sizes_of] == [" x", " y", " z"]
        ends = np.cumsum([0, *counts])
        for axis in range(3):
            assert basis[:, axis, ends[axis] : ends[axis + 1]].any(axis=0).all()


def test_a_layer_over_angles_moves_each_joint_by_its_own_angle():
    observations = observed(model_of("delta", "offsets"), 30)
    _, _, layer = layers(observations)
    assert layer.moves == "joints"
    basis = layer.basis(observations) / USUAL_RAD
    for arm in range(3):
        angle = observations.joints[:, arm]
        expected = matern(np.abs(angle[:, None] - angle) / 0.4)
        assert basis[:, arm] @ basis[:, arm].T == pytest.approx(expected, abs=0.03)
        assert not (basis[:, arm] @ basis[:, (arm + 1) % 3].T).any()
    assert layer.sizes_of == ((layer.name, layer.count),)
    assert basis.shape == (30, 3, layer.count)


def test_no_variance_of_a_layer_is_unseen_at_the_shots_and_all_of_it_far_away():
    observations = observed(model_of("delta", "offsets"), 30)
    for layer, joints in zip(layers(observations), (1, 1, 3), strict=True):
        near = layer.unseen_share(observations)
        assert near.shape == (30, joints)
        assert near.max() < 0.02
        away = replace(observations, near=observations.near + 1e5, joints=observations.joints + 1e3)
        assert layer.unseen_share(away) == pytest.approx(np.ones((30, joints)))
        assert not layer.basis(away).any()
        aside = replace(
            observations, near=observations.near + 30.0, joints=observations.joints + 0.1
        )
        between = layer.unseen_share(aside)
        assert ((between > 0.0) & (between < 1.0)).mean() > 0.8


def test_layers_of_other_kinds_lengths_and_coordinates_have_other_names():
    observations = observed(model_of("delta", "offsets"), 12)
    first, second, third = layers(observations)
    other = Layer.over("place", first.shots, 90.0, 0.5)
    assert len({layer.name for layer in (first, second, third, other)}) == 4


def test_a_change_keeps_its_parameters_where_a_robot_has_other_unknowns():
    before, names = ("a", "b", "c", "d"), ("c", "x", "a", "d", "b")
    step = Step("arm 0", 3.0, np.inf, (2.0, 5.0), (1, 3), 4)
    moved = step.with_names(before, names)
    assert [names[place] for place in moved.places] == ["b", "d"]
    assert moved.by_unknowns.tolist() == [[0, 0], [0, 0], [0, 0], [0, 5], [2, 0]]
    frame = Step("frame", 3.0, np.inf, (1.0,) * 6, tuple(range(6)), 6)
    assert frame.with_names(before, names) is frame
