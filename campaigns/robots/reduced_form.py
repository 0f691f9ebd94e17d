"""Reduced form: what a controller with fewer parameters can hold of an identified set."""

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import JsonValue, TypeAdapter, ValidationError

from campaigns.errors import ConfigInvalid

FORM = "projection"
"""Key of a robot file's provenance, and of a record: the set is a form of an identified one."""


@dataclass(frozen=True, slots=True)
class ReducedForm:
    """Form of an identified set for a controller that takes fewer parameters, or a warmer robot.

    `of`: sha256 of the identified geometry. Lost: error of position over the workspace beside that
    set, the controller's frame best fitted, mm; files of older software have no rms.
    """

    of: str
    lost_mean_mm: float
    lost_max_mm: float
    lost_rms_mm: float | None = None
    name: str = "plain"

    @property
    def says(self) -> str:
        """What it is, and what it loses."""
        lost = f", {self.loses}" if self.lost_max_mm else ""
        return f"a form of the identified parameters ({self.name}){lost}"

    @property
    def loses(self) -> str:
        """What it loses: the same words and numbers wherever it is mentioned."""
        return f"loses {self.lost_mean_mm:.4f} mm on average, {self.lost_max_mm:.4f} mm at most"


def form_of(stated: Mapping[str, JsonValue] | None, where: str) -> ReducedForm | None:
    """Form that a provenance or a record states; None for a whole set.

    Raises `ConfigInvalid` naming `where` for one that cannot be read.
    """
    form = (stated or {}).get(FORM)
    if form is None:
        return None
    try:
        return TypeAdapter(ReducedForm).validate_python(form)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise ConfigInvalid(
            f"{where}: {FORM} {place}: {first['msg'].lower()}",
            remedy="export it again: the file was changed",
        ) from error
