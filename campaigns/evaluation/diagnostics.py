"""Doubts: findings that speak against taking a result, each with its name and its numbers."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from campaigns.estimation.change_detection import Change
from campaigns.estimation.information import (
    LEAST_SHARE,
    SIGNIFICANCE,
    ChiSquareTest,
    TrackerScale,
    Uncertainty,
)
from campaigns.estimation.lack_of_fit import GENERAL, LackOfFit
from campaigns.evaluation.decision import COVERAGE, Decision
from campaigns.evaluation.plausibility import beyond_tolerance, common_scale
from campaigns.evaluation.region import FARTHER_OFF, Region
from campaigns.evaluation.summary import Spread
from campaigns.mechanisms.parameters import Parameters, ParameterSpace
from campaigns.mechanisms.transmission import YIELDING
from campaigns.robots.schema import Tolerance

COMMON_SCALE, LARGE_CHANGE, CHANGE, SWAPPED, HOLD_OUT, CAREFUL, LACK, REFLECTOR = (
    "common-scale",
    "large-change",
    "change-during-campaign",
    "swapped",
    "hold-out",
    "careful-statement",
    "lack-of-fit",
    "reflector-constant",
)
EXTRAPOLATION, KNOWN_LENGTH, NESTS = "extrapolation", "known-length", "nests"
UNMEASURED, UNKNOWN_POSITIONS = "unmeasured-length", "unknown-positions"
MOST_BEYOND = 0.05
"""Share of the workspace that may be so far from all shots."""
PPM = 1e6
FAR_BELOW = 0.2
"""Scatter over what is stated below which the statement is no caution any more."""
ANOTHER_TYPE_MM = 1.0
"""Error of a constant from which the reflector is of another type."""
PLAY = 2.0
"""Backlash over the scatter of the joints that it makes."""
BY_LIMITS = "the model has no parameter for it; pass by acceptance limits that are met"
HARMONIC = ("eccentricity", "period", "ripple")
BY_AUTO = "--model auto fits it"
LACKS = {
    "eccentricity": (
        "eccentric encoder, or sag of the arm's own weight",
        f"{BY_AUTO}; or mend the encoder",
        "°",
    ),
    "period": ("error of the carriage's drive with a period", BY_AUTO, " mm"),
    "ripple": ("ripple of the gear or of the motor's encoder", BY_AUTO, "°"),
    "ratio": (
        "ratio of the gear or pitch of the drive",
        f"{BY_AUTO}; or correct the controller's",
        " %",
    ),
    "backlash": ("backlash", f"{BY_AUTO}; or renew the gear", ""),
    "azimuths": ("azimuths off nominal", "--model auto fits those that can be told", ""),
    "parts": ("rods of unequal length or tilted axes", "--model full, or auto, looks for them", ""),
    YIELDING: ("a gear yields under the plate's weight", f"stiffen it; {BY_LIMITS}", " mm"),
    "sag": ("the plate sags by its reach", f"stiffen the robot; {BY_LIMITS}", " mm"),
    "reflector": (
        "the reflector's constant is off, ranges too long by it",
        "set the reflector's type in the tracker, or --free reflector_constant_mm",
        " mm",
    ),
    "transit axis": ("the tracker's axes are out of square", "have the tracker compensated", "°"),
    GENERAL: (
        "what is left follows the joints",
        f"the model lacks something (bending, warmth); --model auto may tell; else {BY_LIMITS}",
        "",
    ),
}
"""Causes of a lack of fit in words, what to do, and the size's unit; of parameters their own."""
PER_UNIT = {" mm": 1.0, "°": float(np.degrees(1.0)), " %": 100.0}
TINY = 1e-300
SMALL_DEG = 0.1
ACCEPT = {COMMON_SCALE: "--accept-scale", LARGE_CHANGE: "--accept-large-change"}
"""Option with which a result is taken all the same."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Finding that speaks against a result: by name, in words, in numbers.

    `decision` is what the verdict can be at most; empty for what is only told.
    """

    name: str
    says: str
    decision: Decision | None = None
    numbers: dict[str, float | str] = field(default_factory=dict)
    accepted: bool = False

    @property
    def affects_verdict(self) -> bool:
        """Whether the verdict has to heed it."""
        return self.decision is not None and not self.accepted

    @property
    def by_limits(self) -> bool:
        """Whether it would affect the verdict, were acceptance limits of distances not met."""
        return self.name in {LACK, HOLD_OUT} and self.decision is None


