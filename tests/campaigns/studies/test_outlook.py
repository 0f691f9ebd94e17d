"""What is planned will determine what `identify` then states; which further kind gains most."""

from dataclasses import replace

import numpy as np
import pytest
from printers import BED_MM, Printer, printer, rings

from campaigns.api import find_robot, identify, plan, sample_workspace
from campaigns.design.restricted_space import ANYWHERE, Disc, RestrictedSpace, Zone
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.identification.objects import Object, linked
from campaigns.identification.observations import error_model
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.other_kinds import Measured, other_kinds
from campaigns.kinematics.transmission import approach_along
from campaigns.planning import forecast
from campaigns.planning.paths import RobotModel
from campaigns.planning.plans import in_turn, joints_of, poses_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.observation_candidates import ObservedCell, candidates_of, kind_of, read_wish
from campaigns.studies.outlook import judged_in_space, outlook, planned_points, without_tracker

TRACKER_MM = np.array([2400.0, -300.0, -450.0])
BED = RestrictedSpace((Zone("bed", Disc((0.0, 0.0), BED_MM), ANYWHERE, keeps_in=True),))
OBJECTS = linked(
    [
        Object("bed"),
        Object("part", shrinkage_percent=0.2, shrinkage_std_percent=0.01),
        Object("block", on="bed", height_mm=30.0, std_mm=0.01),
    ]
)


def outlook_of(robot, kinds, shots=None, *, poses=100):
    """Outlook of observations and shots, all of which are planned for shots."""
    nominal = robot.kinematics
    model = error_model(nominal, None, IdentificationOptions(tolerances=robot.tolerances))
    if shots is None:
        model = without_tracker(model)
        shots = points_of(model, ())
    near = sample_workspace(robot, poses, seed=1)
    judged = judged_in_space(model, nominal.inverse(near).values_or_raise(), near)
    return outlook(model, shots, len(shots), kinds, judged)


def points_of(model, shots):
    if not shots:
        nothing = np.zeros((0, len(model.nominal.mechanism.joints)))
        poses = np.zeros((0, len(model.nominal.mechanism.task)))
        return planned_points(model, nothing, poses, nothing, TRACKER_MM, TrackerUncertainty())
    joints, poses = joints_of(shots), poses_of(shots)
    approach = approach_along(joints)
    return planned_points(model, joints, poses, approach, TRACKER_MM, TrackerUncertainty())


def rms_of(quantities):
    return {quantity.name: quantity.rms for quantity in quantities}


def test_expected_uncertainty_is_what_identification_states_afterwards():
    """Heights, widths and a block on a simulated printer: within a quarter."""
    made = Printer(3)
    observed = [
        made.heights(rings(BED_MM, 6)),
        made.widths(65.0, shrinkage=(0.002, 1e-4)),
        made.heights(rings(60.0, 2), level_mm=30.0),
    ]
    kinds = other_kinds(observed, made.robot.kinematics)
    expected = outlook_of(made.robot, kinds)
    for number, block in enumerate(kinds.fitted, start=1):
        expected = expected.with_rows(number, np.arange(len(block)))
    result = identify(None, made.robot, observations=observed)
    stated = rms_of(result.uncertainty.determined)
    assert set(stated) == {"flat", "xy", "position"}
    assert rms_of(expected.determined) == pytest.approx(stated, rel=0.25)


def printer_outlook(wishes):
    return printer_candidates(wishes)[1]


def printer_candidates(wishes, seed=1):
    """Candidates of a printer without a tracker, and the outlook in which none is planned."""
    robot = printer()
    model = RobotModel(robot.kinematics, robot.limits, robot.workspace_centre, BED)
    cell = ObservedCell(robot=model, region=None, instrument=TrackerUncertainty())
    rng = np.random.default_rng(seed)
    candidates = [candidates_of(read_wish(wish, OBJECTS), cell, rng) for wish in wishes]
    return candidates, outlook_of(robot, other_kinds(candidates, robot.kinematics))


