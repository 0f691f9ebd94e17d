"""LinuxCNC's own settings in campaign.yaml, under `controller`."""

import math
from typing import Literal, Self

from pydantic import Field, model_validator

from campaigns.files.yaml_explanation import broken_rule
from campaigns.files.yamlfile import FileModel


class LinuxcncConfig(FileModel):
    """What no question can tell about a LinuxCNC."""

    coordinates: Literal["world", "joints"] = Field(
        default="world",
        description="what its moves are in: world (kinematics par4kins: X Y Z C) "
        "or joints (four rotary joints: X Y Z A)",
    )
    hal_file: str | None = Field(
        default=None,
        description="the HAL file of its parameters, calib.hal beside its INI file; "
        "empty with joints: linuxcnc-active.hal in this folder",
    )
    beside: str = Field(
        default="",
        description="the command that runs others on LinuxCNC's computer, like ssh USER@HOST; "
        "empty when it is this one",
    )
    full_speed_deg_per_s: float = Field(
        default=180.0,
        gt=0.0,
        le=10_000.0,
        description="the speed of the fastest joint at speed_percent 100, deg/s",
    )
    connect_password: str = Field(
        default="EMC", min_length=1, description="the password of linuxcncrsh's --connectpw"
    )
    enable_password: str = Field(
        default="EMCTOO", min_length=1, description="the password of linuxcncrsh's --enablepw"
    )

    @property
    def full_speed_rad_s(self) -> float:
        """The speed of the fastest joint at full speed."""
        return math.radians(self.full_speed_deg_per_s)

    @model_validator(mode="after")
    def _world_has_its_file(self) -> Self:
        if self.coordinates == "world" and not self.hal_file:
            raise broken_rule("has no hal_file, which coordinates: world needs")
        return self
