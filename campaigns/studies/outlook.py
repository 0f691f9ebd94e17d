"""Outlook: what planned shots and observations of other kinds will determine, before any is taken.

Theory of operation. A posterior covariance depends on derivatives and weights, not on what will be
measured. So the fit of `identify` is made at the nominal robot, with every size of errors at its
tolerance and all noise as stated, of rows that are of two sorts: those planned have the weight 1,
candidates have 0. Whatever identification says of a quantity then follows from that fit by its own
functions: its σ, and the share of it that comes from tolerances (`determined.py`).

A candidate becomes planned by another weight. Which one is best, is an optimal design: that after
which the mean variance of the wanted quantity is least (`campaigns.fit.design`). And what ten more
of a kind would gain, is the σ after the ten best ones of it beside the σ now.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.fit.design import ShotDesign
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.fit import Fit, Prior, noise_parts
from campaigns.fit.kinds import Block
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.rows import Rows
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.fit.uncertainty import free_turns_deg, length_std, null_directions, without_frame
from campaigns.identification.determined import (
    ON_PLANE,
    Determined,
    by_on_planes,
    determined_by,
    determined_on_planes,
)
from campaigns.identification.options import QuantityWord
from campaigns.identification.other_kinds import OtherKinds
from campaigns.planning.forecast import Forecast, std_by_name

SHOTS = 0
"""Number of the shots among all that is observed; objects are counted from 1."""
FLAT_FRAME = 1e-8
"""Precision of a tracker's frame, in mm and mrad, before any shot: practically none."""
LEAST_SPARE = 0.1
"""Least √(k ν) - k by which scatter is expected: with less it is an assumption, and said to be."""
SCATTER = ("points", "joints")
"""Parts of the noise that are the robot's scatter: none is known before it is measured."""
MOST_EXCHANGED = 100
"""Largest number of observations that are exchanged for better ones: more gain little by it."""


@dataclass(frozen=True, slots=True)
class Gain:
    """What so many more observations of one object would gain in a quantity."""

    name: str
    """Object, or "shots"."""
    kind: str
    count: int
    now: float
    """1 σ of the quantity over the workspace now, rms, mm or deg."""
    then: float
    """1 σ with these observations."""
    assumed: float
    """Share of its variance that would then come from tolerances whose size nothing estimates."""
    seconds: float = 0.0
    """Time that they take, estimated."""

    @property
    def share(self) -> float:
        """Part of σ that they take away."""
        return 1.0 - self.then / self.now


