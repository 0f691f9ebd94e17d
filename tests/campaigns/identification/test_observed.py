"""Rows of files as blocks of the fit: objects, what is held out, and what is refused."""

from dataclasses import fields, replace

import numpy as np
import pytest
from observation_files import rows_of
from printers import BED_MM, Printer, printer, rings

from campaigns.api import read_observations
from campaigns.errors import OptionsInvalid, ShotsInvalid
from campaigns.fit.kinds import KINDS
from campaigns.identification.objects import Object
from campaigns.identification.observed import hold_out, measured_of, objects_of
from campaigns.identification.plausible_observations import check_observations
from campaigns.settings.sections import ObjectConfig
from campaigns.shots.observations_csv import ObservationRow, write_observations
from campaigns.shots.shot_sets import ShotSet

OBJECTS = (Object("bed"), Object("part", shrinkage_percent=0.2, shrinkage_std_percent=0.01))
NOMINAL = printer().kinematics
PLACES = rings(BED_MM, 3)


@pytest.fixture(scope="module")
def heights():
    return rows_of(Printer(3).heights(PLACES, level_mm=0.0))


@pytest.fixture(scope="module")
def widths():
    return rows_of(Printer(3).widths(60.0))


def test_keys_of_an_object_are_those_of_the_fit():
    assert {field.name for field in fields(Object)} == set(ObjectConfig.model_fields)
    config = ObjectConfig(name="block", on="bed", height_mm=30.0, std_mm=0.01)
    block = dict(zip("ab", objects_of((ObjectConfig(name="bed"), config)), strict=True))["b"]
    assert (block.on.name, block.height_mm, block.std_mm) == ("bed", 30.0, 0.01)


def test_rows_come_back_as_they_were_measured(heights, widths):
    drawn = Printer(3)
    bed, part = measured_of(heights + widths, OBJECTS)
    assert (bed.kind, bed.object, part.kind) == ("height", OBJECTS[0], "distance")
    np.testing.assert_array_equal(bed.joints, drawn.heights(PLACES).joints)
    assert part.joints.shape == (12, 2, 3)
    assert bed.moment is None
    assert bed.session is None


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_a_row_states_one_sigma_whatever_its_values(kind):
    joints, values = ((0.0, 0.0, 0.0),) * kind.poses, (0.0,) * len(kind.columns)
    row = ObservationRow(kind.name, "it", joints, values, std_mm=0.02)
    (measured,) = measured_of([row, row, row], (Object("it"),))
    np.testing.assert_array_equal(measured.std_mm, np.full((3, kind.width), 0.02))


def test_held_out_rows_times_and_stations_are_kept(heights):
    timed = [
        replace(row, time=f"{place}", session=1 + place % 2) for place, row in enumerate(heights)
    ]
    timed[4] = replace(timed[4], purpose=ShotSet.VALIDATION)
    fitted, held_out = measured_of(timed, OBJECTS)
    assert (fitted.held_out, held_out.held_out) == (False, True)
    assert held_out.moment.tolist() == [4.0]
    assert held_out.session.tolist() == [1]
    assert len(fitted.moment) == len(heights) - 1


def test_unknown_object_is_named_with_the_line_to_add(heights):
    with pytest.raises(OptionsInvalid) as error:
        measured_of(heights, OBJECTS[1:])
    assert "- {name: bed}" in error.value.remedy


@pytest.mark.parametrize("seed", [1, 2])
def test_a_share_is_held_out_all_over_the_file(heights, widths, seed):
    rows = hold_out(heights + widths, 0.2, np.random.default_rng(seed))
    places = [n for n, row in enumerate(rows) if row.purpose is ShotSet.VALIDATION]
    of_bed = [place for place in places if place < len(heights)]
    assert (len(of_bed), len(places) - len(of_bed)) == (4, 2)
    assert set(np.diff(of_bed).tolist()) <= {4, 5}


def test_what_a_file_marks_as_held_out_stays(heights):
    marked = [replace(heights[0], purpose=ShotSet.VALIDATION), *heights[1:]]
    assert list(hold_out(marked, 0.5, np.random.default_rng(1))) == marked


def scaled(rows, factor):
    return [replace(row, values=tuple(factor * value for value in row.values)) for row in rows]


def at_levels():
    drawn = Printer(3)
    levels = [rows_of(drawn.heights(PLACES[:10], level_mm=mm)) for mm in (0.0, 30.0, 60.0)]
    return [row for rows in levels for row in rows]


