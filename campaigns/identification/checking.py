"""Checking of an identified robot by a few new shots, and its repair by some more."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ShotsInvalid
from campaigns.estimation import information
from campaigns.estimation.change_detection import Cause
from campaigns.estimation.estimate import Estimate, estimate
from campaigns.estimation.f_test import FittedShots
from campaigns.estimation.information import Uncertainty, WorkspaceSample
from campaigns.estimation.least_squares import Priors
from campaigns.estimation.residuals import FRAME_COLUMNS, PointResiduals, PositionModel
from campaigns.estimation.rigid_transforms import frame_jacobian
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.estimation.variance_components import VarianceComponents
from campaigns.evaluation.base_motion import BaseMotion, NestPlaces, base_motion
from campaigns.evaluation.calibration_check import CalibrationCheck, PartChange, judge_check
from campaigns.evaluation.identification import REPAIR
from campaigns.identification.change import part_causes
from campaigns.identification.fit import covariance_of, linearized
from campaigns.identification.nests import nest_places
from campaigns.identification.observations import Observations
from campaigns.identification.result import Pedigree, PositionStd, RecordedIdentification
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.mechanisms.parameters import FOREARM, ParameterSpace
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

ROUNDS = 3
"""Of linearising about the change that was found."""
FEWEST_TURNED = 3
"""Shots before and after a step of the tracker's stand by which its turn is told too."""
EXPECTED_LENGTH_MM = 0.1
"""Change of a length which a check's shots shall tell from others'."""
EXPECTED_OFFSET = {"deg": float(np.radians(0.05)), "mm": float(np.radians(0.05)) * 300.0}
"""That of a joint's offset, rad and mm: of a carriage as much as the end of a crank of 300 mm."""
ANY_STD = {"mm": 10.0, "deg": 0.1, "ppm": 0.01}
"""Changes, mm, rad and parts, that a repair takes to be possible: it starts from none."""
CheckFrame = tuple[PointResiduals, Array, Array, Array]
"""Coordinates of a check, unknowns with its frame last, the frame's covariance (6, 6), and what
errors of the stored parameters do to the frame, (6, F)."""
BY_ONE = frozenset({"joint", "length"})
"""Kinds of causes that are a parameter each."""


@dataclass(frozen=True, eq=False)
class StoredCalibration:
    """Identified robot as the journal has it, on which a check and a repair rest."""

    nominal: Kinematics
    found: RecordedIdentification

    @property
    def space(self) -> ParameterSpace:
        """Space of its parameters."""
        return self.nominal.mechanism.parameters

    @property
    def known(self) -> Uncertainty:
        """Uncertainty that was stated of it."""
        assert self.found.covariance is not None, "a result that passed has one"
        return self.found.covariance

    @cached_property
    def kinematics(self) -> Kinematics:
        """Identified robot."""
        return Kinematics.of(self.nominal.mechanism, self.found.flat())

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the known parameters as positions turned out to have it, mm and rad."""
        units = self.space.units(self.known.names)
        return self.known.as_turned_out(self.known.array * np.outer(units, units))

    @property
    def with_expected_changes(self) -> Array:
        """The same where each joint offset and each length may have changed, (F, F)."""
        space = self.space
        lengths = (*space.arm_lengths, *space.of_field(FOREARM))
        offsets = [space.geometry[place] for place in space.offsets.tolist()]
        std = dict.fromkeys(lengths, EXPECTED_LENGTH_MM)
        std |= {name: EXPECTED_OFFSET[space[name].unit] for name in offsets}
        expected = np.array([std.get(name, 0.0) for name in self.known.names])
        return np.asarray(self.covariance + np.diag(expected**2))

    @property
    def scatter(self) -> VarianceComponents:
        """The robot's own scatter as it was identified."""
        own, axis = self.found.robot_scatter, self.nominal.mechanism.joints[0]
        return own.components(axis) if own else VarianceComponents()

    def can_repair(self, judged: CalibrationCheck) -> bool:
        """Whether each part that a check names has a parameter among those that are known."""
        known = {*self.with_moved(judged.of_robot).known.names}
        moved = [{*moved_by(each, self.kinematics)} for each in judged.of_robot]
        return bool(moved) and all(known & each for each in moved)

    def with_moved(self, changes: tuple[PartChange, ...]) -> "StoredCalibration":
        """The same, the parameters of parts that moved among those known, the new ones exactly.

        A first rail's encoder held the base frame: the other rails hold it where it was.
        """
        parts = [moved_by(each, self.kinematics) for each in changes if each.kind != "growth"]
        units = {name: self.space[name].unit for part in parts for name in part}
        return replace(self, found=replace(self.found, covariance=self.known.with_exact(units)))

    def observations(
        self, shots: Shots, instrument: TrackerUncertainty, at: Mapping[str, float]
    ) -> tuple[Observations, Array]:
        """Coordinates of shots by parameters `at`, mm and deg, weighed with the robot's scatter.

        With the unknowns there, (F + 6 a session,). Raises `NoSolution` and `LinAlgError`.
        """
        names = self.known.names
        robot = Kinematics.of(self.nominal.mechanism, at)
        model = PositionModel(
            robot, self.space.places(names), shots.joints, approach=shots.approach
        )
        stated = self.known.sigma0**2 * shots.covariance_mm2(instrument)
        own = np.unique(shots.session, return_inverse=True)[1]
        sessions = own if own.any() else None
        points = PointResiduals.from_points(model, shots.points_in_tracker_mm, stated, sessions)
        values = np.array([at[name] for name in names]) * self.space.units(names)
        x = np.concatenate([values, np.zeros(points.frames)])
        fitted = Observations(points, Priors.none(), shots, shots.numbers, stated, ())
        weighed = points.with_covariance(covariance_of(fitted, x, self.scatter))
        return replace(fitted, residuals=weighed), x


