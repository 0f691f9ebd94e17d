"""The engine: one loop over groups of shots. When anything goes wrong the robot stops.

A group is a pair or a single shot, and counts only as a whole. If all attempts at a group fail it
is deferred, and tried once more at the end. After each group the operator's wishes are applied, and
once the goal is met, groups that are not needed any more are left out.

A refused shot may be right, and an earlier one wrong: that is found out by measuring
(`suspects.py`). A pose that cannot be measured is set aside, for it may be hidden from the tracker;
several in a row are no accident of poses, and end the run.

Whatever ends the run early, a fault, a wish or an error of this program, the robot is stopped
first. Only then is the end of the session written, for writing may fail.
"""

from collections.abc import Sequence
from functools import partial
from math import dist, inf

from campaigns.errors import GateRefused, NotSettled, TargetOutOfReach
from campaigns.evaluation.time_series import FEWEST_VISITS
from campaigns.journal.records import BeamStart, Event, Outcome, PairVoided, Rejected
from campaigns.measuring.beam import Beam
from campaigns.measuring.gate import next_fit
from campaigns.measuring.monitors import StationMonitor, TemperatureMonitor
from campaigns.measuring.nests import NestPointer
from campaigns.measuring.reference_poses import ReferencePose, pose_settling, reference_poses
from campaigns.measuring.results import (
    Accepted,
    Loss,
    Lost,
    Refused,
    ShotResult,
    Skipped,
    TakenBack,
    failure_of,
)
from campaigns.measuring.resume import ResumeState
from campaigns.measuring.run_state import EngineState, PositionUncertainty, Wish
from campaigns.measuring.shot_taker import ShotTaker
from campaigns.measuring.stability_check import BEGIN_ANEW, DRIFT, drift_text, measure_change
from campaigns.measuring.stopping import stopping_robot
from campaigns.measuring.stopping_rule import in_ranges, in_words, is_met, only_identifies
from campaigns.measuring.suspects import Suspects
from campaigns.measuring.work import Session
from campaigns.planning.steps import Group, Step, groups, shots_of
from campaigns.shots.shot_sets import ShotSet
from drivers.errors import ExplainedError
from drivers.values import Weather

MOST_IN_A_ROW = 3
"""Groups one after another that cannot be measured, from which on the poses are not the cause."""
MOST_DEFERRED = 0.2
"""Largest share of a plan's groups that may be set aside before the run ends."""


