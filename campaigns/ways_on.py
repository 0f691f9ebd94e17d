"""Ways on from an identification that did not pass, and the next step by what stands against it.

Pure.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from campaigns.estimation.estimators import Estimator, Model
from campaigns.evaluation import diagnostics, identification
from campaigns.evaluation.summary import Spread
from campaigns.identification.result import RecordedIdentification
from campaigns.next_step import NextStep, WayOn

ENOUGH_SHOTS = 240
"""Number of shots to identify from, beyond which more tell nothing new."""
FEWEST_SHOTS = 40
"""Number of shots from which a part can be identified alone, or some pairs be kept unseen."""
FEW = {
    identification.UNTOLD,
    identification.TOO_FEW,
    identification.NOTHING_UNSEEN,
    diagnostics.EXTRAPOLATION,
}
"""Names of doubts that more shots settle."""
AGAIN = {
    diagnostics.KNOWN_LENGTH,
    diagnostics.UNKNOWN_POSITIONS,
    identification.MANY_LEFT_OUT,
    identification.LOST,
}
"""Names of doubts that only another measurement settles."""
TAKEN = {
    diagnostics.LARGE_CHANGE: "look at units, joints and robot.yaml; if the robot is built so",
    diagnostics.COMMON_SCALE: "check the reflector's and the air's constants; if it is the robot",
}
"""What to do before a doubt is accepted."""
FREED = {"reflector": "reflector_constant_mm"}
"""Parameters that are in no model, by the cause of a lack of fit."""
MEND = "mend what the diagnostics name"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Unusable:
    """Identification that did not pass, with what the way on from it depends on.

    `shots`: how many it was made from. Sessions, by number, of all shots that were measured; limits
    are of distances, mean and max.
    """

    found: RecordedIdentification
    shots: int
    limits_mm: Mapping[str, float] = field(default_factory=dict)
    sessions: Mapping[int, int] = field(default_factory=dict)
    folder: str = "DIR"
    imported: bool = False
    """Whether further shots are imported too."""
    shot_s: float | None = None
    """Time that a shot took; None where nobody knows."""

    def ways_on(self) -> Iterator[WayOn]:
        """Ways on with what each would cost: a larger model, limits, more shots."""
        found, unseen = self.found, self.found.unseen_mm
        if found.model not in {Model.AUTO, Model.EXTENDED}:
            larger = self._identify("--model", Model.AUTO.value)
            yield WayOn("model", larger, "no new shot, some seconds")
        if unseen is not None and found.verdict == "not decided":
            yield WayOn("limits", self._by_limits(unseen.after), "no new shot, if these will do")
        if self.shots < ENOUGH_SHOTS and not self.imported:
            more = NextStep(("plan", self.folder, "--shots", str(2 * self.shots)))
            took = "" if self.shot_s is None else f", about {self.shot_s * self.shots / 60:.0f} min"
            halved = "σ falls to about 0.7 of what it is"
            yield WayOn("shots", more, f"{self.shots} more shots{took}; {halved}")

    def way_on(self) -> NextStep:
        """Next step by the first that stands against it."""
        found = self.found
        affecting = [each for each in found.doubts if each.affects_verdict]
        name = next(iter(found.obstacles or [each.name for each in affecting]), "")
        numbers = next((each.numbers for each in affecting if each.name == name), {})
        freed = FREED.get(str(numbers.get("cause")), "")
        if name == identification.PRIOR or not name:
            return self._identify()
        if name in TAKEN:
            return self._identify(diagnostics.ACCEPT[name], first=TAKEN[name])
        if name in AGAIN:
            return self._measure(MEND)
        if name in FEW or (name == diagnostics.CHANGE and found.verdict == "not decided"):
            return self._with_few_shots(name)
        if name == diagnostics.CHANGE:
            at = float(numbers.get("before_shot", 0.0))
            return self._after_change(str(numbers.get("kind")), at)
        if numbers.get("cause") == "backlash" and Estimator.DISTANCES.value in found.asked:
            return self._identify()  # all coordinates tell what gears lose
        if freed and not found.asked:
            return self._identify("--free", freed)
        return self._past_a_lack()

    def _identify(self, *option: str, first: str = "") -> NextStep:
        """Identification with one option at most.

        Options of two remedies would have to be typed together. So an identification that had any
        is followed by a measurement, not by another option: two remedies never alternate.
        """
        return NextStep(("identify", self.folder, *option), first)

    def _measure(self, first: str) -> NextStep:
        if self.imported:
            return NextStep(("import", self.folder, "FILE"), f"{first}, measure again")
        return NextStep(("run", self.folder, "--anew"), first)

    def _with_few_shots(self, name: str) -> NextStep:
        """Way on where the shots do not tell enough."""
        if Estimator.DISTANCES.value in self.found.asked:  # coordinates tell σ of few
            return self._identify()
        unseen = name == identification.NOTHING_UNSEEN and not self.found.asked
        if unseen and self.shots >= FEWEST_SHOTS:
            return self._identify("--hold-out", "20%")
        if self.shots < ENOUGH_SHOTS and self.imported:
            pairs = ", with pairs of the set validation" if unseen else ""
            many = f"measure {2 * self.shots} shots all over the workspace{pairs}"
            return NextStep(("import", self.folder, "FILE"), many)
        if self.shots < ENOUGH_SHOTS:
            return NextStep(("plan", self.folder, "--shots", str(2 * self.shots)))
        if name == diagnostics.EXTRAPOLATION:
            space = "leave out what was not measured, under space in campaign.yaml"
            return self._identify(first=space)
        lost = () if self.found.asked else self.found.unobservable
        return self._identify("--fix", lost[0][0]) if lost else self._measure(MEND)

    def _after_change(self, kind: str, at: float) -> NextStep:
        """Way on after a change: frames of their own, or the larger part of the shots alone."""
        sessions = self.sessions
        early = [number for number in sessions if number < at]
        late = [number for number in sessions if number >= at]
        apart = not {sessions[number] for number in early} & {sessions[number] for number in late}
        if self.found.asked or kind == "drift":
            return self._measure(MEND)
        if kind == "frame" and early and late and apart:
            return self._identify("--sessions")
        if max(len(early), len(late)) < FEWEST_SHOTS:
            return self._measure(MEND)
        part = f"-{max(early)}" if len(early) >= len(late) else f"{min(late)}-"
        return self._identify("--shots", part)

    def _past_a_lack(self) -> NextStep:
        """Way on where the model lacks something: a larger one, or limits kept without it."""
        found, unseen = self.found, self.found.unseen_mm
        if found.model not in {Model.AUTO, Model.EXTENDED} and not found.asked:
            return self._identify("--model", Model.AUTO.value)
        if found.verdict == "fail" or unseen is None:
            return self._measure(MEND)
        return self._by_limits(unseen.after)

    def _by_limits(self, reached: Spread) -> NextStep:
        """Identification again once the limits are such as hold-out pairs keep."""
        if diagnostics.limits_met(reached, self.limits_mm):
            return self._identify()
        figures = f"mean {reached.mean_abs:.3f}, largest {reached.max_abs:.3f} mm"
        limits = f"acceptance.distance_mean_mm and distance_max_mm (hold-out pairs: {figures})"
        if self.limits_mm:
            return self._identify(first=f"{MEND}, or widen {limits} in campaign.yaml")
        return self._identify(first=f"set the limits that must be met in campaign.yaml: {limits}")
