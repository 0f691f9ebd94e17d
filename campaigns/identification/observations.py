"""Observations of a fit: shots or pairs that can be used, with the problem that they pose."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.estimation.estimators import Estimator, Weights
from campaigns.estimation.least_squares import LeastSquaresProblem, Priors
from campaigns.estimation.residuals import (
    DistanceResiduals,
    PointResiduals,
    PositionModel,
)
from campaigns.estimation.rigid_transforms import Transform, fit_transform
from campaigns.estimation.tracker_noise import (
    TrackerUncertainty,
    distance_variance_mm2,
    pooled_variance_mm2,
)
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import Excluded
from campaigns.mechanisms.mechanism import Kinematics, KinematicSolution
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from drivers.values import is_positive_definite


@dataclass(frozen=True, slots=True, eq=False)
class UsablePairs:
    """Whole pairs of a set, rows (M, 2), at both shots of which the robot can be assembled."""

    rows: Index
    excluded: tuple[Excluded, ...]


def usable_pairs(nominal: KinematicSolution, data: Shots, purpose: ShotSet) -> UsablePairs:
    """Those of a set, and the others by name, from the nominal robot's poses at all shots."""
    found = nominal.found
    pairs = data.whole_pairs(purpose)
    halves = tuple(
        Excluded(f"shot {data.numbers[row]} has no partner", pair=pair_of(data, row))
        for row in pairs.halves
    )
    rows = pairs.rows
    whole = found[rows].all(axis=1)
    return UsablePairs(rows[whole], halves + without_assembly(data, rows[~whole], found, "nominal"))


def of_one_session(
    data: Shots, usable: UsablePairs, sessions: Mapping[int, int] | None
) -> UsablePairs:
    """Pairs both of whose shots were taken in one session, where sessions have their own frames."""
    if sessions is None:
        return usable
    own = session_of(data, sessions)
    together = own[usable.rows[:, 0]] == own[usable.rows[:, 1]]
    apart = tuple(
        Excluded("its shots are of two sessions", pair=pair_of(data, row))
        for row in usable.rows[~together, 0].tolist()
    )
    return UsablePairs(usable.rows[together], usable.excluded + apart)


def session_of(data: Shots, sessions: Mapping[int, int] | None) -> Index:
    """Session of each shot, (N,), from those by number; 0 of one that is in none."""
    own = [(sessions or {}).get(number, 0) for number in data.numbers]
    return np.array(own, dtype=np.intp)


def without_assembly(data: Shots, pairs: Index, found: Mask, which: str) -> tuple[Excluded, ...]:
    """Exclusions of pairs (M, 2): at which of their shots there is no assembly."""
    return tuple(
        Excluded(
            f"the {which} robot cannot be assembled at the joints of shot {data.numbers[row]}",
            pair=pair_of(data, row),
        )
        for pair in pairs.tolist()
        for row in pair
        if not found[row]
    )


def pair_of(data: Shots, row: int) -> int:
    """The number of a shot's pair."""
    pair = data.pairs[row]
    assert pair is not None, "only shots of pairs are asked for"
    return pair


Kind = Literal["shots", "pairs"]
COORDINATES = 3
FEWEST_OF_A_SESSION = 4
SURELY = 1e-9
"""Least eigenvalue over the size of a matrix that is positive definite beyond rounding."""
SHORTEST_MM = 1.0
"""Of a distance: from shots at one place nothing is learnt."""


