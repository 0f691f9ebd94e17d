"""A plan drawn with letters."""

from app.terminal_picture import VIEW_WIDTH, plan_picture
from campaigns.planning.plan_file import PlannedShot
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose


def shot(purpose, x_mm, y_mm, z_mm):
    return PlannedShot(0, purpose, None, Pose(x_mm, y_mm, z_mm, 0.0), (0.0,) * 4)


CORNERS = [
    shot(ShotSet.IDENTIFICATION, -350.0, 100.0, -600.0),
    shot(ShotSet.VALIDATION, 350.0, -100.0, -500.0),
    shot(ShotSet.DRIFT, 0.0, 0.0, -550.0),
]


def test_both_views_show_every_set_where_it_is():
    titles, *pictured, key = plan_picture(CORNERS)
    above = [line[:VIEW_WIDTH].ljust(VIEW_WIDTH) for line in pictured]
    aside = [line[VIEW_WIDTH + 2 :].ljust(VIEW_WIDTH) for line in pictured]
    assert above[0][0] == "o", "left and far, seen from above"
    assert above[-1][VIEW_WIDTH - 1] == "x"
    assert aside[0][VIEW_WIDTH - 1] == "x", "right and high, seen from the side"
    assert any("+" in line for line in above)
    assert "700 mm wide" in key
    assert titles.startswith("from above")


def test_it_fits_a_small_terminal():
    assert all(len(line) <= 80 for line in plan_picture(CORNERS))


def test_one_place_alone_can_be_drawn():
    assert len(plan_picture(CORNERS[2:])) == 3