def parameter_doubts(
    nominal: Parameters,
    changes: Mapping[str, float],
    known: Uncertainty,
    tolerance: Tolerance,
    accepted: frozenset[str],
) -> Iterator[Doubt]:
    """Doubts of what a fit found: changes in mm and deg, with their uncertainty."""
    beyond = tuple(beyond_tolerance(nominal.space, tolerance, changes))
    if beyond:
        more = f" (and {len(beyond) - 1} more)" if len(beyond) > 1 else ""
        yield Doubt(
            LARGE_CHANGE,
            f"{beyond[0]}{more}: no robot is built so far off; look at units, joints and "
            f"robot.yaml, or say {ACCEPT[LARGE_CHANGE]}",
            "fail",
            {"beyond": float(len(beyond))},
            LARGE_CHANGE in accepted,
        )
    scale = common_scale(nominal, changes, known)
    if scale.significant:
        yield Doubt(
            COMMON_SCALE,
            f"all lengths changed by the same share, {100.0 * scale.share:+.3f} % (p = "
            f"{scale.p:.1g}): a wrong reflector or air constant, or a scale in the export, rather "
            f"than the robot; if it is the robot, say {ACCEPT[COMMON_SCALE]}",
            "fail",
            {"share": scale.share, "p": scale.p},
            COMMON_SCALE in accepted,
        )


def noise_doubts(noise: ChiSquareTest) -> Iterator[Doubt]:
    """Doubt of a scatter far below what is stated."""
    ratio = noise.birge_ratio
    if ratio is not None and noise.consistent is False and ratio < FAR_BELOW:
        yield Doubt(
            CAREFUL,
            f"the shots scatter by {ratio:.2g} of what is stated: is the statement in other units, "
            "or are the points no measurements?",
            None,
            {"birge_ratio": ratio},
        )


def change_doubt(
    change: Change, numbers: tuple[int, int], nominal: Parameters, play: float = 0.0
) -> Doubt:
    """Doubt of a change between two shots, by their numbers; lengths' is told of nominal ones.

    An encoder's that is smaller than the play of the gears (rad, mm) is only told. Of one that a
    single shot shows, near the end, it is not decided whether it is one.
    """
    (before, after), space = numbers, nominal.space
    size = float(change.size[0])
    values: dict[str, float | str] = {
        "kind": change.kind,
        "cause": change.name,
        "after_shot": float(before),
        "before_shot": float(after),
        "p": change.p,
    }
    where = f"between shots {before} and {after}"
    alone = _alone(before, after)
    below = change.kind == "joint" and abs(size) < play
    if change.kind == "drift" and len(change.size) == 1:
        links, std = [nominal[name] for name in space.arm_lengths], float(change.std[0])
        per_mm = PPM / float(np.mean(links))
        values |= {"size": size, "std": std, "ppm": per_mm * size, "std_ppm": per_mm * std}
        grown = f"{space[space.arm_lengths[0]].field.stem}s"
        grew = f"{grown} {'grew' if size >= 0.0 else 'shrank'} by {abs(per_mm * size):.3g}"
        what = f"{grew} ± {COVERAGE * per_mm * std:.2g} ppm over the run, {size:+.2g} mm"
        remedy = WARM_UP
    elif change.kind in ("frame", "drift", "mount"):
        moved_mm = float(np.linalg.norm(change.size[-3:]))
        values |= {"moved_mm": moved_mm}
        moved = "the tracker or the robot's base"
        if change.kind == "mount":
            moved = f"arm {space[change.name].arm}'s mount"
        what = (
            f"{moved} drifted by {moved_mm:.2g} mm over the campaign"
            if change.kind == "drift"
            else f"{moved} moved by {moved_mm:.2g} mm {where}"
        )
        remedy = f"if it was between two sessions, --sessions; else {alone}"
        if change.kind == "mount":
            remedy = f"fasten it; {alone}"
    else:
        changed, unit = space[change.name], float(space.units((change.name,))[0])
        values |= {"size": size / unit, "std": float(change.std[0]) / unit}
        by = f"{size / unit:+.3g}{changed.sign} {where}"
        if change.kind == "joint":
            what = f"arm {changed.arm}'s encoder changed by {by}"
            remedy = f"mend the encoder or its coupling; {alone}"
        else:
            link = "" if changed.field.name == "arm_mm" else f"'s {changed.field.words}"
            what = f"arm {changed.arm}{link} changed its length by {by}"
            remedy = f"look for warmth or a loose joint; {alone}"
    if below:
        remedy = "less than the play that the shots show in the gears"
    decision: Decision | None = None if below else "fail"
    if change.p >= SIGNIFICANCE:
        decision = None if below else "not decided"
        what = f"shot {after} is off, as if {what}, and those after it are too few to tell"
        return Doubt(CHANGE, f"{what}: measure some again; {remedy}", decision, values)
    return Doubt(CHANGE, f"{what} ({_chance(change.p)}): {remedy}", decision, values)


