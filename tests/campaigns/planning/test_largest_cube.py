"""The largest cube in bodies of which it is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from campaigns.planning.validation_plan import CUBE_STEPS, largest_cube

MIDDLE = np.array([20.0, -30.0, -500.0])


def cube_in(allows) -> tuple[np.ndarray, float]:
    """The cube in a body about `MIDDLE`, of a robot with a turn."""
    centre, extent = np.array([0.0, 0.0, -480.0, 0.0]), np.full(4, 400.0)
    return largest_cube(
        SimpleNamespace(
            centre=centre, extent=extent, allows=lambda poses: allows(poses[:, :3] - MIDDLE)
        )
    )


def test_cube_in_a_ball_and_in_a_box_is_the_one_of_geometry() -> None:
    for allows, edge_mm in (
        (lambda at: np.linalg.norm(at, axis=1) < 300.0, 600.0 / 3.0**0.5),
        (lambda at: (np.abs(at) < [150.0, 200.0, 110.0]).all(axis=1), 220.0),
    ):
        middle, found_mm = cube_in(allows)
        step_mm = 1.1 * (edge_mm + 40.0) / CUBE_STEPS
        assert edge_mm - 2.0 * step_mm < found_mm <= edge_mm
        assert found_mm == pytest.approx(edge_mm, rel=0.06)
        corners = middle + 0.5 * found_mm * np.array([[-1, -1, -1], [1, 1, 1], [1, -1, 1]])
        assert allows(corners - MIDDLE).all()


def test_a_body_that_holds_no_cube_gives_none() -> None:
    assert cube_in(lambda at: np.zeros(len(at), dtype=bool))[1] == 0.0


def test_a_robot_in_a_plane_has_the_largest_square() -> None:
    centre, extent = np.array([0.0, 0.0, 0.0]), np.array([400.0, 400.0, 0.0])
    middle = np.array([20.0, -30.0, 0.0])
    region = SimpleNamespace(
        centre=centre,
        extent=extent,
        allows=lambda poses: (
            (poses[:, 2] == 0.0) & (np.linalg.norm(poses - middle, axis=1) < 300.0)
        ),
    )
    found, edge_mm = largest_cube(region)
    assert edge_mm == pytest.approx(600.0 / 2.0**0.5, rel=0.06)
    np.testing.assert_allclose(found, middle, atol=25.0)
    assert found[2] == 0.0
