"""Arms that grow while they are measured: named, and taken up where the shots say so."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from fake_cell import NOMINAL
from family_cases import Member
from identified_cases import NOISE_MM, SPACE, TRACKER_FROM_BASE, TRUTH, simulated, stating

from app.report.model_sections import warmth_in_words
from campaigns.arrays import Array
from campaigns.estimation.estimators import Model
from campaigns.identification import term_selection
from campaigns.identification.candidates import Candidate
from campaigns.identification.identify import identify
from campaigns.identification.model_selection import candidate_models, select_model, terms_to_add
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection, select_parameters
from campaigns.identification.result import IdentificationResult
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.shots.shots import Shots
from campaigns.shots.warmth import Course, part_passed


def warming(
    growth_ppm: float,
    *,
    degC: bool = False,
    evenly: bool = False,
    at_once: bool = False,
    parts: Sequence[str] = SPACE.arm_lengths,
) -> Shots:
    """Shots of a robot whose arms grow by so much to the last one, or from one day to the next."""
    rng, shots = np.random.default_rng(4), simulated(60, 20, 4)
    count = len(shots)
    shots = replace(shots.rows(rng.permutation(count)), numbers=tuple(range(count)))
    passed = np.linspace(0.0, 1.0, count)
    passed = passed if evenly else np.expm1(-3.0 * passed) / np.expm1(-3.0)
    passed = np.round(np.linspace(0.0, 1.0, count)) if at_once else passed
    longer = TRUTH.p.copy()
    longer[SPACE.places(parts)] *= 1.001
    cold, grown = (
        robot.forward(shots.joints).values_or_raise()[:, :3]
        for robot in (TRUTH, Kinematics(TRUTH.mechanism, longer))
    )
    moved = (1e-3 * growth_ppm * passed)[:, None] * (grown - cold)
    points = shots.points_in_tracker_mm + moved @ TRACKER_FROM_BASE.rotation.T
    points = points + NOISE_MM * rng.standard_normal(points.shape)
    temperatures = 20.0 + 10.0 * passed if degC else np.full(count, np.nan)
    warm = replace(shots, points_in_tracker_mm=points, part_temperature_degC=temperatures)
    return stating(warm)


def identified(shots: Shots) -> IdentificationResult:
    terms = terms_to_add(SPACE, Model.AUTO)
    return select_model(NOMINAL, shots, candidate_models(SPACE, Model.RODS), terms=terms)


@pytest.mark.slow
@pytest.mark.parametrize("degC", [False, True], ids=["by time", "by temperature"])
def test_growth_is_taken_up_and_told_with_its_uncertainty(degC: bool) -> None:
    found = identified(warming(200.0, degC=degC))
    kept = next(model for model in found.models if model.kept)
    arms = found.parameters["arm_expansion_ppm"]
    noise_mm2 = 2.0 * NOISE_MM**2  # of a measured distance, whatever the model
    left, right = (each.unseen_rms_mm**2 - noise_mm2 for each in (kept, found.models[0]))
    assert left < 0.25 * right
    assert abs(arms.value - (20.0 if degC else 200.0)) < 3.0 * arms.std
    assert found.warmth["source"] == ("temperature" if degC else "time")
    assert found.warmth["reference_degC"] == (20.0 if degC else None)
    says = warmth_in_words(found)
    assert says.startswith(f"arms grew by {arms.value:.3g} ± {2.0 * arms.std:.2g}")
    per, state = ("/°C", "at 20 °C") if degC else (" over the run", "at its end")
    assert f"ppm{per} (k = 2)" in says
    assert says.endswith(state)


@pytest.mark.slow
def test_growth_from_one_day_to_the_next_is_taken_up_where_temperatures_tell_it() -> None:
    forearms = SPACE.of_field("forearm_mm")  # which looks like a step of the tracker's stand
    found = identified(warming(200.0, degC=True, at_once=True, parts=forearms))
    assert found.warmth["source"] == "temperature"
    assert found.verdict == "pass"


@pytest.mark.slow
def test_growth_that_shows_among_drifts_alone_is_tried() -> None:
    shots = warming(50.0)
    assert identify(NOMINAL, shots, select_parameters(SPACE)).doubts == ()
    found = identified(shots)
    assert [each.name for each in found.models if each.kept] == ["standard+warmth"]


def test_a_time_constant_that_was_searched_has_its_part_in_the_uncertainty() -> None:
    shots, names = warming(200.0), ("arm_expansion_ppm", "arm1.arm_mm", "arm2.forearm_mm")
    known = select_parameters(SPACE, SPACE.thermal, names=SPACE.model)
    robot = Candidate("", known, NOMINAL, shots, IdentificationOptions())

    def fitted_by(course: Course) -> tuple[float, Array, Array]:
        candidate = robot.warmed(course).instead("", known)
        found = [candidate.found.parameters[name] for name in names]
        return candidate.bic, *np.array([[each.value, each.std] for each in found]).T

    searched = Course.by_time(part_passed(shots), 0.28)
    _, _, with_it = fitted_by(searched)
    price, _, without = fitted_by(replace(searched, errors=None))
    part = np.sqrt(with_it**2 - without**2)
    (slower, more, _), (faster, less, _) = (
        fitted_by(Course.by_time(part_passed(shots), 0.28 * factor)) for factor in (1.2, 1.0 / 1.2)
    )
    by_log = np.abs(more - less) / (2.0 * np.log(1.2))
    std_log = part / by_log
    assert np.ptp(std_log) < 0.1 * std_log.mean()
    # as far as the criterion, which goes with its square, says
    curvature = (slower + faster - 2.0 * price) / np.log(1.2) ** 2
    assert abs(std_log.mean() * np.sqrt(0.5 * curvature) - 1.0) < 0.15


def test_a_robot_that_stays_as_it_is_has_no_warmth() -> None:
    found = identified(warming(0.0))
    assert found.warmth is None
    assert warmth_in_words(found) == ""


def test_a_drift_is_named_as_growth_with_its_size_and_uncertainty() -> None:
    found = identify(NOMINAL, warming(-150.0, evenly=True), select_parameters(SPACE))
    (doubt,) = (each for each in found.doubts if each.name == "change-during-campaign")
    numbers = doubt.numbers
    assert (numbers["kind"], numbers["cause"]) == ("drift", "lengths")
    assert abs(numbers["ppm"] + 150.0) < 3.0 * numbers["std_ppm"] < 75.0
    told = f"{-numbers['ppm']:.3g} ± {2.0 * numbers['std_ppm']:.2g}"
    assert doubt.says.startswith(f"arms shrank by {told} ppm over the run, {numbers['size']:+.2g}")


RAILS = Member("i4l")


def on_rails(
    passed: Array,
    stand_mm: float = 0.0,
    gain_ppm: float = 0.0,
    member: Member = RAILS,
    **growth_ppm: float,
) -> Shots:
    """Shots of an I4L whose parts grow, or whose tracker's stand moves, as time passes."""
    robot, plain = member.nominal, simulated(60, 20, 4)
    poses = member.reachable_poses(robot, len(plain), seed=5)
    readings = robot.inverse(poses).values_or_raise()
    joints = (1.0 + 1e-6 * gain_ppm) * readings
    grown = robot.mechanism.grown(robot.parameters, growth_ppm)
    ends = (robot, Kinematics(robot.mechanism, grown.vector))
    cold, warm = (each.forward(joints).values_or_raise()[:, :3] for each in ends)
    moved = passed[:, None] * (warm - cold + np.array([stand_mm, 0.0, 0.0]))
    points = TRACKER_FROM_BASE.apply(cold + moved)
    points += NOISE_MM * np.random.default_rng(4).standard_normal(points.shape)
    approach = np.zeros_like(joints)
    named = tuple(range(len(plain)))
    order = np.random.default_rng(6).permutation(len(plain))
    shots = replace(plain.rows(order), numbers=named, joints=readings, approach=approach)
    return stating(replace(shots, points_in_tracker_mm=points))


