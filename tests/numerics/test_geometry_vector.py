"""A parameter set as names, as a vector and as arrays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import CASES, NOMINAL, flat_in

from campaigns.numerics.geometry import (
    COUNT,
    FREE_BY_DEFAULT,
    HELD_BY_DEFAULT,
    NAMES,
    Geometry,
    indices,
)


@given(st.lists(st.floats(-2000.0, 2000.0), min_size=COUNT, max_size=COUNT))
def test_names_and_vector_hold_the_same(values):
    flat = dict(zip(NAMES, values, strict=True))
    geometry = Geometry.from_flat(flat)
    assert geometry.flat() == pytest.approx(flat, rel=1e-15, abs=1e-300)
    assert (Geometry.from_vector(geometry.vector()).vector() == geometry.vector()).all()


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


def test_22_parameters_are_free_and_7_are_held():
    assert (len(FREE_BY_DEFAULT), len(HELD_BY_DEFAULT)) == (22, 7)
    assert sorted(FREE_BY_DEFAULT + HELD_BY_DEFAULT) == sorted(NAMES)
