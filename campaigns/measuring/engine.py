"""The run engine: one small loop over groups of shots. When anything goes wrong the robot stops."""

from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from math import dist, inf

from campaigns.errors import GateRefused, NotSettled, TargetOutOfReach
from campaigns.evaluation.time_series import FEWEST_VISITS
from campaigns.journal.records import Event, Outcome, PairVoided, Rejected
from campaigns.measuring.monitors import DriftMonitor, TemperatureMonitor
from campaigns.measuring.reacquisition import (
    ELSEWHERE,
    LOOK_AT_THE_DRIVES,
    NOT_MOVING,
    Reacquisition,
)
from campaigns.measuring.reference_poses import (
    ReferenceNoise,
    ReferencePose,
    pose_settling,
    reference_poses,
)
from campaigns.measuring.run_state import EngineState, PositionUncertainty
from campaigns.measuring.running_fit import next_size
from campaigns.measuring.series_log import problem_of
from campaigns.measuring.shot_taker import (
    ReflectorUnseen,
    ShotFailed,
    ShotRefused,
    ShotTaker,
    Skipped,
    TargetRefused,
)
from campaigns.measuring.stability_check import ANEW, StabilityCheck, drift_text
from campaigns.measuring.station import StationMonitor
from campaigns.measuring.stopping_rule import early_stop, in_ranges, in_words
from campaigns.measuring.wishes import Wish
from campaigns.measuring.work import Session
from campaigns.planning.steps import Group, Step, groups, shots_of
from campaigns.shots.shot_sets import ShotSet
from drivers.errors import RobotStateUnknown

LOOK_S = 0.1
"""How often a pause looks at faults and wishes."""
SUSPECTS = 3
"""First shots that are measured again when a later one contradicts them."""
MOST_IN_A_ROW = 3
"""Groups one after another that cannot be measured; then it is not the poses."""
NOISE_GROWTH = 0.25
"""Share by which the shots have grown when the scatter of poses is worth estimating anew."""
FIT_GROWTH = 0.02
"""Share by which the shots have grown when they are fitted again; a few: after each pair."""
MOST_DEFERRED = 0.2
"""Share of a plan's groups that cannot be measured and still let the run go on."""


