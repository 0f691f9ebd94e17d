"""A scenario come alive as a cell, and its memory over restarts: parameters, places, counts."""

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim import factory
from sim.errors import AssemblyLost, ScenarioInvalid, SimError
from sim.faults import FaultScript
from sim.geometry import KINDS, Array, Geometry, geometry_of, problem_with
from sim.random_streams import Attempts, WorkedTime
from sim.robot.assembly import Assembly, OutOfReach, assemble, follow, joints_for, restore
from sim.robot.controller import SimulatedController
from sim.robot.driven_robot import DrivenRobot, Standing
from sim.robot.rods import Growth, Plate, RodMechanism
from sim.robot.transmission import Transmission
from sim.scenarios.schema import Scenario
from sim.section import Point
from sim.tracker.beam import Beam, Scene, Target
from sim.tracker.instrument import SimulatedTracker, TakenShot

SCHEMA: Literal["pkmcal/cell-memory/1"] = "pkmcal/cell-memory/1"
REMEDY = "delete the simulated cell's memory to begin with a new cell"
NEST = "nest "
"""Before the names of nests, so that none is called as another target."""
REMEMBERED_WITHIN_MM = 0.1
"""Distance beyond any growth of the arms since the robot came to rest."""


class CellMemory(BaseModel):
    """State of a cell beyond what its scenario and seed already say."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    schema_: Literal["pkmcal/cell-memory/1"] = Field(SCHEMA, alias="schema")
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
    attempts_before: int = 0
    """From which arrivals and shots are counted, so that another cell's are not drawn again."""
    fault_counts: dict[str, int]
    tracker_initialised: bool
    tracker_warm: bool
    selected_reflector: int
    beam_on: str | None
    taken: tuple[TakenShot, ...] = ()
    """What the tracker reported, as it really was; memories from before have none."""

    @model_validator(mode="after")
    def _geometry_is_a_robot(self) -> Self:
        kind = KINDS.get(self.mechanism)
        if kind is None:
            raise ValueError(f"mechanism '{self.mechanism}' is not known")
        if problem := problem_with(self.geometry, kind, extensions=kind.optional):
            raise ValueError(f"geometry: {problem}")
        if {len(self.encoders_rad), len(self.play_rad), len(self.joints)} != {kind.arms}:
            raise ValueError(f"a {kind.name} has {kind.arms} joints")
        if len(self.plate) != kind.unknowns:
            raise ValueError(f"plate holds {len(self.plate)} values, not {kind.unknowns}")
        return self


