"""Whether every σ is true and nothing wrong passes: `pkmcal study --effects`, with limits.

python -m benchmarks.doubt [--campaigns N] [--workers N] [--json]

N campaigns of each effect, each of a robot drawn anew: par4-prototype, 60 + 20 pairs; then 26 pairs
for 22 parameters, and 30 pairs some of which are wrong, by bare distances. The table says how often
"pass" is wrong. Exit code 1 when a figure misses its limit; with few campaigns one miss of a rare
kind is enough.
"""

from collections.abc import Iterator, Sequence
from math import inf, nan

import numpy as np

from benchmarks.shared.studies import Studied, mean, options, studied
from benchmarks.shared.yardstick import Figure, Report, Table, main
from campaigns.evaluation.diagnostics import CHANGE, COMMON_SCALE
from campaigns.studies.perturbations import KINDS
from campaigns.studies.study import CampaignRow, CampaignVerdict
from campaigns.studies.summary import verdict_statistics

ROBOT, SCENARIO = "par4-prototype", "drawn-robots"
SHOTS, FEW_SHOTS, WRONG_SHOTS = 120, 52, 60
POINTS, DISTANCES, EQUAL = "points", "distances", "distances, equal weights"
METHODS = (*options("estimator", (POINTS, DISTANCES)), *options("weights", ("stated", "equal")))
HONEST = ("clean", "own-scatter", "backlash")
STEPS = ("encoder-step", "bumped-stand", "grown-arm")
BEYOND = ("clean", "unequal-rods", "tilted-axes")
TELLABLE = 7.0
"""σ of a step that is found in 98 of 100: 5 so that chance makes none in any of a thousand tests,
and 2 more."""
FEW_WRONG_SIGMAS = 5.0
FALSE_ACCEPTANCE = {POINTS: 0.01, DISTANCES: 0.01, EQUAL: inf}
FALSE_ALARMS = {"change": 0.005, "outlier": 0.01, "common scale": 0.01}
WRONG_PAIRS_NAMED = {1: 0.95, 2: 0.80}
COLUMNS = ("effect", "estimator", "campaigns", "passed", "off", "worse", "wrong", "named")


def measure(campaigns: int, workers: int) -> Report:
    def run(shots: int, *asked: str) -> list[Studied]:
        return studied(ROBOT, SCENARIO, shots, asked, campaigns, workers)

    usual = run(SHOTS, "--effects", "all", *METHODS)
    few = run(FEW_SHOTS, "--effects", "clean", *METHODS)
    pairs = run(WRONG_SHOTS, "--effects", "wrong-pairs", *METHODS)
    by = {(one.told["effect"], one.told["estimator"]): one for one in usual}
    figures = [
        *false_acceptance(usual),
        *honesty([row for name in HONEST for row in by[name, POINTS].rows]),
        *gross_errors([by["gross-errors", method] for method in (POINTS, DISTANCES)]),
        *(figure for name in STEPS for figure in steps(by[name, POINTS])),
        *(f for name in BEYOND for m in (POINTS, DISTANCES) for f in positions(by[name, m])),
        *scales(by["scale", POINTS].verdicts()),
        *(figure for one in few[1:] for figure in few_distances(one)),
        *wrong_pairs(pairs[-1]),
    ]
    rows = [[one.told[key] for key in COLUMNS] for one in usual]
    return Report(figures, [Table('how often "pass" is wrong', COLUMNS, rows)])


def false_acceptance(found: Sequence[Studied]) -> Iterator[Figure]:
    """How often "pass" is wrong by each estimator, over all effects."""
    for method, limit in FALSE_ACCEPTANCE.items():
        rows = [row for one in found if one.told["estimator"] == method for row in one.rows]
        rate = verdict_statistics(rows).false_acceptance_rate
        yield Figure(f'wrong "pass" by {method}', rate, f"of {len(rows)}", highest=limit)


