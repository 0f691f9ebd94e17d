"""Causes by name: what a model lacks, and what changed at the end, by all shots of a campaign."""

from dataclasses import replace

import numpy as np
import pytest
from fake_cell import NOMINAL
from family_cases import Member
from identified_cases import (
    NOISE_MM,
    TRACKER_FROM_BASE,
    TRUTH,
    identified,
    moved,
    noisy,
    simulated,
    stating,
)
from par4_space import SPACE

from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator, Model
from campaigns.identification.identify import identify
from campaigns.identification.model_selection import candidate_models, select_model, terms_to_add
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import select_parameters
from campaigns.mechanisms.mechanism import Kinematics

BOTH = pytest.mark.parametrize("estimator", list(Estimator))
PLAIN = simulated(40, 20, seed=2)
UNSEEN_FROM = 80


def with_joints(joints, seed=1, truth=TRUTH):
    """The same encoder readings, the points of the robot that stands at these joints."""
    points = TRACKER_FROM_BASE.apply(truth.forward(joints).values_or_raise()[:, :3])
    return noisy(replace(PLAIN, points_in_tracker_mm=points), seed)


def doubts_of(data, name, estimator=Estimator.POINTS):
    return [each for each in identified(data, estimator).doubts if each.name == name]


@BOTH
def test_an_eccentric_encoder_is_named_with_its_arm_and_size(estimator):
    joints = PLAIN.joints.copy()
    joints[:, 2] += np.radians(0.05) * np.sin(joints[:, 2] + 0.7)
    found = identified(with_joints(joints), estimator)
    (doubt,) = [each for each in found.doubts if each.name == "lack-of-fit"]
    assert doubt.says.startswith("arm 2: eccentric encoder")
    assert doubt.numbers["size"] == pytest.approx(0.05, rel=0.2)
    assert doubt.numbers["unit"] == "°"
    assert found.verdict == "not decided"


def test_a_gears_ratio_is_told_in_percent():
    joints = PLAIN.joints.copy()
    joints[:, 1] *= 1.001
    (doubt,) = doubts_of(with_joints(joints), "lack-of-fit")
    assert (doubt.numbers["cause"], doubt.numbers["arm"]) == ("ratio", 1.0)
    assert doubt.numbers["size"] == pytest.approx(0.1, abs=0.02)


def test_what_could_be_freed_is_named_with_the_option_that_frees_it():
    p = TRUTH.p.copy()
    p[SPACE.places(["arm1.azimuth_deg", "arm3.azimuth_deg"])] += [1e-3, -1e-3]
    data = with_joints(PLAIN.joints, truth=Kinematics(TRUTH.mechanism, p))
    (doubt,) = doubts_of(data, "lack-of-fit")
    assert doubt.numbers["cause"] == "azimuths"
    assert "--model auto fits those that can be told" in doubt.says
    freed = identified(data, Estimator.POINTS, free=["arm[123].azimuth_deg"])
    assert freed.doubts == ()


def test_a_carriages_drive_is_named_with_the_period_that_its_file_states():
    member = Member("linear-delta")
    poses = member.reachable_poses(member.nominal, 120, seed=5)
    joints = member.nominal.inverse(poses).values_or_raise()
    driven = joints + 0.03 * np.sin(2.0 * np.pi * joints / 20.0 + np.arange(3))
    points = TRACKER_FROM_BASE.apply(member.nominal.forward(driven).values_or_raise()[:, :3])
    data = replace(PLAIN, joints=joints, points_in_tracker_mm=points, approach=np.zeros((120, 3)))
    nominal, selection = member.nominal, select_parameters(member.space)
    nominal = replace(nominal, mechanism=nominal.mechanism.with_ripples(20.0))
    found = identify(nominal, noisy(data, 4), selection)
    (doubt,) = [each for each in found.doubts if each.name == "lack-of-fit"]
    assert doubt.numbers["cause"] == "period"
    assert doubt.numbers["period_mm"] == pytest.approx(20.0, rel=0.01)
    assert doubt.numbers["size"] == pytest.approx(0.03, rel=0.3)


