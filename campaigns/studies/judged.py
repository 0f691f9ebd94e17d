"""Judged campaigns: what identification says of an affected campaign, beside what is true of it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import CampaignError
from campaigns.estimation.estimators import Model
from campaigns.estimation.rigid_transforms import fit_transform
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.doubts import CHANGE, COMMON_SCALE, HOLD_OUT, LACK
from campaigns.identification.model_selection import select_model
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import IdentificationResult
from campaigns.mechanisms.arms import AXIS_TILT
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.mechanisms.parameters import PARALLELOGRAM_SKEW
from campaigns.studies.affected import (
    AffectedCampaign,
    BeyondModel,
    Forward,
    affected_campaign,
    fitted_rows,
)
from campaigns.studies.effects import KINDS, Effect, effect_of
from campaigns.studies.study import StudySetup

WRONG_SIGMAS, WRONG_POSITION = 4.0, 2.0
"""How far off a parameter may be in σ, and positions in what is stated, under a "pass"."""
NEAR_SHOTS = 5
"""By which the place of a step may be missed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedCampaign:
    """Verdict on a campaign, and how far it is from the truth."""

    verdict: Decision
    model: str
    """The one that was kept."""
    doubts: tuple[str, ...]
    """Names."""
    known: int
    """Parameters with a σ."""
    worst_sigmas: float
    """Largest error of a parameter, in its σ; 0 without any σ."""
    square_over_variance: float
    """Mean of (error / σ)² over the parameters with a σ; NaN without any."""
    covered: float
    """Share of 95 % intervals that hold the truth; NaN without any σ."""
    square_over_least: float
    """Mean of (error / the least possible σ)² over all parameters."""
    position_mm: float
    """Real error of positions over the workspace, root mean square after the best fit."""
    stated_mm: float
    """The stated one; NaN where not known."""
    change: str
    """Whether a change was named, and rightly: empty, `right`, `place` or `cause`."""
    signal: float
    """Of a step or drift, in σ."""
    missing: int
    """Gross errors not named."""
    too_many: int
    """Good shots, or pairs of good shots, left out."""
    named: bool
    """Whether the effect's own cause was named."""
    false_alarm: bool
    """Whether a change, a scale or a wrong shot was named that is none."""

    @property
    def passed(self) -> bool:
        """Pass: the verdict is "pass"."""
        return self.verdict == "pass"

    def off(self, sigmas: float = WRONG_SIGMAS) -> bool:
        """Error of a parameter beyond so many of its σ."""
        return self.worst_sigmas > sigmas

    @property
    def worse(self) -> bool:
        """Positions worse than what is stated allows; not stated is not worse."""
        return self.position_mm > WRONG_POSITION * self.stated_mm

    @property
    def wrong(self) -> bool:
        """Wrong pass: the campaign passed and should not have."""
        return self.passed and (self.off() or self.worse)


@dataclass(frozen=True, slots=True, eq=False)
class EffectSetup:
    """Study of an effect, and what its campaigns are judged by."""

    study: StudySetup
    workspace: Array
    """Poses (N, t) at which positions are judged."""
    beyond_model: BeyondModel | None = None
    """Robots with unequal rods and tilted axes; None where nothing simulates them."""
    models: Mapping[str, ParameterSelection] | None = None
    """Models among which identification chooses, the standard one first; None: none but one."""
    model: Model = Model.STANDARD
    """Name of that one."""


@dataclass(frozen=True, slots=True, eq=False)
class EffectTask:
    """Campaigns of an effect, some of them, and the true parameter vectors of each, (C, G)."""

    setup: EffectSetup
    effect: str
    numbers: tuple[int, ...]
    truths: Array


@dataclass(frozen=True, slots=True)
class EffectOutcome:
    """Judged campaign, or why there is none."""

    number: int
    what: str
    """Size of the effect."""
    judged: JudgedCampaign | None
    failure: str = ""


def run_effects(task: EffectTask) -> tuple[EffectOutcome, ...]:
    """Outcomes of simulated campaigns; one that cannot be identified is an outcome too."""
    return tuple(
        _outcome(task, number, truth)
        for number, truth in zip(task.numbers, task.truths, strict=True)
    )


def _outcome(task: EffectTask, number: int, truth: Array) -> EffectOutcome:
    effect, setup = effect_of(task.effect, number), task.setup
    seed = [setup.study.seed, number, list(KINDS).index(task.effect)]
    rng = np.random.default_rng(seed)
    try:
        made = affected_campaign(setup.study, effect, truth, rng, setup.beyond_model)
        return EffectOutcome(number, str(effect), judge(setup, made))
    except (NoSolution, CampaignError, np.linalg.LinAlgError) as error:
        return EffectOutcome(number, str(effect), None, str(error))


