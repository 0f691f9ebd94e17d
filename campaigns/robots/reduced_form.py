"""Reduced form: the parameter set that a controller with fewer parameters can hold.

Many controllers compute with the plain geometry alone. For them the extensions of an identified set
(tilts, skews, gears) are left out and the other parameters fitted to the whole set over the
workspace. What the form loses by this is stated with it, in mm, wherever the form appears.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import JsonValue, TypeAdapter, ValidationError

from campaigns.errors import ConfigInvalid

FORM = "projection"
"""Key of a robot file's provenance, and of a record: the set is a form of an identified one."""


@dataclass(frozen=True, slots=True)
class ReducedForm:
    """Form of an identified set for a controller that takes fewer parameters, or a warmer robot.

    Losses are errors of position over the workspace against the identified set, after the best fit
    of the controller's frame.
    """

    of: str
    """SHA-256 of the identified geometry."""
    lost_mean_mm: float
    lost_max_mm: float
    lost_rms_mm: float | None = None
    """None in files of older software."""
    name: str = "plain"

    @property
    def says(self) -> str:
        """Name of the form and its losses, in words."""
        lost = f", which {self.loses}" if self.lost_max_mm else ""
        return f"a reduced set of the identified parameters ({self.name}){lost}"

    @property
    def loses(self) -> str:
        """Mean and largest loss, in the words of every output that mentions the form."""
        return f"loses {self.lost_mean_mm:.3f} mm on average, {self.lost_max_mm:.3f} mm at most"


def form_of(stated: Mapping[str, JsonValue] | None, where: str) -> ReducedForm | None:
    """Return the form that a provenance or a record states; None for a whole set.

    Raise `ConfigInvalid` naming `where` if the form cannot be read.
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