def yielding_delta(yielding_rad_mm):
    """Nominal Delta, and its shots where gears yield by so much for each mm/rad of rise."""
    member = Member("delta")
    poses = member.reachable_poses(member.nominal, 120, seed=5)
    joints = member.nominal.inverse(poses).values_or_raise()
    rises = member.nominal.jacobian(joints, poses)[:, 2, member.space.offsets]
    driven = joints - yielding_rad_mm * rises
    points = TRACKER_FROM_BASE.apply(member.nominal.forward(driven).values_or_raise()[:, :3])
    data = replace(PLAIN, joints=joints, points_in_tracker_mm=points, approach=np.zeros((120, 3)))
    return member, noisy(data, 4)


def test_gears_that_yield_are_corrected_by_eccentricity_and_dimensions_beside_it_doubted():
    member, data = yielding_delta(3e-7)
    models = candidate_models(member.space, Model.STANDARD)
    larger = {"full": candidate_models(member.space, Model.AUTO)["full"]}
    terms = terms_to_add(member.space, Model.AUTO)
    found = select_model(member.nominal, data, models | larger, terms=terms)
    assert next(each.name for each in found.models if each.kept).startswith("standard+yielding")
    (doubt,) = found.doubts
    assert (doubt.name, doubt.decision) == ("yielding", "not decided")
    limits = IdentificationOptions(limits_mm={"mean": 0.1}, yielding=True)
    met = identify(member.nominal, data, models["standard"], limits)
    assert [each.decision for each in met.doubts if each.name == "yielding"] == [None]


class TestReflectorConstant:
    DATA = noisy(PLAIN, 3).with_shorter_ranges(12.7)

    def test_of_another_reflector_is_named_with_its_size(self):
        (doubt,) = doubts_of(self.DATA, "lack-of-fit")
        assert doubt.numbers["cause"] == "reflector"
        assert doubt.numbers["size"] == pytest.approx(-12.7, abs=0.2)
        assert "--free reflector_constant_mm" in doubt.says

    def test_is_fitted_beside_the_robot(self):
        options = IdentificationOptions(free=("reflector_constant_mm",))
        selection = select_parameters(SPACE, options.free)
        found = identify(NOMINAL, self.DATA, selection, options)
        (told,) = found.doubts
        assert told.numbers["off_mm"] == pytest.approx(-12.7, abs=5.0 * told.numbers["std_mm"])
        assert "another type of reflector" in told.says
        assert found.verdict == "pass"
        for name, each in found.parameters.items():
            if each.std is not None:
                assert each.value == pytest.approx(TRUTH.parameters[name], abs=5.0 * each.std)

    def test_is_no_matter_of_distances(self):
        with pytest.raises(OptionsInvalid, match="belongs to --estimator points"):
            IdentificationOptions(estimator=Estimator.DISTANCES, free=("reflector_constant_mm",))


class TestChange:
    def stepped(self, first, offset_deg=0.0, x_mm=0.0, seed=1):
        p = TRUTH.p.copy()
        p[SPACE.offsets[2]] += np.radians(offset_deg)
        p[SPACE.places(["arm2.x_mm"])] += x_mm
        later = with_joints(PLAIN.joints, seed, Kinematics(TRUTH.mechanism, p))
        points = noisy(PLAIN, seed).points_in_tracker_mm.copy()
        points[first:] = later.points_in_tracker_mm[first:]
        return stating(replace(PLAIN, points_in_tracker_mm=points))

    @pytest.mark.parametrize("first", [UNSEEN_FROM + 20, 115])
    def test_among_unseen_shots_is_named(self, first):
        (doubt,) = doubts_of(self.stepped(first, offset_deg=0.1), "change-during-campaign")
        assert doubt.numbers["cause"] == "arm2.joint_offset_deg"
        assert abs(doubt.numbers["before_shot"] - first) <= 1
        assert doubt.decision == "fail"

    def test_of_a_mount_is_no_encoders(self):
        (doubt,) = doubts_of(self.stepped(50, x_mm=0.5), "change-during-campaign")
        assert doubt.says.startswith("arm 2's mount moved by 0.5")

    def test_of_an_encoder_below_the_play_of_the_gears_is_only_told(self):
        play = np.random.default_rng(4).choice([-0.5, 0.5], PLAIN.joints.shape)
        scatter = with_joints(PLAIN.joints + np.radians(0.1) * play)
        joints = PLAIN.joints.copy()
        joints[60:, 2] += np.radians(0.08)
        points = scatter.points_in_tracker_mm + (
            with_joints(joints).points_in_tracker_mm - noisy(PLAIN, 1).points_in_tracker_mm
        )
        found = identified(replace(scatter, points_in_tracker_mm=points), Estimator.POINTS)
        assert found.robot_scatter.joint > 0.0
        (doubt,) = [each for each in found.doubts if each.name == "change-during-campaign"]
        assert doubt.decision is None
        assert "less than the play" in doubt.says
        assert found.verdict == "pass"


