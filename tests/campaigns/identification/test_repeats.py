"""Visits of one pose: whether the scatter of a fit is the robot's, or an error that repeats."""

from dataclasses import replace

import numpy as np
import pytest
from rod_campaigns import SMALL, rod_campaign

from campaigns.api import identify, sample_workspace
from campaigns.shots.shot_sets import ShotSet

VISITS = 10


def with_visits(campaign, scatter_mm, visit_mm, seed=3):
    """The campaign's shots scattered, and visits of one pose that scatter otherwise."""
    rng = np.random.default_rng(seed)
    shots = campaign.shots
    row = int(shots.rows_of(ShotSet.IDENTIFICATION)[20])
    rows = np.concatenate([np.arange(len(shots)), np.full(VISITS, row)])
    more = shots.rows(rows)
    noise = scatter_mm * rng.standard_normal((len(more), 3))
    noise[-VISITS:] = visit_mm * rng.standard_normal((VISITS, 3))
    return replace(
        more,
        numbers=tuple(range(len(more))),
        purposes=(*shots.purposes, *(ShotSet.REPEATABILITY,) * VISITS),
        pairs=(*shots.pairs, *(None,) * VISITS),
        points_in_tracker_mm=more.points_in_tracker_mm + noise,
    )


@pytest.fixture(scope="module")
def campaign():
    return rod_campaign("linear-delta", SMALL, shots=60, seed=6)


def stated(campaign, shots):
    options = {"workspace": sample_workspace(campaign.robot, 30)}
    return identify(shots, campaign.robot, options=options)


def test_scatter_that_visits_do_not_show_is_an_error_of_every_position(campaign):
    repeats = stated(campaign, with_visits(campaign, 0.05, 0.003))
    scatters = stated(campaign, with_visits(campaign, 0.05, 0.05))
    rows = {share.source: share.mm for share in repeats.uncertainty.budget}
    assert rows["repeating"] == pytest.approx(0.05 * 3**0.5, rel=0.25)
    assert "repeating" not in {share.source for share in scatters.uncertainty.budget}
    total_mm = sum(share.mm**2 for share in repeats.uncertainty.budget) ** 0.5
    assert repeats.uncertainty.position_std_mm.rms == pytest.approx(total_mm, rel=1e-3)
    assert repeats.uncertainty.position_std_mm.rms > 1.5 * scatters.uncertainty.position_std_mm.rms
