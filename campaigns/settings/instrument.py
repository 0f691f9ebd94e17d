"""Tracker's uncertainty: as campaign.yaml states it, and as the journal has it with a series.

The limits of the tracker decide about U, and so about the verdict. So what counts for a series is
what campaign.yaml said when the series was begun or imported: its record holds the settings of that
moment. What is changed later counts for later series, and every verdict names the change. The names
of the instruments that campaign.yaml states are treated alike.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, TypeVar

from pydantic import BaseModel, JsonValue, ValidationError

from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import SeriesStarted
from campaigns.settings.sections import (
    InstrumentsConfig,
    TrackerCommonConfig,
    TrackerConfig,
    TrackerLimitsConfig,
)

SectionT = TypeVar("SectionT", bound=BaseModel)
Source = Literal["data sheet", "default", "not recorded"]
SOURCE_KEYS = frozenset({"data_sheet", "typed_by"})
"""Keys of `tracker.uncertainty` and `tracker.common` that state a source, and no limit."""
UNRECORDED = "not recorded by the software of that time"


@dataclass(frozen=True, slots=True)
class StatedLimits:
    """Section of the tracker's limits with its source.

    Attributes:
        section: The limits.
        is_recorded: Whether the source is stated where the limits are; older journals have none.
    """

    section: TrackerLimitsConfig | TrackerCommonConfig
    is_recorded: bool = True

    @property
    def figures(self) -> dict[str, float]:
        """The limits alone, by their keys in campaign.yaml."""
        return self.section.model_dump(exclude=set(SOURCE_KEYS))

    @property
    def source(self) -> Source:
        """The kind of source: a data sheet that somebody names, the defaults, or none recorded."""
        if not self.is_recorded:
            return "not recorded"
        return "data sheet" if self.section.data_sheet and self.section.typed_by else "default"

    @property
    def source_in_words(self) -> str:
        """The source, with who typed the limits."""
        return {
            "data sheet": f"{self.section.data_sheet}, typed by {self.section.typed_by}",
            "default": "default: a common tracker's, not of this one's data sheet",
            "not recorded": UNRECORDED,
        }[self.source]


@dataclass(frozen=True, slots=True)
class StatedInstrument:
    """Tracker's limits with their sources.

    Attributes:
        limits: Limits of the noise of a shot.
        common: Limits of what all shots have in common.
        limits_recorded, common_recorded: Whether the source is stated where these limits are.
    """

    limits: TrackerLimitsConfig
    common: TrackerCommonConfig
    limits_recorded: bool = True
    common_recorded: bool = True

    @classmethod
    def of(cls, tracker: TrackerConfig) -> "StatedInstrument":
        """Return what campaign.yaml states."""
        return cls(tracker.uncertainty, tracker.common)

    @classmethod
    def recorded(cls, started: SeriesStarted, now: TrackerConfig) -> "StatedInstrument":
        """Return what was recorded with a series; what its journal lacks is taken from `now`."""
        tracker = _section(started, "tracker")
        limits, common = tracker.get("uncertainty"), tracker.get("common")
        return cls(
            _read(limits, now.uncertainty),
            _read(common, now.common),
            limits_recorded=isinstance(limits, Mapping) and limits.keys() >= SOURCE_KEYS,
            common_recorded=isinstance(common, Mapping) and common.keys() >= SOURCE_KEYS,
        )

    @property
    def of_shot(self) -> StatedLimits:
        """Limits of the noise of a shot, with their source."""
        return StatedLimits(self.limits, self.limits_recorded)

    @property
    def of_all(self) -> StatedLimits:
        """Limits of what all shots have in common, with their source."""
        return StatedLimits(self.common, self.common_recorded)

    @property
    def uncertainty(self) -> TrackerUncertainty:
        """The tracker's standard uncertainty by these limits."""
        limits, common = self.limits, self.common
        return TrackerUncertainty.of_limits(
            limits.along_um, limits.along_um_per_m, limits.across_um, limits.across_um_per_m
        ).with_common_limits(common.scale_ppm, common.axes_um_per_m, common.reflector_mm)

    @property
    def figures(self) -> dict[str, float]:
        """The limits alone, by their keys in campaign.yaml."""
        return {**self.of_shot.figures, **self.of_all.figures}

    @property
    def limits_in_words(self) -> tuple[str, str, str]:
        """Limits along the beam, across it, and of what all shots have in common."""
        limits, common = self.limits, self.common
        of_all = f"{common.scale_ppm:g} ppm, {common.axes_um_per_m:g} µm/m"
        return (
            f"{limits.along_um:g} µm + {limits.along_um_per_m:g} µm/m",
            f"{limits.across_um:g} µm + {limits.across_um_per_m:g} µm/m",
            f"{of_all}, {common.reflector_mm:g} mm",
        )

    def difference(self, other: "StatedInstrument") -> str:
        """Return the limits that differ from those of another, in words; "" if none does."""
        then, now = self.figures, other.figures
        return ", ".join(
            f"{key} {limit:g} → {now[key]:g}" for key, limit in then.items() if limit != now[key]
        )

    def smaller_of_all(self, then: "StatedInstrument") -> Iterator[str]:
        """Yield the limits of what all shots have in common that are less than then, in words."""
        former = then.of_all.figures
        for key, limit in self.of_all.figures.items():
            if limit < former[key]:
                yield f"{key} {former[key]:g} → {limit:g}"


