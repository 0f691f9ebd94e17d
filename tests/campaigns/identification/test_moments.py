"""Time, session and wrong rows of other kinds: slips, stations, mistyped widths, and what tests."""

import re
from dataclasses import replace

import numpy as np
import pytest
from printers import BED_MM, Printer, rings
from rod_campaigns import TRACKER_FROM_BASE

from campaigns.api import find_robot, identify, sample_workspace
from campaigns.errors import OptionsInvalid, ShotsInvalid
from campaigns.fit.rigid_transforms import Transform
from campaigns.identification.identify import fit_campaign
from campaigns.identification.objects import Object
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.other_kinds import Measured
from campaigns.shots.shots import Shots

SLIP_MM = 0.3
KNOWN = (0.002, 1e-4)
HALF = "distances of part left out as wrong: 6, 7, 8, 9, 10, 11 (from 0), 50 %"


def identified(made, observations, *quantities, shots=None, **options):
    options |= {"quantities": quantities or ("flat",)}
    return identify(shots, made.robot, observations=observations, options=options)


def says(result, name):
    return [f.says for f in result.judgement.findings if f.name == name]


def touches(made, slip_mm=SLIP_MM, since=20):
    """Heights in a drawn order, one in 10 s; carriage 1 slips before number `since`."""
    rows = [made.heights(rings(BED_MM, 6)), made.heights(rings(75.0, 2), held_out=True)]
    order = np.random.default_rng(1).permutation(len(rows[0].values))
    joints, after = rows[0].joints[order], rows[1].joints.copy()
    joints[since:, 1] += slip_mm
    after[:, 1] += slip_mm
    return [
        replace(rows[0], joints=joints, values=rows[0].values[order], moment=10.0 * np.arange(37)),
        replace(rows[1], joints=after, moment=1000.0 + np.arange(13)),
    ]


def slipped(shots, since):
    """Points in the order of their numbers, one in 10 s, before the heights' clock begins at 0."""
    joints = shots.joints.copy()
    joints[since:, 1] += SLIP_MM
    times = tuple(f"{10.0 * row - 10.0 * len(shots):.1f}" for row in range(len(shots)))
    return replace(shots, joints=joints, measured_utc=times)


# --- changes in time ------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "slip_mm"), [(1, SLIP_MM), (2, 1.0)])
def test_heights_alone_find_a_motor_that_slips_half_way(seed, slip_mm):
    made = Printer(seed)
    result = identified(made, touches(made, slip_mm))
    (change,) = says(result, "change")
    assert "arm 1's encoder" in change
    assert "changed before number 20 of the heights of bed" in change
    assert result.judgement.verdict == "fail"
    assert says(result, "wrong-observations") == []


def test_heights_without_a_slip_show_no_change():
    made = Printer(1)
    result = identified(made, touches(made, 0.0))
    assert (result.judgement.verdict, says(result, "change")) == ("pass", [])


def test_a_slip_that_points_find_explains_heights_too():
    """Heights come behind all points: no height is wrong, and the robot of today has the slip."""
    made = Printer(3)
    shots = slipped(made.points(24, pairs=6), 15)
    heights = [replace(rows, moment=rows.moment + 10.0) for rows in touches(made, since=0)]
    for rows in (heights, [replace(row, moment=None) for row in heights]):
        result = identified(made, rows, shots=shots)
        (event,) = (e for e in result.judgement.events if e.kind == "change")
        assert (event.first, event.parts[0]) == (shots.numbers[15], "encoder 1")
        assert says(result, "wrong-observations") == []
        assert "unseen-observations" not in result.judgement.obstacles


def test_a_slip_among_heights_behind_all_points_is_one_of_the_heights():
    made = Printer(3)
    shots = slipped(made.points(40), 60)
    result = identified(made, touches(made), shots=shots)
    assert [e for e in result.judgement.events if e.kind == "change"] == []
    (change,) = says(result, "change")
    # a touch far from the carriage hardly shows it
    assert re.search(
        "arm 1's encoder.* changed before number (19|20|21) of the heights of bed", change
    )


def test_observations_with_times_need_shots_with_times():
    made = Printer(3)
    with pytest.raises(ShotsInvalid, match="have times, which shots lack"):
        identified(made, touches(made), shots=made.points(20))
    short = replace(touches(made)[0], moment=np.zeros(3))
    with pytest.raises(ShotsInvalid, match="3 moments of 37 observations"):
        identified(made, [short])


