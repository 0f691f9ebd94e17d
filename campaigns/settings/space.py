"""Section `space` of campaign.yaml: where the plate may be, and where it may not.

There are three kinds of limits, all in the base frame: heights and a radius for the measured point,
zones that the plate must not enter, and zones that it must not leave. A zone is a box or an upright
cylinder: enough for conveyors, pillars and fences, and convex, which makes clearances on a path
simple. Plate and tool count as an upright cylinder about the measured point, so the plate's turn
does not matter. Poses and paths are checked in `campaigns/design/restricted_space.py`.
"""

from typing import Annotated, Self

from pydantic import Field, model_validator

from campaigns.files.yaml_file import FileModel, Length, Place, broken_rule
from campaigns.files.yaml_file import PlaceRange as Side

MOST_ZONES = 100
"""Largest number of zones of a kind: more would be a drawing, not a rule."""

Margin = Annotated[float, Field(ge=0.0, le=10_000.0)]


class BoxConfig(FileModel):
    """Box along the base frame's axes; a side that is left out is unlimited."""

    name: str = Field(default="", description="what stands there, for messages")
    x_mm: Side | None = Field(default=None, description="lowest and highest x, mm; empty: all")
    y_mm: Side | None = Field(default=None, description="lowest and highest y, mm; empty: all")
    z_mm: Side | None = Field(default=None, description="lowest and highest z, mm; empty: all")

    @model_validator(mode="after")
    def _require_a_side(self) -> Self:
        if self.x_mm or self.y_mm or self.z_mm:
            return self
        raise broken_rule("has none of x_mm, y_mm and z_mm, so it would be everywhere")


class CylinderConfig(FileModel):
    """Cylinder with a vertical axis."""

    name: str = Field(default="", description="what stands there, for messages")
    centre_mm: tuple[Place, Place] = Field(description="x and y of its axis, [x, y] mm")
    radius_mm: Length = Field(description="its radius, mm")
    z_mm: Side | None = Field(default=None, description="lowest and highest z, mm; empty: all")


class ZonesConfig(FileModel):
    """Boxes and cylinders."""

    boxes: tuple[BoxConfig, ...] = Field(
        default=(), max_length=MOST_ZONES, description="boxes with x_mm, y_mm, z_mm and a name"
    )
    cylinders: tuple[CylinderConfig, ...] = Field(
        default=(),
        max_length=MOST_ZONES,
        description="upright cylinders with centre_mm, radius_mm, z_mm and a name",
    )


class SpaceConfig(FileModel):
    """Limits of the space of plate and tool, in the base frame."""

    z_lowest_mm: Place | None = Field(
        default=None, description="the lowest z of the measured point, mm; empty: no limit"
    )
    z_highest_mm: Place | None = Field(
        default=None, description="the highest z of the measured point, mm; empty: no limit"
    )
    radius_mm: Length | None = Field(
        default=None, description="the farthest from the base's z axis, mm; empty: no limit"
    )
    keep_out: ZonesConfig = Field(
        default=ZonesConfig(), description="boxes and cylinders that the plate must not enter"
    )
    keep_in: ZonesConfig = Field(
        default=ZonesConfig(), description="boxes and cylinders that the plate must not leave"
    )
    plate_radius_mm: Margin | None = Field(
        default=None,
        description="the radius about the measured point that holds plate and tool at every turn, "
        "mm; empty: by the robot file",
    )
    margin_mm: Margin = Field(
        default=0.0, description="the distance that the plate keeps from all of it, mm"
    )

    @model_validator(mode="after")
    def _require_height(self) -> Self:
        # the margin is kept from both heights, so it narrows what is between them twice
        low, high = self.z_lowest_mm, self.z_highest_mm
        if low is None or high is None or high - low > 2.0 * self.margin_mm:
            return self
        raise broken_rule(
            f"leaves nothing between z_lowest_mm {low:g} and z_highest_mm {high:g} "
            f"with margin_mm {self.margin_mm:g} at both"
        )
