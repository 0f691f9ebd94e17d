"""Observations of a fit: shots or pairs that can be used, with the problem that they pose."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.estimation import error_columns
from campaigns.estimation.least_squares import LeastSquaresProblem, Priors
from campaigns.estimation.point_sets import directions
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.estimation.rigid_transforms import Transform, fit_transform
from campaigns.estimation.tracker_noise import (
    distance_variance_mm2,
    inverse_roots,
    pooled_variance_mm2,
)
from campaigns.identification.nests import StandMotion
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import Excluded
from campaigns.mechanisms.mechanism import Kinematics, KinematicSolution
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from drivers.values import is_positive_definite

COORDINATES = 3
FEWEST_OF_A_SESSION = 4
SURELY = 1e-9
"""Least eigenvalue over the size of a matrix that is positive definite beyond rounding."""
SHORTEST_MM = 1.0
"""Of a distance: from shots at one place nothing is learnt."""


@dataclass(frozen=True, slots=True, eq=False)
class Inputs:
    """Inputs of a fit: the nominal robot, shots, what is looked for in them and how."""

    nominal: Kinematics
    shots: Shots
    selection: ParameterSelection
    options: IdentificationOptions
    at_nominal: KinematicSolution
    """The nominal robot's poses at all shots."""
    stand: StandMotion | None = None
    """Motion of the tracker that nests show, which the shots are without."""

    @classmethod
    def of(
        cls,
        nominal: Kinematics,
        shots: Shots,
        selection: ParameterSelection,
        options: IdentificationOptions,
    ) -> "Inputs":
        """Inputs with the nominal robot's poses."""
        at_nominal = nominal.forward(shots.joints, approach=shots.approach)
        return cls(nominal, shots, selection, options, at_nominal)

    def model_of(self, shots: Shots, near: Array | None = None) -> PositionModel:
        """Positions of shots by the parameters to be found, from poses (N, t) near theirs."""
        places = self.nominal.mechanism.parameters.places(self.selection.free)
        return PositionModel(self.nominal, places, shots.joints, near, approach=shots.approach)

    def usable_pairs(self, purpose: ShotSet) -> tuple[Index, tuple[Excluded, ...]]:
        """Rows (M, 2) of the whole pairs of a set, and by name those that cannot be used.

        At both shots of a usable pair the nominal robot can be assembled.
        Where sessions have frames of their own, both shots must be of one.
        """
        data, found = self.shots, self.at_nominal.found
        pairs = data.whole_pairs(purpose)
        halves = tuple(
            Excluded(f"shot {data.numbers[row]} has no partner", pair=pair_of(data, row))
            for row in pairs.halves
        )
        whole = found[pairs.rows].all(axis=1)
        apart = without_assembly(data, pairs.rows[~whole], found, "nominal")
        rows = pairs.rows[whole]
        together = np.ones(len(rows), dtype=bool)
        if self.options.sessions:
            together = data.session[rows[:, 0]] == data.session[rows[:, 1]]
        between = _excluded_pairs(data, rows[~together], "its shots are of two sessions")
        return rows[together], halves + apart + between


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """The shots or pairs of a fit, one a block, and the residuals that they make."""

    residuals: PointResiduals | DistanceResiduals
    priors: Priors
    shots: Shots
    """Those that take part, in the order of the residuals' model."""
    numbers: tuple[int, ...]
    """Of the shots or pairs, one a block."""
    stated_mm2: Array
    """Covariances of the points as the tracker states them, (N, 3, 3)."""
    excluded: tuple[Excluded, ...]
    """Exclusions of what could not be used at all."""

    @property
    def kind(self) -> Literal["shots", "pairs"]:
        """Name of the blocks, in the plural."""
        return "shots" if isinstance(self.residuals, PointResiduals) else "pairs"

    @property
    def problem(self) -> LeastSquaresProblem:
        """Problem to be solved; its first unknowns are the free parameters."""
        block = COORDINATES if self.kind == "shots" else 1
        return LeastSquaresProblem(self.residuals, block, self.priors)

    @property
    def points(self) -> PointResiduals:
        """Residuals of coordinates, where it is these that are fitted."""
        assert isinstance(self.residuals, PointResiduals), "distances know of no frame"
        return self.residuals

    @property
    def model(self) -> PositionModel:
        """Of the shots."""
        return self.residuals.model

    def excluded_for(self, block: int, reason: str) -> Excluded:
        """The shot or pair of a block, without the size of its misfit."""
        number = self.numbers[block]
        if self.kind == "shots":
            return Excluded(reason, shot=number)
        return Excluded(reason, pair=number)

    def misfits_mm(self, x: Array) -> Array:
        """Modelled minus measured at the unknowns x, (pairs, 1) or in the tracker's axes (N, 3)."""
        if isinstance(self.residuals, DistanceResiduals):
            return self.residuals.errors_mm(x)[:, None]
        return self.residuals.modelled_mm(x) - self.residuals.points_in_tracker_mm

    def whitened_shifts(self, shifts_mm: Array) -> Array:
        """Shifts of the measured points (N, 3) in units of what is fitted, as residuals stand."""
        residuals = self.residuals
        if isinstance(residuals, PointResiduals):
            return np.asarray(np.einsum("nij,nj->ni", residuals.whitening, shifts_mm)).ravel()
        first, second = residuals.first, residuals.second
        along = directions(self.shots.points_in_tracker_mm, first, second)
        apart = np.einsum("mk,mk->m", along, shifts_mm[second] - shifts_mm[first])
        return np.asarray(residuals.whitening * apart)

    def nominal_misfits_mm(self, kept: Mask) -> Array:
        """The same of what is kept with the nominal parameters and frames that suit them best."""
        if isinstance(self.residuals, DistanceResiduals):
            return self.misfits_mm(self.model.nominal)[kept]
        positions = self.model.positions_mm(self.model.nominal)[kept]
        measured, sessions = self.residuals.points_in_tracker_mm[kept], self.residuals.sessions
        own = np.zeros(len(positions), dtype=np.intp) if sessions is None else sessions[kept]
        misfits = np.empty_like(measured)
        for each in np.unique(own).tolist():
            rows = own == each
            frame = fit_transform(positions[rows], measured[rows])
            misfits[rows] = frame.apply(positions[rows]) - measured[rows]
        return misfits

    def tracker_from_base(self, x: Array) -> tuple[Transform, ...]:
        """Frames at the unknowns x, one a session; none where no frame is estimated."""
        return self.points.session_frames(x) if self.kind == "shots" else ()


