"""Heights, distances and probes, alone and beside points; the truth is that of rods."""

import re
from dataclasses import replace

import numpy as np
import pytest
from printers import AS_BUILT, BED_MM, Printer, printer, rings
from rod_campaigns import TRACKER_FROM_BASE
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from campaigns.api import find_robot, identify, sample_workspace
from campaigns.errors import OptionsInvalid, ShotsInvalid, ShotsMissing
from campaigns.identification.objects import Object
from campaigns.identification.other_kinds import Measured
from campaigns.shots.shots import Shots

KNOWN = (0.002, 1e-4)


def identified(made, observations, *quantities, shots=None):
    options = {"quantities": quantities or ("position",)}
    return identify(shots, made.robot, observations=observations, options=options)


def quantities_of(result):
    return {quantity.name: quantity for quantity in result.uncertainty.determined}


def touches(made, rows=6):
    return [made.heights(rings(BED_MM, rows)), made.heights(rings(75.0, 2), held_out=True)]


def with_callipers(made, **options):
    widths = made.widths(65.0, shrinkage=KNOWN, **options)
    return [*touches(made), widths, made.widths(50.0, shrinkage=KNOWN, held_out=True)]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_heights_determine_how_flat_a_printer_is_and_no_position(seed):
    made = Printer(seed)
    rows = touches(made)
    result = identified(made, rows)
    assert result.judgement.verdict == "not decided"
    assert {"not-determined", "nothing-unseen"} <= {*result.judgement.obstacles}
    found, real = quantities_of(result), made.errors_mm(result)
    assert (found["flat"].is_determined, found["flat"].is_tested) == (True, True)
    assert (found["xy"].is_determined, found["xy"].is_tested) == (False, False)
    assert not found["position"].is_determined
    assert {name: real[name] < 2.0 * found[name].rms for name in real} == dict.fromkeys(real, True)
    assert found["flat"].rms < 0.02
    # what they determine may be passed by itself
    assert identified(made, rows, "flat").judgement.verdict == "pass"
    assert identified(made, rows, "flat,xy").judgement.verdict == "not decided"


def test_what_nothing_held_out_checks_is_not_passed():
    made = Printer(4)
    heights, _, widths, _ = with_callipers(made)
    assert identified(made, [heights], "flat").judgement.obstacles == ("not-tested",)
    assert identified(made, [heights, widths], "xy").judgement.obstacles == ("not-tested",)


def test_seven_heights_pass_nothing_in_space():
    made = Printer(4)
    result = identified(made, touches(made, 1))
    assert result.judgement.verdict == "not decided"
    assert quantities_of(result)["position"].assumed > 0.5
    # of the robot's scatter they say nothing either, which is most of what is stated
    determined = {name: q.is_determined for name, q in quantities_of(result).items()}
    assert determined == {"flat": False, "xy": False, "position": False}


@pytest.mark.parametrize("seed", [1, 2])
def test_callipers_determine_places_on_the_bed(seed):
    made = Printer(seed)
    rows = with_callipers(made)
    result = identified(made, rows, "flat", "xy")
    found, real = quantities_of(result), made.errors_mm(result)
    assert result.judgement.verdict == "pass"
    assert (found["xy"].is_determined, found["xy"].is_tested) == (True, True)
    assert {name: real[name] < 2.0 * found[name].rms for name in real} == dict.fromkeys(real, True)
    assert found["xy"].rms < 0.5 * quantities_of(identified(made, rows[:2]))["xy"].rms
    # nothing that was held out shows where the nozzle is in space
    assert identified(made, rows).judgement.obstacles[-1] == "nothing-unseen"


def test_mistyped_widths_are_left_out_and_named():
    made = Printer(5)
    result = identified(made, with_callipers(made, wrong=(3,)), "flat", "xy")
    says = [f.says for f in result.judgement.findings if f.name == "wrong-observations"]
    assert says == ["distances of part left out as wrong: 3 (from 0)"]
    assert result.judgement.verdict == "pass"
    result = identified(made, with_callipers(made, wrong=(3, 7)), "flat", "xy")
    assert result.judgement.obstacles == ("wrong-observations",)
    assert "left out as wrong: 3, 7 (from 0), 17 % of them" in result.judgement.reasons[0]
    assert made.errors_mm(result)["xy"] < 2.0 * quantities_of(result)["xy"].rms


