"""Memory of a cell over a restart, as a real one has it: parameters, places, counts."""

import json
import math
from collections.abc import Mapping
from typing import Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim import building
from sim.draws import Attempts, WorkedTime, target_key
from sim.errors import AssemblyLost, MemoryInvalid, ScenarioInvalid
from sim.faults import FaultScript
from sim.following import FollowingController
from sim.geometry import KINDS, Array, geometry_of, problem_with
from sim.robot.assembly import Assembly, OutOfReach, assemble, follow, joints_for, restore
from sim.robot.controller import SimulatedController
from sim.robot.driven_robot import DrivenRobot, SeenReflector, Standing
from sim.robot.linuxcnc_joints import joint_source
from sim.robot.rods import Plate, RodMechanism
from sim.scenarios.schema import Scenario
from sim.scenarios.section import Point
from sim.tracker.beam import Beam, Target
from sim.tracker.instrument import SimulatedTracker, TakenShot

REMEDY = "delete the simulated cell's memory to begin with a new cell"


class CellMemory(BaseModel):
    """State of a cell beyond what its scenario and seed already say."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    schema_: Literal["pkmcal/cell-memory/1"] = Field("pkmcal/cell-memory/1", alias="schema")
    scenario: str
    seed: int
    worked_s: float
    mechanism: str = "par4"
    geometry: dict[str, float]
    encoders_rad: tuple[float, ...]
    """Of carriages mm, here and in `play_rad` and `joints`."""
    play_rad: tuple[float, ...]
    joints: tuple[float, ...]
    plate: tuple[float, ...]
    displaced_mm: Point
    arrivals: dict[str, int]
    shots: dict[str, int]
    fault_counts: dict[str, int]
    tracker_initialised: bool
    tracker_warm: bool
    selected_reflector: int
    beam_on: Target | None
    taken: tuple[TakenShot, ...] = ()
    """What the tracker told, as it really was; memories from before have none."""

    @model_validator(mode="after")
    def _geometry_is_a_robot(self) -> Self:
        kind = KINDS.get(self.mechanism)
        if kind is None:
            raise ValueError(f"mechanism '{self.mechanism}' is not known")
        if problem := problem_with(self.geometry, kind, extensions=kind.extensions):
            raise ValueError(f"geometry: {problem}")
        if {len(self.encoders_rad), len(self.play_rad), len(self.joints)} != {kind.arms}:
            raise ValueError(f"a {kind.name} has {kind.arms} joints")
        if len(self.plate) != kind.unknowns:
            raise ValueError(f"plate holds {len(self.plate)} values, not {kind.unknowns}")
        return self

    def as_dict(self) -> dict[str, object]:
        """Plain values for a JSON file."""
        return self.model_dump(mode="json", by_alias=True)


def remembered(memory: Mapping[str, object], *, scenario: str, mechanism: str) -> CellMemory:
    """Check what was remembered; raises `MemoryInvalid`."""
    try:
        found = CellMemory.model_validate_json(json.dumps(memory))
    except (ValidationError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise MemoryInvalid(f"the cell's memory is damaged: {reason}", remedy=REMEDY) from error
    if found.scenario != scenario:
        raise MemoryInvalid(
            f"the cell's memory is of scenario '{found.scenario}', not '{scenario}'", remedy=REMEDY
        )
    if found.mechanism != mechanism:
        raise MemoryInvalid(
            f"the cell's memory is of a {found.mechanism}, not a {mechanism}", remedy=REMEDY
        )
    return found


REMEMBERED_WITHIN_MM = 0.1
"""Distance beyond any growth of the arms since the robot came to rest."""


CellController = SimulatedController | FollowingController


class RobotScene:
    """The robot as the tracker sees it."""

    def __init__(self, controller: CellController, robot: DrivenRobot) -> None:
        self._controller = controller
        self._robot = robot

    def robot_reflector(self, now_s: float) -> SeenReflector:
        """The reflector on the plate, in the base frame."""
        return self._robot.reflector(self._controller.encoders(now_s))

    def robot_is_still(self, now_s: float) -> bool:
        """Whether the robot stands."""
        return not self._controller.state(now_s).moving

    def robot_target(self) -> tuple[int, ...]:
        """Key of the place where the robot rests."""
        return target_key(self._robot.standing.encoders.tolist())


class Cell:
    """A scenario come alive. `memory` continues an earlier cell; `seed` overrides the scenario's.

    Raises `ScenarioInvalid` when no such robot can be put together, `MemoryInvalid` when the memory
    is damaged or another cell's.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        seed: int | None = None,
        memory: Mapping[str, object] | None = None,
    ) -> None:
        self.scenario = scenario
        self.kind = scenario.robot.kind
        past = None
        if memory is not None:
            past = remembered(memory, scenario=scenario.name, mechanism=self.kind.name)
        self.seed = _agreed_seed(scenario, seed, past)
        self.true_geometry = building.true_geometry(scenario.robot, self.seed)
        self._worked = WorkedTime(0.0 if past is None else past.worked_s)
        self.faults = FaultScript(
            map(building.fault_of, scenario.faults), {} if past is None else past.fault_counts
        )
        self.station = building.station_of(scenario.tracker.station)
        self.robot = self._built_robot(past)
        self.controller = self._built_controller(past)
        self._scene = RobotScene(self.controller, self.robot)
        self.tracker = self._built_tracker(past)

    def true_reflector_mm(self, now_s: float) -> Array:
        """(3,): where the reflector really is, in the base frame. A back door for tests."""
        return self._scene.robot_reflector(now_s).point_mm

    def work(self, seconds: float) -> None:
        """Let it have worked for so long: what slow effects follow when no controller is asked."""
        self._worked.add(seconds)

    def advance(self, now_s: float) -> None:
        """Let happen what is due by now."""
        self.controller.state(now_s)
        self.tracker.advance(now_s)

    def close(self) -> None:
        """Let go of the real controller that it follows, if it does."""
        if isinstance(self.controller, FollowingController):
            self.controller.close()

    def memory(self) -> dict[str, object]:
        """State for the next cell of this scenario, as plain values for JSON."""
        standing = self.robot.standing
        return CellMemory(
            schema="pkmcal/cell-memory/1",
            scenario=self.scenario.name,
            seed=self.seed,
            worked_s=self._worked.seconds,
            mechanism=self.kind.name,
            geometry=self.controller.geometry(),
            encoders_rad=tuple(standing.encoders.tolist()),
            play_rad=tuple(standing.play.tolist()),
            joints=tuple(standing.assembly.joints.tolist()),
            plate=tuple(standing.assembly.plate.unknowns.tolist()),
            displaced_mm=tuple(standing.displaced_mm.tolist()),
            arrivals=self.robot.arrivals.memory(),
            shots=self.tracker.attempts.memory(),
            fault_counts=self.faults.memory(),
            tracker_initialised=self.tracker.is_initialised,
            tracker_warm=self.tracker.is_warm,
            selected_reflector=self.tracker.selected,
            beam_on=self.tracker.beam.locked_on,
            taken=tuple(self.tracker.taken),
        ).as_dict()

    def _built_robot(self, past: CellMemory | None) -> DrivenRobot:
        section = self.scenario.robot
        rods = building.rod_mechanism(section, self.true_geometry, self.seed)
        behaviour = building.behaviour(section)
        growth = behaviour.thermal.growth(self._worked.seconds)
        standing = (
            self._first_standing(rods, growth) if past is None else _restored(past, rods, growth)
        )
        return DrivenRobot(
            rods,
            behaviour,
            building.mount(section, self.station),
            standing,
            seed=self.seed,
            worked=self._worked,
            arrivals=Attempts({} if past is None else past.arrivals),
        )

    def _first_standing(self, rods: RodMechanism, growth: float) -> Standing:
        """Standing at the start pose as the controller understands it, by the true robot."""
        start = self.scenario.controller.start
        position_mm = np.array([start.x_mm, start.y_mm, start.z_mm])
        theta_rad = math.radians(start.theta_deg)
        commanded = geometry_of(self.scenario.controller_flat(), self.kind)
        truth = geometry_of(self.true_geometry, self.kind)
        step = building.controller_settings(self.scenario.controller, self.kind).resolution
        try:
            encoders = np.round(joints_for(commanded, position_mm, theta_rad) / step) * step
            near = assemble(rods, truth, position_mm, theta_rad, growth)
            assembly = follow(rods, near, encoders, growth)
        except (OutOfReach, AssemblyLost) as error:
            raise ScenarioInvalid(
                f"{self.scenario.name}: the robot cannot stand at controller.start ({error})",
                remedy="choose a start pose in its workspace, or smaller errors",
            ) from error
        return Standing(encoders, np.zeros(self.kind.arms), assembly, np.zeros(3))

    def _built_controller(self, past: CellMemory | None) -> CellController:
        settings = building.controller_settings(self.scenario.controller, self.kind)
        geometry = self.scenario.controller_flat() if past is None else past.geometry
        joints_from = self.scenario.controller.joints_from
        if joints_from is not None:
            return FollowingController(
                joint_source(joints_from, self.kind),
                self.robot,
                geometry=geometry,
                speed_per_s=settings.speed_per_s,
                worked=self._worked,
                kind=self.kind,
            )
        return SimulatedController(
            settings,
            self.robot,
            geometry=geometry,
            joints=self.robot.standing.encoders,
            faults=self.faults,
            worked=self._worked,
            kind=self.kind,
            drawing=building.known_drawing(self.scenario, self.true_geometry),
        )

    def _built_tracker(self, past: CellMemory | None) -> SimulatedTracker:
        section = self.scenario.tracker
        settings = building.tracker_settings(
            section,
            initialised=section.initialised if past is None else past.tracker_initialised,
            warm=past is not None and past.tracker_warm,
            selected=section.selected if past is None else past.selected_reflector,
        )
        locked_on = Target.ROBOT if section.beam_locked else None
        beam = Beam(
            self._scene,
            self.station,
            standing_in_base_mm=building.other_reflector_mm(section),
            acceptance_rad=math.radians(section.acceptance_deg),
            locked_on=locked_on if past is None else past.beam_on,
        )
        return SimulatedTracker(
            settings,
            self._scene,
            beam,
            seed=self.seed,
            faults=self.faults,
            worked=self._worked,
            attempts=Attempts({} if past is None else past.shots),
            taken=() if past is None else past.taken,
        )


def _agreed_seed(scenario: Scenario, seed: int | None, past: CellMemory | None) -> int:
    """The seed asked for, the one remembered, or the scenario's."""
    if past is None:
        return scenario.seed if seed is None else seed
    if seed is not None and seed != past.seed:
        raise MemoryInvalid(f"the cell's memory is of seed {past.seed}, not {seed}", remedy=REMEDY)
    return past.seed


def _restored(past: CellMemory, rods: RodMechanism, growth: float) -> Standing:
    """Standing as it was to the last bit, so that everything goes on unchanged."""
    joints, plate = np.array(past.joints), Plate(np.array(past.plate))
    try:
        found = restore(rods, joints, plate, growth)
    except AssemblyLost as error:
        raise MemoryInvalid(
            f"the cell's memory is damaged: {error.problem}", remedy=REMEDY
        ) from error
    if np.abs(found.plate.unknowns - plate.unknowns).max() > REMEMBERED_WITHIN_MM:
        raise MemoryInvalid("the cell's memory is damaged: its plate is elsewhere", remedy=REMEDY)
    return Standing(
        np.array(past.encoders_rad),
        np.array(past.play_rad),
        Assembly(joints, plate, found.side),
        np.array(past.displaced_mm),
    )
