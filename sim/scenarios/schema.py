"""Schema of a scenario file (`pkmcal/cell/1`).

Docstrings of the fields are the words of docs/reference/files.md, which `make reference` writes.
"""

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from sim import faults as script
from sim.geometry import problem_with
from sim.robot.section import ControllerSection, RobotSection, changed
from sim.section import Count, NotNegative, Positive, Section, nearest
from sim.tracker.section import TrackerSection


class FaultSection(Section):
    """Entry of the fault script: exactly one of the keys of `KINDS`; at_answer with a device."""

    KINDS: ClassVar[dict[str, tuple[str, ...]]] = {
        "at_measurement": script.MEASUREMENT_FAULTS,
        "at_move": script.MOVE_FAULTS,
        "at_answer": script.ANSWER_FAULTS,
        "at_result": script.RESULT_FAULTS,
    }

    at_measurement: Count | None = None
    """Measurement at which it happens, from 1."""
    at_move: Count | None = None
    """Move at which it happens."""
    at_answer: Count | None = None
    """Answer of `device` at which it happens."""
    at_result: Count | None = None
    """Measurement begun by an emScon tracker at which it happens."""
    device: Literal["controller", "tracker"] | None = None
    """`controller` or `tracker`, with `at_answer`."""
    kind: str
    """Kind of fault."""
    seconds: NotNegative | None = None
    """Duration, or lateness of the answer; left out: for good."""

    @property
    def counter(self) -> str:
        """Key of the occurrence at which the fault is due."""
        return next(key for key in self.KINDS if getattr(self, key) is not None)

    def fault(self) -> script.Fault:
        """Return the fault for the fault script."""
        counts = {"at_measurement": script.Counted.MEASUREMENT, "at_move": script.Counted.MOVE}
        counts |= {"at_result": script.Counted.RESULT}
        key = self.counter
        counted = counts[key] if self.device is None else script.ANSWERS_OF[self.device]
        return script.Fault(counted, getattr(self, key), self.kind, self.seconds)

    @model_validator(mode="after")
    def _is_one_fault(self) -> Self:
        # pydantic has checked the fields one by one; these rules join several of them
        if sum(getattr(self, key) is not None for key in self.KINDS) != 1:
            raise ValueError(f"give exactly one of {', '.join(self.KINDS)}")
        if (self.device is not None) != (self.at_answer is not None):
            raise ValueError("device goes with at_answer, and at_answer with device")
        kinds = self.KINDS[self.counter]
        if self.kind not in kinds:
            raise ValueError(f"kind {self.kind} with {self.counter}; {nearest(self.kind, kinds)}")
        return self


class AcceptanceSection(Section):
    """Limits of a campaign on this cell; left out: no limit."""

    distance_mean_mm: Positive | None = None
    distance_max_mm: Positive | None = None
    rotation_deg: Positive | None = None
    rotation_mm: Positive | None = None
    straightness_mm: Positive | None = None
    repeatability_mm: Positive | None = None
    pose_accuracy_mm: Positive | None = None
    pose_repeatability_mm: Positive | None = None


class Scenario(Section):
    """A simulated cell."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the cell; another name is another cell."""
    about: str = ""
    """What the cell is for."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Seed of everything that is drawn."""
    speed_up: Annotated[float, Field(gt=0.0, le=10_000.0)] = 100.0
    """Seconds in the cell per second outside; changes no result."""
    robot: RobotSection
    controller: ControllerSection = ControllerSection()
    tracker: TrackerSection = TrackerSection()
    faults: tuple[FaultSection, ...] = ()
    """Script of faults."""
    acceptance: AcceptanceSection = AcceptanceSection()

    def controller_flat(self) -> dict[str, float]:
        """Return the geometry that the controller is delivered with."""
        return changed(self.robot.nominal_flat(), self.controller.geometry_errors)

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        if problem := problem_with(self.controller_flat(), self.robot.kind):
            raise ValueError(f"the controller's geometry: {problem}")
        joints_mm = self.controller.plate_joints_mm
        if joints_mm is not None and len(joints_mm) != self.robot.kind.arms:
            raise ValueError(
                f"controller.plate_joints_mm has {len(joints_mm)} entries, a "
                f"{self.robot.mechanism} has {self.robot.kind.arms}"
            )
        wrong = any(fault.kind == "wrong_target" for fault in self.faults)
        if wrong and self.tracker.other_reflector_mm is None:
            raise ValueError("a wrong_target needs tracker.other_reflector_mm")
        # a script has one fault for an occurrence: a second one would silently replace the first
        places = [(f.counter, f.device, getattr(f, f.counter)) for f in self.faults]
        if len(set(places)) < len(places):
            raise ValueError("two faults are at the same place")
        return self
