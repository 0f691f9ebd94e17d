"""Directions that nothing determines, σ of positions without the frame's motion, and its budget."""

from dataclasses import replace

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL
from small_fits import drawn_fit, model_of, observed
from small_plans import LIMITS

from campaigns.design.pose_sampling import workspace_poses
from campaigns.fit import uncertainty
from campaigns.fit.effects import Lag, Layer, Walk
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.fit import Fit, Prior, fit_model, integrate_sizes

NAMES = ("upper_arm1_mm", "forearm1_mm", "scale", "motor1_deg", "motor2_deg")
SHOTS, STD_MM = 40, 0.01


def rows_without(direction: np.ndarray, count: int = 50) -> np.ndarray:
    """Draw derivatives (count, 3, P) of points that do not move along a direction."""
    rows = np.random.default_rng(1).normal(size=(count, 3, len(direction)))
    return rows - (rows @ direction)[..., None] * direction / (direction @ direction)


@pytest.fixture(scope="module")
def posterior() -> Fit:
    random = np.random.default_rng(2)
    poses = workspace_poses(NOMINAL, LIMITS, CENTRE, SHOTS, random)
    joints = NOMINAL.inverse(poses).values
    points = poses[:, :3] + STD_MM * random.normal(size=(SHOTS, 3)) - CENTRE[:3]
    noise = np.broadcast_to(STD_MM**2 * np.eye(3), (SHOTS, 3, 3))
    observations = replace(
        Observations.unmeasured(joints, poses), points=points, noise={"stated": noise}
    )
    return fit_model(ErrorModel(NOMINAL), observations)


def test_a_combination_that_moves_no_point_is_named_and_holds_nothing_of_the_covariance():
    hidden = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    rows = rows_without(hidden)
    information = uncertainty.shot_information(rows, np.broadcast_to(np.eye(3), (50, 3, 3)))
    assert information == pytest.approx(np.einsum("nip,niq->pq", rows, rows))
    null = uncertainty.null_directions_of(information, NAMES, np.eye(5))
    assert null.names == (("forearm1_mm", "upper_arm1_mm"),)
    covariance = null.transform_covariance(np.diag([4.0, 1.0, 1.0, 2.0, 3.0]))
    assert hidden @ covariance @ hidden == pytest.approx(0.0, abs=1e-12)
    assert covariance[3, 3] == pytest.approx(2.0)
    assert null.transform(np.array([3.0, 1.0, 5.0, 6.0, 7.0])) == pytest.approx([1, -1, 5, 6, 7])


def test_a_combination_is_named_by_the_motion_that_takes_it_back():
    # of two directions (1, 1, 0) is a shift, and (0, 1, 1) is hidden by the mechanism: a mixture
    # of them shows neither, and a motion that takes nothing back has no direction
    shift, hidden = np.array([1.0, 1, 0, 0, 0]), np.array([0, 1.0, 1, 0, 0])
    vectors = np.linalg.qr(np.array([shift, hidden]).T)[0]
    turned = vectors @ np.linalg.qr(np.random.default_rng(3).normal(size=(2, 2)))[0]
    back = turned.T @ np.array([2.0, 0, 0, 0, 0])  # of the hidden one nothing
    motions = {"turn": 0.0 * back, "shift": back}
    null = uncertainty.NullDirections.spanned_by(turned, NAMES, np.eye(5), (), motions)
    assert null.motions == ("", "shift")
    assert {*null.names[0]} == {NAMES[1], NAMES[2]}
    assert {*null.names[1]} in ({NAMES[0], NAMES[1]}, {NAMES[0], NAMES[2]})
    both = {"turn": 3.0 * back, "shift": back}
    null = uncertainty.NullDirections.spanned_by(turned, NAMES, np.eye(5), (), both)
    assert null.motions == ("", "turn together with shift")


def test_two_combinations_are_named_by_the_fewest_parameters_and_the_trackers_are_left_out():
    vectors = np.linalg.qr(np.array([[1.0, 1, 0, 0, 0], [0, 0, 0, 1, -1], [0, 0, 1, 0, 0]]).T)[0]
    turned = vectors @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    null = uncertainty.NullDirections.spanned_by(turned, NAMES, np.eye(5))
    assert null.names == (("forearm1_mm", "upper_arm1_mm"), ("motor1_deg", "motor2_deg"))
    assert uncertainty.NullDirections.spanned_by(np.zeros((5, 0)), NAMES, np.eye(5)).names == ()


def test_of_combinations_as_simple_as_others_rounding_chooses_none():
    # any two of three parameters can be the ones that the third imitates
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    alike, named = np.array([np.cos(angles), np.sin(angles)]).T, set()
    for seed in range(20):
        random = np.random.default_rng(seed)
        vectors = np.zeros((5, 2))
        vectors[:3] = alike @ np.linalg.qr(random.normal(size=(2, 2)))[0]
        vectors += 1e-6 * random.normal(size=vectors.shape)
        null = uncertainty.NullDirections.spanned_by(vectors, NAMES, np.eye(5))
        named.add(null.names)
    assert named == {(("forearm1_mm", "scale"), ("scale", "upper_arm1_mm"))}


