"""What the campaigns of a study share, which of them make a task, and what comes of each."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import islice
from typing import TypeVar

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator, Model
from campaigns.estimation.observability import observability, unobservable_combinations
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.estimation.rigid_transforms import Transform
from campaigns.evaluation.decision import Decision
from campaigns.identification.model_selection import select_geometry
from campaigns.identification.observations import Inputs, distance_observations, point_observations
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import REFLECTOR_CONSTANT, ParameterSelection
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, poses_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.studies.perturbations import Perturbation, sizes_of
from campaigns.version import VERSION

Value = TypeVar("Value")
WRONG_SIGMAS, WRONG_POSITION = 4.0, 2.0
"""How far off a parameter may be in σ, and positions in what is stated, under a "pass"."""

MANY_CAMPAIGNS = 1000
"""Of a study, from which compiled loops are loaded: that takes as long as a few hundred without."""
CAMPAIGNS_AT_ONCE, COMPILED_AT_ONCE = 100, 400
"""Fitted together, and by compiled loops, which keep less: more share what any fit costs, and fill
the memory."""

Forward = Callable[[Array], Array]
"""From joints (N, n) to a robot's points in the base frame, (N, 3)."""


Noise = Callable[[Array, np.random.Generator], Array]
"""Errors (N, 3), mm, of an instrument of one's own at points (N, 3) in its frame."""
ForwardInTime = Callable[[Array, Array | float], Array]
"""The same by how much of the campaign has passed, (N,) from 0 to 1."""

BeyondModel = Callable[[Kinematics, Perturbation, np.random.Generator], tuple[ForwardInTime, Array]]
"""Source of robots with imperfect parts, each like a true one with perfect parts.

Gives its points, and its parameters at the end (P,), skews, tilts and transmission too, in the
datum of that robot.
"""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StudySetup:
    """Setup that all campaigns of a study share.

    `shots` are those of the plan, fitted and unseen; where their points are each campaign draws.
    """

    nominal: Kinematics
    shots: Shots
    free: tuple[str, ...]
    options: IdentificationOptions
    """Options of the fits; their instrument is what the simulated tracker states, and has.

    Their workspace is where positions are judged when something goes wrong.
    """
    tracker_from_base: Transform
    seed: int
    perturbation: str = ""
    """Name of what goes wrong: all of `identify` judges then. Nothing goes wrong without one."""
    beyond_model: BeyondModel | None = None
    """None where nothing simulates such robots."""
    misread: Callable[[Array, Perturbation], Array] | None = None
    """Points (N, 3) as a faulty tracker reads them, in its frame; None: not simulated."""
    noise: Noise | None = None
    """None: as the options' instrument states it."""
    models: Mapping[str, ParameterSelection] | None = None
    """Models among which identification chooses, the standard one first; None: none but one."""
    model: Model = Model.STANDARD
    """Name of that one."""
    is_long: bool = False
    """Whether there are so many campaigns that loading compiled loops pays."""

    @property
    def at_once(self) -> int:
        """Number of campaigns that are fitted together; loops are compiled of level plates."""
        is_level = set(self.free) <= set(self.nominal.mechanism.parameters.names)
        is_compiled = self.is_long and is_level and find_spec("numba") is not None
        return COMPILED_AT_ONCE if is_compiled else CAMPAIGNS_AT_ONCE

    @property
    def fitted(self) -> Shots:
        """Shots that are identified from."""
        return self.shots.of_set(ShotSet.IDENTIFICATION)

    @property
    def pairs(self) -> int:
        """Number of pairs to identify from."""
        return len(self.shots.whole_pairs(ShotSet.IDENTIFICATION).rows)

    @property
    def estimator(self) -> Estimator:
        """Estimator of the fits."""
        return self.options.estimator

    @property
    def dof(self) -> int:
        """Numbers measured less numbers sought; of points three a shot, and a frame's six more."""
        if self.estimator is Estimator.POINTS:
            return 3 * len(self.fitted) - len(self.free) - FRAME_COLUMNS
        return self.pairs - len(self.free)

    def digest(self, truth: str) -> str:
        """Twelve characters that differ between studies; `truth` says how robots are drawn."""
        shots, frame, how = self.shots, self.tracker_from_base, self.options
        pairs = [-1 if pair is None else pair for pair in shots.pairs]
        parts = [self.nominal.p, frame.rotation, frame.translation_mm, shots.joints]
        parts.append(np.array(pairs, dtype=np.float64))
        sets = [purpose.value for purpose in shots.purposes]
        words = (how.estimator.value, how.outliers.value, how.weights.value)
        asked = (*words, how.robust_loss, how.instrument)
        settings = [truth, self.nominal.mechanism.name, sets, self.free, *asked, self.seed]
        if self.perturbation:
            settings += [self.perturbation, sizes_of(self.perturbation), self.model.value]
        chain, space = self.nominal.mechanism, self.nominal.mechanism.parameters
        if chain.platform.at_point != chain.seen_from(None).platform.at_point:
            settings.append(chain.platform.at_point)  # the reflector's half, if it was said
        tilts = {*self.free} & {*space.extensions} or self.nominal.p[len(space.names) :].any()
        if (self.perturbation or tilts) and chain.plate != chain.typical_plate(self.nominal.p):
            settings.append(chain.plate)  # perfect parts don't tell how it is made
        if chain.rate:
            settings.append(chain.rate)
        if how.workspace is not None:
            parts.append(how.workspace)
        text = repr((*settings, VERSION))  # another version may find other numbers
        hashed = hashlib.sha256(text.encode("utf-8"))
        for part in parts:
            hashed.update(np.ascontiguousarray(part).tobytes())
        return hashed.hexdigest()[:12]