def test_held_out_heights_that_contradict_the_result_decide_nothing():
    """A bump of 2 mm in the bed where nothing was fitted."""
    made = Printer(6)
    fitted, held_out = touches(made)
    bump = replace(held_out, values=held_out.values + 2.0 * (np.arange(13) < 4))
    result = identified(made, [fitted, bump], "flat")
    assert result.judgement.obstacles == ("unseen-observations",)


def test_held_out_heights_of_a_leaning_printer_are_stated_as_narrow_as_others():
    """Rails 8 mrad off upright: no tilt of bed and base widens what heights are stated to."""
    made = Printer(2, replace(AS_BUILT, azimuths_mrad=8.0))
    result = identified(made, touches(made), "flat")
    (says,) = (f.says for f in result.judgement.findings if f.name == "unseen-observations")
    assert float(re.search(r"stated ([\d.]+) mm", says)[1]) < 0.02


def test_held_out_heights_of_a_good_printer_contradict_nothing():
    """Bed and base move together by what sizes may be: the mean over them misses no plane."""
    made = Printer(5)
    result = identified(made, touches(made), "flat")
    assert result.judgement.verdict == "pass"


def test_heights_beside_points_narrow_positions():
    made = Printer(7)
    shots, heights = made.points(40), touches(made)
    alone = identified(made, [], shots=shots)
    both = identified(made, heights, "position,flat,xy", shots=shots)
    found, real = quantities_of(both), made.errors_mm(both)
    assert [found[name].is_tested for name in ("position", "flat", "xy")] == [True] * 3
    assert found["position"].rms < quantities_of(alone)["position"].rms
    assert {name: real[name] < 2.0 * found[name].rms for name in real} == dict.fromkeys(real, True)
    shares = {share.source: share.mm for share in both.uncertainty.budget}
    assert sum(mm**2 for mm in shares.values()) ** 0.5 == pytest.approx(found["position"].rms)
    assert shares["surroundings"] < 0.01


def test_the_papers_method_refuses_other_kinds():
    made = Printer(8)
    with pytest.raises(OptionsInvalid, match="observations of other kinds are not fitted"):
        identify(
            made.points(20), made.robot, observations=touches(made), options={"model": "paper"}
        )


def test_each_height_may_have_its_own_uncertainty():
    made = Printer(5)
    fitted, held_out = touches(made)
    coarse = np.arange(len(fitted.values)) % 2 == 1
    values = fitted.values + 0.1 * coarse * made.rng.standard_normal(len(coarse))
    std_mm = np.where(coarse, 0.1, 0.01)[:, None]
    alike, apart = (
        identified(made, [replace(fitted, values=values, std_mm=std), held_out])
        for std in (0.1, std_mm)
    )
    flat = quantities_of(apart)["flat"]
    assert flat.rms < 0.5 * quantities_of(alike)["flat"].rms
    assert made.errors_mm(apart)["flat"] < 2.0 * flat.rms


def test_a_result_without_points_is_shown_and_stored():
    result = identified(Printer(9), touches(Printer(9)), "flat")
    assert "verdict: pass" in result.report()
    document = result.document()
    assert [row["name"] for row in document["determined"]] == ["flat", "xy", "position"]
    assert (document["frame"], document["residuals_mm"]) == (None, None)


def test_a_quantity_on_a_plane_needs_a_plane():
    made = Printer(8)
    result = identified(made, [], "position,flat", shots=made.points(40))
    assert "not-determined" in result.judgement.obstacles


# --- a probe on a hexapod -------------------------------------------------------------------------

PLACE_MM, TURN = np.array([10.0, 5.0, -20.0]), Rotation.from_rotvec([0.3, -0.2, 0.5])