def check_calibration(
    stored: StoredCalibration, shots: Shots, instrument: TrackerUncertainty
) -> CalibrationCheck:
    """Judgement on shots of a robot whose parameters were identified; raises `ShotsInvalid`.

    Where a length or offset changed they are linearised anew about the change. Parts count as warm
    as the parameters are stated for. Nests among them tell whether the base moved since.
    """
    every, moved = shots.rows(shots.order_of_time()), dict[str, float]()
    shots = every.on_robot()
    shots = replace(shots, session=np.zeros(len(shots), dtype=np.intp))
    for _ in range(ROUNDS):
        try:
            judged, frame = _judged(stored, shots, instrument, moved)
        except (NoSolution, np.linalg.LinAlgError) as error:
            raise _not_assembled() from error
        moved = {each.name: each.size for each in judged.changed if each.kind in BY_ONE}
        if not moved:
            break
    degC = (stored.found.warmth or {}).get("reference_degC")
    if judged.decision == "fail" and degC is not None:
        says = f"{judged.says} (the set is of parts at {degC:g} °C: warmer ones have grown)"
        judged = replace(judged, says=says)
    base = None if frame is None else _base_moved(stored, every, frame, instrument)
    if base is None:
        return judged
    return replace(judged, base=base, says=f"{judged.says}; {base.says}")


def _base_moved(
    stored: StoredCalibration, every: Shots, frame: CheckFrame, instrument: TrackerUncertainty
) -> BaseMotion | None:
    """Motion of the base since the campaign about the check's middle; None where no nests tell."""
    older, (points, x, covariance, by_parameters) = stored.found.nest_places(), frame
    if older is None or not any(every.nests):
        return None
    _, newer = nest_places(every, points, x, covariance, instrument)
    assert newer is not None, "the frame's covariance is known"
    base_from_tracker = points.tracker_from_base(x).inverted()
    about_mm = base_from_tracker.apply(every.on_robot().points_in_tracker_mm).mean(axis=0)
    of_campaign = _frame_by_parameters(stored, instrument)
    common_mm2 = None
    if of_campaign is not None:
        moved_before = _nests_by_frame(older) @ of_campaign
        moved_now = _nests_by_frame(newer) @ by_parameters
        common_mm2 = moved_before @ stored.covariance @ moved_now.T
    return base_motion(older, newer, about_mm, common_mm2)


def _nests_by_frame(nests: NestPlaces) -> Array:
    """∂(places of n nests in the base frame)/∂(the frame), (3 n, 6)."""
    return frame_jacobian(nests[1]).reshape(-1, FRAME_COLUMNS)