@pytest.mark.parametrize(
    ("rows", "cause"),
    [
        (lambda: scaled(rows_of(Printer(3).widths(60.0)), 0.1), "look like centimetres"),
        (lambda: scaled(rows_of(Printer(3).widths(60.0)), 1 / 25.4), "look like inches"),
        (lambda: scaled(at_levels(), 0.001), "look like metres"),
        (lambda: scaled(at_levels(), -1.0), "seem to have the other sign"),
    ],
)
def test_values_in_another_unit_or_sign_are_refused(rows, cause):
    with pytest.raises(ShotsInvalid, match=cause):
        check_observations(NOMINAL, rows(), OBJECTS, 60.0, "o.csv")


def test_values_as_measured_pass_even_with_wrong_ones_among_them(heights):
    check_observations(NOMINAL, at_levels(), OBJECTS, 60.0, "o.csv")
    mistyped = rows_of(Printer(3).widths(60.0, wrong=(1, 4)))
    check_observations(NOMINAL, heights + mistyped, OBJECTS, 60.0, "o.csv")


def test_shrinkage_of_which_nothing_is_known_explains_no_unit():
    rows = scaled(rows_of(Printer(3).widths(60.0)), 0.1)
    with pytest.raises(ShotsInvalid, match="centimetres"):
        check_observations(NOMINAL, rows, (Object("part"),), 60.0, "o.csv")


def test_values_of_no_robot_are_refused(widths):
    values = np.random.default_rng(1).uniform(200.0, 900.0, len(widths))
    rows = [replace(row, values=(float(v),)) for row, v in zip(widths, values, strict=True)]
    with pytest.raises(ShotsInvalid, match="limit 60 mm"):
        check_observations(NOMINAL, rows, OBJECTS, 60.0, "o.csv")


def test_joints_without_an_assembly_are_named_by_line(heights):
    rows = [replace(row, line=2 + place) for place, row in enumerate(heights)]
    rows[5] = replace(rows[5], joints=((0.0, 599.0, 300.0),))
    with pytest.raises(ShotsInvalid, match=":7: the nominal robot cannot be assembled"):
        check_observations(NOMINAL, rows, OBJECTS, 60.0, "o.csv")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"values": (1e300,)}, r"3: its value is 1e\+300 mm, limit 200000 mm"),
        ({"std_mm": 1e9}, r"3: its σ is 1e\+09 mm, limit 100 mm"),
    ],
)
def test_what_no_instrument_measures_is_named_by_line(heights, changed, said):
    rows = [heights[0], replace(heights[1], line=3, **changed), *heights[2:]]
    with pytest.raises(ShotsInvalid, match=said):
        check_observations(NOMINAL, rows, OBJECTS, 60.0, "o.csv")


def test_a_length_that_is_none_is_named_by_line(widths):
    rows = [widths[0], replace(widths[1], line=5, values=(0.0,)), *widths[2:]]
    with pytest.raises(ShotsInvalid, match="5: its value is 0 mm, must be above 0"):
        check_observations(NOMINAL, rows, OBJECTS, 60.0, "o.csv")


def test_a_file_is_read_in_python_as_the_command_reads_it(heights, widths, tmp_path):
    path, robot = tmp_path / "o.csv", printer()
    write_observations(path, heights + widths, robot.mechanism)
    bed, part = read_observations(path, robot, OBJECTS)
    assert (bed.object, part.object) == OBJECTS
    np.testing.assert_allclose(bed.values[:, 0], [row.values[0] for row in heights])
    assert [rows.object for rows in read_observations(path, robot)] == [
        Object("bed"), Object("part"),
    ]  # fmt: skip
    with pytest.raises(ShotsInvalid, match=f"{path}:.*unknown object 'part'"):
        read_observations(path, robot, OBJECTS[:1])
    write_observations(path, [replace(heights[0], values=())], robot.mechanism, overwrite=True)
    with pytest.raises(ShotsInvalid, match=f"{path}:2: 1 of 1 observations have no value"):
        read_observations(path, robot)


def test_one_place_touched_many_times_is_refused(heights):
    rows = [replace(row, joints=heights[0].joints) for row in heights]
    with pytest.raises(ShotsInvalid, match="within 0 mm of each other"):
        check_observations(NOMINAL, rows, OBJECTS, 60.0, "o.csv")
