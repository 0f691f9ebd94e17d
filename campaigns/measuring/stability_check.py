"""Stability check: poses measured again after a restart and at the end; what has moved.

All shots of a series share one frame of the tracker. If the stand was pushed between two sessions,
or an encoder lost its zero, the fit would still find parameters, and they would be wrong. So three
or four accepted poses, far from each other, are measured again. `rigid_body_test` decides whether
the noise explains the differences and, if not, whether a motion of the tracker, one encoder or
something else does. A single pose, where there are no three, can only show a distance: it has a
fixed limit.

The repetitions go into the journal as rejected, with their data: they are no shots of the plan, and
must neither count twice in the fit nor enter the gate that rests on the poses they are compared
with.
"""

import re
from collections.abc import Sequence
from functools import partial
from math import dist

from campaigns.journal.records import Event, EventKind, Outcome
from campaigns.measuring.reference_poses import FEWEST_POSES, ReferencePose, rigid_body_test
from campaigns.measuring.results import SKIPPED, Accepted, Lost, Skipped, TakenBack, failure_of
from campaigns.measuring.shot_taker import ShotTaker
from campaigns.measuring.work import Session
from campaigns.planning.steps import Step

BEGIN_ANEW = (
    "shots before and after it have no common frame: mend it, then begin anew with "
    "--anew; or `pkmcal run DIR --force` goes on all the same"
)
DRIFT = "the drift pose is"
_DRIFT_MM = re.compile(rf"{DRIFT} ([\d.]+) mm from where it was first")


def measure_change(
    when: str, references: Sequence[ReferencePose], session: Session, shots: ShotTaker
) -> str:
    """Measure reference poses again; return what has changed, in words; "" for no change.

    `when` begins the text. Raise `GateRefused` if a pose cannot be measured.
    """
    pairs = [(before, _measure_again(step, before, session, shots)) for step, before in references]
    then = [before for before, now in pairs if now is not None]
    again = [now for _, now in pairs if now is not None]
    kind: EventKind = "drift check"
    # The operator has skipped so many that nothing can be tested: his decision, which is noted.
    if len(again) < min(FEWEST_POSES, len(references)):
        text = f"{when} it is not known whether anything has moved: {SKIPPED}"
        session.log.announce(Event("operator note", text))
        return ""
    if len(again) < FEWEST_POSES:
        moved_mm = dist(then[0].point_in_tracker_mm, again[0].point_in_tracker_mm)
        limit_mm = session.work.rules.gate.drift_mm
        has_changed = moved_mm > limit_mm
        text = f"shot {again[0].shot}: {drift_text(f'{when} the pose is', moved_mm, limit_mm)}"
    else:
        # The robot's own scatter, by which poses may differ, is that of the accepted shots so far.
        work, gate = session.work, session.gate
        noise = work.noise_by(work.uncertainty_monitor.posterior(gate.of_robot))
        robot = gate.seen_from(gate.reflector)
        compared = rigid_body_test(robot, gate.of_reflector, then, again, noise)
        has_changed = bool(compared.change)
        kind = "robot changed" if compared.is_robots else kind
        text = f"{when} {compared.size}: {compared.change or 'no change detected'}"
    session.log.write(Event(kind, text))
    return text if has_changed else ""


def _measure_again(
    step: Step, before: Outcome, session: Session, shots: ShotTaker
) -> Outcome | None:
    """Return the outcome of a reference pose, even if the gate refuses it; None if skipped.

    Raise `GateRefused` if it is off by more than the gate's limit of distances: a wrong target.
    """
    # What the gate refuses by some mm is the very motion that is looked for, and is returned.
    result = shots.retry(partial(shots.take, step))
    if isinstance(result, Skipped | TakenBack):
        return None
    if isinstance(result, Lost):
        raise failure_of(result)
    away_mm = dist(before.point_in_tracker_mm, result.outcome.point_in_tracker_mm)
    if isinstance(result, Accepted):  # a refused one has been written as rejected already
        reason = f"only compared with the first one, {away_mm:.3f} mm away"
        shots.compare_only(result.outcome, reason)
    elif away_mm > session.work.rules.gate.distance_mm:
        raise failure_of(result)
    return result.outcome


def drift_mm(text: str) -> float | None:
    """Return the distance in the words of a visit to the drift pose; None for other words."""
    drift = _DRIFT_MM.search(text)
    return None if drift is None else float(drift[1])


def drift_text(what: str, moved_mm: float, limit_mm: float) -> str:
    """Return the distance of a pose from where it was first, and its limit, in words."""
    return f"{what} {moved_mm:.3f} mm from where it was first, limit {limit_mm:g} mm"