WARM_UP = "let the robot warm up first, or measure again when it is warm"


def late_doubt(off: int, first: int) -> Doubt:
    """Doubt of shots that all others contradict and that lie together at the end."""
    return Doubt(
        CHANGE,
        f"the {off} shots that all others contradict lie together from shot {first} on: something "
        f"changed there; {_alone(first - 1, first)}",
        "fail",
        {"kind": "unknown", "cause": "", "before_shot": float(first), "off": float(off)},
    )


def nests_told(kind: str, moved_mm: float, std_mm: float, between: tuple[int, int]) -> Doubt:
    """What nests tell of a `stand` that moved, of a `loose` nest or of the `robot`: it is told."""
    before, after = between
    size = f"moved {moved_mm:.3f} ± {std_mm:.2g} mm between shots {before} and {after}"
    says = {
        "stand": f"nests {size}: the tracker's stand moved; measure again, or --sessions if it was "
        "between two sessions",
        "loose": f"nests {size}, and not as one body: fasten the loose one, or --sessions if the "
        "tracker was put elsewhere",
        "robot": f"the drift pose {size}, beside what the nests did: the robot, not the tracker",
    }[kind]
    numbers: dict[str, float | str] = {"kind": kind, "moved_mm": moved_mm, "std_mm": std_mm}
    numbers |= {"after_shot": float(before), "before_shot": float(after)}
    return Doubt(NESTS, says, None, numbers)


def swapped_doubt(one: int, other: int) -> Doubt:
    """Doubt of two neighbours that have each other's points."""
    says = (
        f"shots {one} and {other} are swapped: each has the other's point, and both were left out; "
        "exchange them in the file"
    )
    return Doubt(SWAPPED, says, None, {"shot": float(one), "other": float(other)})


def reflector_told(off_mm: float, std_mm: float) -> Doubt:
    """What was found of the reflector's constant beside the robot: told, it decides nothing."""
    says = (
        f"the reflector's constant is off by {off_mm:+.3f} ± {std_mm:.2g} mm: ranges are too "
        f"{'long' if off_mm > 0.0 else 'short'} by it, and were corrected"
    )
    if abs(off_mm) > ANOTHER_TYPE_MM:
        says += "; another type of reflector is set in the tracker"
    return Doubt(REFLECTOR, says, None, {"off_mm": off_mm, "std_mm": std_mm})


def lack_doubt(found: LackOfFit, space: ParameterSpace, *, limits_met: bool) -> Doubt:
    """Doubt of residuals that have a cause which the model lacks, as no scatter has."""
    words, remedy, unit = LACKS[found.name]
    values: dict[str, float | str] = {"share": found.share, "p": found.p, "cause": found.name}
    told, arm = "", None
    if found.name != GENERAL:
        size, unit, arm = _largest(found, space, unit)
        values |= {"size": size, "unit": unit.strip()}
        signed = len(found.size) == 1
        told = _size_text(size, unit, signed=signed)
    if arm is not None:
        values["arm"] = float(arm)
        alone = len(set(found.arms)) == 1
        values["alone"] = float(alone)
        words = f"arm {arm}: {words}" if alone else f"{words}, most in arm {arm}"
    if (period := found.group.period) and found.name == "ripple":
        values["per_turn"] = 2.0 * np.pi / period
        words += f", {values['per_turn']:.4g} times a turn"
    elif period:
        values["period_mm"] = period
        words += f" of {period:.3g} mm"
    says = (
        f"{words}{told} ({100.0 * found.share:.0f} % of what is left, {_chance(found.p)}), and "
        f"positions are off by more than their σ: {remedy}"
    )
    return _unless_limits_are_met(LACK, says, values, met=limits_met)


def _size_text(size: float, unit: str, *, signed: bool) -> str:
    """`, +0.3 mm`; small angles in minutes, as gears are said: `, 0.17′`."""
    if unit == "°" and abs(size) < SMALL_DEG:
        size, unit = 60.0 * size, "′"
    return f", {size:+.3g}{unit}" if signed else f", {abs(size):.2g}{unit}"


