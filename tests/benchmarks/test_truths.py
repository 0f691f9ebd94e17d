"""Drawn robots and campaigns of them are in the situation that its words say."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.true_campaigns import measure, nominal_robot, planned_shots, resolve_step
from benchmarks.truths import ROBOTS, Situation, Streams, draw_robot
from pkmcal import find_robot, sample_workspace

SHOTS = 30
BY_PARAMETERS = (
    *("clean", "eccentricity 0.01", "ratio 200", "ratios 200", "azimuths 0.5", "rods 0.05"),
    *("tilts 0.5", "bars 0.5", "frame 0.05", "backlash 0.3", "plate 10"),
)
SECOND_ORDER_MM = 0.005
"""The model is of first order in unequal rods and tilted axes; the tracker scatters by more."""


@pytest.fixture(scope="module")
def plans(tmp_path_factory):
    return tmp_path_factory.mktemp("plans")


@pytest.fixture(scope="module")
def measured(plans):
    """Campaigns of Par4 by a situation's words, with their plan."""
    nominal, planned, streams = find_robot("par4-prototype"), plan_of("par4", plans), Streams((5,))

    @cache
    def measured(words):
        situation = Situation.parse(words)
        truth = draw_robot(nominal, situation, planned, streams)
        return measure(nominal, truth, situation, planned, streams)

    measured.planned = planned
    return measured


@cache
def plan_of(mechanism, folder):
    return planned_shots(mechanism, SHOTS, 1, folder)


def moved_mm(campaign, clean):
    """How far each point is from where it is in a clean campaign."""
    shots = campaign.shots.points_in_tracker_mm - clean.shots.points_in_tracker_mm
    return np.linalg.norm(shots, axis=1)


@pytest.mark.parametrize("mechanism", ROBOTS)
@pytest.mark.parametrize("words", BY_PARAMETERS)
def test_known_parameters_give_the_points_of_the_rods(mechanism, words, plans):
    situation, nominal = Situation.parse(words), find_robot(ROBOTS[mechanism])
    if not situation.suits(mechanism):
        pytest.skip("the mechanism has no such part")
    truth = draw_robot(nominal, situation, plan_of(mechanism, plans), Streams((3,)))
    if truth.kind.on_rails and {"azimuths", "tilts"} & {words.split()[0]}:
        pytest.skip("a rail's tilt is several parameters")
    known = {name: value for name, value in truth.known().items() if "ity" not in name or value}
    robot = nominal.of(nominal.mechanism, known, name="true", limits=nominal.limits)
    poses = sample_workspace(nominal, 20, seed=1)
    sides = np.random.default_rng(4).choice([-1.0, 1.0], (20, truth.kind.arms))
    joints = robot.kinematics.inverse(poses, sides).values_or_raise()
    left = truth.points(joints, sides, poses) - poses[:, :3]
    assert np.abs(left - left.mean(axis=0)).max() < SECOND_ORDER_MM


@pytest.mark.parametrize(
    "words",
    ["cleen", "rods", "rods 0.2 mm", "rods 0.2, drift 0.1", "encoder 0.1", "wrong 3 x", "wrong 2"],
)
def test_words_that_mean_nothing_are_refused(words):
    with pytest.raises(ValueError, match=r"is no effect|does not say"):
        Situation.parse(words)


def test_effects_do_not_change_what_others_draw(measured):
    alone, beside = measured("rods 0.2"), measured("small + rods 0.2 + wrong 3 x 1.5")
    small = measured("small")
    together = beside.now.build.rod_errors_mm
    assert together == pytest.approx(alone.now.build.rod_errors_mm * 0.25 / 0.2)
    assert beside.now.flat["arm0.x_mm"] == small.now.flat["arm0.x_mm"]
    assert np.count_nonzero(moved_mm(measured("wrong 3 x 1.5"), measured("clean")) > 1e-9) == 1


@pytest.mark.parametrize(
    ("words", "first", "end"), [("from 30", 15, 30), ("from 20 to 27", 10, 14)]
)
def test_a_stand_moves_from_its_shot_on(measured, words, first, end):
    moved, fitted = (
        moved_mm(measured(f"stand 0.3 {words}"), measured("clean")),
        measured.planned.fitted,
    )
    last = fitted[end - 1] + 1 if end < SHOTS else len(moved)
    assert moved[fitted[first] : last] == pytest.approx(0.3)
    assert not moved[: fitted[first]].any()
    assert not moved[last:].any()


@pytest.mark.parametrize("words", ["encoder 0.05", "arm 0.3", "forearm 0.3", "mount 0.3"])
def test_a_step_of_an_arm_moves_the_shots_after_it_and_the_robot_of_now(measured, words):
    clean, campaign = measured("clean"), measured(f"{words} last 5")
    moved = moved_mm(campaign, clean)
    assert not moved[:-5].any()
    assert (moved[-5:] > 0.001).all()
    assert campaign.steps[0].first == len(moved) - 5
    assert campaign.steps[0].part.startswith(words.split()[0])
    assert campaign.now.flat != clean.now.flat


