"""Outcomes of the calls of a simulated GeoCOM instrument: now, or when they have ended."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from drivers.wire.geocom import parse_number, parse_string, parse_whole, parse_words
from drivers.wire.geocom_constants import USER_PRISM, Capability, Result, Rpc, TargetType
from sim.tracker.instrument import SimulatedTracker

Value = float | str


@dataclass(frozen=True, slots=True)
class Outcome:
    """A return code and the values behind it; whole numbers and flags are written as such."""

    result: int = Result.OK
    values: tuple[Value, ...] = ()


@dataclass(frozen=True, slots=True)
class Later:
    """Action that takes time: when it ends, and what then comes of it."""

    due_s: float
    finish: Callable[[float], Outcome]


Handler = Callable[[Sequence[str], float], Outcome | Later]
"""Handler of a call's words, at a time; may raise `WireError` for the words."""

DONE = Outcome()


def refusal(result: Result) -> Outcome:
    """Outcome that says no, without values."""
    return Outcome(result)


MODEL = "SIM-TS"
DEVICE_CLASS = 350
EQUIPMENT = Capability.MOTORISED | Capability.TARGET_RECOGNITION
VERSION = (1, 0, 0)
WAVELENGTH_M = 6.58e-7
ROUND_PRISM = "Leica Circ Prism"
PRISM = 1
"""A reflector type: neither undefined nor tape."""
MOST_DECIMALS = 15


@dataclass(frozen=True, slots=True)
class Place:
    """Station that the instrument is told, in m, and the heights of both ends."""

    east: float = 0.0
    north: float = 0.0
    up: float = 0.0
    instrument_height: float = 0.0
    target_height: float = 0.0