def _excluded_pairs(data: Shots, rows: Index, reason: str) -> tuple[Excluded, ...]:
    return tuple(Excluded(reason, pair=pair_of(data, row)) for row in rows[:, 0].tolist())


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


def distance_observations(
    inputs: Inputs,
    covariance_mm2: Mapping[int, Array] | None = None,
    left_out: frozenset[int] = frozenset(),
) -> Observations:
    """Distances of the identification pairs, without the shots that are left out by number.

    Weighed by the covariances (3, 3) of the shots' points, by number; as the tracker states them,
    and all alike where that is asked for, without any. Raises `ShotsMissing` for fewer measurements
    than unknowns and `ShotsInvalid` for a covariance that is none.
    """
    data, options, known = inputs.shots, inputs.options, inputs.selection
    rows, excluded = inputs.usable_pairs(ShotSet.IDENTIFICATION)
    apart = data.measured_distances_mm(rows) >= SHORTEST_MM
    excluded += _excluded_pairs(data, rows[~apart], "its two shots are at one place")
    rows = rows[apart]
    wrong = np.isin(np.array(data.numbers)[rows], sorted(left_out))
    rows = rows[~wrong.any(axis=1)]
    wanted = max(1, len(known.free) - len(known.priors))
    if len(rows) < wanted:
        raise ShotsMissing(
            f"{len(rows)} pairs{_left_out(excluded)} cannot give {len(known.free)} parameters",
            remedy=f"measure at least {wanted} pairs, better 60; or fix some parameters",
        )
    shots, ends = data.rows(rows.ravel()), np.arange(rows.size).reshape(rows.shape)
    model = inputs.model_of(shots, inputs.at_nominal.values[rows.ravel()])
    stated = covariance = _stated(shots, options)
    if covariance_mm2 is not None:
        covariance = np.array([covariance_mm2[number] for number in shots.numbers])
    variance = distance_variance_mm2(shots.points_in_tracker_mm, covariance, *ends.T)
    is_stated = np.isfinite(shots.stated_covariance_mm2).any()
    if options.equal_weights or not is_stated:
        variance = np.full(len(rows), pooled_variance_mm2(variance))
    measured, whitening = shots.measured_distances_mm(ends), np.sqrt(1.0 / variance)
    distances = DistanceResiduals(model, ends[:, 0], ends[:, 1], measured, whitening)
    pairs = tuple(pair_of(data, row) for row in rows[:, 0].tolist())
    return Observations(distances, _priors(inputs, model), shots, pairs, stated, excluded)