class Engine:
    """Measures groups of steps and watches drift, air and the tracker's place meanwhile."""

    def __init__(
        self, session: Session, starts: Sequence[BeamStart], kept: ResumeState, air: Weather | None
    ) -> None:
        """Take the `starts` of all sessions of the series, and the `air` of its first session."""
        self._session, self._work, self._rules = session, session.work, session.work.rules
        self._log, self._gate, self._run_state = session.log, session.gate, session.run_state
        self._beam = Beam(session, starts)
        self._shots = ShotTaker(session, self._beam, NestPointer(session, kept.kept))
        self._suspects = Suspects(session, self._shots, self._beam, self._void_shot)
        self._plan = groups(session.work.steps)
        self._first_drift_mm = kept.first_drift_mm()
        """Point of the first drift shot of each reflector."""
        self._air = TemperatureMonitor(self._rules.gate.temperature_change_degC, air)
        planned = [step.planned for step in self._work.steps]
        kinematics = self._work.robot.kinematics
        self._station = StationMonitor(self._rules.station, kinematics, planned)
        self._references: tuple[ReferencePose, ...] = ()
        self._deferred: list[Group] = []
        self._failed_in_a_row = 0
        self._uncertainty: PositionUncertainty | None = None
        self._fit_due = 0
        """Number of accepted shots at which they are fitted again."""
        self._settled_visits: tuple[int, ...] | None = None
        """Visits of the drift pose since which the robot stays, as reported last."""
        self._fit_shots()

    def run(self, groups_left: Sequence[Group]) -> None:
        """Measure all groups, the deferred ones once more, and compare the reference poses.

        Raise the error that ended the run, once the robot has been stopped, or `RobotStateUnknown`
        if the stop could not be confirmed.
        """
        self._session.mover.foresee([step for group in groups_left for step in group])
        with stopping_robot(self._session.cell.robot, self._run_state):
            self._measure_queue(groups_left)
            # By now the gate predicts better, and a person in the beam may have gone.
            deferred, self._deferred = self._deferred, []
            self._measure_queue(deferred, is_last_try=True)
            self._fit_shots()
            if groups_left:
                self._compare_at_end()
            self._shots.nests.leave()  # before the robot moves: its reflector may be in a nest
            if end := self._work.ends_at:
                self._session.mover.return_to(end, "to where it ends", self._run_state.enter)
                self._run_state.show_idle()
            self._run_state.enter(EngineState.FINISHED)

    def check_unmoved(self) -> None:
        """Measure reference poses again after a restart, or a single one if there are few.

        Raise `GateRefused` if something has moved, unless the operator overrides the check. Stop
        the robot like `run`.
        """
        with stopping_robot(self._session.cell.robot, self._run_state):
            if not (references := reference_poses(self._work.steps, self._gate.of_reflector)):
                return
            change = measure_change("after the restart", references, self._session, self._shots)
            if change and not self._work.override:
                raise GateRefused(change, remedy=BEGIN_ANEW)
            if change:
                # What was measured before predicts nothing any more: gate and drift check begin
                # again as if no shot had been taken.
                self._log.announce(Event("gone on anyway", f"gone on all the same: {change}"))
                self._gate.reset([shot.shot for shot in self._gate.accepted])
                self._first_drift_mm.clear()
                self._uncertainty = None
                self._run_state.update(None)
            elif len(references) > 1:
                self._references = references

    def leave_out_superfluous(self, groups_left: Sequence[Group]) -> tuple[Group, ...]:
        """Return the groups that shall still be measured, and name the others in the journal.

        Once the goal is met, only groups that serve more than the identification are measured.
        """
        goal_mm, uncertainty = self._work.goal_mm, self._uncertainty
        if uncertainty is None or not is_met(goal_mm, uncertainty):
            return tuple(groups_left)
        superfluous = [group for group in groups_left if only_identifies(group)]
        if superfluous:
            shots = sorted(shot for group in superfluous for shot in shots_of(group))
            text = (
                f"goal {goal_mm:g} mm met by {uncertainty.shots} shots: positions to "
                f"±{uncertainty.position_std_mm:.4f} mm; "
                f"{len(shots)} shots left out: {in_ranges(shots)}"
            )
            self._log.announce(Event("goal met", text))
            self._run_state.leave_out(len(shots))
        return tuple(group for group in groups_left if not only_identifies(group))

    def _measure_queue(self, groups_left: Sequence[Group], *, is_last_try: bool = False) -> None:
        """Measure groups one after another; defer those that fail, or skip them at the last try."""
        # Groups whose shots turned out wrong go to the head of the queue, because all later shots
        # are compared with them.
        pending = self.leave_out_superfluous(groups_left)
        while pending:
            group, *others = pending
            pending = tuple(others)
            attempts = 1 if is_last_try else self._rules.gate.attempts
            match self._shots.retry(partial(self._measure_group, group), attempts):
                case Accepted():
                    self._failed_in_a_row = 0
                case TakenBack(is_voided=is_voided):
                    last_groups = () if is_voided else self._void_last()
                    pending = (*last_groups, group, *pending)
                case Skipped():
                    self._note_skipped(group, "skipped: by the operator")
                case (Refused() | Lost()) as failure if is_last_try:
                    self._note_skipped(group, f"skipped: {failure_of(failure).problem}")
                case Lost() as lost:
                    self._defer(group, lost)
                case Refused() as refused:
                    wrong_groups = self._suspects.void_wrong_shots(refused.outcome)
                    if wrong_groups is not None:
                        pending = (*wrong_groups, group, *pending)
                    elif self._suspects.regain_reflector(refused):
                        pending = (group, *pending)
                    else:
                        self._defer(group, refused)
            pending = self.leave_out_superfluous(self._apply_wishes(pending))

    def _measure_group(self, group: Group) -> ShotResult:
        """Measure a pair or a single shot once, as a whole."""
        accepted_shots: list[int] = []
        for step in group:
            result = self._measure(step)
            if not isinstance(result, Accepted):
                if accepted_shots:  # the first shot of a pair does not count without its partner
                    self._void(group[0].planned.pair, tuple(accepted_shots), result.reason)
                    if isinstance(result, TakenBack):
                        return TakenBack(is_voided=True)
                return result
            accepted_shots.append(step.planned.shot)
        return result

    def _measure(self, step: Step) -> ShotResult:
        """Measure one shot; write it and let it count if it agrees with the accepted ones."""
        # A drift shot is compared with the first one before it counts: beyond the limit it must not
        # enter the fit that judges the next shots. What only informs (uncertainty, settling, air,
        # station) is computed after the outcome is on the disk.
        wall_clock, purpose = self._session.cell.wall_clock, step.planned.purpose
        started_s = wall_clock.now_s()
        result = self._shots.take(step)
        if not isinstance(result, Accepted):
            return result
        outcome = result.outcome
        if nest := step.planned.nest:
            self._shots.accept_nest(nest, outcome)
            self._run_state.accept(wall_clock.now_s() - started_s, None, None)
            return result
        drift_mm = self._check_drift(outcome) if purpose is ShotSet.DRIFT else None
        self._shots.accept(outcome)
        if self._uncertainty is None or len(self._gate.of_robot) >= self._fit_due:
            self._fit_shots()
        self._run_state.accept(wall_clock.now_s() - started_s, outcome.residual_mm, drift_mm)
        if purpose is ShotSet.DRIFT:
            self._report_settling()
        air = self._air.events(outcome.weather)
        for event in (*air, *self._station.events(self._gate.of_robot)):
            self._log.announce(event)
        return result

    def _check_drift(self, outcome: Outcome) -> float | None:
        """Return the distance of a drift shot from the first one; None for the first one itself.

        Raise `GateRefused` if the distance exceeds the limit.
        """
        # The gate cannot see a slow drift: its limits are millimetres, and its fit follows the
        # latest shots. The first drift shot of the series counts, also if another session took it.
        point_mm, limit_mm = outcome.point_in_tracker_mm, self._rules.gate.drift_mm
        if outcome.reflector not in self._first_drift_mm:
            self._first_drift_mm[outcome.reflector] = point_mm
            return None
        moved_mm = dist(self._first_drift_mm[outcome.reflector], point_mm)
        text = drift_text(DRIFT, moved_mm, limit_mm)
        self._log.write(Event("drift check", f"shot {outcome.shot}: {text}"))
        if moved_mm > limit_mm:
            self._log.write(Rejected(outcome.shot, outcome.attempt, text, outcome))
            raise GateRefused(
                f"shot {outcome.shot}: {text}",
                remedy="the tracker, the robot or its base has moved: fix it, then begin anew "
                "with --anew",
            )
        return moved_mm

    def _report_settling(self) -> None:
        """Report since which drift shot the robot has settled, whenever that changes."""
        accepted = self._gate.of_reflector
        drift = {s.planned.shot for s in self._work.steps if s.planned.purpose is ShotSet.DRIFT}
        visits = [outcome for outcome in accepted if outcome.shot in drift]
        if len(visits) < FEWEST_VISITS:
            return
        if self._noise.freedom == inf:
            return  # the robot's scatter has not been estimated yet
        robot = self._gate.seen_from(self._gate.reflector)
        settled, text = pose_settling(robot, accepted, visits, self._noise)
        if self._settled_visits is None or settled[:1] != self._settled_visits[:1]:
            # Only the journal notes a robot that has stayed from its first visit on: nothing is to
            # be done.
            report = self._log.write if len(settled) == len(visits) else self._log.announce
            report(Event("settling", text, settled))
        self._settled_visits = settled

    def _defer(self, group: Group, failure: Refused | Lost) -> None:
        """Leave a group for the end; raise the failure's error if too many groups fail."""
        self._deferred.append(group)
        # A pose whose reflector is hidden is a matter of the plan, and no sign that beam or robot
        # are out of order.
        is_unseen = isinstance(failure, Lost) and failure.loss is Loss.UNSEEN
        self._failed_in_a_row += not is_unseen
        most = max(MOST_IN_A_ROW, MOST_DEFERRED * len(self._plan))
        error = failure_of(failure)
        if self._failed_in_a_row < MOST_IN_A_ROW and len(self._deferred) <= most:
            how = f"set aside, to be tried once more at the end: {error.problem}"
            self._note_skipped(group, how)
            return
        # The most specific error ends the run: the controller's own, or that the robot does not
        # move, or else that the attempts have failed.
        match failure:
            case Lost(error=ExplainedError() as refusal):
                raise refusal
            case Refused():
                self._beam.require_robot_moves()
        raise error

    def _void_shot(self, wrong: Outcome, reason: str) -> Group:
        """Void a shot, its pair with it, and announce why.

        If the first drift shot is void, the next one takes its place.

        Return the shot's group; () if the plan does not have the shot any more.
        """
        event = Event("shot voided", f"shot {wrong.shot} does not count: {reason}")
        self._log.announce(event)
        group = next((g for g in self._plan if wrong.shot in shots_of(g)), ())
        if wrong.point_in_tracker_mm == self._first_drift_mm.get(wrong.reflector):
            del self._first_drift_mm[wrong.reflector]  # the next drift shot becomes the first one
        pair = group[0].planned.pair if group else None
        self._void(pair, self._counting_shots(group) or (wrong.shot,), event.text)
        return group

    def _counting_shots(self, group: Group) -> tuple[int, ...]:
        """Return the shots of a group that count."""
        accepted = {outcome.shot for outcome in self._gate.accepted}
        return tuple(shot for shot in shots_of(group) if shot in accepted)

    def _void(self, pair: int | None, shots: tuple[int, ...], reason: str) -> None:
        """Withdraw the outcomes of shots: first in the journal, then in gate, fit and display."""
        self._log.write(PairVoided(pair, shots, reason))
        self._gate.reset(shots)
        self._fit_shots()
        self._run_state.void(len(shots))

    def _note_skipped(self, group: Group, how: str) -> None:
        shots = shots_of(group)
        self._log.announce(Event("shot skipped", f"{in_words(shots)} {how}", shots))

    def _apply_wishes(self, pending: tuple[Group, ...]) -> tuple[Group, ...]:
        """Apply the operator's wishes between two groups; return the groups to measure now."""
        # Until no wish remains: the operator may ask for more while the run pauses.
        wishes = self._session.wishes
        while True:
            if wishes.take(Wish.AGAIN):
                pending = (*self._void_last(), *pending)
            if wishes.take(Wish.PARK):
                self._park()
            elif wishes.take(Wish.PAUSE):
                self._pause("paused by the operator")
            else:
                return pending

    def _void_last(self) -> tuple[Group, ...]:
        """Void the group of the last shot that counts, and return it; none without such a shot."""
        last = self._gate.accepted[-1].shot if self._gate.accepted else None
        for group in self._plan:
            if last in shots_of(group):
                shots = self._counting_shots(group)
                text = f"measuring {in_words(shots)} again (operator)"
                self._log.announce(Event("operator note", text, shots))
                self._void(group[0].planned.pair, shots, text)
                return (group,)
        self._log.announce(Event("operator note", "no shot counts that can be measured again"))
        return ()

    def _park(self) -> None:
        """Go where somebody can reach the robot, by a checked way, and wait there."""
        joints = self._work.park_joints
        if joints is not None:
            mover = self._session.mover
            try:
                mover.return_to(joints, "to where it is parked", self._run_state.enter)
            except (TargetOutOfReach, NotSettled) as error:
                # Parking is a convenience: the robot waits where it stands, and the run goes on.
                self._log.announce(Event("operator note", f"not parked: {error.problem}"))
            self._run_state.show_idle()
        self._pause("parked by the operator")

    def _pause(self, text: str) -> None:
        """Wait until the operator goes on; raise the robot's faults and `Interrupted` meanwhile."""
        self._log.announce(Event("operator note", text))
        self._run_state.enter(EngineState.PAUSED)
        while not self._session.wishes.take(Wish.PAUSE):
            self._session.mover.require_sound()
            self._session.mover.pause(0.1)
        self._run_state.show_idle()
        self._log.announce(Event("operator note", "resumed by the operator"))

    def _compare_at_end(self) -> None:
        """Compare the poses that were compared after a restart, or as many as there are."""
        # A change is noted for report and verdict, and does not end a run whose shots are measured.
        # Those of another reflector than that which is measured now would have to be carried to.
        references = tuple(
            pose for pose in self._references if pose[1].reflector == self._gate.reflector
        )
        if not references and self._work.compared_at_end:
            spread = reference_poses(self._work.steps, self._gate.of_reflector)
            references = spread if len(spread) > 1 else ()
        if not references:
            return
        try:
            change = measure_change("at the end", references, self._session, self._shots)
        except GateRefused as error:
            change = f"at the end a pose could not be compared: {error.problem}"
            self._log.write(Event("drift check", change))
        if change:
            self._log.show(change)

    def _fit_shots(self) -> None:
        """Fit the shots that count as `identify` will, and show the uncertainty."""
        # Again when the shots have grown by half: σ falls by a fifth, with their square root. With
        # a goal each twentieth, lest the run measures far beyond it.
        accepted, work = self._gate.of_robot, self._work
        self._fit_due = next_fit(len(accepted), 0.5 if work.goal_mm is None else 0.05)
        posterior = work.uncertainty_monitor.posterior(accepted)
        self._noise = work.noise_by(posterior)
        self._uncertainty = work.uncertainty_monitor.stated(posterior)
        self._run_state.update(self._uncertainty)
