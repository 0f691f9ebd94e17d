"""Memory of what was found of a campaign, by digests of all that it rests on, software included.

Kept among the user's caches. Of another file, setting or version nothing is remembered, so nothing
that is out of date can be told; what cannot be read or written counts as not remembered.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from campaigns.version import VERSION

PACKAGES = Path(__file__).parents[2]
SOFTWARE = ("app", "campaigns", "drivers")
CACHES = "PKMCAL_CACHE", "XDG_CACHE_HOME"
"""Variables of the environment that name a folder of caches, the first one first."""
MOST_BYTES = 1_000_000


def recall(asked: str, folder: Path, of: Mapping[str, str]) -> dict[str, object]:
    """What was found of a campaign when these were the digests; empty where nothing is known."""
    try:
        place = _place(asked, folder)
        if place.stat().st_size > MOST_BYTES:
            return {}
        kept = json.loads(place.read_bytes())
        found: object = kept["found"]
        same = _is_told(of) and of == kept["of"]
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):
        return {}
    return found if same and isinstance(found, dict) else {}


def remember(asked: str, folder: Path, of: Mapping[str, str], found: Mapping[str, object]) -> None:
    """Keep what was found of a campaign with these digests, in place of what was found before."""
    if not _is_told(of):
        return
    with suppress(OSError, RuntimeError):
        place = _place(asked, folder)
        place.parent.mkdir(parents=True, exist_ok=True)
        fresh = place.with_name(f"{place.name}.{os.getpid()}")
        fresh.write_text(json.dumps({"of": of, "found": found}), encoding="utf-8")
        fresh.replace(place)


def software() -> str:
    """Digest of version, and of names, sizes and times of all modules that answers are made by.

    Empty where it cannot be told, and then nothing is remembered.
    """
    told = hashlib.sha256(VERSION.encode())
    folders = (each for name in SOFTWARE for each in os.walk(PACKAGES / name))
    try:
        for path in sorted(
            f"{at}/{file}" for at, _, files in folders for file in files if file.endswith(".py")
        ):
            stat = os.stat(path)  # noqa: PTH116 - of 400 files, in a third of the time
            told.update(os.fsencode(path) + b" %d %d\n" % (stat.st_size, stat.st_mtime_ns))
    except OSError:
        return ""
    return told.hexdigest()


def _is_told(of: Mapping[str, str]) -> bool:
    """Whether every digest is known."""
    return bool(of) and all(of.values())


def _place(asked: str, folder: Path) -> Path:
    """File of what was found; raises `RuntimeError` for a user without a home."""
    named = (os.environ.get(each) for each in CACHES)
    caches = Path(next(filter(None, named), None) or Path.home() / ".cache")
    name = hashlib.sha256(str(folder.resolve()).encode(errors="surrogateescape")).hexdigest()
    return caches / "pkmcal" / f"{name[:32]}-{asked}.json"
