"""Calibrate real Delta printers from what their users measured: touches of the bed, callipers.

Heights: what was fitted, and how far others are off that were not. Callipers: what became of rods
and plastic, where only distances on a part are known. Data: data/printers.md.
"""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.fit.error_model import Observations
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.fit import fit_model
from campaigns.identification.findings import UNSEEN_ROWS
from campaigns.identification.objects import Object
from campaigns.identification.observations import error_model
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.other_kinds import Measured, other_kinds
from campaigns.identification.result import IdentificationResult
from campaigns.identification.without_points import identify_without_points
from campaigns.robots.printer_config import PrinterConfig, Tower
from campaigns.robots.robot import RobotFile, parse_robot
from pkmcal import sample_workspace

FOLDER = Path(__file__).parent / "data"
HEIGHTS, CALLIPERS = FOLDER / "printer-41-heights.csv", FOLDER / "printer-callipers.csv"
MM_PER_STEP = 60.0 / (200.0 * 32.0)
FITTED, SPLITS = (21, 25, 30), 12
HEIGHT_STD_MM, CALLIPER_STD_MM = 0.02, 0.05
NOMINAL_MM = 65.0
DIRECTIONS = np.radians([210.0, 270.0, 330.0, 30.0, 90.0, 150.0])
RIDGE_MM = 4.5
"""Distance of a ridge's middle from the end of the line that was drawn."""
GOOD = 0.5
"""Probability of being right below which a distance is named."""
CENTRE_WIDTHS = (0, 2, 1, 0, 2, 1)
"""Number of the ridge in the middle by which each distance from there is too long."""


@dataclass(frozen=True, slots=True)
class SplitFigures:
    """Draws of as many heights, the others kept unseen; mm."""

    fitted: int
    before_mm: float
    """Unseen heights off the plane of the fitted ones by the nominal robot, rms, median."""
    after_mm: float
    """The same by the identified robot."""
    worst_mm: float
    """Largest of all draws."""
    stated_mm: float
    """Stated of them, rms, median."""
    verdicts: Mapping[str, int]
    """Number of draws by verdict on flat."""
    smallest_p: float
    xy_mm: float
    """Stated 1 σ in the bed's plane, median."""
    xy_tested: int
    """Number of draws in which anything checks that: heights do not."""


@dataclass(frozen=True, slots=True)
class ListFigures:
    """What became of a list of calliper readings."""

    name: str
    rods_mm: tuple[tuple[float, float], ...]
    """Each rod with 1 σ."""
    shrinkage_percent: tuple[float, float]
    """Shrinkage of the plastic with 1 σ; 0.3 % is what was known."""
    named: tuple[int, ...]
    """Distances that are named as wrong: 0 to 5 from the middle, 6 to 11 outside."""
    verdict: str


def printer(name: str, sizes_mm: tuple[float, float, float, float], tolerances: str) -> RobotFile:
    """Return a nominal printer by radius, rod, end stop and bed, with tolerances of its file."""
    radius, rod, endstop, bed = sizes_mm
    towers = tuple(Tower(angle, rod, endstop, MM_PER_STEP) for angle in (90.0, 210.0, 330.0))
    text = PrinterConfig(name, radius, bed, towers, ()).robot_text
    usual = "places_mm: 1.0, lengths_mm: 0.2, offsets_mm: 1.0"
    assert usual in text
    return parse_robot(text.replace(usual, tolerances or usual), f"{name}.yaml").robot


def calibrate_heights(splits: int = SPLITS, fitted: Sequence[int] = FITTED) -> list[SplitFigures]:
    """Fit draws of the 41 heights, and test the others."""
    with HEIGHTS.open(encoding="utf-8") as text:
        rows = list(csv.DictReader(text))
    joints = -MM_PER_STEP * np.array([[float(row[f"steps_{a}"]) for a in "abc"] for row in rows])
    values = np.array([float(row["height_mm"]) for row in rows])
    robot = printer("public", (172.0, 340.0, 333.0, 120.0), "")
    at_nominal = robot.kinematics.forward(joints).values_or_raise()
    figures = []
    for count in fitted:
        drawn = []
        for seed in range(splits):
            order = np.random.default_rng(seed).permutation(len(rows))
            seen, unseen = np.sort(order[:count]), np.sort(order[count:])
            result = _identify(robot, [*_touches(joints, values, seen, unseen)], "flat")
            drawn.append((_off_plane(at_nominal, values, seen, unseen), result))
        figures.append(_of_draws(count, drawn))
    return figures


def _touches(joints: Array, values: Array, seen: Index, unseen: Index) -> Iterator[Measured]:
    for rows, held_out in ((seen, False), (unseen, True)):
        yield Measured(
            kind="height", object=Object("bed"), joints=joints[rows], values=values[rows],
            std_mm=HEIGHT_STD_MM, held_out=held_out,
        )  # fmt: skip


def _identify(
    robot: RobotFile, measured: Sequence[Measured], quantities: str
) -> IdentificationResult:
    options = IdentificationOptions(
        tolerances=robot.tolerances, workspace=sample_workspace(robot), quantities=(quantities,)
    )
    return identify_without_points(robot.kinematics, measured, options)


def _off_plane(points: Array, values: Array, seen: Index, unseen: Index) -> float:
    """Return how far unseen points are off the plane of the others, rms, mm."""
    columns = np.column_stack([points[:, :2], np.ones(len(points))])
    heights = points[:, 2] - values
    plane = np.linalg.lstsq(columns[seen], heights[seen], rcond=None)[0]
    return float(np.sqrt(((heights - columns @ plane)[unseen] ** 2).mean()))