def _frame_by_parameters(stored: StoredCalibration, instrument: TrackerUncertainty) -> Array | None:
    """What errors of the parameters did to the campaign's frame, (6, F), mm and rad.

    None where an older result does not say which poses it was fitted to.
    """
    modelled, frame, names = stored.found.modelled, stored.found.frame, stored.known.names
    if modelled is None or frame is None:
        return None
    every = np.array(modelled.after)
    poses = every[[each is ShotSet.IDENTIFICATION for each in modelled.purposes]]
    readings = stored.kinematics.inverse(poses)
    poses, joints = poses[readings.found], readings.values[readings.found]
    in_base = information.point_jacobian(stored.kinematics, names, joints, poses)
    by_joints = stored.kinematics.jacobian(joints, poses)[:, :3, stored.space.offsets]
    transform, rotation = frame.tracker_from_base, frame.tracker_from_base.rotation
    stated = point_covariance_mm2(transform.apply(poses[:, :3]), instrument)
    noise = stored.scatter.covariance_mm2(stored.known.sigma0**2 * stated, rotation @ by_joints)
    turned = np.concatenate([frame_jacobian(poses[:, :3]), in_base[:, :, : len(names)]], axis=2)
    white = information.whitened(rotation @ turned, noise).reshape(3 * len(poses), -1)
    return _taken_by_frame(white[:, :FRAME_COLUMNS], white[:, FRAME_COLUMNS:])


def _taken_by_frame(beside: Array, by_parameters: Array) -> Array:
    """Change of the frame (6, F) by which it takes up errors of parameters, whitened (3 N, F).

    `beside` (3 N, 6 + k) are the columns of what was fitted, the frame's first.
    """
    return np.asarray(np.linalg.lstsq(beside, by_parameters, rcond=None)[0][:FRAME_COLUMNS])


def _not_assembled() -> ShotsInvalid:
    return ShotsInvalid(
        "the check's shots lead to no robot that could be assembled",
        remedy="look at joints and encoders, then check again with --anew",
    )


def _judged(
    stored: StoredCalibration,
    shots: Shots,
    instrument: TrackerUncertainty,
    moved: Mapping[str, float],
) -> tuple[CalibrationCheck, CheckFrame | None]:
    """Judgement by shots linearised about parameters moved by so much, mm and deg.

    They are brought back by the same columns: a change of that size is then told exactly. The frame
    is that beside whatever changed; None where that is not one thing.
    """
    space, flat = stored.space, stored.found.flat()
    at = flat | {name: flat[name] + by for name, by in moved.items()}
    fitted, x = stored.observations(shots, instrument, at)
    about, points = linearized(fitted, x), fitted.points
    rotations = points.rotations(x)

    def by_parameters(names: tuple[str, ...]) -> Array:
        by_names = fitted.model.by_geometry(points.parameters(x), space.places(names))
        return np.asarray(rotations @ by_names)

    frame = about.jacobian[:, :, -FRAME_COLUMNS:]
    back = np.array([*moved.values()]) * space.units(tuple(moved))
    misfit = -about.residual_mm + by_parameters(tuple(moved)) @ back
    own = about.jacobian[:, :, :-FRAME_COLUMNS].reshape(misfit.size, -1)
    expected = own @ stored.covariance @ own.T
    noise = stored.scatter.covariance_mm2(fitted.stated_mm2, about.by_joints)
    for row, each in zip(range(0, misfit.size, 3), noise, strict=True):
        expected[row : row + 3, row : row + 3] += each
    root = np.linalg.cholesky(expected)

    def white(columns: Array) -> Array:
        rows = columns.reshape(misfit.size, -1)
        return np.asarray(np.linalg.solve(root, rows).reshape(len(shots), 3, -1))

    fit = FittedShots.of(white(misfit), white(frame))
    flat_frame = frame.reshape(misfit.size, -1)
    beside = np.eye(misfit.size) - flat_frame @ np.linalg.pinv(flat_frame)
    rms_mm = np.sqrt(np.mean((beside @ misfit.ravel()) ** 2))
    expected_mm = np.sqrt(np.trace(beside @ expected) / misfit.size)
    causes = [*causes_in_robot(stored.kinematics, about.by_joints, by_parameters)]
    causes += causes_in_setup(frame)
    whitened = [replace(each, columns=white(each.columns)) for each in causes]
    judged = judge_check(fit, whitened, space, float(rms_mm), float(expected_mm))
    if judged.as_likely or (judged.decision != "pass" and not judged.of_robot):
        return judged, None
    changed = {(each.kind, each.name) for each in judged.changed}
    beside_it = [each.columns for each in whitened if (each.kind, each.name) in changed]
    columns = np.concatenate([white(frame), *beside_it], axis=2).reshape(misfit.size, -1)
    moved_by = np.linalg.lstsq(columns, white(misfit).ravel(), rcond=None)[0][:FRAME_COLUMNS]
    x[-FRAME_COLUMNS:] += moved_by
    of_frame = information.covariance(columns)[:FRAME_COLUMNS, :FRAME_COLUMNS]
    in_base = frame_jacobian(fitted.model.positions_mm(points.parameters(x)))
    columns[:, :FRAME_COLUMNS] = white(rotations @ in_base).reshape(misfit.size, -1)
    by_stored = white(own.reshape(*misfit.shape[:2], -1)).reshape(misfit.size, -1)
    return judged, (points, x, of_frame, _taken_by_frame(columns, by_stored))


