"""Identify a robot that no tracker measured, from heights, distances and other kinds alone.

The same fit, without points and without frames: the result is in the base frame. What observations
determine is stated for each quantity (`determined.py`), and nothing passes that tolerances state.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import OptionsInvalid, ShotsInvalid, ShotsMissing
from campaigns.fit.error_model import Observations
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.events import add_steps, spread_over_parts, steps_of
from campaigns.fit.fit import Fit, fit_model, integrate_sizes, with_spread
from campaigns.fit.uncertainty import NullDirections, null_directions, without_frame
from campaigns.identification import findings
from campaigns.identification.determined import (
    Determined,
    determined_by,
    determined_on_planes,
    quantity_findings,
    require_turns,
    rotation_determined,
    widened,
)
from campaigns.identification.findings import Finding
from campaigns.identification.moments import in_order_of_time, stations_of
from campaigns.identification.observations import error_model
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.other_kinds import (
    KindTest,
    Measured,
    OtherKinds,
    change_findings_of_others,
    kind_findings,
    other_kinds,
    ratio_of,
    tested_by,
    tests_of,
)
from campaigns.identification.positions import FEWEST_POSES
from campaigns.identification.result import (
    Frame,
    IdentificationResult,
    Judgement,
    PositionStd,
    Provenance,
    Residuals,
    Uncertainty,
    Value,
)
from campaigns.identification.stated_values import StatedValues
from campaigns.kinematics.model import Kinematics


def identify_without_points(
    nominal: Kinematics, measured: Iterable[Measured], options: IdentificationOptions
) -> IdentificationResult:
    """Identify a robot from observations of other kinds, and judge what they determine.

    A tracker's frame is placed by its probes and reflectors. Raise `OptionsInvalid` for options of
    shots, `ShotsMissing` for nothing to fit, `ShotsInvalid` for observations that lead to no robot.
    """
    require_turns(options.quantities, nominal)
    if options.model == "paper" or options.shots != (None, None):
        raise OptionsInvalid(
            "--model paper and --only-shots are for shots, of which there are none",
            remedy="leave them out",
        )
    nominal = replace(nominal, mechanism=nominal.mechanism.body(None))  # no reflector moves along
    measured = tuple(measured)
    joints, task = len(nominal.mechanism.joints), len(nominal.mechanism.task)
    nothing = Observations.unmeasured(np.zeros((0, joints)), np.zeros((0, task)))
    stations = stations_of(measured) if options.sessions else None
    try:
        kinds, _ = in_order_of_time(other_kinds(measured, nominal, None, stations), nothing)
        if not kinds.fitted:
            raise ShotsMissing(
                "nothing was observed: no shots, and no observations of other kinds to fit",
                remedy="give shots, heights or distances",
            )
        fit = _fit(nominal, options, kinds, replace(nothing, blocks=kinds.fitted))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ShotsInvalid(
            f"the observations lead to no robot ({error})",
            remedy="look for gross errors: order and signs of the joints, units of values; a "
            "tracker's frame needs places all over the workspace",
        ) from error
    return _Observed(nominal, options, kinds, fit).make_result()


# Without a tracker its errors are no unknowns, and without moments nothing changes in time.
def _fit(
    nominal: Kinematics, options: IdentificationOptions, kinds: OtherKinds, nothing: Observations
) -> Fit:
    """Return the fit of observations of other kinds alone, with the changes that they show."""
    by_tracker = [block for block in kinds.fitted if block.kind.by_tracker]
    frames = 1 + max((int(block.frame.max()) for block in by_tracker), default=-1)
    model = error_model(nominal, None, options, frames if kinds.has_moments else 0)
    model = model.with_effects((*model.effects, *kinds.slots))
    if not by_tracker:
        model = replace(model, held=frozenset({*model.held, *TRACKER_SOURCES}))
    fit = fit_model(model, nothing)
    return add_steps(fit) if kinds.has_moments else fit


@dataclass(frozen=True, slots=True, eq=False)
class _Observed(StatedValues):
    """Fit of observations without points, from which the result is made."""

    options: IdentificationOptions
    kinds: OtherKinds
    likeliest: Fit
    """Fit at the likeliest sizes of groups."""

    def make_result(self) -> IdentificationResult:
        """Return the result with its findings and verdict."""
        null, fit = null_directions(self.likeliest), integrate_sizes(self.likeliest)
        if steps_of(fit):
            fit = with_spread(fit, spread_over_parts(self.likeliest))
        tests = tuple(tests_of(fit, self.likeliest, self.kinds.held_out))
        stated = null.transform(fit.model.of_today @ fit.at.x)
        # the averaged covariance is of the linear model at the likeliest sizes
        spread = fit.covariance - self.likeliest.inverse
        averaged = replace(self.likeliest, spread=spread)
        identified = fit.model.kinematics(stated)
        determined = tuple(
            widened(quantity, ratio_of(quantity.name, tests))
            for quantity in self._determined(averaged, identified)
        )
        positions = [PositionStd(q.mean, q.max, q.rms) for q in determined if q.name == "position"]
        return IdentificationResult(
            value=Value(
                parameters=self.parameters(fit, null, stated),
                undetermined=null.names,
                motions=null.motions,
                sizes={group: float(size) for group, size in fit.sizes.items()},
                tracker=self.tracker(fit) if fit.at.frames else {},
                frame=Frame.of(fit.at.frames[0]) if fit.at.frames else None,
            ),
            uncertainty=Uncertainty(
                scatter=self.scatter(fit),
                covariance=self.covariance(fit, null, 1.0),
                position_std_mm=positions[0] if positions else None,
                determined=determined,
            ),
            judgement=Judgement.of(
                tuple(self._findings(fit, null, determined, tests)),
                [
                    f"{q.name}: 1 σ is {q.rms:.2g} {q.unit} rms"
                    for q in determined
                    if q.name in self.options.judged_quantities
                ],
            ),
            residuals=Residuals(),
            provenance=Provenance("full", fit.has_converged, fit.rounds),
        )

    def _determined(self, fit: Fit, identified: Kinematics) -> tuple[Determined, ...]:
        tested = tested_by(self.kinds.held_out, ())
        quantities = [*determined_on_planes(fit, tested)]
        if self.options.workspace is not None:
            joints, poses = identified.select_reachable(self.options.workspace)
            if len(poses) >= FEWEST_POSES * len(self.options.workspace):
                quantities += self._in_space(fit, identified, joints, poses)
        return tuple(quantities)

    # A fit that leads far away may have no assembly where the stated robot, of other parameters
    # along directions that nothing determines, has one.
    def _in_space(
        self, fit: Fit, identified: Kinematics, joints: Array, poses: Array
    ) -> Iterator[Determined]:
        tested = tested_by(self.kinds.held_out, ())
        robot = fit.model.robot_at(fit.at.x, Observations.unmeasured(joints, poses), poses)
        if not robot.assembly.is_solved.all():
            return
        by = without_frame(robot.by, robot.assembly.points)
        yield determined_by("position", fit, by, is_tested="position" in tested)
        yield from rotation_determined(
            fit, identified, joints, poses, 1.0, is_tested="rotation" in tested
        )

    def _findings(
        self,
        fit: Fit,
        null: NullDirections,
        determined: tuple[Determined, ...],
        tests: tuple[KindTest, ...],
    ) -> Iterator[Finding]:
        options = self.options
        if not fit.has_converged:
            says = "the fit did not converge: look for gross errors, or measure at more poses"
            yield Finding(findings.NOT_ARRIVED, says, "fail")
        accepted = findings.ACCEPTABLE if options.accept_large_change else ()
        for finding in findings.tolerance_findings(fit, null):
            yield finding.accept(accepted)
        yield from findings.scatter_findings(fit)
        yield from kind_findings(fit, tests, self.kinds.untested)
        yield from change_findings_of_others(fit)
        wanted = options.judged_quantities
        yield from quantity_findings(determined, wanted, options.rotation_deg)
        if "position" in wanted and "position" not in {quantity.name for quantity in determined}:
            says = (
                "position: the identified robot can take too little of the workspace: look for "
                "gross errors, or measure at more poses"
            )
            yield Finding(findings.NOT_DETERMINED, says, "not decided")
        if "position" in wanted and "position" not in tested_by(self.kinds.held_out, ()):
            says = "no held-out point or probe: nothing shows where the robot is in space"
            yield Finding(findings.NOTHING_UNSEEN, says, "not decided")
