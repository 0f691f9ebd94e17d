"""The identification as a document: what is promised to programs, and no number that is none."""

import json
from dataclasses import MISSING, fields, replace

import numpy as np
import pytest
from identified_cases import TRACKER_FROM_BASE, identified, moved, noisy, simulated, workspace
from par4_space import SPACE
from recorded_identifications import PROVENANCE
from tested_journal import plain_journal

from campaigns.controllers.export import latest_identification
from campaigns.errors import FindingUnreadable
from campaigns.estimation.estimators import Estimator, Model, Outliers
from campaigns.estimation.information import Uncertainty
from campaigns.identification.result import Frame, RecordedIdentification, read_identification
from campaigns.journal.records import Finding

CLEAN = noisy(simulated(60, 20, seed=1), seed=2)
SPOILT = moved(CLEAN, (7, 50, 99), by_mm=2.0)
ASKED = {
    "points": {"data": SPOILT, "poses": workspace()},
    "distances": {"data": SPOILT, "estimator": Estimator.DISTANCES},
    "rank lost": {"free": ["arm0.x_mm"], "poses": workspace()},
    "priors and outliers kept": {
        "free": ["arm0.x_mm"],
        "prior": ["arm0.x_mm=0.2"],
        "outliers": Outliers.KEEP,
    },
    "nothing unseen": {"data": noisy(simulated(60, 0, seed=1), seed=2)},
    "no freedom": {"data": simulated(22, 5, seed=3), "estimator": Estimator.DISTANCES},
}
"""By what is special about each."""


def result(data=CLEAN, estimator=Estimator.POINTS, **options):
    return replace(identified(data, estimator, **options), seconds=0.012)


def document(data=CLEAN, estimator=Estimator.POINTS, **options):
    return result(data, estimator, **options).document()


def recorded(**asked):
    return RecordedIdentification.of(result(**asked), **PROVENANCE)


@pytest.mark.parametrize("estimator", list(Estimator))
def test_document_is_plain_json_with_every_parameter(estimator) -> None:
    told = document(estimator=estimator, poses=workspace())
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert list(told["parameters"]) == list(SPACE.names)
    plate = told["parameters"]["plate_mm"]
    assert plate["delta"] == pytest.approx(plate["value"] - plate["nominal"])
    assert told["unseen_mm"]["after"].keys() == {"mean_abs", "rms", "max_abs"}
    assert (told["estimator"], told["seconds"]) == (estimator.value, 0.012)


@pytest.mark.parametrize(
    ("pairs", "options", "known"),
    [
        (simulated(60, 0, 1), {"free": ["arm0.z_mm"]}, 19),
        (simulated(22, 5, seed=3), {"model": Model.PAPER}, 0),
    ],
    ids=["lost rank", "no degrees of freedom"],
)
def test_document_says_null_where_nothing_is_known(pairs, options, known) -> None:
    told = document(pairs, Estimator.DISTANCES, **options)
    assert json.dumps(told, allow_nan=False)
    assert len(told["covariance"]["names"]) == known
    if known:
        assert (told["condition"], len(told["unobservable"])) == (None, 1)
        assert "arm0.z_mm" not in told["covariance"]["names"]
    else:
        test = told["chi2"]
        assert (test["p"], test["believable"], test["scale"]) == (None,) * 3
        assert (told["correlations"], told["position_std_mm"]) == ([], None)


def test_covariance_is_in_file_units_and_agrees_with_the_deviations() -> None:
    told = document(noisy(simulated(24, 5, seed=1), seed=1), Estimator.DISTANCES)
    matrix = np.array(told["covariance"]["matrix"])
    for name, variance in zip(told["covariance"]["names"], np.diag(matrix), strict=True):
        assert told["parameters"][name]["std"] == pytest.approx(np.sqrt(variance))
    assert np.allclose(matrix, matrix.T)
    first = told["correlations"][0]
    at = [told["covariance"]["names"].index(first[end]) for end in ("a", "b")]
    expected = matrix[at[0], at[1]] / np.sqrt(matrix[at[0], at[0]] * matrix[at[1], at[1]])
    assert first["value"] == pytest.approx(expected)


def test_what_was_left_out_tells_size_limit_and_reason() -> None:
    told = document(SPOILT)
    assert [left["shot"] for left in told["excluded"]] == [7, 50, 99]
    left = told["excluded"][0]
    assert set(left) == {"shot", "reason", "size_mm", "size_sigma", "limit_sigma"}
    assert left["size_sigma"] > left["limit_sigma"]
    assert told["outliers"] == "exclude"
    assert document(outliers=Outliers.KEEP)["excluded"] == []


