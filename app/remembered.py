"""Answers of commands, remembered by the digests of all files that they rest on, software included.

Kept among the user's caches. Of another journal, plan, setting or version nothing is remembered, so
nothing that is out of date can be shown; what cannot be read or written counts as not remembered.
"""

import hashlib
import json
import os
import pickle
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from campaigns.version import VERSION

if TYPE_CHECKING:
    from campaigns.campaign import Campaign
    from campaigns.planning.plan_check import CheckedPlan

PACKAGES = Path(__file__).parents[1]
SOFTWARE = ("app", "campaigns", "drivers")
CACHES = "PKMCAL_CACHE", "XDG_CACHE_HOME"
"""Variables of the environment that name a folder of caches, the first one first."""
ANSWER_BYTES = 1_000_000
MOST_BYTES = 200_000_000
"""Of all files: more takes longer to read than an answer to find."""
PASSING = (".lock", ".lock.holder", "-shm", "cell-memory.json")
"""Ends of names that say nothing of a campaign."""


Line = tuple[str, str]
"""A line of an answer, and how it looks."""
Answer = tuple[list[Line], dict[str, object]]
"""Lines for people, and the document for programs."""


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of each file in a campaign's folder; empty where it cannot be told."""
    found, left = {"folder": str(folder)}, MOST_BYTES
    try:
        found["software"] = _software()
        for path in sorted(folder.iterdir()):
            if not path.is_file() or path.name.endswith(PASSING):
                continue
            left -= path.stat().st_size
            if left < 0:
                return {}
            found[f"file {path}"] = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return {}
    return found


def answer_to(asked: str, folder: Path, find: Callable[[], Answer]) -> Answer:
    """Answer for a campaign: the one remembered, or the one found now, which is remembered."""
    of = digests(folder)
    known = remembered(asked, folder, of)
    if known is not None:
        return known
    found = find()
    if of and of == digests(folder):  # else files changed while it was looked for
        _remember(asked, folder, of, found)
    return found


def checked_plan(campaign: "Campaign") -> "CheckedPlan":
    """plan.csv that the nominal robot can run; raises `PlanInvalid`.

    The same shots are not checked again by the same robot, settings and software.
    """
    from campaigns.planning.plan_check import CheckedPlan
    from campaigns.planning.plan_file import plan_digest

    shots, limits = campaign.read_plan(), campaign.plan_limits
    try:
        of = {
            "plan": plan_digest(shots, campaign.robot.mechanism),
            "limits": hashlib.sha256(pickle.dumps(limits)).hexdigest(),
            "software": _software(),
        }
    except OSError:
        return campaign.checked_plan(shots)
    match remembered("plan", campaign.folder, of):
        case _, {"detours": int(detours), "seconds": float(seconds)}:
            return CheckedPlan(shots, detours, seconds)
    found = campaign.checked_plan(shots)
    told: dict[str, object] = {"detours": found.detours, "seconds": found.seconds}
    _remember("plan", campaign.folder, of, ([], told))
    return found


def remembered(asked: str, folder: Path, of: Mapping[str, str]) -> Answer | None:
    """Answer for a campaign whose files had these digests; None where none is known."""
    try:
        place = _place(asked, folder)
        if place.stat().st_size > ANSWER_BYTES:
            return None
        kept = json.loads(place.read_bytes())
        answer = [(str(a), str(b)) for a, b in kept["lines"]], kept["document"]
        same = of and isinstance(answer[1], dict) and of == kept["of"]
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):
        return None
    return answer if same else None


def _remember(asked: str, folder: Path, of: Mapping[str, str], answer: Answer) -> None:
    lines, document = answer
    kept = {"of": of, "lines": lines, "document": document}
    with suppress(OSError, RuntimeError):
        place = _place(asked, folder)
        place.parent.mkdir(parents=True, exist_ok=True)
        fresh = place.with_name(f"{place.name}.{os.getpid()}")
        fresh.write_text(json.dumps(kept), encoding="utf-8")
        fresh.replace(place)


def _place(asked: str, folder: Path) -> Path:
    """File of a campaign's answer; raises `RuntimeError` for a user without a home."""
    named = (os.environ.get(each) for each in CACHES)
    caches = Path(next(filter(None, named), None) or Path.home() / ".cache")
    name = hashlib.sha256(str(folder.resolve()).encode(errors="surrogateescape")).hexdigest()
    return caches / "pkmcal" / f"{name[:32]}-{asked}.json"


def _software() -> str:
    """Digest of version, and of names, sizes and times of all modules that an answer is made by."""
    told = hashlib.sha256(VERSION.encode())
    folders = (each for name in SOFTWARE for each in os.walk(PACKAGES / name))
    for path in sorted(
        f"{at}/{file}" for at, _, files in folders for file in files if file.endswith(".py")
    ):
        stat = os.stat(path)  # noqa: PTH116 - of 400 files, in a third of the time
        told.update(os.fsencode(path) + b" %d %d\n" % (stat.st_size, stat.st_mtime_ns))
    return told.hexdigest()