class Legs:
    """Hexapod by its legs' lengths alone, solved by scipy."""

    def __init__(self, robot, seed):
        rng = np.random.default_rng(seed)
        named = robot.parameters
        arms = [f"arm{arm}" for arm in range(6)]
        self.base, self.plate = (
            np.array([[named[f"{arm}.{stem}{axis}_mm"] for axis in "xyz"] for arm in arms])
            + rng.normal(0.0, 0.1, (6, 3))
            for stem in ("", "plate_")
        )
        self.beyond_mm = np.array([named[f"{arm}.joint_offset_mm"] for arm in arms])
        self.beyond_mm = self.beyond_mm + rng.normal(0.0, 0.2, 6)

    def poses(self, joints, near):
        def misfit(pose, lengths):
            ends = pose[:3] + Rotation.from_rotvec(pose[3:]).apply(self.plate)
            return np.linalg.norm(ends - self.base, axis=1) - lengths

        lengths = joints + self.beyond_mm
        return np.array(
            [fsolve(misfit, at, (row,), xtol=1e-13) for at, row in zip(near, lengths, strict=True)]
        )


@pytest.fixture(scope="module")
def hexapod():
    """Ten pairs of points as shots, forty poses of a probe, twelve of them held out."""
    robot, rng = find_robot("hexapod"), np.random.default_rng(5)
    legs = Legs(robot, 3)
    near = sample_workspace(robot, 80, seed=4)
    joints = robot.kinematics.inverse(near).values_or_raise()
    real = legs.poses(joints, near)
    seen = TRACKER_FROM_BASE.apply(real[:, :3])
    shots = Shots.of(
        joints[:28], seen[:28] + 0.01 * rng.standard_normal((28, 3)), robot,
        sets=["identification"] * 20 + ["validation"] * 8,
        pairs=[n // 2 for n in range(20)] + [n // 2 for n in range(8)],
        covariance_mm2=1e-4 * np.eye(3),
    )  # fmt: skip
    axes = Rotation.from_rotvec(real[:, 3:])
    place = TRACKER_FROM_BASE.apply(real[:, :3] + axes.apply(PLACE_MM))
    noise = Rotation.from_rotvec(1e-4 * rng.standard_normal((80, 3)))
    turn = (noise * Rotation.from_matrix(TRACKER_FROM_BASE.rotation) * axes * TURN).as_rotvec()
    values = np.hstack([place + 0.01 * rng.standard_normal((80, 3)), turn])
    thing = Object("probe", place_mm=tuple(PLACE_MM + 1.0), std_mm=2.0)
    probe = [
        Measured(
            kind="probe", object=thing, joints=joints[rows], values=values[rows], std_mm=0.01,
            held_out=held_out,
        )
        for rows, held_out in ((slice(28, 68), False), (slice(68, 80), True))
    ]  # fmt: skip
    return robot, legs, shots, probe


def test_a_probe_determines_and_tests_the_rotation(hexapod):
    robot, legs, shots, probe = hexapod
    asked = {"quantities": ("position,rotation",)}
    alone = identify(shots, robot, options=asked)
    result = identify(shots, robot, observations=probe, options=asked)
    rotation = quantities_of(result)["rotation"]
    assert (rotation.is_determined, rotation.is_tested) == (True, True)
    assert rotation.rms < 0.5 * quantities_of(alone)["rotation"].rms
    assert (result.judgement.verdict, alone.judgement.verdict) == ("pass", "not decided")
    # real turns, less those of the base's and the tool's own axes
    near = sample_workspace(robot, 60, seed=9)
    joints = robot.kinematics.inverse(near).values_or_raise()
    found = robot.kinematics.of(robot.mechanism, result.value.flat())
    turned, real = (
        Rotation.from_rotvec(poses[:, 3:])
        for poses in (found.forward(joints, near).values_or_raise(), legs.poses(joints, near))
    )
    errors = (turned * real.inv()).as_rotvec()
    motions = np.concatenate([np.tile(np.eye(3), (60, 1, 1)), real.as_matrix()], axis=2)
    columns = motions.reshape(-1, 6)
    left = errors.ravel() - columns @ np.linalg.lstsq(columns, errors.ravel(), rcond=None)[0]
    rms = np.degrees(np.sqrt((left**2).sum() / 60))
    assert rms < 2.0 * rotation.rms


def test_a_probe_alone_places_its_frame(hexapod):
    """Without points: where it sits on the platform is stated, by which the frame is found."""
    robot, _, _, probe = hexapod
    turn_deg = tuple(np.degrees(TURN.as_rotvec()))
    at_tip = replace(
        probe[0].object, place_mm=tuple(PLACE_MM), std_mm=0.05, turn_deg=turn_deg, turn_std_deg=0.02
    )
    asked = {"quantities": ("position,rotation",)}
    measured = [replace(rows, object=at_tip) for rows in probe]
    result = identify(None, robot, observations=measured, options=asked)
    assert result.judgement.verdict == "pass"
    place = [result.value.frame.x_mm, result.value.frame.y_mm, result.value.frame.z_mm]
    assert place == pytest.approx(TRACKER_FROM_BASE.translation_mm, abs=0.5)
    # a place of which nothing is known moves the controlled point itself
    anywhere = replace(at_tip, place_mm=None, std_mm=None, turn_deg=None, turn_std_deg=None)
    measured = [replace(rows, object=anywhere) for rows in probe]
    result = identify(None, robot, observations=measured, options=asked)
    assert result.judgement.obstacles == ("not-determined",)
    assert quantities_of(result)["rotation"].is_tested


def test_a_fit_that_leads_nowhere_decides_nothing():
    made = Printer(6)
    heights, widths = made.heights(rings(BED_MM, 3)), made.widths(60.0)
    result = identified(made, [heights, replace(widths, values=np.zeros(12))])
    assert result.judgement.verdict != "pass"
    assert result.uncertainty.position_std_mm is None
    assert "not-determined" in {finding.name for finding in result.judgement.findings}


# --- what is refused ------------------------------------------------------------------------------

PLACES = np.zeros((8, 3))
BEYOND = np.tile([1e5, 0.0, 0.0], (8, 1))
BED = {"kind": "height", "object": Object("bed"), "std_mm": 0.01}


def bed(count, **changed):
    joints = np.tile(printer().kinematics.inverse([[0.0, 0.0, 0.0]]).values, (count, 1))
    return Measured(**{**BED, "joints": joints, "values": np.zeros(count), **changed})


@pytest.mark.parametrize(
    ("rows", "error", "says"),
    [
        ([bed(8, kind="hight")], OptionsInvalid, "'hight' is no kind of observation"),
        ([bed(5)], ShotsMissing, "5 heights of bed"),
        ([bed(8, values=np.zeros(7))], ShotsInvalid, "7 values of 8 observations"),
        ([bed(8, joints=BEYOND)], ShotsInvalid, "bed: observation 0: the nominal robot"),
        (
            [bed(8, kind="reflector", values=PLACES, object=Object("r", place_mm=(0.0, 0.0, 1.0)))],
            OptionsInvalid,
            "r: place .* with a 1 σ of None",
        ),
        ([bed(8, kind="reflector", values=PLACES)], ShotsInvalid, "not place its frame: points on"),
        ([bed(8, held_out=True)], ShotsMissing, "nothing was observed"),
        ([], ShotsMissing, "nothing was observed"),
        ([bed(8, values=np.full(8, np.nan))], ShotsInvalid, "a value is no number"),
        ([bed(8, std_mm=0.0)], ShotsInvalid, "σ not above 0"),
        ([bed(8, std_mm=np.full(8, 0.01))], ShotsInvalid, "σ .* of 8 values with 1 rows each"),
        ([bed(8, joints=np.zeros((8, 2)))], ShotsInvalid, "joints .* of a robot with 3"),
        ([bed(8, object=Object("bed", "half 3"))], OptionsInvalid, "'half 3' is no part"),
        ([bed(8, object=Object("bed", "half 2"))], OptionsInvalid, "bed: a platform of one part"),
        ([bed(8), bed(8, object=Object("bed", "tool"))], OptionsInvalid, "two objects are called"),
    ],
)
def test_observations_that_cannot_be_fitted_are_refused(rows, error, says):
    with pytest.raises(error, match=says):
        identify(None, printer(), observations=rows)