def test_heights_have_the_warmth_of_their_moment():
    """Parts warm up by 20 °C over the points; heights follow the last one, in the heat."""
    made = Printer(4)
    shots = slipped(made.points(40), 60)
    warm = replace(shots, part_temperature_degC=np.linspace(20.0, 40.0, len(shots)))
    heights, held_out = touches(made, 0.0)
    rows = [replace(heights, moment=heights.moment - 300.0), replace(held_out, moment=None)]
    campaign = fit_campaign(made.robot.kinematics, warm, IdentificationOptions(), measured=rows)
    (block,), (unseen,) = campaign.kinds.fitted, campaign.kinds.held_out
    order = np.argsort(np.concatenate([campaign.observations.moment, block.moment]))
    assert order.tolist() != sorted(order.tolist())
    # from 300 s before the first clock's 0: between shots 30 and 31 of 60, by their temperatures
    expected = np.interp(
        heights.moment - 300.0, 10.0 * np.arange(60) - 600.0, np.linspace(0, 20, 60)
    )
    assert block.warmth == pytest.approx(expected)
    assert (unseen.warmth.any(), np.isinf(unseen.moment).all()) == (False, True)
    growth = [row for row, group in enumerate(campaign.fit.model.groups) if group == "growth"]
    assert campaign.fit.at.others[0].jacobian[..., growth].any()


# --- wrong rows -----------------------------------------------------------------------------------


def test_a_wrong_touch_is_left_out_by_its_number():
    made = Printer(5)
    heights, held_out = touches(made, 0.0)
    heights.values[7] += 1.0
    for moment in (heights.moment, None):
        result = identified(made, [replace(heights, moment=moment), held_out])
        assert says(result, "wrong-observations") == [
            "heights of bed left out as wrong: 7 (from 0)"
        ]
        assert result.judgement.verdict == "pass"


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("with_points", [False, True])
def test_half_of_the_widths_mistyped_are_named_and_pass_nothing(seed, with_points):
    """The outer six of twelve, as in a list that somebody published."""
    made = Printer(seed)
    outer = tuple(range(6, 12))
    widths = made.widths(65.0, shrinkage=KNOWN, wrong=outer)
    rows = [*touches(made, 0.0), widths, made.widths(50.0, shrinkage=KNOWN, held_out=True)]
    shots = slipped(made.points(40), 60) if with_points else None
    result = identified(made, rows, "flat", "xy", shots=shots)
    (wrong,) = says(result, "wrong-observations")
    assert wrong.startswith(HALF)
    assert result.judgement.verdict == "not decided"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_half_of_the_widths_mistyped_are_named_without_anything_else(seed):
    made = Printer(seed)
    widths = made.widths(65.0, shrinkage=(0.002, 0.003), wrong=tuple(range(6, 12)))
    result = identified(made, [widths], "position")
    (wrong,) = says(result, "wrong-observations")
    assert wrong.startswith(HALF)
    assert (result.judgement.verdict, says(result, "scatter")) == ("not decided", [])


# --- held-out rows --------------------------------------------------------------------------------


def test_what_is_held_out_on_a_plane_of_its_own_tests_nothing():
    made = Printer(6)
    heights, held_out = touches(made, 0.0)
    elsewhere = replace(held_out, object=Object("bed 2"))
    result = identified(made, [heights, elsewhere])
    assert says(result, "not-tested")[0].startswith("not tested: 13 heights of bed 2 were held out")
    assert result.judgement.verdict == "not decided"
    assert not any(quantity.is_tested for quantity in result.uncertainty.determined)
    both = identified(made, [heights, held_out, elsewhere])
    assert both.judgement.obstacles == ("not-tested",)


@pytest.mark.parametrize("with_points", [False, True])
def test_held_out_heights_that_contradict_widen_what_they_check(with_points):
    made = Printer(6)
    heights, held_out = touches(made, 0.0)
    shots = slipped(made.points(40), 60) if with_points else None
    bump = replace(held_out, values=held_out.values + 2.0 * (np.arange(13) < 4))
    good, bad = (identified(made, [heights, rows], shots=shots) for rows in (held_out, bump))
    obstacles = [*bad.judgement.obstacles]
    assert obstacles.pop(obstacles.index("unseen-observations"))
    assert tuple(obstacles) == good.judgement.obstacles
    assert "σ of flat is multiplied by" in says(bad, "unseen-observations")[0]
    of_good, of_bad = ({q.name: q.rms for q in r.uncertainty.determined} for r in (good, bad))
    assert of_bad["flat"] > 20.0 * of_good["flat"]
    assert of_bad["xy"] == pytest.approx(of_good["xy"])


