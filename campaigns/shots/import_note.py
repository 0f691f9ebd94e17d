"""What an imported shot came with that no other field of a journal holds: its air and its time."""

import re

from campaigns.files.decimals import number_text

IMPORTED = "imported"
NOTE = re.compile(
    rf"{IMPORTED}(?:, air (?P<air>[-+.e\d]+) °C)?(?:, measured (?P<time>.*))?", re.DOTALL
)


def import_note(temperature_degC: float | None, time: str | None) -> str:
    """The note that stands where a tracker's answer would."""
    air = "" if temperature_degC is None else f", air {number_text(temperature_degC)} °C"
    return f"{IMPORTED}{air}" + ("" if time is None else f", measured {time}")


def noted(note: str) -> tuple[float | None, str | None]:
    """The temperature in °C and the time of a note; None for what it does not say."""
    found = NOTE.fullmatch(note)
    if found is None:
        return None, None
    return None if found["air"] is None else float(found["air"]), found["time"]
