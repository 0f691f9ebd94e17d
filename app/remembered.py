"""Answers of commands that are given again while all files that they rest on are the same."""

import hashlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from campaigns.files import memory

if TYPE_CHECKING:
    from campaigns.campaign import Campaign
    from campaigns.planning.plan_check import CheckedPlan

MOST_BYTES = 200_000_000
"""Of all files: more takes longer to read than an answer to find."""
PASSING = (".lock", ".lock.holder", "-shm", "cell-memory.json")
"""Ends of names that say nothing of a campaign."""


Line = tuple[str, str]
"""A line of an answer, and how it looks."""
Answer = tuple[list[Line], dict[str, object]]
"""Lines for people, and the document for programs."""


def digests(folder: Path, software: str = "") -> dict[str, str]:
    """SHA-256 of each file in a campaign's folder; empty where it cannot be told.

    `software` is the digest of what runs, which does not change meanwhile.
    """
    found, left = {"folder": str(folder), "software": software or memory.software()}, MOST_BYTES
    try:
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
    match memory.recall(asked, folder, of):
        case {"lines": list(lines), "document": dict(document)} if all(map(_is_line, lines)):
            return [(text, style) for text, style in lines], document
    found = find()
    if of == digests(folder, of.get("software", "")):  # else files changed while it was looked for
        lines, document = found
        memory.remember(asked, folder, of, {"lines": lines, "document": document})
    return found


def _is_line(kept: object) -> bool:
    return isinstance(kept, list) and [*map(type, kept)] == [str, str]


def checked_plan(campaign: "Campaign", tell: Callable[[str], None]) -> "CheckedPlan":
    """plan.csv that the nominal robot can run; raises `PlanInvalid`.

    The same shots are not checked again by the same robot, settings and software. `tell` hears what
    is checked.
    """
    from campaigns.planning.plan_check import CheckedPlan
    from campaigns.planning.plan_file import plan_digest

    shots, limits = campaign.read_plan(), campaign.plan_limits
    of = {
        "plan": plan_digest(shots, campaign.robot.mechanism),
        "limits": hashlib.sha256(pickle.dumps(limits)).hexdigest(),
        "software": memory.software(),
    }
    match memory.recall("plan", campaign.folder, of):
        case {"detours": int(detours), "seconds": float(seconds)}:
            return CheckedPlan(shots, detours, seconds)
    found = campaign.checked_plan(shots, tell)
    told = {"detours": found.detours, "seconds": found.seconds}
    memory.remember("plan", campaign.folder, of, told)
    return found
