"""A scenario come alive as a cell, and its memory over restarts: parameters, places, counts.

A `Cell` is the simulated world of one campaign. A scenario and a seed come in, perhaps with the
memory that an earlier process left; encoder readings and measured points go out:

1. `factory` draws the true robot, as its manufacture and its gears turned out;
2. the robot stands where its controller takes the start pose to be, or where the memory says;
3. the controller moves encoders (robot/controller.py), gears, play, weight and warmth make joints
   of their readings (robot/driven_robot.py), and the rods place the plate (robot/rods.py);
4. the tracker looks at the reflector there from its station, and measures with noise (tracker/).

No equation is shared with the estimator: `campaigns.kinematics` closes one contracted forearm an
arm, by squares of distances; here each single rod is closed by its own length, and the controller's
inverse is a third way, by triangles (robot/assembly.py). An error of sign or of order would have to
be made twice to go unseen. Platforms of one body are held by bars (robot/bars.py); a mechanism that
has no parts here is moved by equations that the caller hands in. `sim` imports no code of
`campaigns`; an import contract holds that.
"""

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sim import factory
from sim.errors import AssemblyLost, ScenarioInvalid, SimError
from sim.faults import FaultScript
from sim.geometry import Array, Kind, geometry_of, problem_with
from sim.instruments import Instruments, ReadObject
from sim.random_streams import Attempts, Purpose, WorkedTime, generator
from sim.robot.assembly import Assembly, OutOfReach, assemble, follow, joints_for, restore
from sim.robot.bars import EquationsOf, FreeMechanism, free_mechanism
from sim.robot.controller import SimulatedController
from sim.robot.driven_robot import DrivenRobot, SeenReflector, Standing
from sim.robot.rods import Growth, Mechanism, RodMechanism
from sim.robot.transmission import Transmission
from sim.scenarios.schema import Scenario
from sim.section import Point
from sim.tracker.beam import Beam, Scene, Target
from sim.tracker.instrument import SimulatedTracker, TakenShot, TrackerState

SCHEMA: Literal["pkmcal/cell-memory/1"] = "pkmcal/cell-memory/1"
REMEDY = "delete the simulated cell's memory, cell-memory.json, to begin with a new cell"
NEST_PREFIX = "nest "
"""Before the names of nests, so that none is called as another target."""
REMEMBERED_WITHIN_MM = 0.1
"""Distance of the plate beyond what the arms can have grown since the robot came to rest."""


class Carried(BaseModel):
    """Reflector that was carried to another place on the platform."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    half: Literal[1, 2] | None
    """Half of a platform of two parts; None: the controlled point's."""
    offset_mm: Point
    """Place on its part, as a mounted reflector's."""


class TakenReading(BaseModel):
    """Reading of an instrument, with the truth; mm and rad."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    kind: str
    object: str
    values: tuple[float, ...]
    true: tuple[float, ...]


class CellMemory(BaseModel):
    """State of a cell that does not follow from its scenario and seed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    schema_: Literal["pkmcal/cell-memory/1"] = Field(SCHEMA, alias="schema")
    scenario: str
    seed: int
    worked_s: float
    mechanism: str = "par4"
    geometry: dict[str, float]
    encoders_rad: tuple[float, ...]
    """Encoder readings, rad; of carriages mm, also in `play_rad` and `joints`."""
    play_rad: tuple[float, ...]
    joints: tuple[float, ...]
    plate: tuple[float, ...]
    displaced_mm: Point
    arrivals: dict[str, int]
    shots: dict[str, int]
    attempts_before: int = 0
    """Number after which attempts are counted, to draw no noise of an earlier cell again."""
    fault_counts: dict[str, int]
    tracker_initialised: bool
    tracker_warm: bool
    selected_reflector: int
    beam_on: str | None
    taken: tuple[TakenShot, ...] = ()
    """Shots that the tracker reported, with the truth; memories of older versions have none."""
    carried: Carried | None = None
    """Where the reflector is mounted; None: where the cell file says."""
    readings: tuple[TakenReading, ...] = ()
    """Readings of instruments so far."""
    reading_counts: dict[str, int] = Field(default_factory=dict)

    # a memory is a file that may have been edited: all sizes are checked before arrays are made
    def problem_for(self, kind: Kind) -> str:
        """Return why it is of no robot of a kind; empty if it is of one."""
        if problem := problem_with(self.geometry, kind, extensions=kind.optional):
            return f"geometry: {problem}"
        if {len(self.encoders_rad), len(self.play_rad), len(self.joints)} != {kind.arms}:
            return f"a {kind.name} has {kind.arms} joints"
        if len(self.plate) != kind.unknowns:
            return f"plate holds {len(self.plate)} values, not {kind.unknowns}"
        return ""