class Observations(Protocol):
    """The shots or pairs of a fit, one a block."""

    @property
    def kind(self) -> Kind:
        """Name of the blocks, in the plural."""
        ...

    @property
    def numbers(self) -> tuple[int, ...]:
        """Of the shots or pairs, one a block."""
        ...

    @property
    def problem(self) -> LeastSquaresProblem:
        """Problem to be solved; its first unknowns are the free parameters."""
        ...

    @property
    def model(self) -> PositionModel:
        """Of the shots."""
        ...

    @property
    def excluded(self) -> tuple[Excluded, ...]:
        """Exclusions of what could not be used at all."""
        ...

    def excluded_for(self, block: int, reason: str) -> Excluded:
        """The shot or pair of a block, without the size of its misfit."""
        ...

    def misfits_mm(self, x: Array) -> Array:
        """Modelled minus measured at the unknowns x, (blocks, 1) or (blocks, 3)."""
        ...

    def nominal_misfits_mm(self, kept: Mask) -> Array:
        """The same with the nominal parameters and, if any, the frame that suits them best."""
        ...

    def tracker_from_base(self, x: Array) -> tuple[Transform, ...]:
        """Frames at the unknowns x, one a session; none where no frame is estimated."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class DistanceObservations:
    """Distances of pairs, all of one weight, as in the paper (eq. 19)."""

    problem: LeastSquaresProblem
    distances: DistanceResiduals
    numbers: tuple[int, ...]
    excluded: tuple[Excluded, ...]

    @property
    def kind(self) -> Kind:
        """Pairs."""
        return "pairs"

    @property
    def model(self) -> PositionModel:
        """Of the shots of the pairs."""
        return self.distances.model

    def excluded_for(self, block: int, reason: str) -> Excluded:
        """The pair."""
        return Excluded(reason, pair=self.numbers[block])

    def misfits_mm(self, x: Array) -> Array:
        """Modelled minus measured distances, (pairs, 1)."""
        return self.distances.errors_mm(x)[:, None]

    def nominal_misfits_mm(self, kept: Mask) -> Array:
        """Of the kept pairs."""
        return self.misfits_mm(self.model.nominal)[kept]

    def tracker_from_base(self, x: Array) -> tuple[Transform, ...]:  # noqa: ARG002 - as points
        """Distances know of no frame."""
        return ()


@dataclass(frozen=True, slots=True, eq=False)
class PointObservations:
    """Coordinates of every shot, weighed by its covariance."""

    problem: LeastSquaresProblem
    points: PointResiduals
    numbers: tuple[int, ...]
    excluded: tuple[Excluded, ...]
    stated_mm2: Array
    """Covariances that the tracker states, (N, 3, 3)."""
    order: Index
    """Rows as they were measured."""

    @property
    def kind(self) -> Kind:
        """Shots."""
        return "shots"

    @property
    def model(self) -> PositionModel:
        """Of the shots."""
        return self.points.model

    def excluded_for(self, block: int, reason: str) -> Excluded:
        """The shot."""
        return Excluded(reason, shot=self.numbers[block])

    def misfits_mm(self, x: Array) -> Array:
        """In the tracker's axes, (shots, 3)."""
        return self.points.modelled_mm(x) - self.points.points_in_tracker_mm

    def nominal_misfits_mm(self, kept: Mask) -> Array:
        """Of the kept shots, with a frame fitted to them."""
        positions = self.model.positions_mm(self.model.nominal)[kept]
        measured = self.points.points_in_tracker_mm[kept]
        sessions = self.points.sessions
        own = np.zeros(len(positions), dtype=np.intp) if sessions is None else sessions[kept]
        misfits = np.empty_like(measured)
        for each in np.unique(own).tolist():
            rows = own == each
            frame = fit_transform(positions[rows], measured[rows])
            misfits[rows] = frame.apply(positions[rows]) - measured[rows]
        return misfits

    def tracker_from_base(self, x: Array) -> tuple[Transform, ...]:
        """The frames that x stands for, one a session."""
        return self.points.session_frames(x)


def observations(
    nominal: Kinematics, data: Shots, selection: ParameterSelection, options: IdentificationOptions
) -> Observations:
    """Observations that the estimator asked for makes of the identification shots.

    Raises `ShotsMissing` for fewer measurements than unknowns and `ShotsInvalid` for a covariance
    that is none.
    """
    if options.estimator is Estimator.DISTANCES:
        return distance_observations(nominal, data, selection, options)
    return point_observations(nominal, data, selection, options)


