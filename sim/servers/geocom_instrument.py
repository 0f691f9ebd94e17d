"""A simulated GeoCOM instrument: its settings and readings, and what comes of a call."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import cast

from drivers.wire.geocom import parse_number, parse_string, parse_whole, parse_words
from drivers.wire.geocom_constants import USER_PRISM, Capability, Result, Rpc, TargetType
from sim.servers.queueing import Later
from sim.tracker.instrument import SimulatedTracker

MODEL = "SIM-TS"
DEVICE_CLASS = 350
EQUIPMENT = Capability.MOTORISED | Capability.TARGET_RECOGNITION
VERSION = (1, 0, 0)
WAVELENGTH_M = 6.58e-7
ROUND_PRISM = "Leica Circ Prism"
PRISM = 1
"""A reflector type: neither undefined nor tape."""
USER_PRISM_M = 0.0344
MOST_DECIMALS = 15

Value = float | str
Values = tuple[Value, ...]


@dataclass(frozen=True, slots=True)
class GeocomOutcome:
    """A return code and the values behind it; whole numbers and flags are written as such."""

    result: int = Result.OK
    values: Values = ()
    communication: int = Result.OK


Obeyed = GeocomOutcome | Later[GeocomOutcome]
Handler = Callable[[Sequence[str], float], Obeyed]
"""Handler of a call's words, at a time; may raise `WireError` for the words."""

DONE = GeocomOutcome()
WRONG = GeocomOutcome(Result.INVALID_PARAMETER)


def told(read: Callable[[float], Values]) -> Handler:
    """Handler of a call that only reads something, at a time."""
    return lambda _words, now_s: GeocomOutcome(values=read(now_s))


def _always(values: Values) -> Handler:
    return told(lambda _now_s: values)


@dataclass(frozen=True, slots=True)
class Setting:
    """Setting that one call reads and another one replaces, and as what it is found."""

    reading: Rpc
    replacing: Rpc
    words: str
    """Whole numbers (w) and others (n)."""
    found: Values
    accepts: Callable[[Values], bool] = lambda _values: True

    def parsed(self, words: Sequence[str]) -> Values:
        """Values of a call's words; raises `WireError`."""
        given = zip(self.words, parse_words(words, len(self.words)), strict=True)
        return tuple(
            parse_whole(word) if kind == "w" else parse_number(word) for kind, word in given
        )


SETTINGS = (
    Setting(
        Rpc.COM_GET_DOUBLE_PRECISION,
        Rpc.COM_SET_DOUBLE_PRECISION,
        "w",
        (MOST_DECIMALS,),
        lambda values: values[0] in range(MOST_DECIMALS + 1),
    ),
    Setting(Rpc.TMC_GET_STATION, Rpc.TMC_SET_STATION, "nnnn", (1000.0, 2000.0, 100.0, 1.55)),
    Setting(Rpc.TMC_GET_HEIGHT, Rpc.TMC_SET_HEIGHT, "n", (1.7,)),
    Setting(Rpc.TMC_GET_EDM_MODE, Rpc.TMC_SET_EDM_MODE, "w", (3,)),
    Setting(Rpc.TMC_GET_ATM_CORR, Rpc.TMC_SET_ATM_CORR, "nnnn", ()),
    Setting(Rpc.TMC_GET_REFRACTIVE_CORR, Rpc.TMC_SET_REFRACTIVE_CORR, "wnn", (1, 6378000.0, 0.13)),
    Setting(Rpc.TMC_GET_GEO_PPM, Rpc.TMC_SET_GEO_PPM, "wnnnn", (0, 1.0, 0.0, 0.0, 0.0)),
    Setting(
        Rpc.BAP_GET_TARGET_TYPE,
        Rpc.BAP_SET_TARGET_TYPE,
        "w",
        (int(TargetType.DIRECT),),
        lambda values: values[0] in set(TargetType),
    ),
)