def causes_in_robot(
    kinematics: Kinematics, by_joints: Array, by_parameters: Callable[[tuple[str, ...]], Array]
) -> Iterator[Cause]:
    """Causes in the robot that a check looks for, with their columns (N, 3, k) of shots."""
    space, values = kinematics.mechanism.parameters, kinematics.parameters
    yield from part_causes(space, by_joints, by_parameters)
    for name, names in grown(space).items():
        by_share = by_parameters(names) @ np.array([values[each] for each in names])
        yield Cause("growth", name, by_share[:, :, None])


def causes_in_setup(frame: Array) -> Iterator[Cause]:
    """Causes beside the robot, with their columns (…, N, 3, k) of shots in the order of time.

    By ∂point/∂frame (…, N, 3, 6): the stand from a shot on, and each shot alone.
    """
    count = frame.shape[-3]
    places = np.arange(count)[:, None, None]
    for shot in range(1, count):
        name = f"the tracker's stand before shot {shot + 1} of the check"
        yield Cause("frame", name, frame[..., 3:] * (places >= shot))
        if FEWEST_TURNED <= shot <= count - FEWEST_TURNED:
            yield Cause("frame", name, frame * (places >= shot))
    for shot in range(1, count - 1):  # of the first and the last it is the stand, or the shot
        alone = np.broadcast_to(np.eye(3) * (places == shot), frame[..., :3].shape)
        yield Cause("shot", f"shot {shot + 1} of the check alone", alone)


def grown(space: ParameterSpace) -> dict[str, tuple[str, ...]]:
    """Names of the lengths that grow together by warmth."""
    forearms, offsets = space.of_field(FOREARM), space.of_field("joint_offset_mm")
    lengths = tuple(name for name in space.of_unit("mm", space.names) if name not in offsets)
    groups = {"arms": space.arm_lengths, "forearms": forearms, "lengths": lengths}
    return {name: names for name, names in groups.items() if (name, names) != ("arms", forearms)}


def repaired_estimate(
    stored: StoredCalibration,
    changes: tuple[PartChange, ...],
    shots: Shots,
    instrument: TrackerUncertainty,
) -> tuple[Estimate, Uncertainty, PointResiduals]:
    """Parameters by all that was known but the size of these changes, and by these shots.

    Those that moved are all among them. Each session has a frame of its own, that of the first is
    the last of the unknowns. Raises `ShotsInvalid`.
    """
    stored = stored.with_moved(changes)
    names, space, flat = stored.known.names, stored.space, stored.found.flat()
    prior = stored.covariance + _possible(stored, changes)
    at = flat | {e.name: flat[e.name] + e.size for e in changes[:1] if e.kind in BY_ONE}
    try:
        fitted, _ = stored.observations(shots.on_robot(), instrument, at)
        mean = np.array([flat[name] for name in names]) * space.units(names)
        posed = replace(fitted, priors=Priors.of_covariance(mean, prior)).problem
        found = estimate(posed, len(names), exclude=False, known_variance=True)
    except (NoSolution, np.linalg.LinAlgError) as error:
        raise _not_assembled() from error
    assert found.covariance is not None, "the prior alone determines everything"
    units, count = space.units(names), len(names)
    sigma0 = found.noise.sigma0 or 1.0
    known = Uncertainty.of(names, units, found.covariance[:count, :count], sigma0=sigma0)
    known = replace(known, common=stored.known.common)
    return found, known, fitted.points


