"""The yardstick of doubt on made-up rows: its limits can be missed."""

from dataclasses import asdict

import pytest

from benchmarks import doubt
from benchmarks.shared.studies import Studied
from benchmarks.shared.yardstick import Report
from campaigns.studies.study import CampaignRow, CampaignVerdict
from campaigns.studies.summary import verdict_statistics

GOOD = CampaignVerdict(
    **dict.fromkeys(CampaignVerdict.__slots__, 0)
    | {"verdict": "pass", "model": "standard", "doubts": (), "known": 22, "worst_sigmas": 2.0}
    | {"square_over_variance": 1.0, "covered": 0.95, "square_over_least": 1.0, "change": ""}
    | {"position_mm": 0.01, "stated_mm": 0.01, "named": True, "false_alarm": False}
)


def studied(effect="clean", what="none", **changes):
    """Two campaigns, both so."""
    verdict = CampaignVerdict(**{**asdict(GOOD), **changes})
    rows = [CampaignRow(number, what, verdict=verdict) for number in range(2)]
    told = asdict(verdict_statistics(rows)) | {"by_kind": [{"kind": what}]}
    return Studied(told | {"effect": effect, "estimator": "points"}, rows)


def missed(figures):
    return Report(list(figures)).missed


def test_false_acceptance_misses_the_limit():
    wrong = studied(position_mm=1.0)
    assert 'wrong "pass" by points' in missed(doubt.false_acceptance([wrong]))
    assert 'wrong "pass" by points' not in missed(doubt.false_acceptance([studied()]))


@pytest.mark.parametrize(
    ("changes", "figure"),
    [
        ({"square_over_variance": 1.3}, "none: errors over σ"),
        ({"covered": 0.9}, "none: 95 % intervals hold"),
        ({"square_over_least": 1.3}, "none: variance over the least possible"),
        ({"doubts": ("common-scale",)}, "false alarms: common scale"),
        ({"too_many": 1}, "false alarms: outlier"),
    ],
)
def test_sigma_that_is_not_true_and_false_alarms_miss_theirs(changes, figure):
    assert missed(doubt.honesty(studied().rows)) == []
    assert missed(doubt.honesty(studied(**changes).rows)) == [figure]


def test_step_is_asked_for_where_it_can_be_told():
    step = {"what": "joint 1 deg", "verdict": "fail", "signal": 9.0}
    assert missed(doubt.steps(studied(**step, change="right"))) == []
    named = "joint 1 deg: cause, arm and place named"
    assert missed(doubt.steps(studied(**step, change="place"))) == [named]
    assert list(doubt.steps(studied(**step | {"signal": 6.0}))) == []


def test_what_is_stated_of_positions_and_scales_has_limits():
    assert missed(doubt.positions(studied())) == []
    assert len(missed(doubt.positions(studied(position_mm=0.02)))) == 1
    assert missed(doubt.scales(studied(verdict="fail", doubts=("common-scale",)).verdicts())) == []
    assert len(missed(doubt.scales(studied().verdicts()))) == 2


def test_wrong_shots_and_pairs_are_asked_for():
    assert missed(doubt.gross_errors([studied()])) == []
    assert len(missed(doubt.gross_errors([studied(missing=1, too_many=1)]))) == 2
    assert len(missed(doubt.few_distances(studied(worst_sigmas=6.0, covered=0.9)))) == 2
    assert missed(doubt.wrong_pairs(studied(too_many=1)))[0] == "bare distances: false alarms"
