"""A parameter set as names and as a vector."""

import hashlib

import numpy as np
import pytest
from family_cases import BY_NAME, flat_in
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import CASES, NOMINAL
from par4_space import AXIS_TILT_NAMES, SKEW_NAMES, SPACE, TILTS, par4, places_of

from campaigns.kinematics.parameters import Parameters, Role, stated_rates


def values_of(names):
    return st.fixed_dictionaries({name: st.floats(-2000.0, 2000.0) for name in names})


@given(values_of(SPACE.names + AXIS_TILT_NAMES + SKEW_NAMES))
def test_names_and_vector_hold_the_same(flat):
    geometry = par4(flat)
    told = dict.fromkeys(AXIS_TILT_NAMES + SKEW_NAMES, 0.0) | geometry.parameters
    assert told == pytest.approx(flat, rel=1e-15, abs=1e-300)
    assert par4(geometry.parameters).p == pytest.approx(geometry.p, rel=1e-15, abs=1e-300)


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
    assert SPACE.of_robot == SPACE.names + extensions + gears
    assert SPACE.select()[-3:] == SPACE.select(Role.GROWTH)
    assert [SPACE.select()[place] for place in TILTS] == list(AXIS_TILT_NAMES)


def test_the_papers_method_holds_azimuths_and_one_motor_s_place():
    held = {f"arm{arm}.azimuth_deg" for arm in range(4)} | {f"arm0.{axis}_mm" for axis in "xyz"}
    free = BY_NAME["par4"].free
    assert len(free) == 22
    assert set(SPACE.names) - set(free) == held


RIPPLES = {f"arm{arm}.ripple_sin_deg": 0.01 for arm in (0, 2)}


@pytest.mark.parametrize(
    ("stated", "listed"),
    [
        ((30.0, 30.0, 30.0, 30.0), {"ripples_per_turn": 30.0}),
        ((30.0, 0.0, 30.0, 50.0), {"ripples_per_turn": 30.0}),
        ((30.0, 0.0, 50.0, 0.0), {"arm0.ripples_per_turn": 30.0, "arm2.ripples_per_turn": 50.0}),
    ],
)
def test_rates_are_listed_beside_ripples_as_one_value_where_they_are_alike(stated, listed):
    flat = NOMINAL.parameters | RIPPLES
    parameters = Parameters.of(SPACE, flat | SPACE.named_rates(stated))
    assert parameters.rates == stated
    assert {name: v for name, v in parameters.items() if name.endswith("per_turn")} == listed
    # a set is named by its digest, also one that was made of what another lists
    assert Parameters.of(SPACE, dict(parameters)).digest() == parameters.digest()
    assert stated_rates(SPACE, parameters) == stated
    assert (
        Parameters.of(SPACE, NOMINAL.parameters | SPACE.named_rates(stated)) == NOMINAL.parameters
    )
    without = Parameters.of(SPACE, flat)
    assert stated_rates(SPACE, without, stated) == stated
    assert parameters.digest() != without.digest()


def test_a_digest_with_one_rate_is_that_of_earlier_versions():
    flat = NOMINAL.parameters | RIPPLES | {"ripples_per_turn": 30.0}
    lines = "".join(f"{name}={value + 0.0!r}\n" for name, value in flat.items())
    digest = hashlib.sha256(lines.encode()).hexdigest()
    assert Parameters.of(SPACE, flat).digest() == digest