def _possible(stored: StoredCalibration, changes: tuple[PartChange, ...]) -> Array:
    """Covariance of the known parameters, (F, F), by changes of any size."""
    names, found = stored.known.names, np.zeros((len(stored.known.names),) * 2)
    for each in changes:
        along = np.array([moved_by(each, stored.kinematics).get(name, 0.0) for name in names])
        if each.kind == "mount":
            found += ANY_STD[each.unit] ** 2 * np.diag(along)
        else:
            found += ANY_STD[each.unit] ** 2 * np.outer(along, along)
    return found


def moved_by(change: PartChange, kinematics: Kinematics) -> dict[str, float]:
    """Parameters of a part that changed, by name, and how much each of them moves with it."""
    space = kinematics.mechanism.parameters
    if change.kind == "growth":
        return {name: kinematics.parameters[name] for name in grown(space)[change.name]}
    if change.kind == "mount":
        return {change.name.replace(".x_", f".{axis}_"): 1.0 for axis in "xyz"}
    return {change.name: 1.0}


def repaired(
    stored: StoredCalibration,
    changes: tuple[PartChange, ...],
    shots: Shots,
    instrument: TrackerUncertainty,
    workspace: Array | None,
    series: tuple[int, int],
) -> RecordedIdentification:
    """Set with these changes found anew, its provenance still that of the stored one.

    Nests that the check measured, the first of the series, are placed anew. Raises `ShotsInvalid`.
    """
    last, space = stored.found, stored.space
    found, known, points = repaired_estimate(stored, changes, shots, instrument)
    assert found.covariance is not None, "the prior alone determines everything"
    checked = shots.rows(np.flatnonzero(shots.session == series[0]))
    of_frame = found.covariance[-FRAME_COLUMNS:, -FRAME_COLUMNS:]
    nests, placed = nest_places(checked, points, found.x, of_frame, instrument)
    values = found.x[: len(known.names)] / space.units(known.names)
    std, total = known.std(), known.total_std()
    new = {
        name: replace(
            last.parameters[name], value=value, std=std[name], total_std=total[name], free=True
        )
        for name, value in zip(known.names, values.tolist(), strict=True)
    }
    reasons = [] if found.fit.converged else [found.fit.message]
    if not found.noise.consistent:
        reasons.append(
            f"the shots contradict the repaired set (χ² {found.noise.chi2:.0f} with "
            f"{found.noise.dof} degrees of freedom): more than what was named has changed"
        )
    before, positions = last.position_std_mm, None
    if workspace is not None:
        sample = WorkspaceSample.of_workspace(stored.kinematics, known.names, workspace)
        positions = None if sample is None else PositionStd.of(known, sample)
    return replace(
        last,
        parameters=last.parameters | new,
        covariance=known,
        position_std_mm=positions,
        converged=found.fit.converged,
        message=found.fit.message,
        verdict="fail" if reasons else "pass",
        reasons=tuple(reasons) or last.reasons,
        obstacles=(REPAIR,) if reasons else (),
        nests=nests,  # none by the campaign, whose base frame is no longer this one
        nest_covariance_mm2=None if placed is None else tuple(map(tuple, placed[2].tolist())),
        pedigree=Pedigree(
            repairs=stored.kinematics.parameters.digest(),
            changed=tuple(each.part for each in changes),
            series=series,
            shots=len(shots.on_robot()),
            chi2=found.noise.chi2,
            dof=found.noise.dof,
            p=found.noise.p,
            position_std_before_mm=None if before is None else before.mean,
        ),
    )