def judge(setup: EffectSetup, made: AffectedCampaign) -> JudgedCampaign:
    """Verdict on a campaign, compared with the truth; raises as `identify` does."""
    study, space = setup.study, setup.study.nominal.mechanism.parameters
    options = replace(study.options, workspace=setup.workspace)
    models = setup.models or {setup.model.value: ParameterSelection(made.free)}
    found = select_model(study.nominal, made.shots, dict(models), options)
    names = [name for name in found.free if name in space.geometry]
    units, places = space.units(names), space.places(names)
    p, std = study.nominal.p.copy(), np.full(len(study.nominal.p), np.nan)
    p[places] = np.array([found.parameters[name].value for name in names]) * units
    stated = [found.parameters[name].std for name in names]
    std[places] = np.array([np.nan if each is None else each for each in stated]) * units
    errors = p - made.true.p
    known = np.isfinite(std)
    sigmas = np.abs(errors[known] / std[known])
    position, factor = found.position_std_mm, found.coverage_factor_95 or np.nan
    outliers = _left_out(made, found)
    change = _change(made, found)
    missing, too_many = len(made.gross - outliers), len(outliers - made.gross)
    doubts = tuple(each.name for each in found.doubts)
    return JudgedCampaign(
        verdict=found.verdict,
        model=next((each.name for each in found.models if each.kept), setup.model.value),
        doubts=doubts,
        known=int(known.sum()),
        worst_sigmas=float(sigmas.max(initial=0.0)),
        square_over_variance=float(np.mean(sigmas**2)) if known.any() else np.nan,
        covered=float(np.mean(sigmas <= factor)) if known.any() else np.nan,
        square_over_least=float(np.mean((errors[space.places(made.free)] / made.least_std()) ** 2)),
        position_mm=position_error_mm(
            setup.workspace, made.forward, Kinematics(study.nominal.mechanism, p)
        ),
        stated_mm=np.nan if position is None else position.mean,
        change=change,
        signal=made.signal(),
        missing=missing,
        too_many=too_many,
        named=_named(made.effect, found, change, all_named=missing == too_many == 0),
        false_alarm=_false_alarm(made.effect, doubts, change, too_many),
    )


def position_error_mm(workspace: Array, forward: Forward, identified: Kinematics) -> float:
    """Root mean square over poses (N, t), after the best fit of the frame."""
    joints = identified.inverse(workspace)
    modelled, true = workspace[joints.found, :3], forward(joints.values[joints.found])
    left = true - fit_transform(modelled, true).apply(modelled)
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def _left_out(made: AffectedCampaign, found: IdentificationResult) -> frozenset[int]:
    """Shots named as outliers; of a pair so named those that are wrong, or one of two good ones."""
    outliers = [each for each in found.excluded if each.is_outlier]
    named = {each.shot for each in outliers if each.shot is not None}
    for pair in {each.pair for each in outliers if each.shot is None}:
        both = [
            n for n, own in zip(made.shots.numbers, made.shots.pairs, strict=True) if own == pair
        ]
        named |= made.gross.intersection(both) or {both[0]}
    return frozenset(named)


def _change(made: AffectedCampaign, found: IdentificationResult) -> str:
    """Rightness of a change that was named; empty where none was."""
    told = next((each for each in found.doubts if each.name == CHANGE), None)
    if told is None:
        return ""
    kind, cause = str(told.numbers["kind"]), str(told.numbers["cause"])
    if made.effect.drift:
        wanted = "drift" if made.effect.drift == "frame" else "lengths"
        return "right" if (kind, cause) == ("drift", wanted) else "cause"
    right_arm = kind == "frame" or cause.startswith(f"arm{made.arm}.")
    if kind != made.effect.step or not right_arm:
        return "cause"
    numbers = [made.shots.numbers[row] for row in fitted_rows(made.shots).tolist()]
    place = numbers.index(int(float(told.numbers["before_shot"])))
    return "right" if abs(place - numbers.index(made.first_after)) <= NEAR_SHOTS else "place"


def _named(effect: Effect, found: IdentificationResult, change: str, *, all_named: bool) -> bool:
    """Naming of what happened; of a clean campaign naming nothing."""
    names, scatter = {each.name for each in found.doubts}, found.robot_scatter
    if effect.step or effect.drift:
        return change == "right"
    if effect.gross:
        return all_named
    if effect.scale != 1.0:
        return COMMON_SCALE in names
    if effect.beyond_the_model and not _described(effect, found):
        return bool(names & {LACK, HOLD_OUT})
    if effect.backlash_deg:
        return scatter is not None and scatter.joint > 0.0
    if effect.scatter_mm:
        return scatter is not None and scatter.point_mm > 0.0
    return not any(each.weighs for each in found.doubts) and all_named


def _described(effect: Effect, found: IdentificationResult) -> bool:
    """Presence of parameters for all that is imperfect."""
    fields = {name.rpartition(".")[2] for name in found.free}
    has_skews, has_tilts = PARALLELOGRAM_SKEW.name in fields, AXIS_TILT.name in fields
    return (has_skews or not effect.rods_mm) and (has_tilts or not effect.axes_mrad)


def _false_alarm(effect: Effect, doubts: tuple[str, ...], change: str, too_many: int) -> bool:
    """Naming of a change, a scale or a wrong shot where there is none."""
    changes = bool(effect.step or effect.drift)
    return (
        (bool(change) and not changes)
        or (COMMON_SCALE in doubts and effect.scale == 1.0 and not effect.drift)
        or (too_many > 0 and not changes)
    )