def check_memory(memory: Mapping[str, object], *, scenario: str, kind: Kind) -> CellMemory:
    """Check a memory and return it; raises `SimError` if it is damaged or another cell's."""
    try:
        past = CellMemory.model_validate_json(json.dumps(memory))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "text"
        raise SimError(
            f"the cell's memory is of another version, or damaged: {where}: {first['msg'].lower()}",
            remedy=REMEDY,
        ) from error
    except (TypeError, ValueError) as error:
        raise SimError(f"the cell's memory is damaged: {error}", remedy=REMEDY) from error
    if past.scenario != scenario:
        raise SimError(
            f"the cell's memory is of scenario '{past.scenario}', not '{scenario}'", remedy=REMEDY
        )
    if past.mechanism != kind.name:
        raise SimError(
            f"the cell's memory is of a {past.mechanism}, not a {kind.name}", remedy=REMEDY
        )
    if problem := past.problem_for(kind):
        raise SimError(f"the cell's memory is damaged: {problem}", remedy=REMEDY)
    return past


class Cell:
    """A scenario come alive. `memory` continues an earlier cell; `seed` overrides the scenario's.

    A new cell counts its attempts at each target from `attempts_before` on: it is the same robot,
    and its noise is not that of the cell before it. `equations` are those of a mechanism that has
    no parts here. Raises `ScenarioInvalid` when no such robot can be put together, `SimError` when
    the memory is damaged or another cell's, or when equations are missing.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        seed: int | None = None,
        memory: Mapping[str, object] | None = None,
        attempts_before: int = 0,
        equations: EquationsOf | None = None,
    ) -> None:
        self.scenario = scenario
        section, kind = scenario.robot, scenario.robot.kind
        self.kind = kind
        past = None
        if memory is not None:
            past = check_memory(memory, scenario=scenario.name, kind=kind)
        self.seed = _resolve_seed(scenario, seed, past)
        self.true_geometry = factory.true_geometry(section, self.seed)
        # All draws of manufacture are made again in each process: the seed keeps the robot, and
        # the memory holds only what has happened to it.
        mechanism = factory.mechanism_of(section, self.true_geometry, self.seed, equations)
        behaviour = factory.behaviour(section, self.seed)
        computed = factory.controller_kinematics(scenario, self.true_geometry, equations)
        if past is None:
            first = self._stand_at_start(mechanism, behaviour.transmission, equations)
            past = first.model_copy(update={"attempts_before": attempts_before})
        self._state = state = past
        # one worked time for all parts: robot, air and stand drift with the sum of their work
        self._worked = WorkedTime(state.worked_s)
        self.faults = FaultScript((f.fault() for f in scenario.faults), state.fault_counts)
        self.station = scenario.tracker.station.pose()
        self._mount = factory.mount(scenario, self.station)
        self._carried = state.carried
        self.robot = DrivenRobot(
            mechanism,
            behaviour,
            self._mounted(state.carried),
            _restore_standing(state, mechanism, section.thermal.growth(state.worked_s)),
            worked=self._worked,
            arrivals=self._attempts(Purpose.ARRIVAL, state.arrivals),
        )
        self.controller = SimulatedController(
            scenario.controller,
            self.robot,
            geometry=state.geometry,
            faults=self.faults,
            worked=self._worked,
            kinematics=computed,
        )
        self._scene = Scene(self.controller, self.robot)
        self.instruments = Instruments(
            self.seed,
            np.array(section.workspace_centre_mm),
            self.station,
            self._attempts(Purpose.READING, state.reading_counts),
        )
        self._readings = [*state.readings]
        self._marked: list[tuple[Array, Array]] = []
        """Poses of the tool that were marked for the next reading."""
        self.tracker = self._make_tracker(state)

    def true_reflector_mm(self, now_s: float) -> Array:
        """Return the reflector's true place (3,) in the base frame. A back door for tests."""
        return self._scene.robot_reflector(now_s).point_mm

    def mark(self, now_s: float) -> None:
        """Mark where the tool is, as the first pose of the next reading."""
        self._marked = [self.robot.tool(self.controller.encoders(now_s))]

    def read_instrument(
        self, kind: str, item: ReadObject, std_mm: float, now_s: float
    ) -> tuple[float, ...]:
        """Read an instrument where the tool is, and keep the true values; mm and rad.

        Raise `SimError` for a kind of which there is no instrument.
        """
        tools, self._marked = [*self._marked, self.robot.tool(self.controller.encoders(now_s))], []
        reading = self.instruments.read(kind, item, std_mm, tools)
        self._readings.append(
            TakenReading(kind=kind, object=item.name, values=reading.values, true=reading.true)
        )
        return reading.values

    def carry_reflector(
        self, name: str, half: Literal[1, 2] | None, place_mm: Point, std_mm: float
    ) -> None:
        """Carry the reflector, with the beam, to a place that has a name, or back with the name "".

        `place_mm` is what the operator was asked for, seen from the joints of the half or from the
        controlled point. The holder is off it by a draw of standard deviation `std_mm`, which does
        not change. Raise `SimError` for a half that the platform does not have.
        """
        if half is not None and self.kind.turn is None:
            raise SimError(
                f"the reflector cannot be carried to half {half}: the platform of a "
                f"{self.kind.name} has no halves",
                remedy="leave out `body` of this object in campaign.yaml",
            )
        self._carried = None
        if name:
            draw = generator(self.seed, Purpose.MOUNT, *name.encode()).standard_normal(3)
            x, y, z = (np.array(place_mm) + std_mm * draw).tolist()
            self._carried = Carried(half=half, offset_mm=(x, y, z))
        self.robot.carry_reflector(self._mounted(self._carried))
        self.tracker.beam.put_on_robot()

    def _mounted(self, carried: Carried | None) -> SeenReflector:
        """Return the mounted reflector, which faces the same way wherever it is."""
        if carried is None:
            return self._mount
        return SeenReflector(np.array(carried.offset_mm), self._mount.facing, carried.half)

    def advance(self, now_s: float) -> None:
        """Carry out what is due by now."""
        # the controller carries out what is due when it is asked for its state
        self.controller.state(now_s)
        self.tracker.advance(now_s)

    def memory(self) -> dict[str, object]:
        """Return the state for the next cell of this scenario, as plain values for JSON."""
        standing = self.robot.standing
        # true geometry, rods and gears are not in it: the seed draws them again
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
            "carried": self._carried,
            "readings": tuple(self._readings),
            "reading_counts": self.instruments.attempts.memory(),
        }
        return self._state.model_copy(update=now).model_dump(mode="json", by_alias=True)

    # The true robot stands at the encoder readings that its controller computes for the start pose,
    # and therefore, by all its errors, beside that pose.
    def _stand_at_start(
        self,
        mechanism: RodMechanism | FreeMechanism,
        gears: Transmission,
        equations: EquationsOf | None,
    ) -> CellMemory:
        """Return the state of a new cell; raises `ScenarioInvalid` if it cannot stand there."""
        scenario, kind = self.scenario, self.kind
        start, tracker = scenario.controller.start, scenario.tracker
        geometry = scenario.controller_flat()
        step = scenario.controller.encoder_step(kind)
        try:
            # the assembly is found from the true robot at the start pose, which is close, and then
            # followed to the joints where its gears stand: so it cannot be another assembly of them
            if isinstance(mechanism, RodMechanism):
                pose = start.pose[:3], math.radians(start.theta_deg)
                wanted = joints_for(geometry_of(geometry, mechanism.kind), *pose)
                near = assemble(mechanism, geometry_of(self.true_geometry, mechanism.kind), *pose)
            else:
                wanted = free_mechanism(kind, geometry, equations).joints_for(start.pose)
                near = restore(
                    mechanism, mechanism.joints_for(start.pose), mechanism.plate_of(start.pose)
                )
            encoders = np.round(wanted / step) * step
            assembly = follow(mechanism, near, gears.joints(encoders))
        except (OutOfReach, AssemblyLost) as error:
            raise ScenarioInvalid(
                f"{scenario.name}: the robot cannot stand at controller.start ({error})",
                remedy="choose a start pose in its workspace, or smaller errors",
            ) from error
        return CellMemory(
            schema=SCHEMA,
            scenario=scenario.name,
            seed=self.seed,
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

    def _attempts(self, purpose: Purpose, counts: Mapping[str, int]) -> Attempts:
        return Attempts(self.seed, purpose, counts, self._state.attempts_before)

    def _make_tracker(self, state: CellMemory) -> SimulatedTracker:
        section = self.scenario.tracker
        standing = {NEST_PREFIX + nest.name: np.array(nest.place_mm) for nest in section.nests}
        if (other := section.other_reflector_mm) is not None:
            standing[Target.STANDING] = np.array(other)
        # cached: by identity `Beam` finds out whether the stand has crept since its last look
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
            beam,
            TrackerState(
                is_initialised=state.tracker_initialised,
                is_warm=state.tracker_warm,
                selected_reflector=state.selected_reflector,
                taken=state.taken,
            ),
            faults=self.faults,
            worked=self._worked,
            attempts=self._attempts(Purpose.SHOT, state.shots),
        )