def position_model(
    nominal: Kinematics,
    data: Shots,
    rows: Index,
    free: tuple[str, ...],
    near: Array | None = None,
) -> PositionModel:
    """Positions of some shots by the parameters to be found, from poses (N, t) near theirs."""
    joints, approach = data.joints[rows], data.approach[rows]
    places = nominal.mechanism.parameters.places(free)
    return PositionModel(nominal, places, joints, near, approach=approach)


def distance_observations(
    nominal: Kinematics,
    data: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions,
    *,
    at_nominal: KinematicSolution | None = None,
    covariance_mm2: Mapping[int, Array] | None = None,
    left_out: frozenset[int] = frozenset(),
) -> DistanceObservations:
    """Distances of the identification pairs, without the shots that are left out by number.

    `at_nominal` are the nominal robot's poses at all shots, where they are known already.
    Weighed by the covariances (3, 3) of the shots' points, by number; as the tracker states them,
    and all alike where that is asked for, without any. Raises as `observations` does.
    """
    solution = at_nominal or nominal.forward(data.joints)
    usable = of_one_session(
        data, usable_pairs(solution, data, ShotSet.IDENTIFICATION), options.session_of
    )
    apart = data.measured_distances_mm(usable.rows) >= SHORTEST_MM
    together = tuple(
        Excluded("its two shots are at one place", pair=pair_of(data, row))
        for row in usable.rows[~apart, 0].tolist()
    )
    rows, excluded, free = usable.rows[apart], usable.excluded + together, selection.free
    numbers = np.array(data.numbers)[rows]
    wrong = np.isin(numbers, sorted(left_out))
    rows = rows[~wrong.any(axis=1)]
    wanted = max(1, len(free) - len(selection.priors))
    if len(rows) < wanted:
        raise ShotsMissing(
            f"{len(rows)} pairs{_left_out(excluded)} cannot give {len(free)} parameters",
            remedy=f"measure at least {wanted} pairs, better 60; or hold parameters",
        )
    near = solution.values[rows.ravel()]
    model = position_model(nominal, data, rows.ravel(), free, near)
    first, second = np.arange(rows.size).reshape(rows.shape).T
    covariance = _stated(data, rows.ravel(), options.instrument)
    if covariance_mm2 is not None:
        covariance = np.array([covariance_mm2[data.numbers[row]] for row in rows.ravel().tolist()])
    points = data.points_in_tracker_mm[rows.ravel()]
    variance = distance_variance_mm2(points, covariance, first, second)
    stated = np.isfinite(data.stated_covariance_mm2[rows.ravel()]).any()
    if options.weights is Weights.EQUAL or not stated:
        variance = np.full(len(rows), pooled_variance_mm2(variance))
    whitening = np.sqrt(1.0 / variance)
    measured = data.measured_distances_mm(rows)
    distances = DistanceResiduals(model, first, second, measured, whitening)
    problem = LeastSquaresProblem(distances, 1, _priors(nominal, selection, model))
    pairs = tuple(pair_of(data, row) for row in rows[:, 0].tolist())
    return DistanceObservations(problem, distances, pairs, excluded)


def point_observations(
    nominal: Kinematics,
    data: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions,
    *,
    at_nominal: KinematicSolution | None = None,
) -> PointObservations:
    """Coordinates of the identification shots, weighed as the tracker states; raises likewise.

    `at_nominal` are the nominal robot's poses at all shots, where they are known already.
    """
    solution = at_nominal or nominal.forward(data.joints)
    rows = np.flatnonzero([purpose is ShotSet.IDENTIFICATION for purpose in data.purposes])
    found = solution.found[rows]
    excluded = tuple(
        Excluded("the nominal robot cannot be assembled at its joints", shot=data.numbers[row])
        for row in rows[~found].tolist()
    )
    rows = rows[found]
    _check_coordinates(len(rows), nominal, selection, excluded)
    near = solution.values[rows]
    model = position_model(nominal, data, rows, selection.free, near)
    measured, stated = data.points_in_tracker_mm[rows], _stated(data, rows, options.instrument)
    try:
        sessions = _sessions(data, rows, options)
        points = PointResiduals.from_points(model, measured, stated, sessions)
    except ValueError as error:
        raise ShotsMissing(
            f"{len(rows)} shots fix no frame: {error}", remedy="measure all over the workspace"
        ) from error
    problem = LeastSquaresProblem(points, COORDINATES, _priors(nominal, selection, model))
    shots = tuple(data.numbers[row] for row in rows.tolist())
    order = data.rows(rows).order_of_time()
    return PointObservations(problem, points, shots, excluded, stated, order)