def test_what_is_left_without_the_frames_is_the_inverse_of_the_whole_inverse_block():
    rows = np.random.default_rng(4).normal(size=(30, 9))
    information = rows.T @ rows
    marginal = uncertainty.marginal_information(information, 4)
    assert np.linalg.inv(marginal) == pytest.approx(np.linalg.inv(information)[:4, :4])


def test_a_motion_of_the_frame_is_no_error_of_positions_and_a_change_of_size_is():
    positions = np.random.default_rng(5).uniform(-300.0, 300.0, (20, 3))
    turned = np.array([1.0, 2.0, 3.0]) + np.cross([0.3, -0.2, 0.5], positions)
    grown = positions - positions.mean(axis=0)
    rest = uncertainty.without_frame(np.stack([turned, grown + turned], axis=2), positions)
    assert np.abs(rest[..., 0]).max() < 1e-10
    assert rest[..., 1] == pytest.approx(grown)


def test_sigma_of_positions_is_the_trace_of_their_covariance():
    by = np.random.default_rng(6).normal(size=(7, 3, 2))
    covariance = np.array([[2.0, 0.5], [0.5, 1.0]])
    expected = [np.trace(rows @ covariance @ rows.T) ** 0.5 for rows in by]
    assert uncertainty.length_std(by, covariance) == pytest.approx(expected)


def position_columns(fit, count=9):
    return np.random.default_rng(7).normal(size=(count, 3, fit.model.size))


def test_the_datum_is_where_the_priors_like_it_best():
    rng = np.random.default_rng(8)
    root, z = rng.normal(size=(5, 5)), np.linalg.qr(rng.normal(size=(5, 2)))[0]
    prior, x = root @ root.T, rng.normal(size=5)
    null = uncertainty.NullDirections.spanned_by(z, NAMES, prior)
    best = null.transform(x)
    assert null.projector @ z == pytest.approx(np.zeros((5, 2)), abs=1e-10)
    assert z.T @ prior @ best == pytest.approx(np.zeros(2), abs=1e-10)
    assert null.transform(best) == pytest.approx(best)
    moved = np.linalg.lstsq(z, x - best)[0]
    assert x - z @ moved == pytest.approx(best)
    covariance = np.diag(np.arange(1.0, 6.0))
    assert null.transform_covariance(covariance) == pytest.approx(
        null.projector @ covariance @ null.projector.T
    )


def test_a_direction_is_undetermined_where_three_hundred_tolerances_stay_within_the_noise():
    information = np.diag([1.1 / 300.0**2, 0.9 / 300.0**2, 1.0, 1.0, 1.0])
    null = uncertainty.null_directions_of(information, NAMES, np.eye(5))
    assert null.names == (("forearm1_mm",),)
    assert np.abs(null.vectors[:, 0]) == pytest.approx([0.0, 1.0, 0.0, 0.0, 0.0])


def test_a_parameter_without_any_effect_is_undetermined_and_not_named():
    """A mechanism may have one whose columns are 0 everywhere: no shot will ever show it."""
    information = np.diag([0.0, 0.1 / 300.0**2, 1.0, 1.0, 1.0])
    null = uncertainty.null_directions_of(information, NAMES, np.eye(5))
    assert null.names == (("forearm1_mm",),)
    assert null.vectors.shape == (5, 2)


@pytest.mark.parametrize("with_spread", [False, True])
@pytest.mark.parametrize("with_former", [False, True])
def test_shares_of_the_budget_add_up_with_weights_effects_spread_and_a_former_result(
    with_spread, with_former
):
    good = np.r_[np.ones(17), 0.4, 0.0, 0.9]
    count = drawn_fit().model.size
    root = np.random.default_rng(9).normal(size=(count, count))
    prior = Prior(np.zeros(count), root @ root.T + np.eye(count)) if with_former else Prior()
    fit = drawn_fit(good=good, effects=(Lag(3), Walk(0)), prior=prior)
    size = fit.model.size
    if with_spread:
        fit = replace(fit, spread=0.01 * np.eye(size + 6))
    by = position_columns(fit)
    shares = uncertainty.budget(fit, by)
    std = uncertainty.length_std(by, fit.covariance[:size, :size])
    assert sum(shares.values()) == pytest.approx((std**2).mean(), rel=1e-6)
    sources = {"stated", "points", "joints", "lag", "stand"}
    sources |= {"former"} if with_former else {"offsets", "axes", "sag", "scale"}
    assert {*shares} == sources | ({"sizes"} if with_spread else set())
    assert all(share >= 0.0 for share in shares.values())
    if with_spread:
        assert shares["sizes"] == pytest.approx(0.01 * (by**2).sum() / len(by))