def test_a_step_that_was_taken_back_is_not_in_the_robot_of_now(measured):
    assert measured("encoder 0.05 from 20 to 27").now.flat == measured("clean").now.flat


def test_a_carriage_steps_by_six_millimetres_a_degree(plans):
    term, nominal = Situation.parse("encoder 0.05 from 30").terms[0], find_robot("linear-delta")
    planned, streams = plan_of("linear-delta", plans), Streams((1,))
    kind = draw_robot(nominal, Situation.parse("clean"), planned, streams).kind
    step = resolve_step(term, kind, planned, streams)
    assert [*step.flat.values()] == [pytest.approx(0.3)]


def test_wrong_shots_are_as_many_and_as_far_off_as_is_said(measured):
    campaign, clean = measured("wrong 20 x 1.5 same"), measured("clean")
    off = campaign.shots.points_in_tracker_mm - clean.shots.points_in_tracker_mm
    wrong = sorted(campaign.wrong)
    assert np.flatnonzero(off.any(axis=1)).tolist() == wrong
    assert len(wrong) == 20 * SHOTS // 60
    assert set(wrong) <= set(measured.planned.fitted.tolist())
    assert np.linalg.norm(off[wrong], axis=1) == pytest.approx(1.5)
    assert np.ptp(off[wrong], axis=0) == pytest.approx(0.0, abs=1e-9)


def test_wrong_hold_out_shots_are_none_of_the_fit(measured):
    wrong = measured("unseen 2 x 1.5").wrong
    assert len(wrong) == 2
    assert not wrong & set(measured.planned.fitted.tolist())


def test_no_nominal_robot_has_the_readings_without_an_assembly(measured):
    campaign, nominal = measured("unassembled 3"), find_robot("par4-prototype").kinematics
    solved = nominal.forward(campaign.shots.joints).is_solved
    assert np.flatnonzero(~solved).tolist() == sorted(campaign.wrong)
    assert len(campaign.wrong) == 3


@pytest.mark.parametrize("effect", ["drift", "warm-up"])
def test_a_stand_has_moved_by_its_size_at_the_end(measured, effect):
    moved = moved_mm(measured(f"{effect} 0.1"), measured("clean"))
    assert moved[0] == 0.0
    assert moved[-1] == pytest.approx(0.1, rel=0.02)
    assert (np.diff(moved) > 0.0).all()


def test_lacks_have_their_sizes_at_the_edge(measured):
    truth = replace(measured("edge 0.3").now, reach_mm=500.0)
    points = np.array([[500.0, 0.0, -600.0], [0.0, -250.0, -600.0]])
    errors = truth._lack_mm(truth.lacks[0], points, np.zeros(2))
    assert errors[:, 2] == pytest.approx([0.3, 0.3 / 2**10])
    assert not errors[:, :2].any()


@pytest.mark.parametrize(
    ("words", "least", "most"),
    [("kink 1", 0.1, 0.5), ("cable 0.3", 0.1, 0.4), ("sag 0.3", 0.1, 0.6), ("theta 0.3", 0.05, 0.3),
     ("dent 80", 0.3, 0.501), ("bent 0.1", 0.3, 3.0), ("lag 0.1", 0.3, 3.0), ("ripple", 0.05, 0.5),
     ("edge 1", 0.5, 2.0), ("scatter 0.05", 0.1, 0.3), ("yield 0.2", 0.1, 1.0)],
)  # fmt: skip
def test_what_no_model_has_moves_points_by_its_size(measured, words, least, most):
    moved = moved_mm(measured(words), measured("clean"))
    assert least < moved.max() < most


def test_ripples_are_common_or_of_own_rates_or_of_one_arm(measured):
    common, own, one = (measured(f"ripple{how}").now for how in ("", " own", " one"))
    assert np.ptp(common.rates) == 0.0
    assert len(set(own.rates)) == 4
    assert np.count_nonzero(one.ripple) == 1
    assert one.ripple.max() == common.ripple.max() == pytest.approx(np.radians(0.5 / 60.0))


def test_a_reflector_is_beside_the_place_of_its_file(measured, plans):
    stated = nominal_robot("par4", plans, is_reflector_stated=True).mechanism.plate.reflector_mm
    off = measured("reflector 50").now.reflector_mm - np.array(stated)
    assert np.linalg.norm(off) == pytest.approx(50.0)
    silent = nominal_robot("par4", plans, is_reflector_stated=False)
    assert silent.mechanism.plate.reflector_mm == (0.0, 0.0, 0.0)
    assert not Situation.parse("rods 0.2 + reflector 50 unstated").is_reflector_stated