def _sessions(data: Shots, rows: Index, options: IdentificationOptions) -> Index | None:
    """Session of each of some shots, from 0 without gaps, (N,); None where all are of one.

    Raises `ShotsMissing` for a session whose shots fix no frame.
    """
    if options.session_of is None:
        return None
    own = session_of(data, options.session_of)[rows]
    _, found, counts = np.unique(own, return_inverse=True, return_counts=True)
    if len(counts) < 2:
        return None
    if counts.min() < FEWEST_OF_A_SESSION:
        raise ShotsMissing(
            f"a session has {counts.min()} shots to identify from, which fix no frame of its own",
            remedy=f"leave --sessions out, or measure at least {FEWEST_OF_A_SESSION} shots in each",
        )
    return np.asarray(found, dtype=np.intp)


def _check_coordinates(
    shots: int, nominal: Kinematics, known: ParameterSelection, excluded: tuple[Excluded, ...]
) -> None:
    """Refusal of fewer shots than can tell what is free; a prior is worth a coordinate."""
    priors = {prior.name for prior in known.priors}
    unknown = [name for name in known.free if name not in priors]
    least = nominal.mechanism.minimum_shots(unknown)
    if shots >= least:
        return
    raise ShotsMissing(
        f"{shots} shots{_left_out(excluded)} are too few for {len(known.free)} parameters and the "
        "tracker's frame",
        remedy=f"measure at least {least} shots, better 60; or hold parameters",
    )


def _left_out(excluded: tuple[Excluded, ...]) -> str:
    return f" ({len(excluded)} left out)" if excluded else ""


def _priors(nominal: Kinematics, known: ParameterSelection, model: PositionModel) -> Priors:
    """About the nominal values, in mm and rad."""
    names = tuple(prior.name for prior in known.priors)
    places = np.array([known.free.index(name) for name in names], dtype=np.intp)
    std = np.array([prior.std for prior in known.priors])
    std = std * nominal.mechanism.parameters.units(names)
    return Priors(places, model.nominal[places], std)


def _stated(data: Shots, rows: Index, instrument: TrackerUncertainty) -> Array:
    """Covariances (N, 3, 3) of some shots; raises `ShotsInvalid` naming the first that is none."""
    covariance = data.covariance_mm2(instrument)[rows]
    if _all_positive_definite(covariance):
        return covariance
    for row, matrix in zip(rows.tolist(), covariance.tolist(), strict=True):
        if not is_positive_definite(matrix):
            raise ShotsInvalid(
                f"shot {data.numbers[row]}: its covariance is not positive definite",
                remedy="import the shots again with the file's sxx … szz corrected or left empty, "
                "or measure that shot again",
            )
    return covariance


def _all_positive_definite(covariance: Array) -> bool:
    """Positive definiteness of all of (N, 3, 3), surely and at once; by far the usual case."""
    try:
        least = np.linalg.eigvalsh(covariance)[:, 0] if np.isfinite(covariance).all() else None
    except np.linalg.LinAlgError:
        return False
    size = np.abs(covariance).max(axis=(1, 2), initial=0.0)
    symmetric = np.array_equal(covariance, covariance.swapaxes(1, 2))
    return least is not None and symmetric and bool((least > SURELY * size).all())
