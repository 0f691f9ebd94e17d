"""Every kind of observation at robots of single rods and bars: real errors, and wrong rows."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from remembered import remembered

from benchmarks.observed_truths import BALL_MM, FIRST_MM, SECOND_MM, TrueCell
from campaigns import api
from campaigns.api import sample_workspace
from campaigns.errors import OptionsInvalid, ShotsMissing
from campaigns.identification.objects import Object, linked, with_supports
from campaigns.identification.other_kinds import other_kinds

pytestmark = pytest.mark.slow
identify = remembered(api.identify)

BED = Object("bed")
BLOCK = Object("block", on=BED, height_mm=30.0, std_mm=0.01)
PART = Object("part", shrinkage_percent=0.2, shrinkage_std_percent=0.01)
FIRST = Object("first", place_mm=tuple(FIRST_MM + 1.0), std_mm=2.0)
SECOND = Object("second", place_mm=tuple(SECOND_MM - 1.0), std_mm=2.0, on=FIRST)
HALF = Object("half 1", body="half 1", place_mm=tuple(FIRST_MM + 1.0), std_mm=2.0)
OTHER_HALF = replace(SECOND, name="half 2", body="half 2", on=HALF)
BAR = Object("bar", place_mm=tuple(BALL_MM + 0.5), std_mm=1.0, length_mm=400.0, length_std_mm=0.002)
PLATE = Object("plate")
GAUGE = Object("gauge", on="edge", axis=(0.0, 1.0, 0.0), place_mm=(0.0, 0.0, 0.0), std_mm=0.1)
LEVEL = Object("level")


@dataclass(frozen=True)
class Case:
    """Observations of a robot, and which quantities they determine."""

    robot: str
    kind: str
    thing: Object
    shots: int
    determined: tuple[str, ...]
    std_mm: float = 0.01


CASES = [
    Case("linear-delta", "height", BED, 0, ("flat",)),
    Case("linear-delta", "block", BLOCK, 0, ("flat",)),
    Case("linear-delta", "distance", PART, 0, ("flat", "xy"), 0.03),
    Case("par4-prototype", "reflector", OTHER_HALF, 30, ("position", "rotation")),
    Case("par4-prototype", "reflectors", OTHER_HALF, 10, ("position", "rotation")),
    Case("hexapod", "reflectors", SECOND, 10, ("position", "rotation")),
    Case("hexapod", "span", replace(SECOND, on=None), 20, ("position",)),
    Case("hexapod", "probe", SECOND, 10, ("position", "rotation")),
    Case("hexapod", "ball-bar", BAR, 40, ("position", "rotation"), 0.001),
    Case("hexapod", "place", PLATE, 0, ("position", "rotation")),
    Case("hexapod", "edge", GAUGE, 40, ("position", "rotation"), 0.002),
    Case("hexapod", "inclinometer", LEVEL, 40, ("position", "rotation")),
]
NAMES = [f"{case.kind} of a {case.robot}" for case in CASES]


@cache
def measured(case):
    """The cell, shots or None, and observations, of the case's kind first."""
    cell = TrueCell.of(case.robot, 5)
    poses = sample_workspace(cell.robot, 100, seed=5)
    shots = cell.shots(np.concatenate([poses[: case.shots], poses[-20:]]), 10)
    if case.robot != "linear-delta":
        where = poses[40:80].reshape(-1, 2, 6) if case.kind == "span" else poses[40:80]
        rows = [cell.measure(case.kind, case.thing, where, case.std_mm)]
        return cell, shots if case.shots else None, rows
    heights = cell.measure("height", BED, cell.on_level(150.0, 30))
    if case.kind == "block":
        blocks = cell.measure("block", BLOCK, cell.on_level(120.0, 19, 30.0))
        return cell, None, [blocks, heights]
    if case.kind == "distance":
        places = cell.on_level(140.0, 24).reshape(2, -1, 3).swapaxes(0, 1)
        return cell, None, [cell.measure("distance", PART, places, case.std_mm), heights]
    return cell, None, [heights]


def stated_by(case, observations):
    cell, shots, _ = measured(case)
    asked = {"quantities": (",".join(case.determined),)}
    return identify(shots, cell.robot, observations=observations, options=asked)


def quantities_of(result):
    return {quantity.name: quantity for quantity in result.uncertainty.determined}


@pytest.mark.parametrize("case", CASES, ids=NAMES)
def test_real_errors_are_as_small_as_they_are_stated(case):
    cell, _, rows = measured(case)
    result, touched = stated_by(case, rows), [r.joints for r in rows if r.kind == "height"]
    real, stated = cell.errors(result, touched[0] if touched else None), quantities_of(result)
    assert {name: real[name] < 2.0 * stated[name].rms for name in stated} == dict.fromkeys(
        stated, True
    )
    assert [name for name in case.determined if not stated[name].is_determined] == []
    assert not any(f.name == "wrong-observations" for f in result.judgement.findings)


@pytest.mark.parametrize("case", CASES, ids=NAMES)
def test_a_single_wrong_row_is_named(case):
    cell, _, rows = measured(case)
    values = np.array(rows[0].values)
    values.reshape(len(values), -1)[7, -1] += 0.03 if case.kind == "inclinometer" else 1.5
    result = stated_by(case, [replace(rows[0], values=values), *rows[1:]])
    says = [f.says for f in result.judgement.findings if f.name == "wrong-observations"]
    assert [words.partition(" left out")[2] for words in says] == [" as wrong: 7 (from 0)"]
    real, stated = cell.errors(result), quantities_of(result)
    assert real["position"] < 2.0 * stated["position"].rms