def _of_draws(count: int, drawn: Sequence[tuple[float, IdentificationResult]]) -> SplitFigures:
    """Return the figures of draws: the nominal robot's error and the result of each."""
    results = [result for _, result in drawn]
    tests = [
        {key: float(number) for key, number in finding.numbers.items()}
        for result in results
        for finding in result.judgement.findings
        if finding.name == UNSEEN_ROWS
    ]
    verdicts = [result.judgement.verdict for result in results]
    in_plane = [
        quantity
        for result in results
        for quantity in result.uncertainty.determined
        if quantity.name == "xy"
    ]
    after = [test["rms_mm"] for test in tests]
    return SplitFigures(
        fitted=count,
        before_mm=float(np.median([before for before, _ in drawn])),
        after_mm=float(np.median(after)),
        worst_mm=max(after),
        stated_mm=float(np.median([test["stated_mm"] for test in tests])),
        verdicts={word: verdicts.count(word) for word in dict.fromkeys(verdicts)},
        smallest_p=min(test["p"] for test in tests),
        xy_mm=float(np.median([quantity.rms for quantity in in_plane])),
        xy_tested=sum(quantity.is_tested for quantity in in_plane),
    )


def calibrate_lists() -> list[ListFigures]:
    """Fit the distances of each list alone, on a printer of a usual size."""
    with CALLIPERS.open(encoding="utf-8") as text:
        rows = list(csv.DictReader(text))
    robot = printer("usual", (130.0, 290.0, 300.0, 90.0),
                    "places_mm: 5.0, lengths_mm: 1.0, offsets_mm: 5.0")  # fmt: skip
    part = Object("part", shrinkage_std_percent=0.3)
    poses = np.concatenate([_ends(), np.zeros((12, 2, 1))], axis=2)
    joints = robot.kinematics.inverse(poses.reshape(-1, 3)).values_or_raise().reshape(12, 2, 3)
    figures = []
    for name in dict.fromkeys(row["list"] for row in rows):
        readings = {
            (row["kind"], int(row["number"])): float(row["value_mm"])
            for row in rows
            if row["list"] == name
        }
        apart = [
            readings["center_distance", k] - readings["center_width", CENTRE_WIDTHS[k]]
            for k in range(6)
        ] + [readings["outer_distance", k] - readings["outer_width", k] for k in range(6)]
        measured = Measured(
            kind="distance", object=part, joints=joints, values=np.array(apart),
            std_mm=CALLIPER_STD_MM,
        )  # fmt: skip
        figures.append(_of_list(name, robot, measured))
    return figures


def _ends() -> Array:
    """Return the places of both ridges of each distance on the bed, (12, 2, 2), mm."""
    out = np.column_stack([np.cos(DIRECTIONS), np.sin(DIRECTIONS)])
    along = np.roll(out, -2, axis=0)
    far = NOMINAL_MM + RIDGE_MM
    centre = np.stack([RIDGE_MM * out, far * out], axis=1)
    outer = NOMINAL_MM * out[:, None] + np.stack([RIDGE_MM * along, far * along], axis=1)
    return np.concatenate([centre, outer])


def _of_list(name: str, robot: RobotFile, measured: Measured) -> ListFigures:
    """Return the figures of a list; the fit itself states the plastic, the result does not."""
    result = _identify(robot, [measured], "position")
    rods = [result.value.parameters[f"arm{arm}.forearm_mm"] for arm in range(3)]
    kinds = other_kinds([measured], robot.kinematics)
    options = IdentificationOptions(tolerances=robot.tolerances)
    model = error_model(robot.kinematics, None, options).with_effects(kinds.slots)
    model = replace(model, held=frozenset({*model.held, *TRACKER_SOURCES}))
    nothing = Observations.unmeasured(np.zeros((0, 3)), np.zeros((0, 3)))
    fit = fit_model(model, replace(nothing, blocks=kinds.fitted))
    (slot,), place = kinds.slots, fit.model.effect_places[-1]
    shrinkage, std = slot.values(fit.at.x[place]), np.sqrt(fit.covariance[place, place].diagonal())
    return ListFigures(
        name,
        tuple((rod.value, rod.std or 0.0) for rod in rods),
        (100.0 * float(shrinkage[0]), 100.0 * float(slot.std[0] * std[0])),
        tuple(np.flatnonzero(fit.good_of_others[0] < GOOD).tolist()),
        result.judgement.verdict,
    )


def text_of_heights(figures: Sequence[SplitFigures]) -> str:
    """Say them in lines."""
    lines = [
        "fitted  unseen heights, rms: before → after (worst draw), stated  smallest p  σ of xy",
        *(
            f"{f.fitted:6}  {1e3 * f.before_mm:.0f} → {1e3 * f.after_mm:.0f} "
            f"({1e3 * f.worst_mm:.0f}) µm, {1e3 * f.stated_mm:.0f} µm  {f.smallest_p:.1g}  "
            f"{f.xy_mm:.2f} mm, tested in {f.xy_tested} draws; flat: "
            + ", ".join(f"{word} {count}" for word, count in f.verdicts.items())
            for f in figures
        ),
    ]
    return "\n".join(lines)


def text_of_lists(figures: Sequence[ListFigures]) -> str:
    """Say them in lines."""
    return "\n".join(
        f"{f.name}: rods {', '.join(f'{mm:.2f} ± {std:.2f}' for mm, std in f.rods_mm)} mm; "
        f"shrinkage {f.shrinkage_percent[0]:+.2f} ± {f.shrinkage_percent[1]:.2f} %; "
        f"named as wrong: {', '.join(map(str, f.named)) or 'none'}; position: {f.verdict}"
        for f in figures
    )