@dataclass(frozen=True, slots=True, eq=False)
class StudyTask:
    """Campaigns of a study, some of them, and the true parameter vectors of each, (C, G)."""

    setup: StudySetup
    numbers: tuple[int, ...]
    truths: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignEstimate:
    """Estimate of one campaign's free parameters, in file units (mm, deg): it is to be read."""

    errors: tuple[float, ...]
    """Identified minus true, (F,)."""
    std: tuple[float, ...]
    """Standard deviations as the estimator states them, (F,)."""
    bound: tuple[float, ...]
    """The least standard deviation that its data allow (Cramér and Rao), at the truth, (F,)."""
    unseen_mean_mm: float | None = None
    """Mean error of distances never fitted, against the true robot; None without such pairs."""
    unseen_max_mm: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignVerdict:
    """Verdict on a campaign, and how far it is from the truth; None where no σ is known."""

    verdict: Decision
    model: str
    """The one that was kept."""
    doubts: tuple[str, ...]
    """Names."""
    known: int
    """Parameters with a σ."""
    worst_sigmas: float
    """Largest error of a parameter, in its σ; 0 without any σ."""
    square_over_variance: float | None = None
    """Mean of (error / σ)² over the parameters with a σ."""
    covered: float | None = None
    """Share of 95 % intervals that hold the truth."""
    square_over_least: float
    """Mean of (error / the least possible σ)² over all parameters."""
    position_mm: float
    """Real error of positions over the workspace, root mean square after the best fit."""
    stated_mm: float | None = None
    """The stated one, of what differs from shot to shot."""
    whole_mm: float | None = None
    """The same with what all shots have in common; None in older tables."""
    change: str
    """Whether a change was named, and rightly: empty, `right`, `place` or `cause`."""
    signal: float
    """Of a step or drift, in σ."""
    missing: int
    """Gross errors not named."""
    too_many: int
    """Good shots, or pairs of good shots, left out."""
    causes: tuple[str, ...] = ()
    """Names of what the model was said to lack, the most significant first."""
    named: bool
    """Whether the perturbation's own cause was named."""
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
        stated_mm = self.whole_mm or self.stated_mm
        return stated_mm is not None and self.position_mm > WRONG_POSITION * stated_mm

    @property
    def falsely_accepted(self) -> bool:
        """Whether the campaign passed and should not have."""
        return self.passed and (self.off() or self.worse)


@dataclass(frozen=True, slots=True)
class CampaignRow:
    """Campaign's outcome: an estimate, a verdict if something went wrong, or why there is neither.

    Every study's table has such rows.
    """

    campaign: int
    """Number."""
    what: str = ""
    """Size of what goes wrong."""
    failure: str = ""
    estimate: CampaignEstimate | None = None
    verdict: CampaignVerdict | None = None

    @property
    def key(self) -> int:
        """Order in a table."""
        return self.campaign


def chunks(values: Iterable[Value], most: int) -> Iterator[tuple[Value, ...]]:
    """The values in their order, so many at a time; the last ones may be fewer."""
    left = iter(values)
    while some := tuple(islice(left, most)):
        yield some


def planned_shots(shots: Sequence[PlannedShot]) -> Shots:
    """Shots of plans before anything is measured: their points are not numbers yet.

    Pairs are numbered anew, for those of two plans may have the same numbers.
    """
    joints, count = joints_of(shots), len(shots)
    places: dict[tuple[ShotSet, int], int] = {}
    return Shots(
        numbers=tuple(range(count)),
        purposes=tuple(shot.purpose for shot in shots),
        pairs=tuple(
            None if shot.pair is None else places.setdefault((shot.purpose, shot.pair), len(places))
            for shot in shots
        ),
        joints=joints,
        points_in_tracker_mm=np.full((count, 3), np.nan),
        stated_covariance_mm2=np.full((count, 3, 3), np.nan),
        approach=np.zeros_like(joints),
        commanded=poses_of(shots),
        measured_utc=("",) * count,
        temperature_degC=np.full(count, np.nan),
    )


def studied_parameters(
    space: ParameterSpace, model: Model, freed: Sequence[str], fixed: Sequence[str]
) -> tuple[str, ...]:
    """Names of the geometry's parameters that all campaigns find; raises `OptionsInvalid`."""
    if REFLECTOR_CONSTANT in freed:
        raise OptionsInvalid(
            f"--free {REFLECTOR_CONSTANT}: no fit of a study finds it",
            remedy="leave it out; whether it is named is told by --effects reflector-constant",
        )
    return select_geometry(space, model, freed, fixed)


def fitted_rows(shots: Shots) -> Index:
    """Rows of the shots to identify from."""
    return np.flatnonzero([each is ShotSet.IDENTIFICATION for each in shots.purposes])


def indistinguishable(setup: StudySetup) -> list[tuple[str, ...]]:
    """Free parameters that move together without any effect on what the nominal robot's shots tell.

    Raises `NoSolution` when the nominal robot cannot take them.
    """
    poses = setup.nominal.forward(setup.shots.joints).values_or_raise()
    exact_mm = setup.tracker_from_base.apply(poses[:, :3])
    shots = replace(setup.shots, points_in_tracker_mm=exact_mm)
    selection = ParameterSelection(setup.free)
    inputs = Inputs.of(setup.nominal, shots, selection, setup.options)
    of_points = setup.options.estimator is Estimator.POINTS
    problem = (point_observations if of_points else distance_observations)(inputs).problem
    seen = observability(problem.jacobian(problem.start()))
    return unobservable_combinations(seen, setup.free)