@pytest.mark.parametrize("seed", range(3))
def test_play_of_gears_is_named_and_makes_no_change(seed):
    approach = np.random.default_rng([6, seed]).choice([-1.0, 1.0], PLAIN.joints.shape)
    data = with_joints(PLAIN.joints - 0.5 * np.radians(0.3 / 60.0) * approach, seed)
    found = identified(replace(data, approach=approach), Estimator.POINTS)
    (doubt,) = found.doubts
    assert doubt.numbers["cause"] == "backlash"
    assert doubt.numbers["size"] == pytest.approx(0.005, rel=0.3)


def test_swapped_neighbours_are_told_and_are_no_change():
    data = noisy(PLAIN, 1)
    points = data.points_in_tracker_mm.copy()
    points[[30, 31]] = points[[31, 30]]
    found = identified(replace(data, points_in_tracker_mm=points), Estimator.POINTS)
    (doubt,) = found.doubts
    assert (doubt.name, doubt.decision) == ("swapped", None)
    assert doubt.says.startswith("shots 30 and 31 are swapped")
    assert found.verdict == "pass"


def test_wrong_shots_together_at_the_end_of_what_is_fitted_are_a_change():
    """Each somewhere else, so that no cause explains them."""
    wrong = moved(noisy(PLAIN, 1), (75, 77, 79), 3.0)
    assert any(each.decision == "fail" for each in doubts_of(wrong, "change-during-campaign"))
    apart = moved(noisy(PLAIN, 1), (5, 40, 79), 3.0)
    assert doubts_of(apart, "change-during-campaign") == []


def test_an_encoder_that_slips_before_the_last_shots_is_named_though_they_are_gross_errors():
    """Between two of the last three one that hardly shows it, so that each stands alone."""
    slipped = PLAIN.joints + np.radians(0.3) * np.eye(4)[3]
    moved_mm = TRUTH.forward(slipped).values[:, :3] - TRUTH.forward(PLAIN.joints).values[:, :3]
    least, *_, second, most = np.argsort(np.linalg.norm(moved_mm, axis=1)).tolist()
    others = np.setdiff1d(np.arange(len(slipped)), [least, second, most])
    rows = np.array([*others, second, least, most])
    joints = np.where(np.isin(np.arange(len(slipped)), rows[-3:])[:, None], slipped, PLAIN.joints)
    wrong = with_joints(joints).rows(rows)
    (doubt,) = doubts_of(wrong, "change-during-campaign")
    assert (doubt.numbers["kind"], doubt.numbers["cause"]) == ("joint", "arm3.joint_offset_deg")
    assert doubt.numbers["before_shot"] == wrong.numbers[-3]


@pytest.mark.parametrize("seed", range(3))
def test_noise_with_a_memory_is_no_change(seed):
    rng = np.random.default_rng([5, seed])
    noise = rng.standard_normal((len(PLAIN), 3))
    for row in range(1, len(PLAIN)):
        noise[row] = 0.8 * noise[row - 1] + 0.6 * noise[row]
    points = PLAIN.points_in_tracker_mm + NOISE_MM * noise
    found = identified(stating(replace(PLAIN, points_in_tracker_mm=points)), Estimator.POINTS)
    assert found.doubts == ()