# --- frames ---------------------------------------------------------------------------------------

PLACE_MM = np.array([30.0, -10.0, -25.0])
STATIONS = (
    TRACKER_FROM_BASE,
    Transform(TRACKER_FROM_BASE.rotation.T, np.array([-1800.0, 900.0, 250.0])),
)


@pytest.fixture(scope="module")
def delta():
    """Points of a Delta from two stations, and its reflector at a place of its own from both."""
    robot, rng = find_robot("delta"), np.random.default_rng(3)
    poses = sample_workspace(robot, 100, seed=3)
    offsets_rad = 0.003 * rng.standard_normal(3)
    joints = robot.kinematics.inverse(poses).values_or_raise() + offsets_rad
    session = 1 + np.arange(100) % 2
    frames = [STATIONS[number - 1] for number in session]

    def seen(place):
        points = [
            frame.apply(pose[None, :3] + place)[0]
            for frame, pose in zip(frames, poses, strict=True)
        ]
        return np.array(points) + 0.01 * rng.standard_normal((100, 3))

    shots = Shots.of(
        joints[:60], seen(np.zeros(3))[:60], robot,
        sets=["identification"] * 40 + ["validation"] * 20,
        pairs=[n // 2 for n in range(40)] + [n // 4 * 2 + n % 2 for n in range(20)],
        covariance_mm2=1e-4 * np.eye(3),
    )  # fmt: skip
    holder = Object("holder", place_mm=tuple(PLACE_MM), std_mm=0.02)
    rows = [
        Measured(
            kind="reflector", object=holder, joints=joints[part], values=seen(PLACE_MM)[part],
            std_mm=0.01, held_out=held_out, session=session[part],
        )
        for part, held_out in ((slice(60, 90), False), (slice(90, 100), True))
    ]  # fmt: skip
    return robot, replace(shots, session=session[:60]), rows


def test_reflectors_are_fitted_in_the_frame_of_their_session(delta):
    robot, shots, rows = delta
    result = identify(shots, robot, observations=rows, options={"sessions": True})
    assert says(result, "wrong-observations") == []
    assert result.judgement.verdict == "pass"
    assert len(result.value.sessions) == 2
    for station, of_session in zip(STATIONS, result.value.sessions, strict=True):
        place = [of_session.frame.x_mm, of_session.frame.y_mm, of_session.frame.z_mm]
        assert place == pytest.approx(station.translation_mm, abs=2.0)
    # one frame for both stations fits neither
    with pytest.raises(ShotsInvalid):
        identify(shots, robot, observations=rows)


def test_a_session_may_have_reflectors_alone(delta):
    robot, shots, rows = delta
    first = shots.rows(np.flatnonzero(shots.session == 1))
    result = identify(first, robot, observations=rows, options={"sessions": True})
    assert result.judgement.verdict in {"pass", "not decided"}
    assert says(result, "wrong-observations") == []
    (unseen,) = says(result, "unseen-observations")
    assert "reflectors of holder" in unseen
    assert "unseen-observations" not in result.judgement.obstacles


def test_a_session_that_nothing_places_is_refused(delta):
    robot, shots, rows = delta
    away = replace(rows[1], session=np.full(10, 7))
    with pytest.raises(
        ShotsInvalid, match="nothing fitted places the tracker's frame of session 7"
    ):
        identify(shots, robot, observations=[rows[0], away], options={"sessions": True})
    unstated = [replace(row, session=None) for row in rows]
    with pytest.raises(OptionsInvalid, match="do not state their session"):
        identify(shots, robot, observations=unstated, options={"sessions": True})


def test_reflectors_alone_place_the_frames_of_both_stations(delta):
    robot, _, rows = delta
    result = identify(None, robot, observations=rows, options={"sessions": True})
    (position,) = (q for q in result.uncertainty.determined if q.name == "position")
    assert (position.is_tested, position.is_determined) == (True, True)
    assert result.judgement.verdict == "pass"
    assert result.value.frame.x_mm == pytest.approx(STATIONS[0].translation_mm[0], abs=2.0)
    assert {"constant", "scale"} <= {*result.value.tracker}