class GeocomInstrument:
    """Settings, as an instrument keeps them while nobody is connected, and readings.

    As it is found: somebody has surveyed with it before.
    """

    def __init__(self, tracker: SimulatedTracker) -> None:
        self._tracker = tracker
        self._kept = {setting.reading: setting.found for setting in SETTINGS}
        self._prism: tuple[int, str] = (0, ROUND_PRISM)

    @property
    def decimals(self) -> int:
        """Digits behind the point that numbers are written with."""
        (digits,) = cast("tuple[int]", self._kept[Rpc.COM_GET_DOUBLE_PRECISION])
        return digits

    @property
    def setup_m(self) -> tuple[float, float, float, float]:
        """East, north and up of the telescope, and the prism's height, by what it has been told."""
        east, north, up, height = cast("tuple[float, ...]", self._kept[Rpc.TMC_GET_STATION])
        (prism_height,) = cast("tuple[float]", self._kept[Rpc.TMC_GET_HEIGHT])
        return east, north, up + height, prism_height

    def handlers(self) -> dict[Rpc, Handler]:
        """Handlers of the calls that are answered."""
        reading = {each.reading: told(partial(self._read, each.reading)) for each in SETTINGS}
        replacing = {each.replacing: partial(self._replace, each) for each in SETTINGS}
        fixed: dict[Rpc, Values] = {
            Rpc.COM_NULL_PROC: (),
            Rpc.COM_GET_SW_VERSION: VERSION,
            Rpc.CSV_GET_INSTRUMENT_NO: (int(self._tracker.serial),),
            Rpc.CSV_GET_INSTRUMENT_NAME: (MODEL,),
            Rpc.CSV_GET_SW_VERSION: VERSION,
            Rpc.CSV_GET_DEVICE_CONFIG: (DEVICE_CLASS, int(EQUIPMENT)),
            Rpc.CSV_GET_INT_TEMP: (25.0,),
            Rpc.TMC_IF_DATA_AZE_CORR_ERROR: (0,),
            Rpc.TMC_IF_DATA_INC_CORR_ERROR: (0,),
        }
        reading |= {rpc: _always(values) for rpc, values in fixed.items()}
        reading[Rpc.TMC_GET_FACE] = told(lambda _n: (self._tracker.face - 1,))
        return reading | replacing | self._prism_handlers()

    def _prism_handlers(self) -> dict[Rpc, Handler]:
        return {
            Rpc.TMC_GET_PRISM_CORR: told(
                lambda _n: (USER_PRISM_M if self._prism[0] == USER_PRISM else 0.0,)
            ),
            Rpc.BAP_GET_PRISM_TYPE: told(lambda _n: (self._prism[0],)),
            Rpc.BAP_GET_PRISM_TYPE_2: told(lambda _n: self._prism),
            Rpc.BAP_SET_PRISM_TYPE: self._set_prism,
            Rpc.BAP_SET_PRISM_TYPE_2: self._set_named_prism,
            Rpc.BAP_GET_PRISM_DEF: self._prism_definition,
            Rpc.BAP_GET_USER_PRISM_DEF: self._user_prism_definition,
        }

    def _read(self, rpc: Rpc, now_s: float) -> Values:
        """Setting as it is kept; wavelength, pressure, dry and wet temperature until set: now."""
        if kept := self._kept[rpc]:
            return kept
        temperature_degC, pressure_hPa, humidity_percent = self._tracker.weather(now_s)
        wet_degC = _wet_degC(temperature_degC, humidity_percent)
        return WAVELENGTH_M, pressure_hPa, temperature_degC, wet_degC

    def _replace(self, setting: Setting, words: Sequence[str], _now_s: float) -> GeocomOutcome:
        values = setting.parsed(words)
        if not setting.accepts(values):
            return WRONG
        self._kept[setting.reading] = values
        return DONE

    def _set_prism(self, words: Sequence[str], _now_s: float) -> GeocomOutcome:
        (kind,) = map(parse_whole, parse_words(words, 1))
        if kind != 0:
            return WRONG
        self._prism = (0, ROUND_PRISM)
        return DONE

    def _set_named_prism(self, words: Sequence[str], _now_s: float) -> GeocomOutcome:
        kind, name = parse_words(words, 2)
        identifier = self._reflector(parse_string(name))
        if parse_whole(kind) != USER_PRISM or identifier is None:
            return WRONG
        self._tracker.select_reflector(identifier)
        self._prism = (USER_PRISM, parse_string(name))
        return DONE

    def _prism_definition(self, words: Sequence[str], _now_s: float) -> GeocomOutcome:
        (kind,) = map(parse_whole, parse_words(words, 1))
        return GeocomOutcome(values=(ROUND_PRISM, 0.0, PRISM)) if kind == 0 else WRONG

    def _user_prism_definition(self, words: Sequence[str], _now_s: float) -> GeocomOutcome:
        (name,) = map(parse_string, parse_words(words, 1))
        if self._reflector(name) is None:
            return WRONG
        return GeocomOutcome(values=(USER_PRISM_M, PRISM, "pkmcal"))

    def _reflector(self, name: str) -> int | None:
        """The tracker's reflectors stand for prisms that the operator has defined."""
        return {each.name: each.id for each in self._tracker.reflectors}.get(name)


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