def test_the_frame_is_told_for_points_alone() -> None:
    frame = document()["frame"]
    assert frame["x_mm"] == pytest.approx(2500.0, abs=0.5)
    assert frame["phi_deg"] == pytest.approx(np.degrees(2.1), abs=0.05)
    told = Frame.of(TRACKER_FROM_BASE).tracker_from_base
    assert np.allclose(told.rotation, TRACKER_FROM_BASE.rotation, atol=1e-12)
    assert told.translation_mm.tolist() == [2500.0, 400.0, 300.0]
    assert document(estimator=Estimator.DISTANCES)["frame"] is None


def test_priors_frame_and_provenance_are_told() -> None:
    told = document(free=["arm0.x_mm"], prior=["arm0.x_mm=0.2", "plate_mm=0.5"])
    assert told["priors"] == {"arm0.x_mm": 0.2, "plate_mm": 0.5}
    assert told["known_by_priors_alone"] == [[f"arm{arm}.x_mm" for arm in range(4)]]
    told = recorded().document()
    assert told.items() >= PROVENANCE.items()
    assert told["schema"] == "pkmcal/identification/1"
    own = {"asked", "model", "settings"}
    assert told.keys() - PROVENANCE.keys() == document().keys() | own


@pytest.mark.parametrize("asked", ASKED.values(), ids=ASKED)
def test_what_is_written_to_a_journal_and_read_back_is_equal(tmp_path, asked) -> None:
    written = recorded(**asked)
    with plain_journal(tmp_path) as journal:
        journal.append(Finding("identification", written.document()))
        assert latest_identification(journal) == written


def test_an_older_finding_without_the_optional_keys_is_read() -> None:
    whole = recorded()
    optional = {
        each.name
        for each in fields(RecordedIdentification)
        if each.default is not MISSING or each.default_factory is not MISSING
    }
    assert optional >= {"fitted", "unseen", "chi2", "covariance", "frame", "models", "priors"}
    older = {key: value for key, value in whole.document().items() if key not in optional}
    read = read_identification(older)
    assert (read.fitted, read.unseen, read.chi2, read.covariance, read.frame) == (None,) * 5
    assert (read.models, read.priors, read.known_by_priors_alone) == ((), {}, ())
    assert (read.residuals_mm, read.unseen_mm, read.position_std_mm) == (None,) * 3
    assert (read.flat(), read.nominal_flat()) == (whole.flat(), whole.nominal_flat())
    assert (read.std(), read.free) == (whole.std(), whole.free)
    assert (read.verdict, read.reasons) == (whole.verdict, whole.reasons)
    assert read.journal_digest == PROVENANCE["journal_digest"]


@pytest.mark.parametrize(
    "key", ["parameters", "verdict", "reasons", "converged", "series", "robot_digest", "at_utc"]
)
def test_a_finding_that_lacks_what_counts_is_unreadable_and_named(key) -> None:
    told = recorded().document()
    del told[key]
    with pytest.raises(FindingUnreadable, match=f"the journal's identification, {key}: ") as caught:
        read_identification(told)
    assert caught.value.remedy.startswith("identify again")


def test_a_value_that_is_none_is_named_with_its_place() -> None:
    told = recorded().document()
    told["parameters"]["plate_mm"]["value"] = "wide"
    with pytest.raises(FindingUnreadable, match=r"identification, parameters\.plate_mm\.value: "):
        read_identification(told)


def test_errors_of_every_fitted_and_unseen_measurement_are_told() -> None:
    found = result(SPOILT)
    told = found.document()
    kept = [number for number in range(120) if number not in (7, 50, 99)]
    assert (told["fitted"]["of"], told["fitted"]["numbers"]) == ("shots", kept)
    assert (told["unseen"]["of"], told["unseen"]["numbers"]) == ("pairs", [*range(60, 80)])
    assert np.shape(told["fitted"]["after_mm"]) == (117, 3)
    assert np.shape(told["unseen"]["before_mm"]) == (20, 1)
    assert found.fitted.summary() == found.residuals_mm
    assert found.unseen.summary() == found.unseen_mm


def test_strongest_correlations_are_the_first_of_all_by_size() -> None:
    known = Uncertainty(("a", "b", "c"), ((4.0, -1.8, 0.2), (-1.8, 1.0, 0.1), (0.2, 0.1, 1.0)))
    assert [(each.a, each.b) for each in known.strongest(2)] == [("a", "b"), ("a", "c")]
    assert known.strongest(3, least=0.5)[0].value == pytest.approx(-0.9)
    assert len(known.strongest(3, least=0.5)) == 1
    assert known.std() == {"a": 2.0, "b": 1.0, "c": 1.0}
    assert Uncertainty((), ()).strongest(3) == ()
