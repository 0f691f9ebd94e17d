"""A parameter set as names and as a vector."""

import numpy as np
import pytest
from family_cases import BY_NAME, flat_in
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import CASES, NOMINAL, TILTED
from par4_space import AXIS_TILT_NAMES, PLATE, SKEW_NAMES, SPACE, TILTS, par4, places_of

from campaigns.kinematics.parameters import Role


def values_of(names):
    return st.fixed_dictionaries({name: st.floats(-2000.0, 2000.0) for name in names})


@given(values_of(SPACE.names + AXIS_TILT_NAMES + SKEW_NAMES))
def test_names_and_vector_hold_the_same(flat):
    geometry = par4(flat)
    told = dict.fromkeys(AXIS_TILT_NAMES + SKEW_NAMES, 0.0) | geometry.parameters
    assert told == pytest.approx(flat, rel=1e-15, abs=1e-300)
    assert par4(geometry.parameters).p == pytest.approx(geometry.p, rel=1e-15, abs=1e-300)


def test_names_are_those_of_files_and_axis_tilts_only_where_there_are_any():
    assert tuple(NOMINAL.parameters) == SPACE.names
    assert (NOMINAL.p[TILTS] == 0.0).all()
    flat = NOMINAL.parameters | {"arm2.axis_tilt_deg": 90.0}
    geometry = par4(flat)
    assert geometry.p[TILTS].tolist() == [0.0, 0.0, np.pi / 2, 0.0]
    assert geometry.parameters.keys() - set(SPACE.names) == {"arm2.axis_tilt_deg"}
    assert par4(TILTED.parameters).p == pytest.approx(TILTED.p, rel=1e-15)


def test_files_hold_degrees_and_the_inside_radians():
    flat = flat_in(CASES["nominal"]["geometry"]) | {"arm2.joint_offset_deg": 90.0}
    geometry = par4(flat)
    assert geometry.p[SPACE.columns["joint_offset"]].tolist() == [0.0, 0.0, np.pi / 2, 0.0]
    assert geometry.p[places_of("azimuth_deg")[0]] == np.radians(225.0)
    motor = SPACE.places(("arm3.x_mm", "arm3.y_mm", "arm3.z_mm"))
    assert geometry.p[motor].tolist() == [-172.5, 222.5, 0.0]


def test_a_missing_parameter_is_named_and_an_unknown_one_has_no_place():
    flat = dict(NOMINAL.parameters)
    del flat["arm1.forearm_mm"]
    with pytest.raises(KeyError, match=r"arm1\.forearm_mm"):
        par4(flat)
    assert SPACE.places(("plate_mm", "arm0.x_mm")).tolist() == [28, 0]
    with pytest.raises(KeyError):
        SPACE.places(("arm4.x_mm",))


def test_extensions_transmission_and_growth_stand_after_the_29_of_every_file():
    extensions, gears = SPACE.select(Role.EXTENSION), SPACE.select(Role.TRANSMISSION)
    assert SPACE.places(SPACE.names).tolist() == list(range(29))
    assert extensions[:8] == AXIS_TILT_NAMES + SKEW_NAMES
    assert extensions[8:12] == SPACE.select(group="bars")
    assert extensions[12:] == SPACE.select(group="sag")
    assert [SPACE[name].unit for name in gears] == ["ppm"] * 4 + ["deg"] * 24
    assert gears[-8:] == SPACE.select(field="backlash") + SPACE.select(field="compliance")
    parts = ("arm", "forearm", "frame")
    assert SPACE.select()[-3:] == tuple(f"{part}_expansion_ppm" for part in parts)
    assert SPACE.of_robot == SPACE.names + extensions + gears
    assert SPACE.names[PLATE] == "plate_mm"
    offsets = SPACE.columns["joint_offset"]
    assert [SPACE.names[place] for place in offsets] == list(SPACE.select(field="joint_offset"))
    assert [SPACE.select()[place] for place in TILTS] == list(AXIS_TILT_NAMES)


def test_names_are_selected_by_role_field_and_group():
    assert SPACE.select(field="forearm") == SPACE.select(field="forearm_mm")
    lengths = {f"arm{arm}.{each}_mm" for arm in range(4) for each in ("arm", "forearm")}
    assert {*SPACE.select(group="lengths")} == lengths
    assert not SPACE.select(Role.GEOMETRY, group="rods")


def test_the_papers_method_holds_azimuths_and_one_motor_s_place():
    held = {f"arm{arm}.azimuth_deg" for arm in range(4)} | {f"arm0.{axis}_mm" for axis in "xyz"}
    free = BY_NAME["par4"].free
    assert len(free) == 22
    assert set(SPACE.names) - set(free) == held