def test_rotation_is_determined_by_a_second_reflector_better_than_by_one():
    case = CASES[NAMES.index("reflectors of a hexapod")]
    cell, _, rows = measured(case)
    alone = identify(measured(replace(case, shots=40))[1], cell.robot)
    both = quantities_of(stated_by(case, rows))["rotation"]
    assert both.rms < 0.5 * quantities_of(alone)["rotation"].rms


def test_nests_of_a_plate_share_its_frame_and_differ_by_their_seats():
    case = CASES[NAMES.index("place of a hexapod")]
    cell, _, (whole,) = measured(case)
    seats, std_mm = np.round(whole.values, 0), 0.005
    nests = [
        replace(
            whole,
            object=Object(f"nest {n}", on=PLATE, place_mm=tuple(seat.tolist()), std_mm=std_mm),
            joints=whole.joints[n : n + 1],
            values=(whole.values - seats)[n : n + 1],
        )
        for n, seat in enumerate(seats)
    ]
    result, once = stated_by(case, nests), stated_by(case, [whole])
    real, stated = cell.errors(result), quantities_of(result)["position"]
    assert real["position"] < 2.0 * stated.rms
    assert stated.rms > quantities_of(once)["position"].rms  # seats have errors of their own


def test_places_of_reflectors_are_seen_from_the_controlled_point_wherever_shots_have_theirs():
    """A frame of shots takes up their reflector's place, which no other reflector's place does."""
    cell, place = TrueCell.of("par4-prototype", 5), (20.0, -30.0, -45.0)
    poses = sample_workspace(cell.robot, 60, seed=5)
    shots = cell.shots(poses[:20], place=place)
    both = cell.measure("reflectors", OTHER_HALF, poses[20:])
    fitted = identify(shots, cell.robot, observations=[both]).value.parameters
    for axis, real_mm in zip("xyz", place, strict=True):
        reflector = fitted[f"reflector_{axis}_mm"]
        assert abs(reflector.delta - real_mm) < 3.0 * reflector.std
        assert reflector.std < 3.0


# --- what is refused ------------------------------------------------------------------------------


def test_two_reflectors_need_both_their_objects():
    case = CASES[NAMES.index("reflectors of a hexapod")]
    _, _, (rows,) = measured(case)
    with pytest.raises(OptionsInvalid, match="they are two, and only one is named"):
        stated_by(case, [replace(rows, object=replace(SECOND, on=None))])


def test_a_ball_of_which_nothing_is_stated_needs_readings_for_its_place():
    case = CASES[NAMES.index("ball-bar of a hexapod")]
    _, _, (rows,) = measured(case)
    few = replace(rows, joints=rows.joints[:5], values=rows.values[:5])
    with pytest.raises(ShotsMissing, match=r"5 ball-bars of bar: .* what the centre of bar is"):
        stated_by(case, [few])
    (untested,) = (
        finding.says
        for finding in stated_by(case, [replace(rows, held_out=True)]).judgement.findings
        if finding.says.startswith("not tested")
    )
    assert "ball-bars of bar were held out" in untested


def test_what_an_object_stands_on_may_be_named():
    bed, block = Object("bed", shrinkage_percent=1.0), Object("block", on="bed")
    assert linked(with_supports([bed, block]))["block"].on == bed
    assert linked(with_supports([block]))["block"].on == Object("bed")
    with pytest.raises(OptionsInvalid, match="block stands on 'bed', which is no other object"):
        linked([block])
    with pytest.raises(OptionsInvalid, match="two objects are called 'bed'"):
        linked(with_supports([bed, replace(block, on=Object("bed"))]))


def test_a_block_on_a_bed_that_is_named_shares_its_plane():
    cell, _, (blocks, heights) = measured(CASES[NAMES.index("block of a linear-delta")])
    named = replace(blocks, object=replace(BLOCK, on="bed"))
    whole = replace(heights, object=replace(BED, place_mm=(0.0, 0.0, 0.0), std_mm=1.0))
    kinds = other_kinds([named, whole], cell.robot.kinematics)
    assert [slot.name for slot in kinds.slots] == ["plane of bed", "height of block"]


def test_an_object_states_values_with_their_uncertainty_alone():
    assert Object("bed").stated("plane") is None
    place = (1.0, 2.0, 3.0)
    plate = Object("p", place_mm=place, std_mm=0.1, turn_deg=(0.0, 0.0, 90.0), turn_std_deg=1.0)
    values, std = plate.stated("frame")
    assert values == pytest.approx((*place, 0.0, 0.0, np.pi / 2.0))
    assert std == pytest.approx((0.1,) * 3 + (np.pi / 180.0,) * 3)
    assert plate.stated("seat") is None
    assert replace(plate, on="table").stated("seat") == (place, (0.1,) * 3)
    with pytest.raises(OptionsInvalid, match=r"bar: length .* with a 1 σ of None"):
        Object("bar", length_mm=400.0).stated("length")


def test_held_out_points_of_both_halves_test_the_rotation_and_those_of_one_do_not():
    cell = TrueCell.of("par4-prototype", 5)
    poses = sample_workspace(cell.robot, 100, seed=5)
    shots = cell.shots(np.concatenate([poses[:30], poses[-20:]]), 10)
    fitted = cell.measure("reflector", OTHER_HALF, poses[30:60], 0.01)
    held_out = cell.measure("reflector", OTHER_HALF, poses[60:80], 0.01)
    unseen = replace(held_out, held_out=True)
    asked = {"quantities": ("position,rotation",)}
    for observed, is_tested in (([fitted], False), ([fitted, unseen], True)):
        result = identify(shots, cell.robot, observations=observed, options=asked)
        (rotation,) = (q for q in result.uncertainty.determined if q.name == "rotation")
        assert (rotation.is_determined, rotation.is_tested) == (True, is_tested)
        assert ("not-tested" in result.judgement.obstacles) is not is_tested
