"""Whether every σ is true and nothing wrong passes, by simulated campaigns, and the limits of it.

python -m benchmarks.doubt [--campaigns N] [--workers N] [--json]

The campaigns are those of `pkmcal study --effects`, N of each kind (three times as many where a
false alarm in a hundred is asked about), each of a robot drawn anew: par4-prototype, 60 + 20 pairs,
a tracker better along its beam than across it. The first table says how often "pass" is wrong. Exit
code 1 when a figure misses its limit; with few campaigns one miss of a rare kind is enough.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache, partial
from multiprocessing import get_context
from statistics import median
from typing import Protocol, TypeVar
from zlib import crc32

import numpy as np

from app.papers.corbel2006.printed import TABLE_II
from app.study.rods import RodRobots
from app.study.setup import Method
from benchmarks.shared.prototype import FREE, FREE_ANGLES, FREE_PLACES, NOMINAL, ROBOT, SPACE
from benchmarks.shared.yardstick import Cell, Figure, Report, Table, main
from campaigns.api import plan
from campaigns.arrays import Array
from campaigns.design.pose_sampling import workspace_poses
from campaigns.errors import ShotsInvalid
from campaigns.estimation.estimators import Estimator, Weights
from campaigns.estimation.rigid_transforms import Transform
from campaigns.evaluation.doubts import CHANGE, COMMON_SCALE
from campaigns.evaluation.plausibility import check_shots
from campaigns.identification.options import IdentificationOptions
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.studies.affected import affected_campaign
from campaigns.studies.effects import BACKLASH_DEG, EFFECTS, REPEATABILITY_MM, Effect
from campaigns.studies.judged import (
    EffectOutcome,
    EffectSetup,
    EffectTask,
    JudgedCampaign,
    judge,
    run_effects,
)
from campaigns.studies.study import StudySetup, planned_shots
from campaigns.studies.wrong_passes import covered, errors_over_sigma, wrong_passes
from sim.scenarios.scenario import load_scenario

TRACKER_MM = (2400.0, -300.0, -450.0)
PAIRS, PLAN_SEED, SEED = 60, 3, 1
WORKSPACE_POSES, WORKSPACE_SEED = 300, 1
ERROR_STD = np.where(FREE_ANGLES, np.radians(0.1), 1.0)
"""Of the true robots' parameters about the nominal ones, rad and mm."""
METHODS = {
    str(method): method
    for method in (
        Method(Estimator.POINTS),
        Method(Estimator.DISTANCES),
        Method(Estimator.DISTANCES, Weights.EQUAL),
    )
}
POINTS, DISTANCES, EQUAL = METHODS
"""The third is the paper's: distances alone, no coordinates beside them."""
JUDGED = (POINTS, DISTANCES)
FEW_WRONG_SIGMAS = 5.0
TELLABLE = 7.0
"""σ of a step that is found in 98 of 100: 5 so that chance makes none in any of a thousand tests,
and 2 more."""
STEPS = ("encoder-step", "bumped-stand", "grown-arm")
CHANGES = ("right", "place", "cause", "")
OWN = Effect(scatter_mm=REPEATABILITY_MM)
PLAY = Effect(backlash_deg=BACKLASH_DEG)
SCATTERS = {
    "clean": Effect(),
    "repeatability": OWN,
    "backlash": PLAY,
    "both": replace(OWN, backlash_deg=BACKLASH_DEG),
}
MISREAD: Mapping[str, tuple[Callable[[Shots], Shots], tuple[str, ...]]] = {
    "metres": (lambda shots: _scaled(shots, 1e-3), ("look like metres",)),
    "inches": (lambda shots: _scaled(shots, 1.0 / 25.4), ("look like inches",)),
    "feet": (lambda shots: _scaled(shots, 1.0 / 304.8), ("look like feet",)),
    "micrometres": (lambda shots: _scaled(shots, 1e3), ("look like micrometres",)),
    "× 2": (lambda shots: _scaled(shots, 2.0), ("2 times those",)),
    "radians": (lambda shots: replace(shots, joints=np.radians(shots.joints)), ("radians",)),
    "q0 and q1 swapped": (
        lambda shots: replace(shots, joints=shots.joints[:, [1, 0, 2, 3]]),
        ("order q1, q0, q2, q3",),
    ),
    "q0 and q2 swapped": (
        lambda shots: replace(shots, joints=shots.joints[:, [2, 1, 0, 3]]),
        ("order q2, q1, q0, q3",),
    ),
    "signs turned": (
        lambda shots: replace(shots, joints=-shots.joints),
        ("all joints seem to have the other sign",),
    ),
    "mirrored": (lambda shots: _scaled(shots, np.array([1.0, 1.0, -1.0])), ("mirrored",)),
}
"""How shots were misread, and words that the refusal must have."""
WRONG_PASSES = 0.01
PAPER = {"Table I": load_scenario("paper-simulation").robot.errors, "Table II": TABLE_II}
FEWEST_PAIRS, MORE_PAIRS = 22, 9
OUTLIER_PAIRS = 30