class GeocomInstrument:
    """Settings, as an instrument keeps them while nobody is connected, and readings.

    As it is found: somebody has surveyed with it before.
    """

    def __init__(self, tracker: SimulatedTracker) -> None:
        self._tracker = tracker
        self.place = Place(1000.0, 2000.0, 100.0, 1.55, 1.7)
        self.decimals = MOST_DECIMALS
        self._edm_mode = 3
        self._target_type = TargetType.DIRECT
        self._prism: tuple[int, str] = (0, ROUND_PRISM)
        self._refraction: tuple[Value, ...] = (1, 6378000.0, 0.13)
        self._scale: tuple[Value, ...] = (0, 1.0, 0.0, 0.0, 0.0)
        self._air: tuple[float, ...] | None = None

    def handlers(self) -> dict[Rpc, Handler]:
        """Handlers of the calls that are answered."""
        return self._readers() | self._setters() | self._prism_handlers()

    def _readers(self) -> dict[Rpc, Handler]:
        def reader(read: Sequence[Value]) -> Handler:
            return lambda _words, _now_s: Outcome(values=tuple(read))

        return {
            Rpc.COM_NULL_PROC: reader(()),
            Rpc.COM_GET_DOUBLE_PRECISION: lambda _w, _n: Outcome(values=(self.decimals,)),
            Rpc.COM_GET_SW_VERSION: reader(VERSION),
            Rpc.CSV_GET_INSTRUMENT_NO: reader((int(self._tracker.serial),)),
            Rpc.CSV_GET_INSTRUMENT_NAME: reader((MODEL,)),
            Rpc.CSV_GET_SW_VERSION: reader(VERSION),
            Rpc.CSV_GET_DEVICE_CONFIG: reader((DEVICE_CLASS, int(EQUIPMENT))),
            Rpc.CSV_GET_INT_TEMP: reader((25.0,)),
            Rpc.TMC_GET_STATION: lambda _w, _n: Outcome(values=self._station()),
            Rpc.TMC_GET_HEIGHT: lambda _w, _n: Outcome(values=(self.place.target_height,)),
            Rpc.TMC_GET_EDM_MODE: lambda _w, _n: Outcome(values=(self._edm_mode,)),
            Rpc.TMC_GET_FACE: reader((0,)),
            Rpc.TMC_GET_PRISM_CORR: lambda _w, _n: Outcome(values=(self._constant_m(),)),
            Rpc.TMC_GET_ATM_CORR: lambda _w, now_s: Outcome(values=self._air_at(now_s)),
            Rpc.TMC_GET_REFRACTIVE_CORR: lambda _w, _n: Outcome(values=self._refraction),
            Rpc.TMC_GET_GEO_PPM: lambda _w, _n: Outcome(values=self._scale),
            Rpc.TMC_IF_DATA_AZE_CORR_ERROR: reader((0,)),
            Rpc.TMC_IF_DATA_INC_CORR_ERROR: reader((0,)),
            Rpc.BAP_GET_TARGET_TYPE: lambda _w, _n: Outcome(values=(int(self._target_type),)),
        }

    def _setters(self) -> dict[Rpc, Handler]:
        return {
            Rpc.COM_SET_DOUBLE_PRECISION: self._set_decimals,
            Rpc.TMC_SET_STATION: self._set_station,
            Rpc.TMC_SET_HEIGHT: self._set_height,
            Rpc.TMC_SET_EDM_MODE: self._set_edm_mode,
            Rpc.TMC_SET_ATM_CORR: self._set_air,
            Rpc.TMC_SET_REFRACTIVE_CORR: self._set_refraction,
            Rpc.TMC_SET_GEO_PPM: self._set_scale,
            Rpc.BAP_SET_TARGET_TYPE: self._set_target_type,
        }

    def _prism_handlers(self) -> dict[Rpc, Handler]:
        return {
            Rpc.BAP_GET_PRISM_TYPE: lambda _w, _n: Outcome(values=(self._prism[0],)),
            Rpc.BAP_GET_PRISM_TYPE_2: lambda _w, _n: Outcome(values=self._prism),
            Rpc.BAP_SET_PRISM_TYPE: self._set_prism,
            Rpc.BAP_SET_PRISM_TYPE_2: self._set_named_prism,
            Rpc.BAP_GET_PRISM_DEF: self._prism_definition,
            Rpc.BAP_GET_USER_PRISM_DEF: self._user_prism_definition,
        }

    def _station(self) -> tuple[Value, ...]:
        place = self.place
        return place.east, place.north, place.up, place.instrument_height

    def _set_decimals(self, words: Sequence[str], _now_s: float) -> Outcome:
        (digits,) = map(parse_whole, parse_words(words, 1))
        if not 0 <= digits <= MOST_DECIMALS:
            return refusal(Result.INVALID_PARAMETER)
        self.decimals = digits
        return DONE

    def _set_station(self, words: Sequence[str], _now_s: float) -> Outcome:
        east, north, up, height = map(parse_number, parse_words(words, 4))
        self.place = Place(east, north, up, height, self.place.target_height)
        return DONE

    def _set_height(self, words: Sequence[str], _now_s: float) -> Outcome:
        (height,) = map(parse_number, parse_words(words, 1))
        self.place = replace(self.place, target_height=height)
        return DONE

    def _set_edm_mode(self, words: Sequence[str], _now_s: float) -> Outcome:
        (self._edm_mode,) = map(parse_whole, parse_words(words, 1))
        return DONE

    def _set_target_type(self, words: Sequence[str], _now_s: float) -> Outcome:
        (kind,) = map(parse_whole, parse_words(words, 1))
        if kind not in set(TargetType):
            return refusal(Result.INVALID_PARAMETER)
        self._target_type = TargetType(kind)
        return DONE

    def _set_air(self, words: Sequence[str], _now_s: float) -> Outcome:
        self._air = tuple(map(parse_number, parse_words(words, 4)))
        return DONE

    def _set_refraction(self, words: Sequence[str], _now_s: float) -> Outcome:
        is_on, *rest = parse_words(words, 3)
        self._refraction = (parse_whole(is_on), *map(parse_number, rest))
        return DONE

    def _set_scale(self, words: Sequence[str], _now_s: float) -> Outcome:
        is_on, *rest = parse_words(words, 5)
        self._scale = (parse_whole(is_on), *map(parse_number, rest))
        return DONE

    def _air_at(self, now_s: float) -> tuple[float, ...]:
        """Wavelength, pressure, dry and wet temperature: of the weather, until set otherwise."""
        if self._air is not None:
            return self._air
        temperature_degC, pressure_hPa, humidity_percent = self._tracker.weather(now_s)
        wet_degC = _wet_degC(temperature_degC, humidity_percent)
        return WAVELENGTH_M, pressure_hPa, temperature_degC, wet_degC

    def _constant_m(self) -> float:
        return 0.0344 if self._prism[0] == USER_PRISM else 0.0

    def _set_prism(self, words: Sequence[str], _now_s: float) -> Outcome:
        (kind,) = map(parse_whole, parse_words(words, 1))
        if kind != 0:
            return refusal(Result.INVALID_PARAMETER)
        self._prism = (0, ROUND_PRISM)
        return DONE

    def _set_named_prism(self, words: Sequence[str], _now_s: float) -> Outcome:
        kind, name = parse_words(words, 2)
        identifier = self._reflector(parse_string(name))
        if parse_whole(kind) != USER_PRISM or identifier is None:
            return refusal(Result.INVALID_PARAMETER)
        self._tracker.select_reflector(identifier)
        self._prism = (USER_PRISM, parse_string(name))
        return DONE

    def _prism_definition(self, words: Sequence[str], _now_s: float) -> Outcome:
        (kind,) = map(parse_whole, parse_words(words, 1))
        if kind != 0:
            return refusal(Result.INVALID_PARAMETER)
        return Outcome(values=(ROUND_PRISM, 0.0, PRISM))

    def _user_prism_definition(self, words: Sequence[str], _now_s: float) -> Outcome:
        (name,) = map(parse_string, parse_words(words, 1))
        if self._reflector(name) is None:
            return refusal(Result.INVALID_PARAMETER)
        return Outcome(values=(0.0344, PRISM, "pkmcal"))

    def _reflector(self, name: str) -> int | None:
        """The tracker's reflectors stand for prisms that the operator has defined."""
        by_name = {reflector.name: reflector.id for reflector in self._tracker.reflectors}
        return by_name.get(name)


def _wet_degC(dry_degC: float, humidity_percent: float) -> float:  # noqa: N802 - the unit's sign
    """Stull's empirical formula (2011), good to 0.3 °C near sea level."""
    t, rh = dry_degC, humidity_percent
    return (
        t * math.atan(0.151977 * math.sqrt(rh + 8.313659))
        + math.atan(t + rh)
        - math.atan(rh - 1.676331)
        + 0.00391838 * rh * math.sqrt(rh) * math.atan(0.023101 * rh)
        - 4.686035
    )
