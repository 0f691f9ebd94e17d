"""The identification as a document: what is promised to programs, and no number that is none."""

import json

import numpy as np
import pytest
from identified_cases import NOISE_MM, identified, moved, noisy, simulated, workspace

from campaigns.estimation.estimators import Estimator, LossShape, Outliers
from campaigns.identification.result import identification_document
from campaigns.mechanisms.geometry import NAMES

CLEAN = noisy(simulated(60, 20, seed=1), seed=2)


def document(data=CLEAN, estimator=Estimator.POINTS, **options):
    return identification_document(identified(data, estimator, **options), 0.012)


@pytest.mark.parametrize("estimator", list(Estimator))
def test_document_is_plain_json_with_every_parameter(estimator) -> None:
    told = document(estimator=estimator, poses=workspace())
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert list(told["parameters"]) == list(NAMES)
    plate = told["parameters"]["plate_mm"]
    assert plate["delta"] == pytest.approx(plate["value"] - plate["nominal"])
    assert told["unseen_mm"]["after"].keys() == {"mean_abs", "rms", "max_abs"}
    assert (told["estimator"], told["seconds"]) == (estimator.value, 0.012)
    assert told["loss"] == {"shape": "linear", "scale": 3.0}


def test_document_of_a_lost_rank_has_no_infinity() -> None:
    told = document(simulated(60, 0, 1), Estimator.DISTANCES, free=["arm0.z_mm"])
    assert told["condition"] is None
    assert json.dumps(told, allow_nan=False)
    assert len(told["unobservable"]) == 1
    assert "arm0.z_mm" not in told["covariance"]["names"]


def test_document_without_degrees_of_freedom_has_neither_p_nor_covariance() -> None:
    told = document(simulated(22, 5, seed=3), Estimator.DISTANCES)
    assert (told["chi2"]["p"], told["chi2"]["believable"], told["chi2"]["scale"]) == (None,) * 3
    assert told["covariance"] == {"names": [], "matrix": []}
    assert told["correlations"] == []
    assert told["position_std_mm"] is None
    assert json.dumps(told, allow_nan=False)


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


def test_noise_is_told_in_numbers_and_words() -> None:
    told = document(noisy(simulated(60, 20, seed=1), seed=2, std_mm=4.0 * NOISE_MM))["chi2"]
    assert told["dof"] == 332
    assert told["value"] / told["dof"] == pytest.approx(16.0, rel=0.3)
    assert told["p"] < 1e-3
    assert told["believable"] is False
    assert told["scale"] == pytest.approx(np.sqrt(told["value"] / told["dof"]))
    assert "times what the tracker states" in told["says"]


def test_what_was_left_out_tells_size_limit_and_reason() -> None:
    told = document(moved(CLEAN, (7, 50, 99), by_mm=2.0), loss=LossShape.CAUCHY)
    assert [left["shot"] for left in told["excluded"]] == [7, 50, 99]
    left = told["excluded"][0]
    assert set(left) == {"shot", "reason", "size_mm", "size_sigma", "limit_sigma"}
    assert left["size_sigma"] > left["limit_sigma"]
    assert (told["outliers"], told["loss"]["shape"]) == ("exclude", "cauchy")
    assert document(outliers=Outliers.KEEP)["excluded"] == []


def test_the_frame_is_told_for_points_alone() -> None:
    frame = document()["frame"]
    assert frame["x_mm"] == pytest.approx(2500.0, abs=0.5)
    assert frame["phi_deg"] == pytest.approx(np.degrees(2.1), abs=0.05)
    assert document(estimator=Estimator.DISTANCES)["frame"] is None


def test_priors_are_told_with_their_deviations() -> None:
    told = document(free=["arm0.x_mm"], prior=["arm0.x_mm=0.2", "plate_mm=0.5"])
    assert told["priors"] == {"arm0.x_mm": 0.2, "plate_mm": 0.5}
    assert told["known_by_priors_alone"] == [[f"arm{arm}.x_mm" for arm in range(4)]]