def test_each_share_is_what_its_source_gives():
    fit = drawn_fit(good=np.r_[np.ones(18), 0.4, 0.9], effects=(Lag(3),))
    fit = replace(fit, sizes={**fit.sizes, "axes": 0.5, "lag": 3.0})
    size, by = fit.model.size, position_columns(fit)
    shares = uncertainty.budget(fit, by)
    rows = np.sqrt(fit.good)[:, None, None] * (fit.inverse_noise @ fit.at.jacobian)

    def share(middle):
        covariance = (fit.inverse @ middle @ fit.inverse)[:size, :size]
        return (uncertainty.length_std(by, covariance) ** 2).mean()

    for part in ("stated", "points", "joints"):
        noise = fit.factors[part] * fit.noise[part]
        assert shares[part] == pytest.approx(
            share(np.einsum("nip,nij,njq->pq", rows, noise, rows)), rel=1e-6
        )
    precisions = {"offsets": 1.0, "axes": 4.0, "scale": 1.0, "lag": 1.0 / 9.0}
    groups = [*fit.model.groups, *["lag"] * 3, *[""] * 6]
    for group, precision in precisions.items():
        of_group = np.diag([precision * (member == group) for member in groups])
        assert shares[group] == pytest.approx(share(of_group), rel=1e-6)


def test_a_known_length_determines_the_scale():
    fit = drawn_fit()
    jacobian = fit.at.jacobian.copy()
    place = fit.model.names.index("scale")
    jacobian[..., place] = 0.0
    fit = replace(fit, at=replace(fit.at, jacobian=jacobian))
    null = uncertainty.null_directions(fit)
    assert np.abs(null.vectors[:, 0]) == pytest.approx(np.eye(len(fit.model.names))[place])
    assert null.names == ()
    known = replace(fit, prior=Prior(lengths={"scale": (0.0, fit.model.tolerance[place])}))
    assert uncertainty.null_directions(known).vectors.shape[1] == 0


def test_effects_are_no_part_of_the_datum():
    fit = drawn_fit(effects=(Lag(3),))
    jacobian = fit.at.jacobian.copy()
    size = len(fit.model.names)
    jacobian[..., size : size + 3] = jacobian[..., :3]
    jacobian[..., 4] = jacobian[..., -1]
    null = uncertainty.null_directions(replace(fit, at=replace(fit.at, jacobian=jacobian)))
    assert np.abs(null.vectors) == pytest.approx(np.eye(size)[:, 4:5], abs=1e-6)
    assert null.prior == pytest.approx(fit.precision[:size, :size])


def test_between_the_shots_a_layer_adds_the_variance_that_no_shot_determines():
    model = model_of("delta", "offsets")
    observations = observed(model, 15)
    angles = tuple(joint[:, None] for joint in observations.joints.T)
    place = Layer.over("place", (observations.near[:, :2],), 60.0, 0.02)
    arms = Layer.over("arms", angles, 0.2, 1e-4)
    fit = fit_model(model.with_effects((Lag(3), place, arms)), observations)
    names = [name for name, _ in place.sizes_of]
    fit = replace(
        fit, sizes={**fit.sizes, names[0]: 1.0, names[1]: 2.0, names[2]: 3.0, arms.name: 5.0}
    )
    new = observed(model, 4, seed=8)
    at = fit.model.predict(fit.at.x, fit.at.frames, new, new.near)
    covariance = uncertainty.unseen_covariances(fit, at.by_moves, new)
    share, of_arms = place.unseen_share(new)[:, 0], arms.unseen_share(new)
    for row in range(4):
        turn = at.by_moves["point"][row] * [0.02, 0.04, 0.06]
        joints = at.by_joint[row] * 5e-4
        expected = share[row] * turn @ turn.T + joints * of_arms[row] @ joints.T
        assert covariance[row] == pytest.approx(expected)
    assert not uncertainty.unseen_covariances(replace(fit, model=model), at.by_moves, new).any()


def test_the_budget_of_a_robot_adds_up_with_what_its_sizes_may_be(posterior):
    fit = integrate_sizes(posterior)
    by = position_columns(fit)
    shares = uncertainty.budget(fit, by)
    std = uncertainty.length_std(by, fit.model_covariance)
    assert sum(shares.values()) == pytest.approx((std**2).mean(), rel=1e-6)
    assert shares["sizes"] > 0.0


def test_only_the_robots_place_in_its_base_is_undetermined_by_good_shots(posterior):
    null = uncertainty.null_directions(posterior)
    moved = posterior.at.jacobian[..., : len(posterior.model.names)] @ null.vectors
    frame = posterior.at.jacobian[..., -6:].reshape(-1, 6)
    rest = moved.reshape(len(frame), -1)
    rest = rest - frame @ np.linalg.lstsq(frame, rest, rcond=None)[0]
    assert null.vectors.shape[1] > 0
    assert np.abs(rest).max() < STD_MM / 10.0
