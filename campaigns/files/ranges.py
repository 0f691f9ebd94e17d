"""Ranges of values in files: what a place, a length or an interval may be."""

from typing import Annotated

from pydantic import AfterValidator, Field

from campaigns.files.yaml_file import broken_rule


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] < ends[1]:
        return ends
    raise broken_rule(f"is {list(ends)}, the lowest must be below the highest")


RISING = AfterValidator(_rising)
Place = Annotated[float, Field(ge=-100_000.0, le=100_000.0)]
Length = Annotated[float, Field(gt=0.0, le=100_000.0)]
Point = tuple[Place, Place, Place]
PlaceRange = Annotated[tuple[Place, Place], RISING]
