"""The yardstick of doubt on its smallest run: its limits can be missed."""

import numpy as np
import pytest

from benchmarks import doubt
from campaigns.studies.effects import Effect
from campaigns.studies.judged import EffectOutcome, JudgedCampaign

pytestmark = pytest.mark.slow


def each(work, count):
    return [work(number) for number in range(count)]


@pytest.fixture
def few_kinds(monkeypatch):
    """One effect and one estimator."""
    monkeypatch.setattr(doubt, "EFFECTS", {"clean": (Effect(),)})
    monkeypatch.setattr(doubt, "METHODS", {"points": doubt.METHODS["points"]})


def test_wrong_pass_misses_the_limit(few_kinds, monkeypatch):
    (outcome,) = doubt._outcome("clean", "points", 0)
    values = {name: getattr(outcome.judged, name) for name in JudgedCampaign.__slots__}
    wrong = JudgedCampaign(**{**values, "verdict": "pass", "position_mm": 1.0})
    monkeypatch.setattr(doubt, "_outcome", lambda *_: (EffectOutcome(0, "none", wrong),))
    assert doubt.passes(each, 2).missed == ['wrong "pass" by points']


def test_clean_campaign_passes_and_is_not_wrong(few_kinds):
    assert doubt.passes(each, 1).missed == []


def test_same_campaign_is_drawn_for_each_estimator():
    by = {name: doubt.judged(Effect(), name, 3, pairs=30) for name in doubt.JUDGED}
    over = {name: one.square_over_least for name, one in by.items()}
    assert over["points"] != over["distances"]
    points, distances = (doubt.setup_of(name, 30) for name in doubt.JUDGED)
    np.testing.assert_array_equal(points.study.shots.joints, distances.study.shots.joints)
    np.testing.assert_array_equal(points.workspace, distances.workspace)


def test_misread_shots_are_asked_for_their_cause(monkeypatch):
    monkeypatch.setattr(doubt, "MISREAD", {"metres": doubt.MISREAD["metres"]})
    assert doubt.misread(each, 1).missed == []
    wrong = (doubt.MISREAD["metres"][0], ("look like feet",))
    monkeypatch.setattr(doubt, "MISREAD", {"metres": wrong})
    assert doubt.misread(each, 1).missed == ["misread shots: right cause"]


def test_scaled_points_are_asked_for(monkeypatch):
    monkeypatch.setattr(doubt, "PAPER", {})
    assert doubt.scales(each, 1).missed == []
