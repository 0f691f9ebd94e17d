"""A parameter set as names, as a vector and as arrays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import CASES, NOMINAL, TILTED, flat_in

from campaigns.mechanisms.geometry import (
    AXIS_TILT_NAMES,
    BACKLASH_NAMES,
    BACKLASHES,
    FREE_BY_DEFAULT,
    GEOMETRY_NAMES,
    HELD_BY_DEFAULT,
    MODEL_NAMES,
    NAMES,
    OFFSETS,
    PLATE,
    TILTS,
    Geometry,
    indices,
)


def values_of(names):
    return st.fixed_dictionaries({name: st.floats(-2000.0, 2000.0) for name in names})


@given(values_of(GEOMETRY_NAMES))
def test_names_and_vector_hold_the_same(flat):
    geometry = Geometry.from_flat(flat)
    told = dict.fromkeys(AXIS_TILT_NAMES, 0.0) | geometry.flat()
    assert told == pytest.approx(flat, rel=1e-15, abs=1e-300)
    assert (Geometry.from_vector(geometry.vector()).vector() == geometry.vector()).all()


def test_a_robot_without_axis_tilts_has_the_29_names_of_files_and_controllers():
    assert tuple(NOMINAL.flat()) == NAMES
    assert (NOMINAL.vector()[TILTS] == 0.0).all()


def test_an_axis_tilt_is_named_where_there_is_one():
    flat = NOMINAL.flat() | {"arm2.axis_tilt_deg": 90.0}
    geometry = Geometry.from_flat(flat)
    assert geometry.axis_tilt_rad.tolist() == [0.0, 0.0, np.pi / 2, 0.0]
    assert geometry.flat().keys() - set(NAMES) == {"arm2.axis_tilt_deg"}
    assert Geometry.from_flat(TILTED.flat()).vector() == pytest.approx(TILTED.vector(), rel=1e-15)


def test_files_hold_degrees_and_the_inside_radians():
    flat = flat_in(CASES["nominal"]["geometry"]) | {"arm2.joint_offset_deg": 90.0}
    geometry = Geometry.from_flat(flat)
    assert geometry.joint_offset_rad.tolist() == [0.0, 0.0, np.pi / 2, 0.0]
    assert geometry.azimuth_rad[0] == np.radians(225.0)
    assert geometry.motor_mm[3].tolist() == [-172.5, 222.5, 0.0]


def test_a_missing_parameter_is_named():
    flat = NOMINAL.flat()
    del flat["arm1.forearm_mm"]
    with pytest.raises(KeyError, match=r"arm1\.forearm_mm"):
        Geometry.from_flat(flat)


def test_an_unknown_name_has_no_place():
    assert indices(("plate_mm", "arm0.x_mm")).tolist() == [28, 0]
    with pytest.raises(ValueError):
        indices(("arm4.x_mm",))


def test_what_lies_beyond_the_29_stands_after_them():
    """A place by name is the same whether one thinks of 29, 33 or 37 parameters."""
    assert MODEL_NAMES == NAMES + AXIS_TILT_NAMES + BACKLASH_NAMES
    assert indices(NAMES).tolist() == list(range(29))
    assert NAMES[PLATE] == "plate_mm"
    assert [NAMES[place] for place in OFFSETS] == [f"arm{i}.joint_offset_deg" for i in range(4)]
    assert [MODEL_NAMES[place] for place in TILTS] == list(AXIS_TILT_NAMES)
    assert [MODEL_NAMES[place] for place in BACKLASHES] == list(BACKLASH_NAMES)


def test_22_parameters_are_free_and_7_are_held():
    assert (len(FREE_BY_DEFAULT), len(HELD_BY_DEFAULT)) == (22, 7)
    assert sorted(FREE_BY_DEFAULT + HELD_BY_DEFAULT) == sorted(NAMES)