def remembered(memory: Mapping[str, object], *, scenario: str, mechanism: str) -> CellMemory:
    """Check what was remembered; raises `SimError`."""
    try:
        found = CellMemory.model_validate_json(json.dumps(memory))
    except (ValidationError, TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise SimError(f"the cell's memory is damaged: {reason}", remedy=REMEDY) from error
    if found.scenario != scenario:
        raise SimError(
            f"the cell's memory is of scenario '{found.scenario}', not '{scenario}'", remedy=REMEDY
        )
    if found.mechanism != mechanism:
        raise SimError(
            f"the cell's memory is of a {found.mechanism}, not a {mechanism}", remedy=REMEDY
        )
    return found


class Cell:
    """A scenario come alive. `memory` continues an earlier cell; `seed` overrides the scenario's.

    A new cell counts its attempts at each target from `attempts_before` on: it is the same robot,
    and its noise is not that of the cell before it. Raises `ScenarioInvalid` when no such robot can
    be put together, `SimError` when the memory is damaged or another cell's.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        seed: int | None = None,
        memory: Mapping[str, object] | None = None,
        attempts_before: int = 0,
    ) -> None:
        self.scenario = scenario
        section, kind = scenario.robot, scenario.robot.kind
        self.kind = kind
        past = None
        if memory is not None:
            past = remembered(memory, scenario=scenario.name, mechanism=kind.name)
        self.seed = _agreed_seed(scenario, seed, past)
        self.true_geometry = factory.true_geometry(section, self.seed)
        truth = geometry_of(self.true_geometry, kind)
        rods = RodMechanism(truth, factory.build_of(section, truth, self.seed))
        behaviour = factory.behaviour(section, self.seed)
        self._state = state = (
            _first_state(scenario, self.seed, rods, truth, behaviour.transmission).model_copy(
                update={"attempts_before": attempts_before}
            )
            if past is None
            else past
        )
        self._worked = WorkedTime(state.worked_s)
        self.faults = FaultScript((each.fault() for each in scenario.faults), state.fault_counts)
        self.station = scenario.tracker.station.pose()
        self.robot = DrivenRobot(
            rods,
            behaviour,
            factory.mount(section, self.station),
            _standing(state, rods, section.thermal.growth(state.worked_s)),
            seed=self.seed,
            worked=self._worked,
            arrivals=Attempts(state.arrivals, state.attempts_before),
        )
        self.controller = SimulatedController(
            scenario.controller,
            self.robot,
            geometry=state.geometry,
            faults=self.faults,
            worked=self._worked,
            kind=kind,
            plate=factory.known_plate(scenario, self.true_geometry),
            ripple_rate=factory.known_ripple_rate(scenario),
        )
        self._scene = Scene(self.controller, self.robot)
        self.tracker = self._tracker(state)

    def true_reflector_mm(self, now_s: float) -> Array:
        """Return (3,): where the reflector really is, in the base frame. A back door for tests."""
        return self._scene.robot_reflector(now_s).point_mm

    def advance(self, now_s: float) -> None:
        """Let happen what is due by now."""
        self.controller.state(now_s)
        self.tracker.advance(now_s)

    def memory(self) -> dict[str, object]:
        """Return the state for the next cell of this scenario, as plain values for JSON."""
        standing = self.robot.standing
        now = {
            "worked_s": self._worked.seconds,
            "geometry": self.controller.geometry(),
            "encoders_rad": tuple(standing.encoders.tolist()),
            "play_rad": tuple(standing.play.tolist()),
            "joints": tuple(standing.assembly.joints.tolist()),
            "plate": tuple(standing.assembly.plate.unknowns.tolist()),
            "displaced_mm": tuple(standing.displaced_mm.tolist()),
            "arrivals": self.robot.arrivals.memory(),
            "shots": self.tracker.attempts.memory(),
            "fault_counts": self.faults.memory(),
            "tracker_initialised": self.tracker.is_initialised,
            "tracker_warm": self.tracker.is_warm,
            "selected_reflector": self.tracker.selected,
            "beam_on": self.tracker.beam.locked_on,
            "taken": tuple(self.tracker.taken),
        }
        return self._state.model_copy(update=now).model_dump(mode="json", by_alias=True)

    def _tracker(self, state: CellMemory) -> SimulatedTracker:
        section = self.scenario.tracker
        standing = {NEST + nest.name: np.array(nest.place_mm) for nest in section.nests}
        if (other := section.other_reflector_mm) is not None:
            standing[Target.STANDING] = np.array(other)
        pose = lru_cache(maxsize=1)(section.station.pose)
        beam = Beam(
            self._scene,
            lambda: pose(self._worked.seconds),
            standing_in_base_mm=standing,
            acceptance_rad=math.radians(section.acceptance_deg),
            locked_on=state.beam_on,
        )
        return SimulatedTracker(
            section,
            self._scene,
            beam,
            initialised=state.tracker_initialised,
            warm=state.tracker_warm,
            selected=state.selected_reflector,
            seed=self.seed,
            faults=self.faults,
            worked=self._worked,
            attempts=Attempts(state.shots, state.attempts_before),
            taken=state.taken,
        )


def _first_state(
    scenario: Scenario, seed: int, rods: RodMechanism, truth: Geometry, gears: Transmission
) -> CellMemory:
    """Return a new cell's state: the true robot where its controller takes the start pose to be."""
    start, tracker, kind = scenario.controller.start, scenario.tracker, scenario.robot.kind
    position_mm = np.array([start.x_mm, start.y_mm, start.z_mm])
    theta_rad = math.radians(start.theta_deg)
    geometry = scenario.controller_flat()
    step = scenario.controller.encoder_step(kind)
    try:
        wanted = joints_for(geometry_of(geometry, kind), position_mm, theta_rad)
        encoders = np.round(wanted / step) * step
        near = assemble(rods, truth, position_mm, theta_rad)
        assembly = follow(rods, near, gears.joints(encoders))
    except (OutOfReach, AssemblyLost) as error:
        raise ScenarioInvalid(
            f"{scenario.name}: the robot cannot stand at controller.start ({error})",
            remedy="choose a start pose in its workspace, or smaller errors",
        ) from error
    return CellMemory(
        schema=SCHEMA,
        scenario=scenario.name,
        seed=seed,
        worked_s=0.0,
        mechanism=kind.name,
        geometry=geometry,
        encoders_rad=tuple(encoders.tolist()),
        play_rad=(0.0,) * kind.arms,
        joints=tuple(assembly.joints.tolist()),
        plate=tuple(assembly.plate.unknowns.tolist()),
        displaced_mm=(0.0, 0.0, 0.0),
        arrivals={},
        shots={},
        fault_counts={},
        tracker_initialised=tracker.initialised,
        tracker_warm=False,
        selected_reflector=tracker.selected,
        beam_on=Target.ROBOT if tracker.beam_locked else None,
    )


def _agreed_seed(scenario: Scenario, seed: int | None, past: CellMemory | None) -> int:
    """Return the seed asked for, the one remembered, or the scenario's."""
    if past is None:
        return scenario.seed if seed is None else seed
    if seed is not None and seed != past.seed:
        raise SimError(f"the cell's memory is of seed {past.seed}, not {seed}", remedy=REMEDY)
    return past.seed


def _standing(state: CellMemory, rods: RodMechanism, growth: Growth) -> Standing:
    """Restore the standing to the last bit, so that everything goes on unchanged."""
    joints, plate = np.array(state.joints), Plate(np.array(state.plate))
    try:
        found = restore(rods, joints, plate, growth)
    except AssemblyLost as error:
        raise SimError(f"the cell's memory is damaged: {error.problem}", remedy=REMEDY) from error
    if np.abs(found.plate.unknowns - plate.unknowns).max() > REMEMBERED_WITHIN_MM:
        raise SimError("the cell's memory is damaged: its plate is elsewhere", remedy=REMEDY)
    return Standing(
        np.array(state.encoders_rad),
        np.array(state.play_rad),
        Assembly(joints, plate, found.side),
        np.array(state.displaced_mm),
    )
