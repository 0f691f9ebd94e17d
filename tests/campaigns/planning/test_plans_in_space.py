"""Plans, ways and tests in a restricted space."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, ROBOT
from hypothesis import assume, given
from hypothesis import strategies as st
from small_plans import LIMITS, OPEN, PACE, TWO_PAIRS, VIEW, joints_at

from campaigns.design.pose_sampling import BOUNDARY_STRETCH, workspace_poses
from campaigns.design.restricted_space import (
    ANYWHERE,
    UNRESTRICTED,
    Disc,
    Rectangle,
    RestrictedSpace,
    Zone,
)
from campaigns.errors import PlanInvalid
from campaigns.fit.error_model import ErrorModel
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.planning import paths
from campaigns.planning.optimal_plan import OptimalRequest, make_optimal_plan
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_check import PlanLimits, check_plan
from campaigns.planning.plans import (
    SPACE_RESERVE_MM,
    PlanRequest,
    make_plan,
    poses_of,
    region_of,
    restricted_space,
)
from campaigns.planning.validation_plan import Reachable, fitting_lines, validation_steps
from campaigns.settings.sections import ValidationConfig
from campaigns.settings.space import SpaceConfig
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

MIDDLE = Pose(*CENTRE.tolist())
CONFIG = SpaceConfig.model_validate_json(
    """{"z_lowest_mm": -720.0, "z_highest_mm": -420.0, "radius_mm": 500.0, "margin_mm": 10.0,
    "keep_out": {"boxes": [{"name": "conveyor", "x_mm": [-400.0, -150.0], "y_mm": [150.0, 400.0]}],
    "cylinders": [{"centre_mm": [180.0, -260.0], "radius_mm": 20.0}]}}"""
)
SPACE = restricted_space(CONFIG, 100.0)
PILLAR = Zone("pillar", Disc((0.0, 150.0), 10.0), ANYWHERE, keeps_in=False)
SHEET = Zone("sheet", Rectangle((99.5, 100.5), (-150.0, 400.0)), ANYWHERE, keeps_in=False)
FENCED = RobotModel(NOMINAL, LIMITS, CENTRE, RestrictedSpace((PILLAR, SHEET), 30.0, 5.0))
FINE = 3200


def least_mm(space, here, there):
    """Least clearance by many samples: on the joints' way, and on its straight parts."""
    joints = here + np.linspace(0.0, 1.0, FINE + 1)[:, None] * (there - here)
    points = NOMINAL.forward(joints).values_or_raise()[:, :3]
    along = np.linspace(0.0, 1.0, FINE)[:, None]
    least = space.clearance_mm(points).min()
    for parts in (1, 2, 4, 8, 16):
        for a, b in pairwise(points[:: FINE // parts]):
            straight = a + along[::parts] * (b - a)
            least = min(least, space.clearance_mm(straight).min())
    return least


@pytest.fixture(scope="module")
def plan():
    request = PlanRequest(60, 10, 3, MIDDLE, SPACE)
    return make_plan(ROBOT, VIEW, request, np.random.default_rng(2))


@pytest.mark.slow
def test_poses_keep_off_all_walls_and_identification_poses_lie_near_them(plan):
    assert SPACE.clearance_mm(poses_of(plan)[:, :3]).min() >= SPACE_RESERVE_MM - 1e-6
    poses = np.array([(*s.pose.coordinates,) for s in plan if s.purpose is ShotSet.IDENTIFICATION])
    region = region_of(ROBOT, VIEW, MIDDLE, SPACE)
    assert region.allows(poses).all()
    assert not region.allows(CENTRE + BOUNDARY_STRETCH * (poses - CENTRE)).any()
    open_region = replace(region, space=UNRESTRICTED)
    held_by_space = open_region.allows(CENTRE + BOUNDARY_STRETCH * (poses - CENTRE))
    assert held_by_space.mean() > 0.5, "most are near a zone's wall, not near the reach's"


def test_poses_and_ways_of_a_plan_that_the_space_forbids_are_named():
    low = restricted_space(SpaceConfig(z_lowest_mm=-640.0), 100.0)
    with pytest.raises(PlanInvalid, match=r"shot 3: z -650 mm is below space.z_lowest_mm -640"):
        check_plan(TWO_PAIRS, PlanLimits(RobotModel(NOMINAL, LIMITS, CENTRE, low), VIEW, PACE))
    boxes = {"keep_out": {"boxes": ({"x_mm": (15.0, 16.0)},)}}
    wall = restricted_space(SpaceConfig.model_validate(boxes), 10.0)
    with pytest.raises(PlanInvalid, match=r"no safe way from shot 0 .*space.keep_out.boxes\[0\]"):
        check_plan(TWO_PAIRS, PlanLimits(RobotModel(NOMINAL, LIMITS, CENTRE, wall), VIEW, PACE))


@pytest.mark.slow
@given(st.integers(0, 10_000))
def test_a_way_that_counts_as_clear_is_clear_between_all_samples(seed):
    rng = np.random.default_rng(seed)
    poses = CENTRE + rng.uniform(-1.0, 1.0, (2, 4)) * (220.0, 220.0, 120.0, 0.3)
    here, there = NOMINAL.inverse(poses).values_or_raise()
    assume(FENCED.space.allows(poses[:, :3]).all())  # one in a wall may leave it
    fault = FENCED.fault(here, there)
    least = least_mm(FENCED.space, here, there)
    if fault is None:
        assert least > -0.02
    else:
        assert "would pass" in fault[0] or OPEN.fault(here, there)
    if least < -0.02:
        assert fault is not None


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("parts", [0, 1, 16])
def test_a_needle_that_no_sample_meets_is_found_wherever_a_controller_may_pass(parts):
    """On the joints' coordinated way (0 parts) or on so many straight parts of it."""
    rng = np.random.default_rng(parts)
    missed = 0
    for _ in range(10):
        poses = CENTRE + rng.uniform(0.5, 1.0, 4) * np.array(
            [[-230, -150, 70, 0], [230, 150, -70, 0]]
        )
        here, there = NOMINAL.inverse(poses).values_or_raise()
        part = rng.uniform(0.02, 0.98)
        corners = np.array([part, part])
        if parts:
            corners = (np.floor(part * parts) + np.array([0.0, 1.0])) / parts
        ends = NOMINAL.forward(here + corners[:, None] * (there - here)).values_or_raise()[:, :3]
        point = ends[0] + (part * parts - np.floor(part * parts)) * (ends[1] - ends[0])
        needle = Disc((point[0], point[1]), 0.03)
        height = (point[2] - 0.03, point[2] + 0.03)
        space = RestrictedSpace((Zone("needle", needle, height, keeps_in=False),))
        fault = RobotModel(NOMINAL, LIMITS, CENTRE, space).fault(here, there)
        missed += fault is None or "needle" not in fault[0]
    assert missed == 0


def test_a_pillar_between_two_poses_is_passed_by_way_of_the_centre():
    here, there = joints_at(-120, 170, -600, 0), joints_at(60, 180, -600, 0)
    fault = FENCED.fault(here, there)
    assert "beyond the wall of pillar" in fault[0]
    way = [here, *FENCED.legs(here, there)]
    assert len(way) > 2
    assert min(least_mm(FENCED.space, a, b) for a, b in pairwise(way)) > -0.02
    assert (way[-1] == there).all()


def test_a_pose_behind_a_sheet_is_planned_by_none_and_has_no_way_to_it():
    region = region_of(ROBOT, VIEW, MIDDLE, FENCED.space)
    poses = np.array([[40.0, 0.0, -600.0, 0.0], [160.0, 0.0, -600.0, 0.0]])
    assert FENCED.space.allows(poses[:, :3]).all()
    assert region.allows(poses).tolist() == [True, False]
    assert FENCED.legs(*(joints_at(*pose) for pose in poses)) is None


def test_a_way_leads_out_of_a_forbidden_place_and_none_into_it():
    inside, there = joints_at(0, 150, -600, 0), joints_at(0, -50, -600, 0)
    assert FENCED.legs(inside, there) is not None
    assert FENCED.legs(there, inside) is None
    told = FENCED.standing_fault(tuple(inside))
    assert told.startswith("the plate (radius 30 mm and margin 5 mm) is")
    assert "too near pillar" in told
    assert FENCED.standing_fault(tuple(there)) == ""


def test_a_robot_beyond_a_wall_may_go_no_further():
    edge_mm = 150.0 - 10.0 - 35.0
    away, beyond = joints_at(0, -50, -600, 0), joints_at(0, edge_mm + 2.0, -600, 0)
    further = joints_at(0, edge_mm + 3.0, -600, 0)
    assert FENCED.fault(beyond, away) is None
    assert FENCED.fault(further, beyond) is None
    assert FENCED.fault(beyond, further) is not None
    assert FENCED.legs(away, beyond) is None


def test_moves_in_a_space_are_judged_together_as_one_by_one(monkeypatch):
    rng = np.random.default_rng(7)
    poses = CENTRE + rng.uniform(-1.0, 1.0, (12, 4)) * (220.0, 220.0, 120.0, 0.3)
    poses[::3] = poses[1::3] + 0.1 * (poses[::3] - poses[1::3])  # short moves beside long ones
    stops = NOMINAL.inverse(poses).values_or_raise()
    one_by_one = [FENCED.fault(here, there) for here, there in pairwise(stops)]
    monkeypatch.setattr(paths, "POINTS_AT_ONCE", 200)
    monkeypatch.setattr(paths, "MOVES_AT_ONCE", 3)
    clear = [fault is None for fault in one_by_one]
    assert FENCED.are_safe(np.stack([stops[:-1], stops[1:]])).tolist() == clear
    assert 2 < sum(clear) < 9
    ways = np.stack([stops[:-2], stops[1:-1], stops[2:]])
    assert FENCED.are_safe(ways).tolist() == [all(both) for both in pairwise(clear)]


def test_lines_that_fit_the_robot_fit_its_space_too():
    lengths = ValidationConfig().line_lengths_mm
    narrow = restricted_space(SpaceConfig(radius_mm=300.0), 100.0)
    x_mm, y_mm, z_mm = fitting_lines(NOMINAL, LIMITS, CENTRE, lengths, narrow)
    assert (x_mm, y_mm) == (360.0, 360.0), "nine tenths of 200 mm each way"
    assert z_mm == fitting_lines(NOMINAL, LIMITS, CENTRE, lengths)[2]


def test_a_line_to_validate_on_is_shortened_or_refused_by_the_zone():
    config = ValidationConfig(line_lengths_mm=(300.0, 300.0, 150.0), line_points=3)
    only = frozenset({ShotSet.STRAIGHTNESS})

    def steps(space):
        robot = Reachable(NOMINAL, LIMITS, space=space)
        return validation_steps(config, (), robot, only, np.random.default_rng(1))

    near = restricted_space(SpaceConfig(radius_mm=240.0), 100.0)
    (note, _) = steps(near)[1]
    assert "line along x shortened from 300 to" in note
    assert "space.radius_mm 240" in note
    # a sheet between two of the points
    sheet = Zone("sheet", Rectangle((70.0, 71.0)), ANYWHERE, keeps_in=False)
    with pytest.raises(
        PlanInvalid, match=r"line along x of 300 mm cannot be done.*it crosses sheet"
    ):
        steps(RestrictedSpace((sheet,)))


def test_repeatability_and_pairs_keep_to_the_space():
    def above(z_lowest_mm):
        space = restricted_space(SpaceConfig(z_lowest_mm=z_lowest_mm), 0.0)
        return Reachable(NOMINAL, LIMITS, space=space)

    robot, rng, only = above(-640.0), np.random.default_rng(1), frozenset({ShotSet.REPEATABILITY})
    with pytest.raises(PlanInvalid, match=r"repeatability cannot be done.*space.z_lowest_mm -576"):
        validation_steps(ValidationConfig(), (), above(-576.0), only, rng)
    assert "40 mm away, not 80" in validation_steps(ValidationConfig(), (), robot, only, rng)[1][0]
    pairs = [replace(s, purpose=ShotSet.VALIDATION) for s in TWO_PAIRS if s.pair is not None]
    found = validation_steps(ValidationConfig(), pairs, robot, frozenset({ShotSet.VALIDATION}), rng)
    assert [step.planned.pair for step in found[0]] == [0, 0]
    assert "validation pair 1 left out: z -650 mm is below" in found[1][0]


@pytest.mark.slow
@pytest.mark.long
def test_optimal_poses_keep_to_the_space_and_are_judged_by_what_it_leaves():
    request = OptimalRequest(
        plan=PlanRequest(32, 4, 3, MIDDLE, SPACE),
        uncertainty=TrackerUncertainty(),
        model=ErrorModel(NOMINAL),
    )
    made = make_optimal_plan(ROBOT, VIEW, request, np.random.default_rng(5))
    check_plan(made, PlanLimits(RobotModel(NOMINAL, LIMITS, CENTRE, SPACE), VIEW, PACE))
    judged = workspace_poses(NOMINAL, LIMITS, CENTRE, 300, np.random.default_rng(5), SPACE)
    assert SPACE.allows(judged[:, :3]).all()
