"""Perturbations: what goes wrong in a campaign beside the tracker's noise, by name."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

Step = Literal["", "joint", "length", "mount", "frame"]
Drift = Literal["", "frame", "arms"]


@dataclass(frozen=True, slots=True)
class Perturbation:
    """One kind and size; without any the tracker's noise is all there is."""

    scatter_mm: float = 0.0
    """Half-width of an even draw on each coordinate of each point: repeatability."""
    backlash_deg: float = 0.0
    """From one side to the other, of a crank; of a carriage what moves the point as far."""
    step: Step = ""
    """What changes at one shot: a joint's encoder, an arm's length, the tracker's frame."""
    drift: Drift = ""
    """What changes from the first shot to the last: the tracker's frame, or arms that grow warm."""
    gross: int = 0
    """Shots that are off by `size`."""
    size: float = 0.0
    """Of a step in a joint deg of a crank, else mm."""
    along_pairs: bool = False
    """Whether gross errors are along the line to the shot's partner, for bare distances."""
    rods_mm: float = 0.0
    """Standard deviation of each rod's length about its forearm's."""
    axes_mrad: float = 0.0
    """Standard deviation of the motor axes' tilts."""
    scale: float = 1.0
    """Factor of all measured points."""
    late: bool = False
    """Whether a step is before one of the last shots, fitted and unseen ones in a drawn order."""
    swapped: bool = False
    """Whether two neighbours have each other's points."""
    eccentric_deg: float = 0.0
    """Of the encoder of every crank, at most; where that is is drawn."""
    ratio_ppm: float = 0.0
    """Of one joint's gear or drive."""
    period_mm: float = 0.0
    """Error of every carriage's screw, whose pitch is drawn, at most."""
    sag_mm: float = 0.0
    """Of the plate by the yielding of all gears under its weight, from the least to the most."""
    azimuths_mrad: float = 0.0
    """Standard deviation of the directions of all arms but the first."""
    reflector_mm: float = 0.0
    """By how much ranges are too long."""
    transit_mrad: float = 0.0
    """Of the tracker's transit axis, out of square."""
    known_length: bool = False
    """Whether a bar of a metre, put down five times about the workspace, was measured too."""
    ripple_arcsec: float = 0.0
    """Error of every crank in each turn of its motor, at most; how often that is may be drawn."""
    warmth_ppm: float = 0.0
    """Growth of the arms over the campaign; forearms and frame grow by a drawn part of it."""
    measured: float = 1.0
    """Part of each axis's range in which shots are, about one of the workspace's sides."""

    @property
    def imperfect_parts(self) -> bool:
        """Presence of unequal rods or tilted axes."""
        return self.rods_mm > 0.0 or self.axes_mrad > 0.0

    @property
    def cause(self) -> str:
        """Name of what the model lacks by it; empty where it has one."""
        causes = {
            "eccentricity": self.eccentric_deg,
            "ratio": self.ratio_ppm,
            "period": self.period_mm,
            "ripple": self.ripple_arcsec,
            "warmth": self.warmth_ppm,
            "yielding": self.sag_mm,
            "azimuths": self.azimuths_mrad,
            "reflector": self.reflector_mm,
            "transit axis": self.transit_mrad,
        }
        return next((name for name, size in causes.items() if size), "")

    @property
    def of_cranks(self) -> bool:
        """Presence of what only encoders and gears of cranks do."""
        return bool(self.eccentric_deg or self.ripple_arcsec)

    @property
    def beyond_the_model(self) -> bool:
        """Presence of what no parameter of the contracted model describes."""
        return self.imperfect_parts or bool(self.cause)

    def __str__(self) -> str:
        """Sizes in words."""
        unit = "deg" if self.step == "joint" else "mm"
        count = f"{self.gross} × " if self.gross else ""
        late = "late " if self.late else ""
        what = f"{late}{self.step or self.drift} " if self.step or self.drift else ""
        told = {
            f"{what}{count}{self.size:g} {unit}": self.size,
            f"± {self.scatter_mm:.2g} mm": self.scatter_mm,
            f"{60.0 * self.backlash_deg:.2g}′": self.backlash_deg,
            f"rods {self.rods_mm:g} mm": self.rods_mm,
            f"axes {self.axes_mrad:g} mrad": self.axes_mrad,
            f"× {self.scale:.6g}{', known length' * self.known_length}": self.scale - 1.0,
            f"shots in {self.measured:g} of each range": self.measured - 1.0,
            "two swapped": self.swapped,
            f"eccentric {self.eccentric_deg:g}°": self.eccentric_deg,
            f"ratio {self.ratio_ppm:g} ppm": self.ratio_ppm,
            f"screws {self.period_mm:g} mm": self.period_mm,
            f"ripple {self.ripple_arcsec:g}″": self.ripple_arcsec,
            f"warmth {self.warmth_ppm:g} ppm": self.warmth_ppm,
            f"sag {self.sag_mm:g} mm": self.sag_mm,
            f"azimuths {self.azimuths_mrad:g} mrad": self.azimuths_mrad,
            f"reflector {self.reflector_mm:g} mm": self.reflector_mm,
            f"transit {self.transit_mrad:g} mrad": self.transit_mrad,
        }
        return ", ".join(words for words, size in told.items() if size) or "none"


REPEATABILITY_MM = 0.4 / 3**0.5
BACKLASH_DEG = 1.0 / 60.0