def point_observations(inputs: Inputs) -> Observations:
    """Coordinates of the identification shots, weighed as the tracker states; raises likewise."""
    data, solution = inputs.shots, inputs.at_nominal
    rows = data.rows_of(ShotSet.IDENTIFICATION)
    found = solution.found[rows]
    excluded = tuple(
        Excluded("the nominal robot cannot be assembled at its joints", shot=data.numbers[row])
        for row in rows[~found].tolist()
    )
    shots = data.rows(rows[found])
    _check_coordinates(len(shots), inputs, excluded)
    model = inputs.model_of(shots, solution.values[rows[found]])
    measured, stated = shots.points_in_tracker_mm, _stated(shots, inputs.options)
    sessions = _sessions(shots) if inputs.options.sessions else None
    try:
        points = PointResiduals.from_points(model, measured, stated, sessions)
    except ValueError as error:
        raise ShotsMissing(
            f"{len(shots)} shots fix no frame: {error}", remedy="measure all over the workspace"
        ) from error
    points = replace(points, nuisance=_nuisance(points, inputs))
    return Observations(points, _priors(inputs, model), shots, shots.numbers, stated, excluded)


def _nuisance(points: PointResiduals, inputs: Inputs) -> Array | None:
    """Column of the reflector's constant, where it is fitted beside robot and frame."""
    if not inputs.options.frees_reflector_constant:
        return None
    return error_columns.reflector_constant(points.points_in_tracker_mm)


def all_observations(inputs: Inputs, fitted: Observations, near: KinematicSolution) -> Observations:
    """Coordinates of all shots of pairs in the order of time, unseen ones too, by a fit's frames.

    `near` has poses at all shots near theirs. Raises `NoSolution`, and `LinAlgError` for a
    covariance that is none.
    """
    data, some = inputs.shots, fitted.shots
    known = np.isin(data.session, some.session) | (not inputs.options.sessions)
    pairs = [purpose.in_pairs for purpose in data.purposes]
    order = data.order_of_time()
    rows = order[(known & pairs & near.found)[order]]
    shots = data.rows(rows)
    stated, points = shots.covariance_mm2(inputs.options.instrument), fitted.points
    sessions = points.sessions
    if sessions is not None:
        sessions = np.searchsorted(np.unique(some.session), shots.session)
    residuals = replace(
        points,
        model=inputs.model_of(shots, near.values[rows]),
        points_in_tracker_mm=shots.points_in_tracker_mm,
        whitening=inverse_roots(stated),
        sessions=sessions,
    )
    residuals = replace(residuals, nuisance=_nuisance(residuals, inputs))
    return Observations(residuals, fitted.priors, shots, shots.numbers, stated, ())


def _sessions(shots: Shots) -> Index | None:
    """Session of each shot, from 0 without gaps, (N,); None where all are of one.

    Raises `ShotsMissing` for a session whose shots fix no frame.
    """
    _, found, counts = np.unique(shots.session, return_inverse=True, return_counts=True)
    if len(counts) < 2:
        return None
    if counts.min() < FEWEST_OF_A_SESSION:
        raise ShotsMissing(
            f"a session has {counts.min()} shots to identify from, which fix no frame of its own",
            remedy=f"leave --sessions out, or measure at least {FEWEST_OF_A_SESSION} shots in each",
        )
    return np.asarray(found, dtype=np.intp)


def _check_coordinates(shots: int, inputs: Inputs, excluded: tuple[Excluded, ...]) -> None:
    """Refusal of fewer shots than can tell what is free; a prior is worth a coordinate."""
    known = inputs.selection
    unknown = [name for name in known.free if name not in known.priors]
    least = inputs.nominal.mechanism.minimum_shots(unknown)
    if shots >= least:
        return
    raise ShotsMissing(
        f"{shots} shots{_left_out(excluded)} are too few for {len(known.free)} parameters and the "
        "tracker's frame",
        remedy=f"measure at least {least} shots, better 60; or fix some parameters",
    )


def _left_out(excluded: tuple[Excluded, ...]) -> str:
    return f" ({len(excluded)} left out)" if excluded else ""


def _priors(inputs: Inputs, model: PositionModel) -> Priors:
    """About the nominal values, in mm and rad."""
    known = inputs.selection
    names = tuple(known.priors)
    places = np.array([known.free.index(name) for name in names], dtype=np.intp)
    std = np.array([*known.priors.values()]) * inputs.nominal.mechanism.parameters.units(names)
    return Priors(places, model.nominal[places], std)


def _stated(shots: Shots, options: IdentificationOptions) -> Array:
    """Covariances (N, 3, 3) of shots; raises `ShotsInvalid` naming the first that is none."""
    covariance = shots.covariance_mm2(options.instrument)
    if _all_positive_definite(covariance):
        return covariance
    for number, matrix in zip(shots.numbers, covariance.tolist(), strict=True):
        if not is_positive_definite(matrix):
            raise ShotsInvalid(
                f"shot {number}: its covariance is not positive definite",
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
