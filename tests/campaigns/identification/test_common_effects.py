"""What no shot can tell: the tracker's own errors, known lengths, unmeasured space."""

from dataclasses import replace

import numpy as np
import pytest
from identified_cases import NOMINAL, doubt, found_with, noisy, simulated, workspace

from campaigns.errors import ShotsInvalid
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import TrackerScale
from campaigns.estimation.tracker_noise import (
    TrackerUncertainty,
    common_shifts_mm,
    distance_variance_mm2,
    point_covariance_mm2,
)
from campaigns.evaluation.diagnostics import (
    EXTRAPOLATION,
    KNOWN_LENGTH,
    UNKNOWN_POSITIONS,
    UNMEASURED,
)
from campaigns.settings.sections import KnownLengthConfig
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import COLUMNS, Shots

CLEAN = noisy(simulated(60, 20, seed=1), seed=1)
PPM = 1e-6
BAR = KnownLengthConfig(name="bar", length_mm=1000.0, std_mm=0.005)


def with_known_lengths(shots, ends_mm, instrument, rng):
    """Shots, and pairs of a known length between true points (M, 3), without the robot."""
    count, stated = len(ends_mm), point_covariance_mm2(ends_mm, instrument)
    noise = np.linalg.cholesky(stated) @ rng.standard_normal((count, 3, 1))
    pairs = max((pair for pair in shots.pairs if pair is not None), default=-1) + 1
    numbers = max(shots.numbers) + 1
    ends = replace(
        shots.rows(np.zeros(count, dtype=np.intp)),
        numbers=tuple(range(numbers, numbers + count)),
        purposes=(ShotSet.KNOWN_LENGTH,) * count,
        pairs=tuple(pairs + row // 2 for row in range(count)),
        joints=np.full((count, shots.joints.shape[1]), np.nan),
        points_in_tracker_mm=ends_mm + noise[:, :, 0],
        stated_covariance_mm2=stated,
    )

    def joined(name):
        own, added = getattr(shots, name), getattr(ends, name)
        return np.concatenate([own, added]) if isinstance(own, np.ndarray) else own + added

    return Shots(**{name: joined(name) for name in COLUMNS})


def bar_ends(count, rng):
    """Ends of a bar of a metre, put down anywhere about 2.5 m from the tracker."""
    middle = rng.uniform([2000.0, -500.0, -500.0], [3000.0, 500.0, 500.0], (count, 3))
    way = rng.standard_normal((count, 3))
    way *= 0.5 * BAR.length_mm / np.linalg.norm(way, axis=1, keepdims=True)
    return np.stack([middle - way, middle + way], axis=1).reshape(-1, 3)


def with_bars(data, places=5):
    rng = np.random.default_rng(3)
    return with_known_lengths(data, bar_ends(places, rng), TrackerUncertainty(), rng)


@pytest.mark.parametrize("estimator", list(Estimator))
@pytest.mark.parametrize("effect", common_shifts_mm(np.ones((1, 3)), TrackerUncertainty()))
def test_the_budget_foretells_what_a_common_error_does(effect, estimator):
    """The same shots with the error in them are identified anew."""
    instrument = TrackerUncertainty(scale=1e-5, axes_per_mm=1e-5, reflector_mm=0.02)
    shifts_mm = common_shifts_mm(CLEAN.points_in_tracker_mm, instrument)[effect]
    spoilt = replace(CLEAN, points_in_tracker_mm=CLEAN.points_in_tracker_mm + shifts_mm)
    before, after = (
        found_with(each, estimator=estimator, instrument=instrument) for each in (CLEAN, spoilt)
    )
    foretold = dict(zip(before.covariance.names, before.covariance.common[effect], strict=True))
    for name, change in foretold.items():
        moved = after.parameters[name].value - before.parameters[name].value
        assert moved == pytest.approx(change, abs=0.05 * before.parameters[name].std)


def test_positions_are_the_less_sure_the_less_the_tracker_is_and_both_parts_are_told():
    exact = TrackerUncertainty(scale=0.0, axes_per_mm=0.0, reflector_mm=0.0)
    told = [
        found_with(CLEAN, instrument=each, workspace=workspace()).position_std_mm
        for each in (exact, replace(exact, scale=100 * PPM))
    ]
    assert told[0].mean == pytest.approx(told[1].mean, rel=1e-9)
    assert {*told[0].common.values()} == {0.0}
    from_middle = workspace()[:, :3] - workspace()[:, :3].mean(axis=0)
    size_mm = np.linalg.norm(from_middle, axis=1).mean()
    assert told[1].common["scale"] == pytest.approx(100 * PPM * size_mm, rel=0.02)
    assert told[1].total_mean > 0.9 * told[1].common["scale"] > told[1].mean


@pytest.mark.parametrize(("scale", "least", "most"), [(0.0, 0.0, 0.01), (100 * PPM, 0.95, 1.0)])
def test_a_scale_of_100_ppm_is_found_by_a_bar_of_a_metre(scale, least, most):
    rng, known = np.random.default_rng(1), np.full(5, BAR.length_mm)
    first, second = np.arange(0, 10, 2), np.arange(1, 10, 2)
    said = []
    for _ in range(500):
        points = bar_ends(5, rng)
        covariance = point_covariance_mm2(points, TrackerUncertainty())
        variance = distance_variance_mm2(points, covariance, first, second)
        own = BAR.std_mm * rng.standard_normal()
        noise = np.sqrt(variance) * rng.standard_normal(5) + own
        measured = (1.0 + scale) * known + noise
        together = np.diag(variance) + BAR.std_mm**2
        test = TrackerScale.of(measured - known, known, together, TrackerUncertainty().scale)
        said.append(not test.believable)
    assert least <= np.mean(said) <= most


def test_known_lengths_contradict_a_tracker_whose_scale_is_off():
    data = with_bars(CLEAN)
    good = found_with(data, known_lengths=(BAR,))
    assert good.verdict == "pass"
    assert abs(good.known_lengths.scale.share) < 4.0 * good.known_lengths.scale.std < 60 * PPM
    off = found_with(
        replace(data, points_in_tracker_mm=(1.0 + 100 * PPM) * data.points_in_tracker_mm),
        known_lengths=(BAR,),
    )
    assert off.verdict == "fail"
    assert doubt(off, KNOWN_LENGTH).numbers["ppm"] == pytest.approx(100.0, abs=30.0)
    assert "the tracker's scale is off by +" in doubt(off, KNOWN_LENGTH).says
    assert [each.residual_mm for each in off.known_lengths.lengths] == pytest.approx(
        [0.1] * 5, abs=0.1
    )


def test_one_wrong_known_length_is_named_and_no_scale():
    data = with_bars(CLEAN)
    points = data.points_in_tracker_mm.copy()
    points[-3] += 1.0
    found = found_with(replace(data, points_in_tracker_mm=points), known_lengths=(BAR,))
    assert "contradict each other" in doubt(found, KNOWN_LENGTH).says
    assert "bar, pair 83, is off by" in doubt(found, KNOWN_LENGTH).says
    assert found.verdict == "fail"


def test_a_known_length_makes_a_coarse_tracker_surer():
    coarse = TrackerUncertainty(scale=300 * PPM)
    data = with_bars(CLEAN)
    without = found_with(CLEAN, instrument=coarse, workspace=workspace()).position_std_mm
    known = found_with(
        data, instrument=coarse, workspace=workspace(), known_lengths=(BAR,)
    ).position_std_mm
    assert known.common["scale"] < 0.1 * without.common["scale"]
    assert known.mean == pytest.approx(without.mean, rel=1e-9)


def test_a_pair_whose_length_nobody_tells_is_refused():
    data = with_bars(CLEAN, places=2)
    with pytest.raises(ShotsInvalid, match="pair 81 is of the set known-length"):
        found_with(data, known_lengths=(BAR.model_copy(update={"pairs": (80,)}),))


def test_a_known_length_that_nobody_measured_is_told_and_decides_nothing():
    other = BAR.model_copy(update={"name": "other", "pairs": (999,)})
    found = found_with(with_bars(CLEAN), known_lengths=(BAR, other))
    assert doubt(found, UNMEASURED).says.startswith("of known_lengths other was not measured")
    assert found.verdict == "pass"


def test_a_pass_names_the_region_that_it_is_for():
    found = found_with(CLEAN, workspace=workspace())
    assert found.verdict == "pass"
    assert found.region.beyond <= 0.05
    assert found.reasons[-1].startswith("valid for ")
    assert set(found.region.ends) == {"x_mm", "y_mm", "z_mm", "theta_deg"}


def test_without_any_uncertainty_of_positions_nothing_is_decided():
    """The identified robot takes none of these poses: above its base, where no forearm reaches."""
    out_of_reach = workspace() + np.array([0.0, 0.0, 5000.0, 0.0])
    found = found_with(CLEAN, workspace=out_of_reach)
    assert found.position_std_mm is None
    assert found.verdict == "not decided"
    says = doubt(found, UNKNOWN_POSITIONS).says
    assert "less than 10 % of the poses of its workspace" in says
    assert says in found.reasons


def test_a_workspace_of_which_three_quarters_were_never_measured_is_not_decided():
    many = noisy(simulated(200, 80, seed=1), seed=1)
    x, y = NOMINAL.forward(many.joints).values[:, :2].T
    rows = np.flatnonzero((x > 0.0) & (y > -50.0))
    own = [np.intersect1d(rows, many.rows_of(each)) for each in set(many.purposes)]
    kept = many.rows(np.concatenate([each[: len(each) // 2 * 2] for each in own]))
    quarter = replace(kept, pairs=tuple(row // 2 for row in range(len(kept))))
    found = found_with(quarter, workspace=workspace())
    assert doubt(found, EXTRAPOLATION).numbers["beyond"] > 0.05
    assert found.verdict == "not decided"
    assert found.region.ends["x_mm"][1] > 300.0
