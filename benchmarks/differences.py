"""Differences between two records of `benchmarks.yardsticks`, in words and by tolerance."""

import difflib
import json
import re
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

TOLERANCES = (
    (r"^plans/.*\.csv", 0.0, 1e-6),
    (r"std|sigma|scatter|_u_", 0.02, 1e-9),
    (r"deg", 0.02, 1e-5),
    (r"", 0.02, 1e-4),
)
"""Relative and absolute tolerance of numbers, by a pattern of their place; the first one counts."""
SHARE_OF_SIGMA = 0.05
"""Allowed change of an identified parameter in its σ."""
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def differences(old: Any, new: Any, place: str, sigma: float | None = None) -> Iterator[str]:
    """Describe what differs between two documents, a line each."""
    if isinstance(old, dict) and isinstance(new, dict):
        yield from (f"{place}.{key}: missing" for key in old if key not in new)
        yield from (f"{place}.{key}: added" for key in new if key not in old)
        for key in (key for key in old if key in new):
            std = old.get("std") if key in ("value", "delta") else None
            yield from differences(old[key], new[key], f"{place}.{key}", std)
    elif isinstance(old, list) and isinstance(new, list):
        yield from list_differences(old, new, place)
    elif isinstance(old, str) and isinstance(new, str):
        yield from text_differences([old], [new], place)
    elif is_number(old) and is_number(new):
        whole = isinstance(old, int) and isinstance(new, int)
        allowed = 0.0 if whole else SHARE_OF_SIGMA * sigma if sigma else tolerance(place, old)
        if abs(new - old) > allowed:
            yield f"{place}: {old:.6g} → {new:.6g} (off by {new - old:+.3g}, allowed {allowed:.3g})"
    elif old != new:
        yield f"{place}: {json.dumps(old)[:80]} → {json.dumps(new)[:80]}"


def list_differences(old: list[Any], new: list[Any], place: str) -> Iterator[str]:
    if all(isinstance(entry, str) for entry in old + new):
        yield from text_differences(old, new, place)
    elif len(old) != len(new):
        yield f"{place}: {len(old)} → {len(new)} entries"
    else:
        for number, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(pair[0], pair[1], f"{place}[{number}]")


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def tolerance(place: str, value: float) -> float:
    relative, absolute = next(sizes for pattern, *sizes in TOLERANCES if re.search(pattern, place))
    return relative * abs(value) + absolute


def text_differences(old: Sequence[str], new: Sequence[str], place: str) -> Iterator[str]:
    """Describe lines that differ in words, or in a number by more than its tolerance."""
    before, after = ([NUMBER.sub("#", line) for line in lines] for lines in (old, new))
    matcher = difflib.SequenceMatcher(None, before, after, autojunk=False)
    for change, a, a_end, b, b_end in matcher.get_opcodes():
        for x, y in zip_longest(old[a:a_end], new[b:b_end]):
            if change != "equal" or not numbers_agree(x, y, place):
                lines = [f"    {mark} {line}" for mark, line in (("-", x), ("+", y)) if line]
                yield "\n".join([f"{place}:", *lines])


def numbers_agree(old: str, new: str, place: str) -> bool:
    """Compare numbers by tolerance, or by one unit of the last digit that is printed."""
    for x, y in zip(NUMBER.findall(old), NUMBER.findall(new), strict=True):
        last_digit = 10.0 ** -len(x.partition(".")[2]) if "." in x and "e" not in x.lower() else 0.0
        a, b = (float(text.replace("−", "-")) for text in (x, y))
        strict = place.startswith("plans/") or not last_digit
        allowed = tolerance(place, a) if strict else max(tolerance(place, a), 1.001 * last_digit)
        if abs(a - b) > allowed:
            return False
    return True


def file_differences(old: Path, new: Path, name: str) -> Iterator[str]:
    before, after = (path.read_text(encoding="utf-8") for path in (old, new))
    if name.endswith(".json"):
        return differences(json.loads(before), json.loads(after), name)
    return text_differences(before.splitlines(), after.splitlines(), name)


def compare(old: Path, new: Path, most: int) -> int:
    """Print what differs between two records; 1 if anything does."""
    names = [{str(p.relative_to(top)) for p in top.rglob("*") if p.is_file()} for top in (old, new)]
    names = [{name for name in side if not name.startswith("campaign/")} for side in names]
    differing = 0
    for name in sorted(names[0] | names[1]):
        if name not in names[1] or name not in names[0]:
            lines = ["missing" if name in names[0] else "added"]
        else:
            lines = list(file_differences(old / name, new / name, name))
        if lines:
            differing += 1
            print(f"{name}: {len(lines)} differences")
            for line in lines[:most]:
                print(f"  {line.removeprefix(name).lstrip('.:').lstrip()}")
    print(f"{differing} of {len(names[0] | names[1])} files differ")
    return 1 if differing else 0
