"""Parameter selection: which to find, which to hold, and which are about known before.

Names may be patterns in the manner of a shell: `arm*.azimuth_deg`, `arm[12].*`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from campaigns.errors import OptionsInvalid
from campaigns.files.wording import shown, suggestion
from campaigns.mechanisms.parameters import ParameterSpace

LEAST_STD = 1e-6
"""mm or deg, of a prior: what is known better need not be looked for."""
WILD = frozenset("*?[")
REFLECTOR_CONSTANT = "reflector_constant_mm"
"""Stands among the names to free; it is the tracker's, not the robot's."""


@dataclass(frozen=True, slots=True)
class ParameterSelection:
    """Parameters to find, in the order of all names, and what is known of them before."""

    free: tuple[str, ...]
    priors: Mapping[str, float] = field(default_factory=dict)
    """Standard deviation about the nominal value, mm or deg, by name."""


def select_parameters(
    space: ParameterSpace,
    freed: Sequence[str] = (),
    fixed: Sequence[str] = (),
    priors: Sequence[str] = (),
    *,
    names: tuple[str, ...] | None = None,
    by_default: tuple[str, ...] | None = None,
) -> ParameterSelection:
    """Selection by patterns to free and to fix, and priors such as `arm*.forearm_mm=0.05`.

    Of all that a file holds unless other `names` may be told; free by default is what the mechanism
    has so. A whole name outranks a pattern. Raises `OptionsInvalid` for a pattern that matches
    nothing, for a name both freed and fixed, for a prior on held parameters and when nothing is
    left free.
    """
    names = space.names if names is None else names
    by_default = space.free_by_default if by_default is None else by_default
    free = _free(_freed(space, freed, names), _ranked(fixed, names), names, by_default)
    return ParameterSelection(free, _priors(priors, names, free))


def matching(pattern: str, names: tuple[str, ...]) -> tuple[str, ...]:
    """Names that a pattern means; raises `OptionsInvalid` when there is none."""
    found = tuple(name for name in names if fnmatchcase(name, pattern))
    if found:
        return found
    if not pattern:
        raise OptionsInvalid(
            "an empty name is not a parameter", remedy="give a name or a pattern, as 'arm*.x_mm'"
        )
    what = "matches no parameter" if WILD & set(pattern) else "is not a parameter"
    raise OptionsInvalid(f"{shown(pattern)} {what}", remedy=suggestion(pattern, names))


def _free(
    to_free: dict[str, int],
    to_fix: dict[str, int],
    names: tuple[str, ...],
    by_default: tuple[str, ...],
) -> tuple[str, ...]:
    for name in names:
        if name in to_free and to_free.get(name) == to_fix.get(name):
            raise OptionsInvalid(
                f"{name} is both freed and fixed", remedy="give it to one of --free and --fix"
            )
    held = {name for name, rank in to_fix.items() if rank > to_free.get(name, -1)}
    wanted = {*by_default, *to_free} - held
    if not wanted:
        raise OptionsInvalid("--fix leaves no parameter to find", remedy="fix fewer")
    return tuple(name for name in names if name in wanted)


def _freed(
    space: ParameterSpace, patterns: Sequence[str], names: tuple[str, ...]
) -> dict[str, int]:
    """Names to free; of the tilts a pattern leaves those out that are the frame's horizontal."""
    horizontal = {*space.datum} & {*space.extensions}
    ranked = _ranked(patterns, names)
    return {name: rank for name, rank in ranked.items() if rank or name not in horizontal}


def _ranked(patterns: Sequence[str], names: tuple[str, ...]) -> dict[str, int]:
    """Every name meant, with 1 where it is written out and 0 where a pattern means it."""
    ranks: dict[str, int] = {}
    patterns = [patterns] if isinstance(patterns, str) else patterns
    for pattern in (each for each in patterns if each != REFLECTOR_CONSTANT):
        for name in matching(pattern, names):
            ranks[name] = max(ranks.get(name, 0), int(name == pattern))
    return ranks


def _priors(
    texts: Sequence[str], names: tuple[str, ...], free: tuple[str, ...]
) -> dict[str, float]:
    """The last word on a parameter counts; a pattern means those of its matches that are free."""
    known: dict[str, float] = {}
    for text in texts:
        pattern, std = _prior_of(text)
        meant = matching(pattern, names)
        found = [name for name in meant if name in free]
        if not found:
            raise OptionsInvalid(
                f"--prior {shown(text)}: {_listed(meant)} held at the nominal value",
                remedy=f"free it too, with --free '{pattern}', or leave the prior out",
            )
        known |= dict.fromkeys(found, std)
    return {name: known[name] for name in names if name in known}


def _prior_of(text: str) -> tuple[str, float]:
    """Pattern and standard deviation of `NAME=σ`."""
    pattern, equals, number = text.partition("=")
    try:
        std = float(number)
    except ValueError:
        std = 0.0
    if equals and LEAST_STD <= std < float("inf"):
        return pattern.strip(), std
    if equals and 0.0 < std < LEAST_STD:
        raise OptionsInvalid(
            f"--prior {shown(text)}: σ is {std:g}, must be {LEAST_STD:g} or more",
            remedy="hold what is known for sure at its nominal value, with --fix",
        )
    raise OptionsInvalid(
        f"--prior {shown(text)} is not understood: σ must be a number above 0",
        remedy="give name and σ in the name's unit, as arm*.forearm_mm=0.05",
    )


def _listed(names: tuple[str, ...]) -> str:
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"
