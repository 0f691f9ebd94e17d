"""The yardstick of doubt on its smallest run, and the truths that it compares with."""

import numpy as np
import pytest

from benchmarks import doubt
from benchmarks.doubt import Judged, judged, scales
from benchmarks.shared.prototype import FREE_PLACES, NOMINAL
from benchmarks.shared.simulated import Effects, position_error_mm, simulate
from campaigns.mechanisms.mechanism import Kinematics

pytestmark = pytest.mark.slow


def each(work, count):
    return [work(number) for number in range(count)]


def one(**told):
    values = {
        "verdict": "pass",
        "errors": np.array([0.3, 0.1]),
        "std": np.array([0.1, 0.1]),
        "least": np.array([0.1, 0.1]),
        "real_mm": 0.01,
        "stated_mm": 0.01,
        "doubts": frozenset(),
        "change": "",
        "signal": 0.0,
        "missing": 0,
        "too_many": 0,
    }
    return Judged(**{**values, **told})


@pytest.fixture
def few_kinds(monkeypatch):
    """One scenario and one estimator."""
    monkeypatch.setattr(doubt, "SCENARIOS", {"clean": (Effects(pairs=30),)})
    monkeypatch.setattr(doubt, "ESTIMATORS", {"points": doubt.ESTIMATORS["points"]})


def test_parameter_counts_as_wrong_beyond_its_sigmas_only():
    assert not one().off(4.0)
    assert one(errors=np.array([0.41, 0.0])).off(4.0)


def test_parameter_without_sigma_says_nothing():
    assert not one(std=np.array([np.nan, 0.1])).off(4.0)


def test_position_counts_as_wrong_beyond_twice_what_is_stated():
    assert not one(real_mm=0.019).worse
    assert one(real_mm=0.021).worse


def test_wrong_pass_misses_the_limit(few_kinds, monkeypatch):
    monkeypatch.setattr(doubt, "judged", lambda *_: one(real_mm=1.0))
    assert doubt.wrong_passes(each, 2).missed == ['wrong "pass" by points']


def test_clean_campaign_passes_and_is_not_wrong(few_kinds):
    assert doubt.wrong_passes(each, 1).missed == []


def test_same_campaign_is_drawn_for_each_estimator():
    by = {name: judged(Effects(pairs=30), name, None, 3) for name in doubt.JUDGED}
    assert np.array_equal(by["points"].least, by["distances"].least)
    assert not np.array_equal(by["points"].errors, by["distances"].errors)


def test_encoder_step_is_named_with_cause_arm_and_place():
    assert judged(Effects(step="joint", size=0.3), "points", None, 0).change == "right"


def test_gross_errors_are_counted_when_named():
    found = judged(Effects(pairs=30, gross=3, size=2.0), "points", None, 0)
    assert (found.missing, found.too_many) == (0, 0)


def test_misread_shots_are_asked_for_their_cause(monkeypatch):
    monkeypatch.setattr(doubt, "MISREAD", {"metres": doubt.MISREAD["metres"]})
    assert doubt.misread(each, 1).missed == []
    wrong = (doubt.MISREAD["metres"][0], ("look like feet",))
    monkeypatch.setattr(doubt, "MISREAD", {"metres": wrong})
    assert doubt.misread(each, 1).missed == ["misread shots: right cause"]


def test_scaled_points_are_asked_for(monkeypatch):
    monkeypatch.setattr(doubt, "SCALES", (1.01,))
    monkeypatch.setattr(doubt, "PAPER", {})
    assert scales(each, 1).missed == []


def test_true_robot_has_no_position_error():
    made = simulate(Effects(), (1,))
    p = NOMINAL.p.copy()
    p[FREE_PLACES] = made.true_parameters
    assert position_error_mm(made.forward, Kinematics(NOMINAL.mechanism, p)) < 1e-9
    assert position_error_mm(made.forward, NOMINAL) > 0.1


def test_eight_rods_without_faults_are_the_contracted_robot():
    made = simulate(Effects(rods_mm=1e-9), (1,))
    p = NOMINAL.p.copy()
    p[FREE_PLACES] = made.true_parameters
    assert position_error_mm(made.forward, Kinematics(NOMINAL.mechanism, p)) < 1e-6


@pytest.mark.parametrize(("size", "sure"), [(0.5, True), (0.005, False)])
def test_signal_tells_a_step_that_can_be_found_from_one_that_cannot(size, sure):
    made = simulate(Effects(step="length", size=size), (4,))
    assert (made.signal() > doubt.TELLABLE) is sure
