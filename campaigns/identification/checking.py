"""Checking of an identified robot by a few new shots."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ShotsInvalid
from campaigns.estimation.change_detection import Cause
from campaigns.estimation.f_test import FittedShots
from campaigns.estimation.information import Uncertainty
from campaigns.estimation.least_squares import Priors
from campaigns.estimation.residuals import FRAME_COLUMNS, PointResiduals, PositionModel
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.estimation.variance_components import VarianceComponents
from campaigns.evaluation.calibration_check import CalibrationCheck, judge_check
from campaigns.identification.change import part_causes
from campaigns.identification.fit import covariance_of, linearized
from campaigns.identification.observations import Observations
from campaigns.identification.result import RecordedIdentification
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.mechanisms.parameters import FOREARM, ParameterSpace
from campaigns.shots.shots import Shots

ROUNDS = 3
"""Of linearising about the change that was found."""
FEWEST_TURNED = 3
"""Shots before and after a step of the tracker's stand by which its turn is told too."""
BY_ONE = frozenset({"joint", "length"})
"""Kinds of causes that are a parameter each."""


@dataclass(frozen=True, eq=False)
class StoredCalibration:
    """Identified robot as the journal has it, on which a check rests."""

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
    def scatter(self) -> VarianceComponents:
        """The robot's own scatter as it was identified."""
        own, axis = self.found.robot_scatter, self.nominal.mechanism.joints[0]
        return own.components(axis) if own else VarianceComponents()

    def observations(
        self, shots: Shots, instrument: TrackerUncertainty, at: Mapping[str, float]
    ) -> tuple[Observations, Array]:
        """Coordinates of shots by parameters `at`, mm and deg, weighed with the robot's scatter.

        With the unknowns there, (F + 6,). Raises `NoSolution` and `LinAlgError`.
        """
        names = self.known.names
        robot = Kinematics.of(self.nominal.mechanism, at)
        model = PositionModel(
            robot, self.space.places(names), shots.joints, approach=shots.approach
        )
        stated = self.known.sigma0**2 * shots.covariance_mm2(instrument)
        points = PointResiduals.from_points(model, shots.points_in_tracker_mm, stated)
        values = np.array([at[name] for name in names]) * self.space.units(names)
        x = np.concatenate([values, np.zeros(points.frames)])
        fitted = Observations(points, Priors.none(), shots, shots.numbers, stated, ())
        weighed = points.with_covariance(covariance_of(fitted, x, self.scatter))
        return replace(fitted, residuals=weighed), x


def check_calibration(
    stored: StoredCalibration, shots: Shots, instrument: TrackerUncertainty
) -> CalibrationCheck:
    """Judgement on shots of a robot whose parameters were identified; raises `ShotsInvalid`.

    Where a length or offset changed they are linearised anew about the change. The shots
    have one frame.
    """
    shots, moved = shots.rows(shots.order_of_time()).on_robot(), dict[str, float]()
    for _ in range(ROUNDS):
        try:
            judged = _judged(stored, shots, instrument, moved)
        except (NoSolution, np.linalg.LinAlgError) as error:
            raise ShotsInvalid(
                "the check's shots lead to no robot that could be assembled",
                remedy="look at joints and encoders, then check again with --anew",
            ) from error
        moved = {each.name: each.size for each in judged.changed if each.kind in BY_ONE}
        if not moved:
            break
    return judged


def _judged(
    stored: StoredCalibration,
    shots: Shots,
    instrument: TrackerUncertainty,
    moved: Mapping[str, float],
) -> CalibrationCheck:
    """Judgement by shots linearised about parameters moved by so much, mm and deg.

    They are brought back by the same columns: a change of that size is then told exactly.
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
    return judge_check(fit, whitened, space, float(rms_mm), float(expected_mm))


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
