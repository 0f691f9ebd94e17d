"""What a cell keeps over a restart, as a real one does: parameters, places, counts."""

import json
from collections.abc import Mapping
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim.errors import MemoryInvalid
from sim.geometry import problem_with
from sim.scenarios.section import PerArm, Point
from sim.tracker.beam import Target

REMEDY = "delete the simulated cell's memory to begin with a new cell"


class CellMemory(BaseModel):
    """Everything of a cell that its scenario and seed do not already say."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    schema_: Literal["pkmcal/cell-memory/1"] = Field("pkmcal/cell-memory/1", alias="schema")
    scenario: str
    seed: int
    worked_s: float
    geometry: dict[str, float]
    encoders_rad: PerArm
    play_rad: PerArm
    joints_rad: PerArm
    plate: tuple[float, float, float, float, float, float, float]
    displaced_mm: Point
    arrivals: dict[str, int]
    shots: dict[str, int]
    fault_counts: dict[str, int]
    tracker_initialised: bool
    tracker_warm: bool
    selected_reflector: int
    beam_on: Target | None

    @model_validator(mode="after")
    def _geometry_is_a_robot(self) -> Self:
        if problem := problem_with(self.geometry):
            raise ValueError(f"geometry: {problem}")
        return self

    def as_dict(self) -> dict[str, object]:
        """As plain values for a JSON file."""
        return self.model_dump(mode="json", by_alias=True)


def remembered(memory: Mapping[str, object], *, scenario: str) -> CellMemory:
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
    return found