class Engine:
    """Measures groups of steps: pairs whole or again, and everything watched."""

    def __init__(
        self,
        session: Session,
        shot_taker: ShotTaker,
        reacquisition: Reacquisition,
        drift: DriftMonitor,
        air: TemperatureMonitor,
        station: StationMonitor | None,
    ) -> None:
        """`station` is None where nobody said where the tracker stands."""
        self._session = session
        self._log, self._gate, self._run_state = session.log, session.gate, session.run_state
        self._shot_taker = shot_taker
        self._reacquisition = reacquisition
        self._drift, self._air, self._station = drift, air, station
        self._uncertainty = session.work.uncertainty_monitor()
        self._plan = groups(session.work.steps)
        self._stability = StabilityCheck(session, shot_taker)
        self._references: tuple[ReferencePose, ...] = ()
        self._deferred: list[Group] = []
        self._in_a_row = 0
        self._compared: set[int] = set()
        self._looked_back: Counter[int] = Counter()
        self._known: PositionUncertainty | None = None
        self._at_rest: tuple[int, ...] | None = None
        self._noise: ReferenceNoise | None = None
        self._noise_due = self._update_due = 0
        self._update_by_a_fit()

    def wanted(self, left: Sequence[Group]) -> tuple[Group, ...]:
        """The groups that shall still be measured; the others are named in the journal."""
        goal = self._session.work.goal
        end = early_stop(goal, self._known, left)
        if end is None:
            return tuple(left)
        wanted, event = end
        self._log.announce(event)
        self._run_state.leave_out(sum(map(len, left)) - sum(map(len, wanted)))
        return wanted

    def run(self, left: Sequence[Group]) -> None:
        """Measure all groups; raises whatever made it stop, once the robot has been stopped.

        `RobotStateUnknown` when the stop could not be confirmed.
        """
        self._guarded(lambda: self._measure_all(left))

    def check_unmoved(self) -> None:
        """Measure reference poses again after a restart, or where there are few, one alone.

        Raises `GateRefused` when something has changed, unless the operator overrides it: what
        was measured before then predicts nothing any more. Stops the robot like `run`.
        """
        self._guarded(self._refuse_change)

    def _guarded(self, work: Callable[[], None]) -> None:
        try:
            work()
        except BaseException as error:
            self._stop(error)
            raise

    def _stop(self, because: BaseException) -> None:
        try:
            self._retry_stop()
        except BaseException as error:
            raise RobotStateUnknown(
                f"robot state unknown: the stop failed ({problem_of(error)}), "
                f"after: {problem_of(because)}",
                remedy="use the hardware stop",
            ) from error
        finally:
            self._run_state.enter(EngineState.STOPPED)

    def _retry_stop(self) -> None:
        try:
            self._session.cell.robot.stop()
        except KeyboardInterrupt:  # an impatient operator: the robot comes first
            self._session.cell.robot.stop()

    def _measure_all(self, groups_left: Sequence[Group]) -> None:
        left = self.wanted(groups_left)
        while left:
            first = self._measured(left[0])
            left = self.wanted(self._heeded((*first, *left[1:])))
        left = self.wanted(self._deferred)
        while left:
            self._measure_once_more(left[0])
            left = self._heeded(left[1:])
        self._update_by_a_fit()
        if groups_left and (references := self._references or self._chosen_at_end()):
            change = self._stability.at_end(references)
            if change:
                self._log.tell(change)
        self._shot_taker.nests.leave()
        if end := self._session.work.ends_at:
            self._session.mover.return_to(end, "to where it ends", self._run_state.enter)
            self._run_state.rest()
        self._run_state.enter(EngineState.FINISHED)

    def _chosen_at_end(self) -> tuple[ReferencePose, ...]:
        """Poses that are compared at the end where none were after a restart."""
        work = self._session.work
        found = reference_poses(work.steps, self._gate.accepted) if work.compared_at_end else ()
        return found if len(found) > 1 else ()

    def _measured(self, group: Group) -> tuple[Group, ...]:
        """Measure a group, or defer it; gives what is to be measured before the rest.

        That is nothing, unless an earlier shot was the wrong one: then its group, and this one.
        """
        try:
            self._shot_taker.retry(partial(self._measure_group, group))
        except GateRefused as error:
            lost = error.__cause__
            if not isinstance(lost, ShotFailed):
                raise
            if isinstance(lost, ShotRefused):
                first = self._recover(lost)
                if first is not None:
                    return (*first, group)
            self._defer(group, error, lost)
        except Skipped:
            self._tell_skipped_by_wish(group)
        else:
            self._in_a_row = 0
        return ()

    def _heeded(self, left: tuple[Group, ...]) -> tuple[Group, ...]:
        """Heed the operator's wishes between two groups; gives what is to be measured now."""
        wishes = self._session.wishes
        while True:
            if wishes.take(Wish.AGAIN):
                left = (*self._void_last(), *left)
            if wishes.take(Wish.PARK):
                self._park()
            elif wishes.take(Wish.PAUSE):
                self._pause("paused by the operator")
            else:
                return left

    def _void_last(self) -> tuple[Group, ...]:
        """The group of the last shot that counts, voided as the operator wishes; none is told."""
        last = self._gate.accepted[-1].shot if self._gate.accepted else None
        group = next((g for g in self._plan if last in shots_of(g)), None)
        if group is not None:
            return (self._void_by_wish(group),)
        self._log.announce(Event("operator note", "no shot counts that can be measured again"))
        return ()

    def _void_by_wish(self, group: Group) -> Group:
        counted = {outcome.shot for outcome in self._gate.accepted}
        shots = tuple(shot for shot in shots_of(group) if shot in counted)
        text = f"{in_words(shots)} measured again, as the operator wishes"
        self._log.announce(Event("operator note", text, shots))
        self._void(group[0].planned.pair, shots, text)
        return group

    def _park(self) -> None:
        """Go where somebody can reach the robot, by a checked way, and wait there."""
        joints = self._session.work.park_joints
        if joints is not None:
            mover = self._session.mover
            try:
                mover.return_to(joints, "to where it is parked", self._run_state.enter)
            except (TargetOutOfReach, NotSettled) as error:
                self._log.announce(Event("operator note", f"not parked: {error.problem}"))
            self._run_state.rest()
        self._pause("parked by the operator")

    def _pause(self, text: str) -> None:
        """Wait, the robot watched, until the operator goes on."""
        self._log.announce(Event("operator note", text))
        self._run_state.enter(EngineState.PAUSED)
        while not self._session.wishes.take(Wish.PAUSE):
            self._session.mover.require_sound()
            self._session.mover.pause(LOOK_S)
        self._run_state.rest()
        self._log.announce(Event("operator note", "the operator goes on"))

    def _recover(self, lost: ShotRefused) -> tuple[Group, ...] | None:
        """The groups to measure anew before the refused one is; None: it is the one at fault.

        By the shots that count it is they that are wrong, the refused one, or the beam. Raises
        `GateRefused` when the beam cannot be brought back onto the robot's reflector.
        """
        refused = lost.refused
        if standing := self._gate.standing(refused):
            why = _of_one_point((*standing, refused))
            first = dict.fromkeys(
                self._void_first(each, f"{why}: a reflector that stands elsewhere")
                for each in standing
                if each.shot in {outcome.shot for outcome in self._gate.accepted}
            )
            if not self._reacquisition.look_back(refused.point_in_tracker_mm):
                raise GateRefused(f"{why}: {ELSEWHERE}, or {NOT_MOVING}", remedy=LOOK_AT_THE_DRIVES)
            return tuple(first)
        for suspect in self._gate.suspects(refused)[:SUSPECTS]:
            if (wrong := self._compare(suspect, refused)) is not None:
                return (wrong,)
        looked = self._looked_back[refused.shot]
        if lost.relocked or looked >= self._session.work.gate.attempts - 1:
            return None
        self._looked_back[refused.shot] += 1
        return () if self._reacquisition.look_back() else None

    def _compare(self, suspect: Outcome, refused: Outcome) -> Group | None:
        """The group of a first shot, voided, if it is wrong; it is measured again once."""
        step = next((s for g in self._plan for s in g if s.planned.shot == suspect.shot), None)
        if step is None or suspect.shot in self._compared:  # or its row was taken out since
            return None
        self._compared.add(suspect.shot)
        try:
            again = self._shot_taker.retry(partial(self._shot_taker.look, step))
        except Skipped:
            return None
        away_mm = dist(suspect.point_in_tracker_mm, again.point_in_tracker_mm)
        reason = f"only compared with the one before, {away_mm:.3f} mm away"
        self._shot_taker.compare_only(again, reason)
        if not self._gate.is_replaced(suspect, again, refused):
            return None
        return self._void_first(
            suspect,
            f"a wrong target or a wrong pose: measured again it is {away_mm:.1f} mm away, "
            f"where shot {refused.shot} agrees with it",
        )

    def _defer(self, group: Group, error: GateRefused, lost: ShotFailed) -> None:
        """Leave a group for the end; raises what was wrong when it is more than single poses."""
        self._deferred.append(group)
        self._in_a_row += not isinstance(lost, ReflectorUnseen)
        most = max(MOST_IN_A_ROW, MOST_DEFERRED * len(self._plan))
        if self._in_a_row >= MOST_IN_A_ROW or len(self._deferred) > most:
            if isinstance(lost, TargetRefused) and isinstance(lost.__cause__, Exception):
                raise lost.__cause__
            one_point = self._reacquisition.poses_of_one_point()
            if isinstance(lost, ShotRefused) and len(one_point) > 1:
                problem = f"{_of_one_point(one_point)}: {ELSEWHERE}, or {NOT_MOVING}"
                raise GateRefused(problem, remedy=LOOK_AT_THE_DRIVES) from error
            raise error
        self._tell_skipped(group, "set aside, to be tried once more at the end", error)

    def _measure_once_more(self, group: Group) -> None:
        try:
            self._shot_taker.retry(partial(self._measure_group, group), allowed=1)
        except GateRefused as error:
            if not isinstance(error.__cause__, ShotFailed):
                raise
            self._tell_skipped(group, "skipped", error)
        except Skipped:
            self._tell_skipped_by_wish(group)

    def _tell_skipped_by_wish(self, group: Group) -> None:
        shots = shots_of(group)
        text = f"{in_words(shots)} skipped: by the operator"
        self._log.announce(Event("shot skipped", text, shots))

    def _tell_skipped(self, group: Group, how: str, error: GateRefused) -> None:
        shots = shots_of(group)
        text = f"{in_words(shots)} {how}: {error.problem}"
        self._log.announce(Event("shot skipped", text, shots))

    def _measure_group(self, group: Group) -> None:
        """A pair or a single shot, as a whole."""
        taken: list[int] = []
        try:
            for step in group:
                self._measure(step)
                taken.append(step.planned.shot)
        except ShotFailed as lost:
            if taken:  # one does not count without its partner
                self._void(group[0].planned.pair, tuple(taken), str(lost))
            raise

    def _measure(self, step: Step) -> None:
        wall_clock = self._session.cell.wall_clock
        started_s = wall_clock.now_s()
        outcome = self._shot_taker.measure(step)
        if nest := step.planned.nest:
            self._shot_taker.accept_nest(nest, outcome)
            self._run_state.accept(wall_clock.now_s() - started_s, None, None)
            return
        drift_mm = self._drift_mm(outcome) if step.planned.purpose is ShotSet.DRIFT else None
        self._shot_taker.accept(outcome)
        if (
            step.planned.purpose is ShotSet.IDENTIFICATION
            and len(self._gate.accepted) >= self._update_due
        ):
            self._update_by_a_fit()
        seconds = wall_clock.now_s() - started_s
        self._run_state.accept(seconds, outcome.residual_mm, drift_mm)
        if step.planned.purpose is ShotSet.DRIFT:
            self._tell_settling()
        seen = self._station.events(self._gate.accepted) if self._station else ()
        for event in (*self._air.events(outcome.weather), *seen):
            self._log.announce(event)

    def _tell_settling(self) -> None:
        """Whether the robot has settled, where that is news; one that was at rest is only noted."""
        work, kept = self._session.work, self._gate.accepted
        drift = {s.planned.shot for s in work.steps if s.planned.purpose is ShotSet.DRIFT}
        visits = [outcome for outcome in kept if outcome.shot in drift]
        if len(visits) < FEWEST_VISITS:
            return
        if (noise := self._noise) is None or len(kept) >= self._noise_due:
            noise = self._noise = work.reference_noise(kept)
            self._noise_due = next_size(len(kept), NOISE_GROWTH)
        if noise.freedom == inf:
            return  # nor is it known by how much it scatters
        rest, text = pose_settling(work.robot.kinematics, kept, visits, noise)
        if self._at_rest is None or rest[:1] != self._at_rest[:1]:
            tell = self._log.write if len(rest) == len(visits) else self._log.announce
            tell(Event("settling", text, rest))
        self._at_rest = rest

    def _drift_mm(self, outcome: Outcome) -> float | None:
        """How far a drift shot is from the first one; one too far is rejected and ends the run."""
        drift = self._drift
        moved_mm = drift.moved_mm(outcome.point_in_tracker_mm)
        if moved_mm is None:
            return None
        text = drift_text("the drift pose is", moved_mm, drift.limit_mm)
        self._log.write(Event("drift check", f"shot {outcome.shot}: {text}"))
        if moved_mm <= drift.limit_mm:
            return moved_mm
        self._log.write(Rejected(outcome.shot, outcome.attempt, text, outcome))
        raise GateRefused(
            f"shot {outcome.shot}: {text}",
            remedy="the tracker, the robot or its base has moved: fix it, then begin anew "
            "with --anew",
        )

    def _void_first(self, wrong: Outcome, why: str) -> Group:
        """Void a shot, its pair with it, and name it to the operator; gives its group."""
        event = Event("shot voided", f"shot {wrong.shot} does not count: {why}")
        self._log.announce(event)
        group = next((g for g in self._plan if wrong.shot in shots_of(g)), ())
        self._drift.reset(wrong.point_in_tracker_mm)
        counted = {outcome.shot for outcome in self._gate.accepted}
        pair = group[0].planned.pair if group else None
        shots = tuple(shot for shot in shots_of(group) if shot in counted) or (wrong.shot,)
        self._void(pair, shots, event.text)
        return group

    def _void(self, pair: int | None, shots: tuple[int, ...], reason: str) -> None:
        self._log.write(PairVoided(pair, shots, reason))
        self._gate.reset(shots)
        self._update_by_a_fit()
        self._run_state.void(len(shots))

    def _refuse_change(self) -> None:
        references = reference_poses(self._session.work.steps, self._gate.accepted)
        if not references:
            return
        change = self._stability.after_restart(references)
        if change and not self._session.work.override:
            raise GateRefused(change, remedy=ANEW)
        if change:
            self._log.announce(Event("gone on anyway", f"gone on all the same: {change}"))
            self._gate.reset([shot.shot for shot in self._gate.accepted])
            self._drift.reset()
            self._update(None)
        elif len(references) > 1:
            self._references = references

    def _update_by_a_fit(self) -> None:
        """Fit the shots that count, as `identify` will; due again when they have grown a little."""
        self._update_due = next_size(len(self._gate.accepted), FIT_GROWTH)
        self._update(self._uncertainty.fitted(self._gate.accepted))

    def _update(self, known: PositionUncertainty | None) -> None:
        self._known = known
        self._run_state.update(known)


def _of_one_point(outcomes: Sequence[Outcome]) -> str:
    shots = in_ranges(sorted(each.shot for each in outcomes))
    return f"shots {shots} have one point, although the encoders moved between them"