@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """Posterior of all that is planned; candidates beside it have the weight 0."""

    fit: Fit
    """At the nominal robot, with sizes and noise as tolerances and data sheets say."""
    judged: Mapping[QuantityWord, Array]
    """Derivatives (K, d, P) of each quantity, without the motions that its users define."""
    tested: frozenset[str] = frozenset()
    """Quantities that planned hold-out shots and observations will check."""

    def count(self, number: int) -> int:
        """Return how many observations of an object are planned; of the shots: number 0."""
        return len(self.chosen(number))

    def chosen(self, number: int) -> Index:
        """Return the rows of an object's observations that are planned."""
        return np.flatnonzero(self.fit.rows[number].good >= 0.5)

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Planned observations and candidates, a block for each object."""
        return self.fit.observations.blocks

    @property
    def determined(self) -> tuple[Determined, ...]:
        """What is planned will determine, as `identify` states it."""
        fit = self.planned_fit
        on_planes = determined_on_planes(fit, self.tested)
        in_space = (
            determined_by(name, fit, by, is_tested=name in self.tested)
            for name, by in self.judged.items()
            if name not in ON_PLANE
        )
        return (*on_planes, *in_space)

    def std(self, quantity: QuantityWord) -> float:
        """Return 1 σ of a quantity over the workspace or the plane, rms, mm or deg."""
        return self._determined(quantity).rms

    def _determined(self, quantity: QuantityWord) -> Determined:
        """Return how well a quantity will be known where it is judged."""
        by, is_tested = self.judged[quantity], quantity in self.tested
        return determined_by(quantity, self.planned_fit, by, is_tested=is_tested)

    def with_best(self, number: int, count: int, quantity: QuantityWord) -> Self:
        """Return the outlook with so many more observations of an object, the best for a quantity.

        All candidates are taken if there are fewer.
        """
        rows = self.fit.rows[number]
        free = np.flatnonzero(rows.good < 0.5)
        design = ShotDesign(
            _whitened(rows)[free], self._precision, _padded(self.judged[quantity], self._unknowns)
        )
        design.add_until(min(count, len(free)))
        if count <= MOST_EXCHANGED:
            design.exchange()
        return self.with_rows(number, free[design.chosen])

    def with_rows(self, number: int, rows: Index) -> Self:
        """Return the outlook with these rows of an object, or of the shots, planned as well."""
        weights = [self.fit.good, *self.fit.good_of_others]
        weights[number] = weights[number].copy()
        weights[number][rows] = 1.0
        return replace(self, fit=self.fit.with_weights(weights))

    def judged_where_planned(self) -> Self:
        """Return the outlook with quantities on a plane judged where it is planned to be touched.

        There `identify` states them; before anything is chosen they are judged at all candidates.
        """
        on_plane = _on_plane(self.fit.model, self.planned_fit.observations.blocks)
        return replace(self, judged={**self.judged, **dict(on_plane)})

    def gain(self, number: int, count: int, quantity: QuantityWord) -> Gain:
        """Return what so many more of an object, the best ones, would gain in a quantity."""
        more = self.with_best(number, count, quantity)
        then = more._determined(quantity)  # noqa: SLF001 - of this class
        block = None if number == SHOTS else self.blocks[number - 1]
        return Gain(
            name="shots" if block is None else block.name,
            kind="shot" if block is None else block.kind.name,
            count=more.count(number) - self.count(number),
            now=self.std(quantity),
            then=then.rms,
            assumed=then.assumed,
        )

    def forecast(self, of_shots: Forecast) -> Forecast:
        """Return the forecast by all that is planned, without scatter, from that of shots alone."""
        fit, names = self.fit, len(self.fit.model.names)
        covariance = np.asarray(np.linalg.inv(self._precision))
        in_datum = null_directions(fit).transform_covariance(covariance[:names, :names])
        size = fit.model.size
        stds = {name: length_std(by, covariance[:size, :size]) for name, by in self.judged.items()}
        return replace(
            of_shots,
            std=std_by_name(fit.model, in_datum),
            position_std_mm=stds["position"],
            rotation_std_deg=stds.get("rotation"),
            freedom=fit.freedom,
        )

    @property
    def _unknowns(self) -> int:
        """Number of unknowns, frames included."""
        return int(self.fit.at.jacobian.shape[2])

    @property
    def _precision(self) -> Array:
        """Precision (Q, Q) of all unknowns by what is planned."""
        frames = np.arange(self._unknowns) >= self.fit.model.size
        return self.fit.normal[0] + self.fit.precision + np.diag(FLAT_FRAME * frames)

    @property
    def planned_fit(self) -> Fit:
        """The fit of what is planned alone, without candidates."""
        fit, kept = self.fit, self.fit.kept
        planned = [
            (block.rows(chosen), rows, chosen)
            for number, (block, rows) in enumerate(
                zip(self.blocks, self.fit.at.others, strict=True), start=1
            )
            if len(chosen := self.chosen(number))
        ]
        at = replace(
            fit.at,
            residual=fit.at.residual[kept],
            jacobian=fit.at.jacobian[kept],
            others=tuple(
                replace(
                    rows,
                    residual=rows.residual[chosen],
                    jacobian=rows.jacobian[chosen],
                    noise={part: v[chosen] for part, v in rows.noise.items()},
                )
                for _, rows, chosen in planned
            ),
        )
        alone = replace(
            fit,
            observations=replace(
                fit.observations.rows(kept), blocks=tuple(block for block, _, _ in planned)
            ),
            at=at,
            noise={part: v[kept] for part, v in fit.noise.items()},
            usable=fit.usable[kept],
            good=fit.good[kept],
            good_of_others=tuple(np.ones(len(block)) for block, _, _ in planned),
        )
        return replace(alone, factors=alone.factors | expected_scatter(alone))


def outlook(
    model: ErrorModel,
    shots: Observations,
    planned: int,
    kinds: OtherKinds,
    judged: Mapping[QuantityWord, Array],
) -> Outlook:
    """Return the outlook of shots, of which the first are planned, with no object observed yet.

    `shots` (N) are those of `planned_points`; without any there is no tracker, whose errors are
    left out. `judged` are derivatives (K, d, P) by the model's own unknowns.
    """
    model = model.with_effects(kinds.slots)
    frames: tuple[Transform, ...] = ()
    if len(shots):
        away_mm = shots.points[0] - model.nominal.points(shots.near[:1])[0]
        frames = (Transform(np.eye(3), away_mm),)
    observations = replace(shots, blocks=kinds.fitted)
    at = model.predict(np.zeros(model.size), frames, observations, shots.near)
    stated = dict(shots.noise) or {"stated": np.zeros((0, 3, 3))}
    fit = Fit(
        model,
        observations,
        Prior(),
        at,
        noise=noise_parts(model, replace(shots, noise=stated), at.by_joint),
        usable=np.ones(len(shots), dtype=np.bool_),
        good=(np.arange(len(shots)) < planned).astype(np.float64),
        sizes=dict.fromkeys(model.sized_groups, 1.0),
        factors={"stated": 1.0} | dict.fromkeys(SCATTER, 0.0),
        good_of_others=tuple(np.zeros(len(block)) for block in kinds.fitted),
    )
    padded = {name: _padded(by, model.size) for name, by in judged.items()}
    return Outlook(fit, padded | dict(_on_plane(model, kinds.fitted)))


def planned_points(
    model: ErrorModel,
    joints: Array,
    poses: Array,
    approach: Array,
    tracker_mm: Array,
    instrument: TrackerUncertainty,
) -> Observations:
    """Return the points that a tracker will measure at joints (N, n) and poses (N, t).

    They are as the nominal robot shows them, seen from the tracker's place (3,) with the base's
    axes, and have the noise of its data sheet. `approach` (N, n) are the joints' sides.
    """
    seen = model.nominal.points(poses) - tracker_mm
    observations = Observations.unmeasured(joints, poses, approach)
    noise = {"stated": point_covariance_mm2(seen, instrument)}
    return replace(observations, points=seen, noise=noise)


def without_tracker(model: ErrorModel) -> ErrorModel:
    """Return the model without a tracker and its reflector, for other kinds alone."""
    nominal = replace(model.nominal, mechanism=model.nominal.mechanism.body(None))
    return replace(model, nominal=nominal, held=frozenset({*model.held, *TRACKER_SOURCES}))


def judged_in_space(model: ErrorModel, joints: Array, poses: Array) -> dict[QuantityWord, Array]:
    """Return derivatives (N, 3, P) of position, and of rotation if the tool turns, deg.

    Positions are without motions of the frame, turns without those of the base's and tool's axes.
    """
    robot = model.robot_at(np.zeros(model.size), Observations.unmeasured(joints, poses), poses)
    judged: dict[QuantityWord, Array] = {"position": without_frame(robot.by, robot.assembly.points)}
    if len(model.nominal.mechanism.task) > 3:
        judged["rotation"] = free_turns_deg(model, np.zeros(model.size), joints, poses)
    return judged


def _on_plane(model: ErrorModel, blocks: Sequence[Block]) -> Iterator[tuple[QuantityWord, Array]]:
    """Yield derivatives of quantities on a plane, where it is touched, or else where parts lie."""
    touched = (
        [block for block in blocks if quantity in block.kind.checks and not block.kind.by_tracker]
        for quantity in ON_PLANE
    )
    places = next(filter(None, touched), [])
    yield from by_on_planes(model, np.zeros(model.size), places)


# With ν degrees of freedom, noise of variance s² and k parts of scatter, of each of which the size
# has a half-Cauchy prior of a far larger tolerance, -2 log posterior is
#     ν log(s² + Σ v) + ν s²/(s² + Σ v) - Σ log v
# if the robot has no scatter. Its minimum is at v = s²/(√(k ν) - k) for each part: the fewer rows
# there are to spare, the more of the scatter's tolerance is left.
def expected_scatter(fit: Fit) -> dict[str, float]:
    """Return the factors of the scatter that a fit without any will find by its prior."""
    parts = len(SCATTER)
    spare = np.sqrt(parts * max(fit.freedom, 0.0)) - parts
    share = 1.0 / max(float(spare), LEAST_SPARE)
    rows = sum(rows.count for rows in fit.rows)
    factors = {}
    for part in SCATTER:
        weighed = sum(float((rows.weights * rows.noise[part]).sum()) for rows in fit.rows)
        factors[part] = min(1.0, share * rows / max(weighed, 1e-300))
    return factors


def _padded(by: Array, unknowns: int) -> Array:
    """Return derivatives (K, d, P) with zeros for further unknowns, (K, d, unknowns)."""
    return np.pad(by, ((0, 0), (0, 0), (0, unknowns - by.shape[2])))


def _whitened(rows: Rows) -> Array:
    """Return derivatives (M, r, Q) of rows in units of their noise."""
    return np.asarray(np.linalg.solve(np.linalg.cholesky(rows.total_noise), rows.jacobian))