def _largest(found: LackOfFit, space: ParameterSpace, unit: str) -> tuple[float, str, int | None]:
    """Largest effect in a unit for people (that of its parameter where none is given), its arm."""
    size, arms, names = found.size, found.arms, found.group.parameters
    if found.name in HARMONIC:
        size, arms = np.hypot(size[::2], size[1::2]), arms[::2]
    if found.name == "sag":
        size = size[2:3]
    weight = np.maximum(found.std, TINY) if names else 1.0
    most = int(np.argmax(np.abs(size / weight)))
    if not unit:
        offset = space.offsets[arms[most]]
        own = space.places((names[found.part[most]],))[0] if names else offset
        unit = space.every[own].sign
    return float(size[most]) * PER_UNIT[unit], unit, arms[most] if arms else None


def _alone(before: int, after: int) -> str:
    return f"identify from the shots before or after alone, --shots -{before} or --shots {after}-"


def _chance(p: float) -> str:
    return f"p = {p:.1g}" if p > 0.0 else "p < 1e-300"


def region_doubts(region: Region | None) -> Iterator[Doubt]:
    """Doubt of a result that is valid for a part of the workspace alone."""
    if region is not None and region.beyond > MOST_BEYOND:
        yield Doubt(
            EXTRAPOLATION,
            f"{100.0 * region.beyond:.0f} % of the workspace (limit {100.0 * MOST_BEYOND:.0f} %) "
            f"is too far from all shots: σ of positions there is more than {FARTHER_OFF:g} times "
            "its largest at the shots; measure there too, or leave it out under `space` in "
            "campaign.yaml",
            "not decided",
            {"beyond": region.beyond},
        )


def unknown_positions_doubt() -> Doubt:
    """Return the doubt of a robot that can hardly be assembled in its own workspace."""
    return Doubt(
        UNKNOWN_POSITIONS,
        "the uncertainty of positions is unknown: the identified robot can be assembled at less "
        f"than {100.0 * LEAST_SHARE:g} % of the poses of its workspace; look at limits and space, "
        "and for wrong points, and measure again",
        "not decided",
    )


def scale_doubt(scale: TrackerScale, worst: str) -> Doubt:
    """Doubt of a tracker that known lengths contradict; `worst` names the worst of them."""
    ppm, std_ppm = PPM * scale.share, PPM * scale.std
    what = f"the tracker's scale is off by {ppm:+.0f} ppm ± {std_ppm:.0f} (p = {scale.p:.1g})"
    remedy = "look at its weather station and at the air, and measure again"
    if scale.scatter_p < SIGNIFICANCE:
        what = f"the known lengths contradict each other (p = {scale.scatter_p:.1g}): {worst}"
        remedy = "measure them again, or correct known_lengths in campaign.yaml"
    numbers = {"ppm": ppm, "std_ppm": std_ppm, "p": scale.p, "scatter_p": scale.scatter_p}
    return Doubt(KNOWN_LENGTH, f"{what}: {remedy}", "fail", dict(numbers))


def unmeasured_told(names: Iterable[str]) -> Doubt:
    """Known lengths that no pair measured, which is only told."""
    which = ", ".join(names)
    says = f"of known_lengths {which} was not measured: it tells nothing of the tracker's scale"
    return Doubt(UNMEASURED, says)


def hold_out_doubt(ratio: float, p: float, pairs: int, *, limits_met: bool) -> Doubt:
    """Doubt of hold-out pairs that are farther off than their σ say."""
    says = (
        f"{pairs} hold-out pairs are {ratio:.2g} times as far off as their σ say (p = {p:.1g}): "
        "the model lacks something; σ of positions are multiplied by it"
    )
    numbers: dict[str, float | str] = {"ratio": ratio, "p": p, "pairs": float(pairs)}
    return _unless_limits_are_met(HOLD_OUT, says, numbers, met=limits_met)


def yielding_doubt(*, limits_met: bool) -> Doubt:
    """Doubt of dimensions, which took up with eccentricity's terms what yielding gears do."""
    says = (
        "gears yield under the plate's weight: terms of eccentric encoders and the geometry took "
        "it up together, so that positions are right and parameters may be no dimensions: stiffen "
        "the gears, or pass by acceptance limits that are met"
    )
    return _unless_limits_are_met(YIELDING, says, {}, met=limits_met)


def limits_met(after: Spread, limits_mm: Mapping[str, float]) -> bool:
    """State in which acceptance limits of distances are asked for and all of them kept."""
    reached = {"mean": after.mean_abs, "max": after.max_abs}
    return bool(limits_mm) and all(reached[name] <= limit for name, limit in limits_mm.items())


def _unless_limits_are_met(
    name: str, says: str, numbers: Mapping[str, float | str], *, met: bool
) -> Doubt:
    more = "; acceptance limits are met all the same" if met else ""
    return Doubt(name, f"{says}{more}", None if met else "not decided", dict(numbers))