def honesty(rows: Sequence[CampaignRow]) -> Iterator[Figure]:
    """Whether σ are true whatever the robot's own scatter is, nothing given away; false alarms."""
    for what in dict.fromkeys(row.what for row in rows):
        own = [row for row in rows if row.what == what]
        found = verdict_statistics(own)
        least = [row.verdict.square_over_least for row in own if row.verdict is not None]
        yield Figure(f"{what}: errors over σ", found.errors_over_sigma or nan, highest=1.08)
        yield Figure(f"{what}: 95 % intervals hold", found.covered or nan, "", 0.93, 0.97)
        yield Figure(f"{what}: variance over the least possible", mean(least), highest=1.12)
    judged = [row.verdict for row in rows if row.verdict is not None]
    alarms = {
        "change": mean(CHANGE in one.doubts for one in judged),
        "outlier": mean(one.too_many > 0 for one in judged),
        "common scale": mean(COMMON_SCALE in one.doubts for one in judged),
    }
    for name, share in alarms.items():
        limit = FALSE_ALARMS[name]
        yield Figure(f"false alarms: {name}", share, f"of {len(judged)}", highest=limit)


def gross_errors(found: Sequence[Studied]) -> Iterator[Figure]:
    """Shots that are off, by either estimator."""
    kinds = [one.verdicts(each["kind"]) for one in found for each in one.told["by_kind"]]
    named = min(mean(each.missing == 0 for each in kind) for kind in kinds)
    too_many = mean(each.too_many > 0 for kind in kinds for each in kind)
    yield Figure("gross errors all named, worst kind", named, "", lowest=0.98)
    yield Figure("good shots named too, all kinds", too_many, "", highest=0.01)


def steps(found: Studied) -> Iterator[Figure]:
    """Steps at any shot, or between two sessions; limits are for those that the shots tell of."""
    for kind in found.told["by_kind"]:
        what = kind["kind"]
        told = [each for each in found.verdicts(what) if each.signal > TELLABLE]
        if told:
            right, of = mean(each.change == "right" for each in told), f"of {len(told)}"
            yield Figure(f"{what}: cause, arm and place named", right, of, lowest=0.97)
            yield Figure(f"{what}: passed", sum(each.passed for each in told), of, highest=0)


def positions(found: Studied) -> Iterator[Figure]:
    """Real over stated error of positions where robots pass that no parameter describes."""
    for kind in found.told["by_kind"]:
        ratios = [
            each.position_mm / (each.stated_mm or nan)
            for each in found.verdicts(kind["kind"])
            if each.passed
        ]
        if ratios:
            rms = float(np.sqrt(np.mean(np.square(ratios))))
            what = f'{kind["kind"]}, {found.told["estimator"]}: real over stated where "pass"'
            yield Figure(what, rms, f"of {len(ratios)}", 0.7, 1.4)


def scales(found: Sequence[CampaignVerdict]) -> Iterator[Figure]:
    """Small common factors, which only the result tells."""
    missed = sum(COMMON_SCALE not in each.doubts for each in found)
    yield Figure("common scale: not named", missed, f"of {len(found)}", highest=0)
    yield Figure("common scale: passed", sum(each.passed for each in found), "", highest=0)


def few_distances(found: Studied) -> Iterator[Figure]:
    """Hardly more pairs than parameters, coordinates beside them or not."""
    name, verdicts = f"26 {found.told['estimator']}", found.verdicts()
    wrong = mean(each.passed and each.off(FEW_WRONG_SIGMAS) for each in verdicts)
    yield Figure(f"{name}: 95 % intervals hold", found.told["covered"] or nan, "", 0.93, 0.97)
    yield Figure(f"{name}: wrong passes", wrong, f"of {len(verdicts)}", highest=0.005)


def wrong_pairs(found: Studied) -> Iterator[Figure]:
    """Pairs of 30 that are off by 2 mm, with nothing but distances."""
    for kind in KINDS["wrong-pairs"]:
        verdicts = found.verdicts(str(kind))
        if least := WRONG_PAIRS_NAMED.get(kind.gross):
            named = mean(each.missing == 0 for each in verdicts)
            yield Figure(f"bare distances: {kind.gross} of 30 named", named, "", lowest=least)
        elif not kind.gross:
            alarms = mean(each.too_many > 0 for each in verdicts)
            yield Figure("bare distances: false alarms", alarms, "", highest=0.01)


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, campaigns=12, workers=1))
