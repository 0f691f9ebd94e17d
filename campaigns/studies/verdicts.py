"""Verdicts on perturbed campaigns: what identification says, beside what is true."""

from collections.abc import Iterator
from dataclasses import replace
from string import digits

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import CampaignError
from campaigns.estimation.rigid_transforms import fit_transform
from campaigns.evaluation.diagnostics import (
    CHANGE,
    COMMON_SCALE,
    EXTRAPOLATION,
    HOLD_OUT,
    KNOWN_LENGTH,
    LACK,
    SWAPPED,
)
from campaigns.identification.model_selection import select_model, terms_to_add
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import IdentificationResult
from campaigns.mechanisms.arms import AXIS_TILT
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.mechanisms.parameters import PARALLELOGRAM_SKEW
from campaigns.studies import study
from campaigns.studies.perturbations import KINDS, Perturbation, perturbation_of
from campaigns.studies.perturbed import BAR, PerturbedCampaign, perturbed_campaign

GROWTH = {("drift", "lengths"), ("drift", "growth")}
"""Kind and cause of the change that growth of the arms, or of all parts, is told as."""
NEAR_SHOTS = 5
"""By which the place of a step may be missed."""


def judged(task: study.StudyTask) -> tuple[study.CampaignRow, ...]:
    """Rows with a verdict each."""
    return tuple(
        _row(task.setup, number, truth)
        for number, truth in zip(task.numbers, task.truths, strict=True)
    )


def _row(setup: study.StudySetup, number: int, truth: Array) -> study.CampaignRow:
    perturbation = perturbation_of(setup.perturbation, number)
    effect = setup.perturbation.partition("=")[0]
    rng = np.random.default_rng([setup.seed, number, list(KINDS).index(effect)])
    try:
        verdict = judge(setup, perturbed_campaign(setup, perturbation, truth, rng))
        return study.CampaignRow(number, str(perturbation), verdict=verdict)
    except (NoSolution, CampaignError, np.linalg.LinAlgError) as error:
        return study.CampaignRow(number, str(perturbation), str(error))


def judge(setup: study.StudySetup, made: PerturbedCampaign) -> study.CampaignVerdict:
    """Verdict on a campaign, compared with the truth; raises as `identify` does."""
    nominal, workspace = setup.nominal, setup.options.workspace
    assert workspace is not None, "given to whatever is judged"
    space = nominal.mechanism.parameters
    models = setup.models or {setup.model.value: ParameterSelection(made.free)}
    options = replace(setup.options, known_lengths=(BAR,) * made.perturbation.known_length)
    terms = terms_to_add(space, setup.model)
    found = select_model(nominal, made.shots, dict(models), options, terms=terms)
    names = [name for name in found.free if name in space.of_robot]
    units, places = space.units(names), space.places(names)
    p, std = nominal.p.copy(), np.full(len(nominal.p), np.nan)
    p[places] = np.array([found.parameters[name].value for name in names]) * units
    stated = [found.parameters[name].std for name in names]
    std[places] = np.array([np.nan if each is None else each for each in stated]) * units
    errors = p - made.true.p
    if made.perturbation.sag_mm:  # taken up by what no robot has, which is right of positions alone
        std[space.places(space.transmission)] = np.nan
    known = np.isfinite(std)
    sigmas = np.abs(errors[known] / std[known])
    factor = found.coverage_factor_95 or np.nan
    outliers = _left_out(made, found)
    change = _change(made, found)
    missing, too_many = len(made.gross - outliers), len(outliers - made.gross)
    mechanism = nominal.mechanism
    if found.ripples is not None:
        mechanism = mechanism.with_ripples(found.ripples.value)
    doubts = tuple(each.name for each in found.doubts)
    model = next((each.name for each in found.models if each.kept), setup.model.value)
    base = max((name for name in models if model.startswith(name)), key=len, default=model)
    causes = (*_added(model.removeprefix(base)), *_causes(found))
    return study.CampaignVerdict(
        verdict=found.verdict,
        model=model,
        doubts=doubts,
        known=int(known.sum()),
        worst_sigmas=float(sigmas.max(initial=0.0)),
        square_over_variance=float(np.mean(sigmas**2)) if known.any() else None,
        covered=float(np.mean(sigmas <= factor)) if known.any() else None,
        square_over_least=float(np.mean((errors[space.places(made.free)] / made.least_std()) ** 2)),
        position_mm=position_error_mm(workspace, made.forward, Kinematics(mechanism, p)),
        stated_mm=None if found.position_std_mm is None else found.position_std_mm.mean,
        whole_mm=None if found.position_std_mm is None else found.position_std_mm.total_mean,
        change=change,
        signal=made.signal(),
        missing=missing,
        too_many=too_many,
        causes=causes,
        named=_named(made, found, change, causes, all_named=missing == too_many == 0),
        false_alarm=_false_alarm(made.perturbation, doubts, change, too_many),
    )


