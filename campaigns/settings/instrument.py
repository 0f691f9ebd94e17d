"""Tracker's uncertainty: as campaign.yaml states it, and as the journal has it with a series.

The limits of the tracker decide about U, and so about the verdict. So what counts for a series is
what campaign.yaml said when the series was begun or imported: its record holds the settings of that
moment. Limits that are changed later count for later series, and every verdict names the change.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

from pydantic import BaseModel, ValidationError

from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import SeriesStarted
from campaigns.settings.sections import TrackerCommonConfig, TrackerConfig, TrackerLimitsConfig

SectionT = TypeVar("SectionT", bound=BaseModel)
Source = Literal["data sheet", "default", "not recorded"]
SOURCE_KEYS = frozenset({"data_sheet", "typed_by"})
"""Keys of `tracker.uncertainty` that state a source, and no limit."""


@dataclass(frozen=True, slots=True)
class StatedInstrument:
    """Tracker's limits with their source.

    Attributes:
        limits: Limits of the noise of a shot.
        common: Limits of what all shots have in common.
        is_recorded: Whether the source is stated where the limits are; older journals have none.
    """

    limits: TrackerLimitsConfig
    common: TrackerCommonConfig
    is_recorded: bool = True

    @classmethod
    def of(cls, tracker: TrackerConfig) -> "StatedInstrument":
        """Return what campaign.yaml states."""
        return cls(tracker.uncertainty, tracker.common)

    @classmethod
    def recorded(cls, started: SeriesStarted, now: TrackerConfig) -> "StatedInstrument":
        """Return what was recorded with a series; what its journal lacks is taken from `now`."""
        tracker = started.configuration.get("tracker")
        sections = tracker if isinstance(tracker, Mapping) else {}
        limits, common = sections.get("uncertainty"), sections.get("common")
        return cls(
            _read(limits, now.uncertainty),
            _read(common, now.common),
            is_recorded=isinstance(limits, Mapping) and limits.keys() >= SOURCE_KEYS,
        )

    @property
    def uncertainty(self) -> TrackerUncertainty:
        """The tracker's standard uncertainty by these limits."""
        limits, common = self.limits, self.common
        return TrackerUncertainty.of_limits(
            limits.along_um, limits.along_um_per_m, limits.across_um, limits.across_um_per_m
        ).with_common_limits(common.scale_ppm, common.axes_um_per_m, common.reflector_mm)

    @property
    def source(self) -> Source:
        """The kind of source: a data sheet that somebody names, the defaults, or none recorded."""
        if not self.is_recorded:
            return "not recorded"
        return "data sheet" if self.limits.data_sheet and self.limits.typed_by else "default"

    @property
    def source_in_words(self) -> str:
        """The source, with who typed the limits."""
        return {
            "data sheet": f"{self.limits.data_sheet}, typed by {self.limits.typed_by}",
            "default": "default: a common tracker's, not of this one's data sheet",
            "not recorded": "not recorded by the software of that time",
        }[self.source]

    @property
    def figures(self) -> dict[str, float]:
        """The limits alone, by their keys in campaign.yaml."""
        return {**self.limits.model_dump(exclude=set(SOURCE_KEYS)), **self.common.model_dump()}

    @property
    def limits_in_words(self) -> tuple[str, str, str]:
        """Limits along the beam, across it, and of what all shots have in common."""
        limits, common = self.limits, self.common
        typed = "default" if common == TrackerCommonConfig() else "by campaign.yaml"
        of_all = f"{common.scale_ppm:g} ppm, {common.axes_um_per_m:g} µm/m"
        return (
            f"{limits.along_um:g} µm + {limits.along_um_per_m:g} µm/m",
            f"{limits.across_um:g} µm + {limits.across_um_per_m:g} µm/m",
            f"{of_all}, {common.reflector_mm:g} mm ({typed})",
        )

    def difference(self, other: "StatedInstrument") -> str:
        """Return the limits that differ from those of another, in words; "" if none does."""
        then, now = self.figures, other.figures
        return ", ".join(
            f"{key} {limit:g} → {now[key]:g}" for key, limit in then.items() if limit != now[key]
        )

    def is_smaller_than(self, other: "StatedInstrument") -> bool:
        """Return whether any limit is smaller than that of another."""
        others = other.figures
        return any(limit < others[key] for key, limit in self.figures.items())


def _read(recorded: object, now: SectionT) -> SectionT:
    """Return a section as a journal has it, completed by campaign.yaml's; its own if unreadable."""
    if not isinstance(recorded, Mapping):
        return now
    try:
        return type(now).model_validate({**now.model_dump(), **recorded})
    except ValidationError:  # of a version whose limits had other names
        return now