def measured_by(made, candidates, rows):
    """What a drawn printer measures at these rows of heights, heights of a block or widths."""
    joints, slopes = candidates.joints[rows], made.slopes
    real = made.positions(joints.reshape(-1, 3))
    if candidates.kind == "distance":
        ends = real.reshape(-1, 2, 3)
        values = 0.998 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    else:
        values = (real[:, 2] - real[:, :2] @ slopes) / np.sqrt(1.0 + slopes @ slopes)
        values -= 30.0 * (candidates.kind == "block")
    values = values + candidates.std_mm * made.rng.standard_normal(len(values))
    return replace(candidates, joints=joints, values=values)


def test_a_planned_campaign_determines_what_was_expected_of_it():
    candidates, expected = printer_candidates(["bed=30", "part=12", "block=8"])
    for number, count in enumerate((30, 12, 8), start=1):
        expected = expected.with_best(number, count, "position")
    made = Printer(4)
    observed = [
        measured_by(made, rows, expected.chosen(number))
        for number, rows in enumerate(candidates, start=1)
    ]
    result = identify(None, made.robot, observations=observed)
    stated, errors = rms_of(result.uncertainty.determined), made.errors_mm(result)
    assert rms_of(expected.determined) == pytest.approx(stated, rel=0.1)
    assert {name: errors[name] < 2.0 * stated[name] for name in errors} == dict.fromkeys(
        errors, True
    )


@pytest.mark.parametrize("count", [12, 30])
def test_fewer_heights_are_expected_to_leave_more_of_the_scatter(count):
    (heights,), empty = printer_candidates(["bed=30"])
    expected = empty.with_rows(1, np.arange(count))
    made = Printer(2)
    observed = measured_by(made, heights, expected.chosen(1))
    stated = rms_of(identify(None, made.robot, observations=[observed]).uncertainty.determined)
    assert rms_of(expected.determined)["flat"] == pytest.approx(stated["flat"], rel=0.25)
    few = next(q for q in empty.with_best(1, 7, "flat").determined if q.name == "flat")
    assert not few.is_determined  # nothing estimates the scatter: its tolerance is assumed


def test_callipers_gain_what_more_heights_do_not():
    heights = printer_outlook(["bed=30", "part=12"]).with_best(1, 30, "flat")
    assert (heights.count(1), heights.count(2)) == (30, 0)
    touches, widths = heights.gain(1, 10, "xy"), heights.gain(2, 10, "xy")
    assert (touches.name, touches.kind, widths.name) == ("bed", "height", "part")
    assert touches.share < 0.1 < 0.5 < widths.share
    assert widths.then < 0.5 * touches.then
    assert not next(q for q in heights.determined if q.name == "xy").is_determined
    both = heights.with_best(2, 12, "xy")
    assert next(q for q in both.determined if q.name == "xy").is_determined
    # how flat it is, heights say themselves
    assert both.gain(1, 10, "flat").then < both.gain(1, 10, "flat").now


def test_chosen_observations_determine_more_than_drawn_ones():
    empty = printer_outlook(["bed=30"])
    drawn = empty.with_rows(1, np.arange(20))
    chosen = empty.with_best(1, 20, "flat")
    assert chosen.count(1) == drawn.count(1) == 20
    assert chosen.std("flat") < 0.8 * drawn.std("flat")


# --- the reflector on either half of a plate ------------------------------------------------------


@pytest.fixture(scope="module")
def par4():
    robot = find_robot("par4-prototype")
    return robot, {count: plan(robot, TRACKER_MM, shots=count, seed=1).shots for count in (30, 60)}


def rotation_mrad(robot, shots, of_second):
    """Expected 1 σ of the tool's rotation, `of_second` (N,) shots being of half 2."""
    model = error_model(robot.kinematics, None, IdentificationOptions(tolerances=robot.tolerances))
    joints, poses = joints_of(shots), poses_of(shots)
    identify_rows = np.array([shot.purpose is ShotSet.IDENTIFICATION for shot in shots])
    points = points_of(model, shots).rows(identify_rows & ~of_second)
    rows = identify_rows & of_second
    half = Object("half 2", body="half 2", place_mm=(0.0, 0.0, 0.0), std_mm=5.0)
    observed = [
        Measured(kind="reflector", object=half, joints=joints[rows], std_mm=0.015,
                 values=poses[rows, :3] - TRACKER_MM)
    ] * bool(rows.any())  # fmt: skip
    expected = outlook_of(robot, other_kinds(observed, robot.kinematics, points), points)
    if observed:
        expected = expected.with_rows(1, np.arange(rows.sum()))
    return np.radians(1e3 * rms_of(expected.determined)["rotation"])