def _resolve_seed(scenario: Scenario, seed: int | None, past: CellMemory | None) -> int:
    """Return the remembered seed, else the one asked for, else the scenario's.

    Raise `SimError` if another than the remembered one is asked for.
    """
    if past is None:
        return scenario.seed if seed is None else seed
    if seed is not None and seed != past.seed:
        raise SimError(f"the cell's memory is of seed {past.seed}, not {seed}", remedy=REMEDY)
    return past.seed


def _restore_standing(state: CellMemory, mechanism: Mechanism, growth: Growth) -> Standing:
    """Restore the standing to the last bit, so that everything goes on unchanged."""
    # The assembly is solved only to check the memory and to find its side. The plate itself stays
    # the remembered one: a second solution would differ from it in the last bits.
    joints, plate = np.array(state.joints), mechanism.plate_of(np.array(state.plate))
    try:
        assembly = restore(mechanism, joints, plate, growth)
    except AssemblyLost as error:
        raise SimError(f"the cell's memory is damaged: {error.problem}", remedy=REMEDY) from error
    if np.abs(assembly.plate.unknowns - plate.unknowns).max() > REMEMBERED_WITHIN_MM:
        raise SimError(
            "the cell's memory is damaged, or cell.yaml was changed: its plate is elsewhere",
            remedy=REMEDY,
        )
    return Standing(
        np.array(state.encoders_rad),
        np.array(state.play_rad),
        Assembly(joints, plate, assembly.side),
        np.array(state.displaced_mm),
    )