def position_error_mm(workspace: Array, forward: study.Forward, identified: Kinematics) -> float:
    """Root mean square over poses (N, t), after the best fit of the frame."""
    joints = identified.inverse(workspace)
    modelled, true = workspace[joints.found, :3], forward(joints.values[joints.found])
    left = true - fit_transform(modelled, true).apply(modelled)
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def _left_out(made: PerturbedCampaign, found: IdentificationResult) -> frozenset[int]:
    """Shots named as outliers; of a pair so named those that are wrong, or one of two good ones."""
    outliers = [each for each in found.excluded if each.is_outlier]
    named = {each.shot for each in outliers if each.shot is not None}
    for pair in {each.pair for each in outliers if each.shot is None}:
        both = [
            n for n, own in zip(made.shots.numbers, made.shots.pairs, strict=True) if own == pair
        ]
        named |= made.gross.intersection(both) or {both[0]}
    return frozenset(named)


def _change(made: PerturbedCampaign, found: IdentificationResult) -> str:
    """Rightness of a change that was named; empty where none was."""
    told = next((e for e in found.doubts if e.name == CHANGE and e.decision is not None), None)
    if told is None:
        return ""
    kind, cause = str(told.numbers["kind"]), str(told.numbers["cause"])
    if made.perturbation.drift or made.perturbation.warmth_ppm:
        wanted = {("drift", "drift")} if made.perturbation.drift == "frame" else GROWTH
        return "right" if (kind, cause) in wanted else "cause"
    if not cause:
        return "place"
    right_arm = kind == "frame" or made.true.mechanism.parameters[cause].arm == made.arm
    if kind != made.perturbation.step or not right_arm:
        return "cause"
    numbers = made.shots.numbers
    place = numbers.index(int(float(told.numbers["before_shot"])))
    return "right" if abs(place - numbers.index(made.first_after)) <= NEAR_SHOTS else "place"


def _named(
    made: PerturbedCampaign,
    found: IdentificationResult,
    change: str,
    causes: tuple[str, ...],
    *,
    all_named: bool,
) -> bool:
    """Naming of what happened; of a clean campaign naming nothing."""
    perturbation = made.perturbation
    names, scatter = {each.name for each in found.doubts}, found.robot_scatter
    if perturbation.step or perturbation.drift:
        return change == "right"
    if perturbation.gross:
        return all_named
    if perturbation.scale != 1.0:
        return bool(names & {COMMON_SCALE, KNOWN_LENGTH})
    if perturbation.measured < 1.0:
        return EXTRAPOLATION in names
    if perturbation.cause:
        return next(iter(causes), "") == perturbation.cause
    if perturbation.swapped:
        return SWAPPED in names
    if perturbation.beyond_the_model and not _described(made, found):
        return bool(names & {LACK, HOLD_OUT})
    if perturbation.backlash_deg:
        return scatter is not None and scatter.joint > 0.0
    if perturbation.scatter_mm:
        return scatter is not None and scatter.point_mm > 0.0
    return not any(each.affects_verdict for each in found.doubts) and all_named


def _added(terms: str) -> Iterator[str]:
    """Names of the causes whose terms a choice of models added, as `+ratio1`, the first first."""
    yield from (each.rstrip(digits) for each in terms.split("+")[1:])


def _causes(found: IdentificationResult) -> Iterator[str]:
    """Names of what the model was said to lack: growth, and causes of residuals."""
    for each in found.doubts:
        if each.name == CHANGE and (each.numbers["kind"], each.numbers["cause"]) in GROWTH:
            yield "warmth"
    yield from (str(each.numbers["cause"]) for each in found.doubts if each.name == LACK)


def _described(made: PerturbedCampaign, found: IdentificationResult) -> bool:
    """Presence of parameters for all that is imperfect."""
    space, perturbation = made.true.mechanism.parameters, made.perturbation
    fields = {space[name].field for name in found.free}
    has_skews, has_tilts = PARALLELOGRAM_SKEW in fields, AXIS_TILT in fields
    return (has_skews or not perturbation.rods_mm) and (has_tilts or not perturbation.axes_mrad)


def _false_alarm(
    perturbation: Perturbation, doubts: tuple[str, ...], change: str, too_many: int
) -> bool:
    """Naming of a change, a scale or a wrong shot where there is none."""
    drifts = bool(perturbation.drift or perturbation.warmth_ppm)
    changes = drifts or bool(perturbation.step or perturbation.swapped)
    # carriages know lengths: to them a tracker's scale is a ratio
    lacking = changes or perturbation.beyond_the_model or perturbation.scale != 1.0
    return (
        (bool(change) and not changes)
        or (COMMON_SCALE in doubts and perturbation.scale == 1.0 and not drifts)
        or (too_many > 0 and not changes and not perturbation.cause)
        or (KNOWN_LENGTH in doubts and perturbation.scale == 1.0)
        or (EXTRAPOLATION in doubts and perturbation.measured == 1.0)
        or (LACK in doubts and not (lacking or perturbation.gross))
    )