@pytest.mark.parametrize(("count", "least"), [(30, 0.55), (60, 0.55)])
def test_a_reflector_on_the_halves_in_turn_halves_the_uncertainty_of_rotation(par4, count, least):
    robot, plans = par4
    shots = plans[count]
    alone = rotation_mrad(robot, shots, np.zeros(len(shots), dtype=bool))
    dealt = in_turn(shots, ("", "half 2"))
    both = rotation_mrad(robot, dealt, np.array([bool(shot.reflector) for shot in dealt]))
    assert both < least * alone


def test_a_plan_in_turn_moves_the_reflector_once_and_deals_its_pairs_evenly(par4):
    shots = par4[1][60]
    dealt = in_turn(shots, ("", "half 2"))
    places = [shot.reflector for shot in dealt]
    assert places == sorted(places)
    for purpose in (ShotSet.IDENTIFICATION, ShotSet.VALIDATION):
        of_set = [shot for shot in dealt if shot.purpose is purpose]
        counts = [sum(shot.reflector == name for shot in of_set) for name in ("", "half 2")]
        assert abs(counts[0] - counts[1]) <= 2
        before = {(shot.pair, shot.joints) for shot in shots if shot.purpose is purpose}
        assert {(shot.pair, shot.joints) for shot in of_set} == before
    for name in ("", "half 2"):
        sets = [shot.purpose for shot in dealt if shot.reflector == name]
        assert sets[0] is sets[-1] is ShotSet.DRIFT
        assert sets.count(ShotSet.DRIFT) >= 3
    assert [shot.shot for shot in dealt] == list(range(len(dealt)))
    # the others are no points of the robot's own reflector
    assert {dealt[row].reflector for row in forecast.points_of(dealt)} == {""}
    assert in_turn(shots, ("",)) == tuple(shots)


# --- wishes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("thing", "kind"),
    [
        (Object("bed"), "height"),
        (Object("print bed"), "height"),
        (Object("part"), "distance"),
        (Object("disc", shrinkage_std_percent=0.3), "distance"),
        (Object("block", on="bed", height_mm=30.0), "block"),
        (Object("other", body="half 2"), "reflector"),
        (Object("other", body="half 2", on=Object("first", body="half 1")), "reflectors"),
        (Object("tip", body="tool", turn_deg=(0.0, 0.0, 0.0), turn_std_deg=1.0), "probe"),
        (Object("bar", length_mm=300.0), "ball-bar"),
    ],
)
def test_what_is_stated_of_an_object_decides_what_is_observed_of_it(thing, kind):
    assert kind_of(thing) == kind


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("bed", "a number from 1 to 1000 must follow"),
        ("bed=0", "a number from 1 to 1000 must follow"),
        ("bed=many", "a number from 1 to 1000 must follow"),
        ("bad=30", "bad is no object of campaign.yaml"),
        ("hight:bed=30", "hight is no kind of observation"),
        ("thing=3", "nothing says what is observed of thing"),
    ],
)
def test_unclear_wishes_are_refused(text, says):
    with pytest.raises(OptionsInvalid, match=says):
        read_wish(text, OBJECTS | {"thing": Object("thing")})


def test_a_bed_out_of_reach_has_no_poses_and_says_what_to_state():
    robot = printer()
    model = RobotModel(robot.kinematics, robot.limits, robot.workspace_centre, BED)
    cell = ObservedCell(robot=model, region=None, instrument=TrackerUncertainty())
    bed = Object("bed", place_mm=(0.0, 0.0, -5000.0))
    with pytest.raises(PlanInvalid, match="too few poses for bed") as caught:
        candidates_of(read_wish("bed=30", {"bed": bed}), cell, np.random.default_rng(1))
    assert "place_mm" in str(caught.value.remedy)
    probe = Object("probe", body="tool", turn_std_deg=1.0)
    with pytest.raises(PlanInvalid, match="a tracker, whose frame is placed by shots"):
        candidates_of(read_wish("probe=9", {"probe": probe}), cell, np.random.default_rng(1))
