"""Restricted space: clearances of a plate from zones, at points and on lines."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.design.restricted_space import (
    ANYWHERE,
    Disc,
    Rectangle,
    RestrictedSpace,
    Zone,
    count_refusals,
)

FLOOR = Zone("space.z_lowest_mm -800", Rectangle(), (-800.0, math.inf), keeps_in=True)
ROUND = Zone("space.radius_mm 500", Disc((0.0, 0.0), 500.0), ANYWHERE, keeps_in=True)
BOX = Zone("box", Rectangle((100.0, 200.0), (-50.0, 50.0)), (-700.0, -600.0), keeps_in=False)
SHEET = Zone("sheet", Rectangle((300.0, 300.001)), ANYWHERE, keeps_in=False)
PILLAR = Zone("pillar", Disc((-100.0, 0.0), 20.0), ANYWHERE, keeps_in=False)
CASE = Zone("case", Rectangle((-400.0, 400.0)), (-900.0, -100.0), keeps_in=True)
EVERY = RestrictedSpace((FLOOR, ROUND, BOX, SHEET, PILLAR, CASE), 60.0, 15.0)

places = st.tuples(*[st.floats(-600.0, 600.0)] * 2, st.floats(-950.0, -50.0))


def clearances(space, *point):
    return space.clearance_mm(np.array([point], dtype=float))[0]


@pytest.mark.parametrize(
    ("zone", "point", "expected"),
    [
        (FLOOR, (0, 0, -790), -5.0),  # 10 above it, margin 15
        (FLOOR, (300, 0, -700), 85.0),
        (ROUND, (300, 400, 0), -75.0),
        (ROUND, (0, 0, 0), 425.0),
        (BOX, (0, 0, -650), 25.0),
        (BOX, (70, 90, -650), -25.0),  # 50 from its corner
        (BOX, (150, 0, -580), 5.0),  # above it
        (BOX, (150, 0, -650), -65.0),  # shortest way out is up
        (PILLAR, (-200, 0, 0), 5.0),
        (CASE, (350, 0, -500), -25.0),
        (CASE, (0, 1e6, -120), 5.0),
    ],
)
def test_clearance_is_of_a_plate_with_its_margin(zone, point, expected):
    space = RestrictedSpace((zone,), 60.0, 15.0)
    assert clearances(space, *point) == pytest.approx([expected])
    assert space.allows(np.array([point], dtype=float))[0] == (expected >= 0.0)


@pytest.mark.slow
@given(places, places)
def test_least_clearance_of_a_line_is_that_of_its_points(start, end):
    start, end = np.array(start), np.array(end)
    (least,) = EVERY.line_clearance_mm(start[None], end[None])
    samples = start + np.linspace(0.0, 1.0, 2001)[:, None] * (end - start)
    sampled = EVERY.clearance_mm(samples).min(axis=0)
    step = np.linalg.norm(end - start) / 2000
    assert (least <= sampled + 1e-6).all(), "never more than is there"
    below = least <= 0.0
    assert (least[below] >= sampled[below] - step - 1e-6).all(), "and no less"
    assert (sampled[~below] > -1e-6).all()


def test_a_thin_sheet_is_not_jumped_over_and_a_line_along_a_wall_is_clear():
    space = RestrictedSpace((SHEET,))
    start, end = np.array([[0.0, 0.0, -500.0]]), np.array([[900.0, 10.0, -400.0]])
    assert space.allows(start)[0]
    assert space.allows(end)[0]
    assert space.line_clearance_mm(start, end)[0, 0] == pytest.approx(-0.0005, abs=1e-4)
    space = RestrictedSpace((BOX, FLOOR))
    along = np.array([[100.0, -80.0, -600.0], [200.0, 60.0, -600.0]])
    assert space.line_clearance_mm(along[:1], along[1:])[0, 0] == pytest.approx(0.0, abs=1e-5)


def test_faults_name_zone_value_and_what_is_added():
    space = RestrictedSpace((FLOOR, BOX), 60.0, 0.0)
    assert space.fault(np.array([0.0, 0.0, -812.0])) == (
        "z -812 mm is below space.z_lowest_mm -800"
    )
    assert "with margin_mm 15" in space.with_margin(15.0).fault(np.array([0.0, 0.0, -790.0]))
    near = space.fault(np.array([60.0, 0.0, -650.0]))
    assert near == "the plate (radius 60 mm) is 20 mm too near box"
    assert space.fault(np.array([0.0, 0.0, -700.0])) == ""


def test_refusals_are_counted_by_zone():
    points = np.array([[0.0, 0.0, -900.0], [150.0, 0.0, -650.0], [0.0, 0.0, -500.0]])
    counted = count_refusals(RestrictedSpace((FLOOR, BOX)), points)
    assert (counted.tried, counted.refused) == (3, 2)
    assert dict(counted.by_zone) == {FLOOR.name: 1, "box": 1}