@dataclass(frozen=True, slots=True)
class NamedInstruments:
    """Names of the instruments that no device states, by their keys in campaign.yaml."""

    names: Mapping[str, str]

    @classmethod
    def of(cls, tracker: TrackerConfig, instruments: InstrumentsConfig) -> "NamedInstruments":
        """Return what campaign.yaml states."""
        return cls(
            {
                "instruments.tracker": instruments.tracker,
                "tracker.serial": tracker.serial or "",
                "tracker.reflector": tracker.reflector,
                "instruments.reflector_serial": instruments.reflector_serial,
                "instruments.robot_serial": instruments.robot_serial,
            }
        )

    def recorded(self, started: SeriesStarted) -> "NamedInstruments":
        """Return what was recorded with a series; what was left empty then is taken from `self`."""
        # A name that is filled in later contradicts nothing. One that was there is not replaced.
        return NamedInstruments(
            {key: _recorded_text(started, key) or now for key, now in self.names.items()}
        )

    def difference(self, now: "NamedInstruments") -> Iterator[str]:
        """Yield the names that differ from those of `now`, in words."""
        for key, name in self.names.items():
            if name != now.names[key]:
                yield f"{key} '{name}' → '{now.names[key]}'"

    @property
    def reflector(self) -> str:
        """The reflector with its serial number."""
        names = (self.names["tracker.reflector"], self.names["instruments.reflector_serial"])
        return " ".join(filter(None, names))


def _section(started: SeriesStarted, name: str) -> Mapping[str, JsonValue]:
    """Return a section of campaign.yaml as it was recorded with a series; empty without it."""
    section = started.configuration.get(name)
    return section if isinstance(section, Mapping) else {}


def _recorded_text(started: SeriesStarted, key: str) -> str:
    """Return the text of a key of campaign.yaml as recorded with a series; "" without it."""
    section, _, field = key.partition(".")
    text = _section(started, section).get(field)
    return text if isinstance(text, str) else ""


def _read(recorded: object, now: SectionT) -> SectionT:
    """Return a section as a journal has it, completed by campaign.yaml's; its own if unreadable."""
    # A source is never completed: it would be of other limits, or of another time.
    if not isinstance(recorded, Mapping):
        return now
    sourceless = now.model_dump() | dict.fromkeys(SOURCE_KEYS & now.model_dump().keys(), "")
    try:
        return type(now).model_validate({**sourceless, **recorded})
    except ValidationError:  # of a version whose limits had other names
        return now