Work = TypeVar("Work")


class Each(Protocol):
    """Does work for each number below a count, by one process or several."""

    def __call__(self, work: Callable[[int], Work], count: int) -> list[Work]: ...


def measure(campaigns: int, workers: int) -> Report:
    context = get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:

        def each(work: Callable[[int], Work], count: int) -> list[Work]:
            if workers == 1:
                return [work(number) for number in range(count)]
            return list(pool.map(work, range(count), chunksize=max(1, count // (4 * workers))))

        parts = [
            passes(each, campaigns),
            scatter(each, 3 * campaigns),
            few_distances(each, 2 * campaigns),
            gross_errors(each, campaigns),
            bare_distances(each, campaigns),
            steps(each, campaigns),
            eight_rods(each, campaigns),
            misread(each, max(2, campaigns // 10)),
            scales(each, campaigns),
        ]
    figures = [figure for part in parts for figure in part.figures]
    return Report(figures, [table for part in parts for table in part.tables])


@cache
def setup_of(method: str, pairs: int = PAIRS) -> EffectSetup:
    """Setup with so many pairs for the fit, and 20 that it never sees."""
    made = plan(ROBOT, TRACKER_MM, shots=2 * PAIRS, seed=PLAN_SEED)
    shots = [shot for shot in made.shots if shot.purpose is not ShotSet.DRIFT]
    fitted = [shot for shot in shots if shot.purpose is ShotSet.IDENTIFICATION][: 2 * pairs]
    unseen = [shot for shot in shots if shot.purpose is ShotSet.VALIDATION]
    chosen = METHODS[method]
    rng = np.random.default_rng(WORKSPACE_SEED)
    centre = ROBOT.workspace_centre
    return EffectSetup(
        StudySetup(
            nominal=NOMINAL,
            shots=planned_shots([*fitted, *unseen]),
            free=FREE,
            options=IdentificationOptions(estimator=chosen.estimator, weights=chosen.weights),
            tracker_from_base=Transform(np.eye(3), -np.array(TRACKER_MM)),
            seed=SEED,
        ),
        workspace_poses(NOMINAL, ROBOT.limits, centre, WORKSPACE_POSES, rng),
        RodRobots(load_scenario("realistic").robot),
    )


def truth_of(number: int, errors: Array | None = None) -> Array:
    """Parameters (G,) of a campaign's robot: `errors` (F,) instead of drawn ones."""
    drawn = ERROR_STD * np.random.default_rng([SEED, number]).standard_normal(len(FREE_PLACES))
    p = NOMINAL.p.copy()
    p[FREE_PLACES] += drawn if errors is None else errors
    return p


def judged(
    effect: Effect, method: str, number: int, pairs: int = PAIRS, errors: Array | None = None
) -> JudgedCampaign:
    """One campaign, identified and compared with what is true of it."""
    setup = setup_of(method, pairs)
    rng = np.random.default_rng([SEED, number, crc32(repr(effect).encode())])
    truth = truth_of(number, errors)
    made = affected_campaign(setup.study, effect, truth, rng, setup.beyond_model)
    return judge(setup, made)


def of_effect(effect: Effect, method: str, pairs: int, number: int) -> JudgedCampaign:
    """The same, its number last."""
    return judged(effect, method, number, pairs)


def passes(each: Each, campaigns: int) -> Report:
    """How often "pass" is wrong, by effect and estimator."""
    rows: list[list[Cell]] = []
    wrong_of = dict.fromkeys(METHODS, 0)
    for effect in EFFECTS:
        for method in METHODS:
            taken = each(partial(_outcome, effect, method), campaigns)
            found = wrong_passes([one for some in taken for one in some])
            wrong_of[method] += found.wrong
            honest: list[Cell] = [
                np.nan if value is None else value
                for value in (found.errors_over_sigma, found.covered)
            ]
            counts = (found.campaigns, found.passed, found.off, found.worse, found.wrong)
            rows.append([effect, method, *counts, found.named, found.false_alarms, *honest])
    columns = (
        *("effect", "estimator", "campaigns", "pass", "> 4 σ", "> 2 × position", "wrong"),
        *("named", "alarms", "errors/σ", "95 %"),
    )
    total = campaigns * len(EFFECTS)
    return Report(
        [
            Figure(
                f'wrong "pass" by {method}',
                wrong / total,
                f"of {total}",
                highest=WRONG_PASSES if method in JUDGED else np.inf,
            )
            for method, wrong in wrong_of.items()
        ],
        [Table('how often "pass" is wrong', columns, rows)],
    )


def _outcome(effect: str, method: str, number: int) -> tuple[EffectOutcome, ...]:
    truths = truth_of(number)[None]
    return run_effects(EffectTask(setup_of(method), effect, (number,), truths))


def scatter(each: Each, campaigns: int) -> Report:
    """The robot's own scatter: are σ true, and is nothing given away? And false alarms."""
    rows: list[list[Cell]] = []
    figures: list[Figure] = []
    clean: list[JudgedCampaign] = []
    for name, effect in SCATTERS.items():
        for method in JUDGED:
            count = campaigns if method == POINTS else campaigns // 3 + 1
            taken = each(partial(of_effect, effect, method, PAIRS), count)
            size, held = errors_over_sigma(taken) or np.nan, covered(taken) or np.nan
            by_points = method == POINTS
            least = float(np.mean([one.square_over_least for one in taken]))
            least = least if by_points else np.nan
            passed = sum(one.passed for one in taken) / count
            rows.append([name, method, count, size, held, least, passed])
            if by_points:
                clean += taken
                figures += [
                    Figure(f"{name}: errors over σ", size, highest=1.08),
                    Figure(f"{name}: 95 % intervals hold", held, "", 0.93, 0.97),
                    Figure(f"{name}: variance over the least possible", least, highest=1.12),
                ]
    alarms = {
        "change": sum(CHANGE in one.doubts for one in clean),
        "outlier": sum(one.too_many > 0 for one in clean),
        "common scale": sum(COMMON_SCALE in one.doubts for one in clean),
    }
    limits = {"change": 0.005, "outlier": 0.01, "common scale": 0.01}
    total = len(clean)
    figures += [
        Figure(f"false alarms: {name}", count / total, f"of {total}", highest=limits[name])
        for name, count in alarms.items()
    ]
    columns = ("scatter", "estimator", "campaigns", "errors/σ", "95 %", "variance/least", "pass")
    return Report(figures, [Table("the robot's own scatter", columns, rows)])


def few_distances(each: Each, campaigns: int) -> Report:
    """From 22 to 30 pairs for 22 parameters, coordinates beside them or not."""
    figures: list[Figure] = []
    rows: list[list[Cell]] = []
    for method in (DISTANCES, EQUAL):
        taken = each(partial(_of_few, method), campaigns)
        held = covered(taken) or np.nan
        wrong = sum(one.passed and one.off(FEW_WRONG_SIGMAS) for one in taken)
        passed = sum(one.passed for one in taken)
        known = sum(one.known == len(FREE) for one in taken)
        rows.append([method, campaigns, known, passed, held, wrong])
        figures += [
            Figure(f"22 to 30 {method}: 95 % intervals hold", held, "", 0.93, 0.97),
            Figure(
                f"22 to 30 {method}: wrong passes",
                wrong / campaigns,
                f"of {campaigns}",
                0,
                0.005,
            ),
        ]
    columns = ("estimator", "campaigns", "all σ known", "pass", "95 %", "pass, > 5 σ")
    return Report(figures, [Table("22 to 30 distances", columns, rows)])


def _of_few(method: str, number: int) -> JudgedCampaign:
    return judged(Effect(), method, number, FEWEST_PAIRS + number % MORE_PAIRS)


def gross_errors(each: Each, campaigns: int) -> Report:
    """Shots of 60 that are off, by either estimator."""
    rows: list[list[Cell]] = []
    named, too_many = [], []
    for method in JUDGED:
        for count in (0, 1, 3, 6):
            for size in (0.5, 2.0, 20.0) if count else (0.0,):
                effect = Effect(gross=count, size=size)
                taken = each(partial(of_effect, effect, method, OUTLIER_PAIRS), campaigns)
                all_named = sum(one.missing == 0 for one in taken) / campaigns
                more = sum(one.too_many > 0 for one in taken) / campaigns
                rows.append([method, count, size, all_named, more])
                if count:
                    named.append(all_named)
                too_many.append(more)
    figures = [
        Figure("gross errors all named, worst kind", min(named), "", lowest=0.98),
        Figure("good shots named too, all kinds", float(np.mean(too_many)), "", highest=0.01),
    ]
    columns = ("estimator", "of 60", "mm", "all named", "good ones too")
    return Report(figures, [Table("gross errors of shots", columns, rows)])


def bare_distances(each: Each, campaigns: int) -> Report:
    """Pairs of 30 that are off by 2 mm, with nothing but distances."""
    limits = {0: 0.0, 1: 0.95, 2: 0.80, 3: 0.0}
    rows: list[list[Cell]] = []
    figures: list[Figure] = []
    for count, least in limits.items():
        effect = Effect(gross=count, size=2.0, along_pairs=True)
        taken = each(partial(of_effect, effect, EQUAL, OUTLIER_PAIRS), campaigns)
        all_named = sum(one.missing == 0 for one in taken) / campaigns
        more = sum(one.too_many > 0 for one in taken) / campaigns
        passed = sum(one.passed for one in taken)
        rows.append([count, all_named, more, passed])
        if least:
            figures.append(
                Figure(f"bare distances: {count} of 30 named", all_named, "", lowest=least)
            )
        elif not count:
            figures.append(Figure("bare distances: false alarms", more, "", highest=0.01))
    columns = ("of 30", "all named", "good ones too", "pass")
    return Report(figures, [Table("gross errors, bare distances, 2 mm", columns, rows)])


def steps(each: Each, campaigns: int) -> Report:
    """Steps at any shot, or between two sessions of equal length.

    Limits are for those that the shots can tell of at all.
    """
    rows: list[list[Cell]] = []
    figures: list[Figure] = []
    for scattering in ("", "repeatability"):
        for kind in STEPS:
            for effect in EFFECTS[kind]:
                own = replace(effect, scatter_mm=REPEATABILITY_MM if scattering else 0.0)
                taken = each(partial(of_effect, own, POINTS, PAIRS), campaigns)
                told = [one for one in taken if one.signal >= TELLABLE]
                said = [sum(one.change == word for one in taken) for word in CHANGES]
                passed = sum(one.passed for one in taken)
                wrong = sum(one.passed for one in told)
                rows.append([str(effect), scattering or "tracker", *said, passed, len(told), wrong])
                if told and not scattering:
                    right = sum(one.change == "right" for one in told) / len(told)
                    of = f"of {len(told)}"
                    figures += [
                        Figure(f"{effect}: cause, arm and place named", right, of, lowest=0.97),
                        Figure(f"{effect}: passed", wrong, of, highest=0),
                    ]
    columns = (
        *("step", "scatter", "right", "place wrong", "cause wrong", "silent", "pass"),
        *("can be told", "of these pass"),
    )
    return Report(figures, [Table("steps", columns, rows)])


def eight_rods(each: Each, campaigns: int) -> Report:
    """Robots that the 22 parameters cannot describe: real position error over the stated one.

    "Honest" is the share that does not pass or has a ratio of 0.7 to 1.4 of its own; chance alone
    leaves the share of the perfect robots.
    """
    rows: list[list[Cell]] = []
    figures: list[Figure] = []
    for effect in (Effect(), *EFFECTS["unequal-rods"], *EFFECTS["tilted-axes"]):
        name = str(effect) if effect.beyond_the_model else "perfect parts"
        for method in JUDGED:
            taken = each(partial(of_effect, effect, method, PAIRS), campaigns)
            passed = [one for one in taken if one.passed]
            ratios = [_ratio(one) for one in taken]
            honest = sum(not one.passed or 0.7 <= _ratio(one) <= 1.4 for one in taken) / campaigns
            low, high = (float(each_) for each_ in np.quantile(ratios, (0.05, 0.95)))
            over = [_ratio(one) for one in passed]
            real_um = 1e3 * median(one.position_mm for one in taken)
            rms = float(np.sqrt(np.mean(np.square(over)))) if over else np.nan
            rows.append(
                [name, method, len(passed), real_um, low, median(ratios), high, rms, honest]
            )
            if over:
                what = f'{name}, {method}: real over stated where "pass"'
                figures.append(Figure(what, rms, f"of {len(over)}", 0.7, 1.4))
    columns = (
        *("robot", "estimator", "pass", "real, µm", "5 %", "median", "95 %"),
        *("rms of passes", "honest"),
    )
    return Report(
        figures, [Table("eight-rod robots: real over stated position error", columns, rows)]
    )


def _ratio(one: JudgedCampaign) -> float:
    return one.position_mm / one.stated_mm


def misread(each: Each, campaigns: int) -> Report:
    """Shots in other units, orders and signs: is the cause named?"""
    rows: list[list[Cell]] = []
    for name in ("as they are", *MISREAD):
        named = sum(each(partial(_cause_named, name), campaigns))
        rows.append([name, named, campaigns])
    share = sum(int(row[1]) for row in rows) / (campaigns * len(rows))
    title = "misread shots: refused with the right cause (the first: not refused)"
    return Report(
        [Figure("misread shots: right cause", share, f"of {len(rows) * campaigns}", lowest=1.0)],
        [Table(title, ("misread", "right", "of"), rows)],
    )


def _cause_named(name: str, number: int) -> bool:
    rng = np.random.default_rng([SEED, number, crc32(b"misread")])
    shots = affected_campaign(setup_of(POINTS).study, Effect(), truth_of(number), rng).shots
    change, words = MISREAD.get(name, (_unchanged, ()))
    try:
        check_shots(NOMINAL, change(shots), "shots.csv")
    except ShotsInvalid as refused:
        return bool(words) and all(word in str(refused) for word in words)
    return not words


def _unchanged(shots: Shots) -> Shots:
    return shots


def _scaled(shots: Shots, factor: float | Array) -> Shots:
    """Shots whose points, and what is stated of them, are in another unit."""
    size = np.broadcast_to(factor, 3)
    return replace(
        shots,
        points_in_tracker_mm=shots.points_in_tracker_mm * size,
        stated_covariance_mm2=shots.stated_covariance_mm2 * np.outer(size, size),
    )


def scales(each: Each, campaigns: int) -> Report:
    """Small common factors, which only the result tells: robots drawn, and those of the paper."""
    rows: list[list[Cell]] = []
    for effect in EFFECTS["scale"]:
        for robot, count in (("drawn", campaigns), *((table, 3) for table in PAPER)):
            taken = each(partial(_scaled_campaign, robot, effect), count)
            named = sum(COMMON_SCALE in one.doubts for one in taken)
            passed = sum(one.passed for one in taken)
            rows.append([str(effect), robot, count, named, passed])
    figures = [
        Figure(
            "common scale: not named",
            sum(int(row[2]) - int(row[3]) for row in rows),
            f"of {sum(int(row[2]) for row in rows)}",
            highest=0,
        ),
        Figure("common scale: passed", sum(int(row[4]) for row in rows), "", highest=0),
    ]
    columns = ("scale", "robot", "campaigns", "named", "pass")
    return Report(figures, [Table("all points longer by the same share", columns, rows)])


def _scaled_campaign(robot: str, effect: Effect, number: int) -> JudgedCampaign:
    errors = None
    if robot in PAPER:
        errors = np.array([PAPER[robot].get(name, 0.0) for name in FREE]) * SPACE.units(FREE)
    return judged(effect, POINTS, number, errors=errors)


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, campaigns=10, workers=1))