def of_rails(shots: Shots) -> IdentificationResult:
    terms = terms_to_add(RAILS.space, Model.AUTO)
    return select_model(
        RAILS.nominal, shots, candidate_models(RAILS.space, Model.RODS), terms=terms
    )


TIME = np.linspace(0.0, 1.0, 160)
WARMING = np.expm1(-3.0 * TIME) / np.expm1(-3.0)


@pytest.mark.long
def test_a_scale_of_carriages_that_looks_like_sag_is_taken_up_where_no_stand_moved() -> None:
    grown = dict(zip(RAILS.space.thermal, (40.0, 20.0, 20.0), strict=True))
    found = of_rails(on_rails(WARMING, gain_ppm=100.0, **grown))
    assert next(each.name for each in found.models if each.kept) == "standard+ratio+warmth"
    assert (found.verdict, found.doubts) == ("pass", ())
    moved = of_rails(on_rails(np.round(TIME), stand_mm=0.1, gain_ppm=300.0))
    assert {"standard+ratio", "standard+warmth"} < {each.name for each in moved.models}
    assert moved.models[0].kept
    assert moved.obstacles[0] == "change-during-campaign"


@pytest.mark.slow
def test_growth_that_shows_beside_other_terms_alone_is_taken_up_then(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shows = term_selection._grows
    asked: list[bool] = []

    def later(best: Candidate) -> bool:
        asked.append(shows(best))
        return len(asked) > 1 and asked[-1]

    monkeypatch.setattr(term_selection, "_grows", later)
    found = of_rails(on_rails(WARMING, arm_expansion_ppm=150.0))
    assert asked[0]
    assert found.warmth is not None
    assert found.verdict == "pass"


def of_carriages(**error_ppm: float) -> tuple[Candidate, ParameterSelection]:
    """Standard model of a linear Delta whose parts grow, or whose pitches are off, and terms."""
    member = Member("linear-delta")
    shots = on_rails(np.expm1(-5.0 * TIME) / np.expm1(-5.0), member=member, **error_ppm)
    known, options = select_parameters(member.space), IdentificationOptions()
    standard = Candidate("", known, member.nominal, shots, options)
    return standard.instead("standard", known), terms_to_add(member.space, Model.AUTO)


def test_a_scale_that_comes_with_time_is_growth_of_the_rails_where_pitches_are_off_alike() -> None:
    parts = Member("linear-delta").space.thermal
    standard, terms = of_carriages(**dict(zip(parts, (30.0, 15.0, 15.0), strict=True)))
    pitches = term_selection._with_pitches(standard, terms)
    [grown] = term_selection._grown_alike(standard, pitches, terms)
    assert grown.name == "standard+warmth"
    assert grown.alike < pitches.bic < grown.bic, "its pitches each by itself cost more"
    found = grown.found.parameters["arm_expansion_ppm"]
    assert abs(found.value - 30.0) < 3.0 * found.std


def test_a_scale_that_is_off_all_the_time_is_no_growth() -> None:
    standard, terms = of_carriages(gain_ppm=30.0)
    assert not [*term_selection._grown_alike(standard, standard, terms)]