PERTURBATIONS: Mapping[str, tuple[Perturbation, ...]] = {
    "clean": (Perturbation(),),
    "own-scatter": (Perturbation(scatter_mm=REPEATABILITY_MM),),
    "backlash": (
        Perturbation(backlash_deg=BACKLASH_DEG),
        Perturbation(backlash_deg=BACKLASH_DEG, scatter_mm=REPEATABILITY_MM),
    ),
    "bumped-stand": tuple(Perturbation(step="frame", size=size) for size in (0.1, 0.3, 0.9)),
    "encoder-step": tuple(Perturbation(step="joint", size=size) for size in (0.02, 0.05, 0.3, 1.0)),
    "grown-arm": tuple(Perturbation(step="length", size=size) for size in (0.05, 0.2, 0.5)),
    "drift": tuple(
        Perturbation(drift=drift, size=size)
        for size in (0.05, 0.1, 0.3)
        for drift in ("frame", "arms")  # type: tuple[Drift, ...]
    ),
    "unequal-rods": (Perturbation(rods_mm=0.05), Perturbation(rods_mm=0.2)),
    "tilted-axes": (
        Perturbation(axes_mrad=0.5),
        Perturbation(axes_mrad=2.0),
        Perturbation(axes_mrad=2.0, rods_mm=0.2),
    ),
    "gross-errors": tuple(
        Perturbation(gross=count, size=size) for count in (1, 3, 6) for size in (0.5, 2.0, 20.0)
    ),
    "scale": (Perturbation(scale=1.01), Perturbation(scale=0.995)),
}
"""By name; where there are several sizes, campaigns take them in turn."""

BY_SIZE: Mapping[str, tuple[Perturbation, ...]] = {
    "imperfect-parts": (
        Perturbation(),
        Perturbation(rods_mm=0.05),
        Perturbation(rods_mm=0.2),
        Perturbation(axes_mrad=0.5),
        Perturbation(axes_mrad=2.0),
        Perturbation(rods_mm=0.05, axes_mrad=0.5),
        Perturbation(rods_mm=0.2, axes_mrad=2.0),
        Perturbation(rods_mm=0.05, axes_mrad=0.5, scatter_mm=0.1 / 3**0.5),
    ),
    "wrong-pairs": (
        Perturbation(),
        *(Perturbation(gross=count, size=2.0, along_pairs=True) for count in (1, 2, 3)),
    ),
    "eccentric-encoders": tuple(Perturbation(eccentric_deg=size) for size in (0.005, 0.01, 0.02)),
    "gear-ratio": tuple(Perturbation(ratio_ppm=size) for size in (200.0, 500.0, 1000.0)),
    "carriage-period": tuple(Perturbation(period_mm=size) for size in (0.005, 0.01, 0.03)),
    "sag": tuple(Perturbation(sag_mm=size) for size in (0.05, 0.1, 0.2)),
    "azimuths": tuple(Perturbation(azimuths_mrad=size) for size in (0.2, 0.5, 2.0)),
    "reflector-constant": tuple(Perturbation(reflector_mm=size) for size in (0.2, 0.5, 12.7)),
    "transit-axis": tuple(Perturbation(transit_mrad=size) for size in (0.02, 0.05, 0.2)),
    "late-encoder-step": tuple(
        Perturbation(step="joint", size=size, late=True) for size in (0.02, 0.05, 0.3)
    ),
    "late-mount-step": tuple(
        Perturbation(step="mount", size=size, late=True) for size in (0.1, 0.3, 1.0)
    ),
    "moved-mount": tuple(Perturbation(step="mount", size=size) for size in (0.1, 0.3, 1.0)),
    "swapped-neighbours": (Perturbation(swapped=True),),
    "tracker-scale": tuple(
        Perturbation(scale=1.0 + 1e-6 * ppm, known_length=known)
        for known in (False, True)
        for ppm in (50.0, 100.0, 300.0)
    ),
    "part-of-the-workspace": tuple(Perturbation(measured=part) for part in (0.25, 0.5, 0.75)),
    "ripple": tuple(Perturbation(ripple_arcsec=size) for size in (5.0, 10.0, 20.0)),
    "warmth": tuple(Perturbation(warmth_ppm=size) for size in (50.0, 100.0, 200.0)),
}
"""Not among `all`, and told by size: parts that are never perfect, from none to coarse, of which
each model leaves something; wrong shots of which bare distances tell nothing but that; small errors
with a cause each, and changes before the last shots; what no shot can tell."""

KINDS: Mapping[str, tuple[Perturbation, ...]] = {**PERTURBATIONS, **BY_SIZE}
"""Their order is part of what is drawn."""


def sizes_of(name: str) -> tuple[Perturbation, ...]:
    """Perturbations of an effect by its name, or of one's own sizes of it, as `warmth=60,180,600`.

    Raises `KeyError` for a name that there is not, and `ValueError` for sizes that are no finite
    numbers above 0, or of an effect that differs by more than one.
    """
    effect, given, sizes = name.partition("=")
    kinds = KINDS[effect]
    if not given:
        return kinds
    [size] = (f.name for f in fields(Perturbation) if len({getattr(k, f.name) for k in kinds}) > 1)
    values: list[dict[str, Any]] = [{size: float(text)} for text in sizes.split(",")]
    if not all(0.0 < value[size] < math.inf for value in values):
        raise ValueError(sizes)
    return tuple(replace(kinds[0], **value) for value in values)


def perturbation_of(name: str, campaign: int) -> Perturbation:
    """Perturbation of a campaign by its number."""
    kinds = sizes_of(name)
    return kinds[campaign % len(kinds)]
