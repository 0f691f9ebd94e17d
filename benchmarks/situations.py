"""Identify and check robots whose campaigns are more than a robot with errors of manufacture.

python -m benchmarks.situations [--cells SITUATION …] [--mechanisms NAME …] [--campaigns N] …
python -m benchmarks.situations --check

The truth is of single rods; `benchmarks.truths` explains a situation's words. One line a cell:

- real: rms error of positions in the best frame, µm, and stated: 1 σ (medians); the largest ratio
- passes, failures, "not decided"; WRONG: passes with a real error above twice the stated one
- wrong shots found of all, and good shots lost
- steps of which a finding names the part; also the first shot; also the size within U; of all
- processor time of an identification, s: median and largest
- findings by name and part, in brackets if they are only reported. `!` is the part that changed,
  `~` another one beside which it is named, `?` one that did not change
"""

import argparse
import json
import math
import re
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed

from benchmarks.true_campaigns import (
    PLANS_FOLDER,
    Measured,
    TrueStep,
    measure,
    nominal_robot,
    planned_shots,
    position_error_um,
    settled_robot,
    streams_of,
)
from benchmarks.truths import ROBOTS, PlannedShots, Situation, Streams, draw_robot
from campaigns.errors import CampaignError
from campaigns.identification.checking import check
from campaigns.identification.options import IdentificationOptions
from pkmcal import find_robot, identify
from sim.errors import AssemblyLost

KEY_CELLS = (
    *("clean", "small", "tolerances", "scatter 0.05", "ratio 1000"),
    *("rods 0.2 + reflector 50", "rods 0.2 + reflector 50 unstated", "rods 0.2 + plate 10"),
    *("wrong 6 x 0.3", "wrong 10 x 1.5", "wrong 20 x 1.5", "wrong 20 x 50", "wrong 14 x 1.5 same"),
    "unassembled 3",
    *("encoder 0.05 from 30", "encoder 0.05 last 5", "encoder 2 from 25", "forearm 0.3 from 30"),
    *("mount 0.3 from 30", "stand 0.05 from 30", "stand 0.3 from 30", "stand 5 from 30"),
    *("stand 0.3 from 20 to 27", "encoder 0.05 from 20 + forearm 0.3 from 40"),
    *("drift 0.1", "drift 0.3", "walk 0.1", "drift 0.1 + stand 0.3 from 30"),
    *("ripple", "ripple own", "ripple one", "edge 0.3", "kink 1", "sag 0.3", "bent 0.1"),
    *("theta 0.3", "dent 80", "lag 0.1", "lag 1", "ripple + drift 0.1"),
    "encoder 0.05 from 30 + wrong 10 x 1.5",
    "wrong 10 x 1.5 + rods 0.2 + reflector 50 + drift 0.1",
)  # fmt: skip
"""Situations that are measured unless others are asked for."""
MORE_CELLS = (
    *("rods 0.2", "backlash 0.3", "azimuths 0.5", "eccentricity 0.03", "yield 0.2"),
    *("reflector 50", "reflector 50 unstated", "plate 10", "rods 0.2 + reflector 50 + plate 10"),
    *(
        f"wrong {count} x {size}{how}"
        for count in (1, 3, 6, 9, 10, 14, 20)
        for size in ("0.1", "0.3", "1.5", "10", "50")
        for how in ("", " same")
    ),
    *("unseen 1 x 1.5", "unassembled 8"),
    *(f"encoder {size} from {s}" for size in ("0.02", "0.05", "0.5", "2") for s in (25, 52)),
    *(f"stand {size} from {s}" for size in ("0.1", "0.2", "1", "3", "20") for s in (30, 52)),
    *(f"stand {size} from 20 to 27" for size in ("0.1", "0.2", "3", "20")),
    *(f"{part} {mm} from 30" for part in ("forearm", "arm", "mount") for mm in ("0.2", "1", "5")),
    *(f"{step} last {k}" for step in ("encoder 0.02", "stand 0.3", "forearm 0.3") for k in (5, 10)),
    *("encoder 0.05 last 10", "encoder 0.05 from 30 + stand 0.3 from 30"),
    *("encoder 0.5 from 20 to 27", "stand 0.3 from 20 + stand 0.3 from 40"),
    *("drift 0.02", "drift 0.05", "drift 0.2", "walk 0.05", "turn 0.1", "warm-up 0.1"),
    *("drift 0.1 + encoder 0.05 from 30", "drift 0.1 + stand 0.1 from 30"),
    *("drift 0.3 + stand 0.3 from 20 to 27", "drift 0.3 + wrong 10 x 1.5"),
    *("ripple 0.33", "ripple 3", "ripple + encoder 0.05 from 30", "ripple + wrong 10 x 1.5"),
    *("edge 0.1", "edge 1", "cable 0.3", "dent 150", "edge 0.3 + wrong 6 x 1.5"),
    *("wrong 6 x 0.3 + rods 0.2 + reflector 50 + drift 0.1", "stand 0.3 from 30 + wrong 10 x 1.5"),
    "small + reflector 50 + drift 0.05",
)
"""Further situations, chosen by --cells with a pattern."""
CHECKS = (
    "clean",
    *(f"wrong 1 x {size}" for size in ("0.06", "0.1", "0.15", "0.3", "0.5", "2", "20")),
    "wrong 2 x 0.3",
    *(f"encoder {size} from 0" for size in ("0.01", "0.05", "0.5")),
    *(f"forearm {size} from 0" for size in ("0.1", "0.3")),
    *(f"arm {size} from 0" for size in ("0.1", "0.3", "2")),
)
"""What has happened to a robot, or to the shots, since it was identified."""
VERDICTS = ("pass", "fail", "not decided")
HEADING = (
    f"{'':60}    real/stated  most | p/f/nd WRONG | found/of lost | part first size/of |"
    "   s   most | findings"
)
WRONG_POSITIONS = 2.0
"""Real over stated error of positions beyond which a pass is wrong."""
CHECK_SHOTS = 8
SHOTS_BESIDE = 1
"""Identification shots by which a change may be named too early or too late."""
NAMED = re.compile(r"shots? (\d+(?:(?:, | and |–)\d+)*)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of one campaign."""

    mechanism: str
    cell: str
    shots: int
    seed: int
    verdict: str
    """Verdict, or the class of the error that refused the shots."""
    real_um: float | None = None
    stated_um: float | None = None
    wrong: int = 0
    found: int = 0
    lost: int = 0
    steps: int = 0
    parts: int = 0
    """Steps of which a finding names the part."""
    places: int = 0
    """Steps of which it also names the first shot."""
    sizes: int = 0
    """Steps of which it also has the size within U."""
    findings: tuple[str, ...] = ()
    seconds: float = 0.0
    """Processor time of the identification."""
    says: str = ""

    @property
    def ratio(self) -> float:
        """Real over stated error of positions."""
        return self.real_um / self.stated_um if self.real_um and self.stated_um else math.nan

    @property
    def is_wrong_pass(self) -> bool:
        """Whether the robot passed and is far worse than stated."""
        return self.verdict == "pass" and self.ratio > WRONG_POSITIONS


def run(mechanism: str, cell: str, shots: int, seed: int, folder: Path) -> Outcome:
    """Measure and identify one campaign, and compare the result with the truth."""
    situation, streams = Situation.parse(cell), streams_of(mechanism, seed)
    about: dict[str, Any] = {"mechanism": mechanism, "cell": cell, "shots": shots, "seed": seed}
    nominal = nominal_robot(mechanism, folder, is_reflector_stated=situation.is_reflector_stated)
    planned = planned_shots(mechanism, shots, seed, folder)
    truth = draw_robot(nominal, situation, planned, streams)
    try:
        measured = measure(nominal, truth, situation, planned, streams)
    except AssemblyLost:
        return Outcome(**about, verdict="no truth")
    about |= {"wrong": len(measured.wrong), "steps": len(measured.steps)}
    start = time.process_time()
    try:
        result: Any = identify(measured.shots, nominal)
    except Exception as error:  # noqa: BLE001 - a crash is an outcome, and the next cell is run
        seconds = time.process_time() - start
        return Outcome(**about, verdict=type(error).__name__, says=str(error), seconds=seconds)
    about["seconds"] = time.process_time() - start
    try:
        about["real_um"] = position_error_um(nominal, measured.now, result)
    except (CampaignError, AssemblyLost):
        about["real_um"] = math.inf
    return judged(measured, planned, result, about)


def judged(
    measured: Measured, planned: PlannedShots, result: Any, about: dict[str, Any]
) -> Outcome:
    """Compare what a result names with the truth."""
    judgement = result.judgement
    named = {excluded.shot for excluded in judgement.excluded if excluded.shot is not None}
    wrong_findings = [finding.says for finding in judgement.findings if "wrong" in finding.name]
    stated = result.uncertainty.position_std_mm
    rights = [named_rightly(step, judgement.findings, planned) for step in measured.steps]
    return Outcome(
        **about,
        verdict=str(judgement.verdict),
        stated_um=None if stated is None else 1e3 * stated.rms,
        found=len(measured.wrong & (named | shots_named(wrong_findings))),
        lost=len(named - measured.wrong),
        parts=sum(right.part for right in rights),
        places=sum(right.place for right in rights),
        sizes=sum(right.size for right in rights),
        findings=tuple(sorted(label(finding, measured.steps) for finding in judgement.findings)),
        says="; ".join(finding.says for finding in judgement.findings),
    )


def shots_named(texts: Iterable[str]) -> set[int]:
    """Return the numbers of the shots that sentences name, `shots 3, 7`."""
    return {
        int(number)
        for text in texts
        for match in NAMED.finditer(text)
        for number in re.findall(r"\d+", match[1])
    }


def words_of(part: str) -> str:
    """Return the words by which a finding calls a part: `arm 1's encoder`."""
    if part == "frame":
        return "the tracker's stand"
    kind, _, arm = part.partition(" ")
    return f"arm {arm}" if kind == "arm" else f"arm {arm}'s {kind}"


def names_part(finding: Any, step: TrueStep) -> bool:
    """Whether a finding of a change names a part, by itself or among those that it may be."""
    named = finding.says.partition(" changed")[0].split(" or ")
    return finding.numbers.get("part") == step.part or words_of(step.part) in " or ".join(named)


class Rightly(NamedTuple):
    """What a finding has right of a step: part, first shot, and size within U."""

    part: bool = False
    place: bool = False
    size: bool = False


def named_rightly(step: TrueStep, findings: Iterable[Any], planned: PlannedShots) -> Rightly:
    """Return what the best of the findings has right of a step."""
    fitted, best = planned.fitted, Rightly()
    for finding in findings:
        numbers = finding.numbers
        if "part" not in numbers or not names_part(finding, step):
            continue
        first, size, limit = (
            float(numbers.get(key, math.nan)) for key in ("before_shot", "size", "U")
        )
        ends = np.searchsorted(fitted, [step.first, first])
        off = abs(size - step.size)
        if step.is_of_place:
            # of a motion in space the largest share along an axis is named
            off = max(abs(size) - step.size, step.size / math.sqrt(3.0) - abs(size))
        is_size = numbers["part"] == step.part and off <= limit
        is_place = bool(abs(ends[1] - ends[0]) <= SHOTS_BESIDE)
        best = max(best, Rightly(part=True, place=is_place, size=is_size))
    return best


def label(finding: Any, steps: Sequence[TrueStep]) -> str:
    """Return a finding's name with its part: `change encoder!` if that part has changed."""
    numbers = finding.numbers
    part = str(numbers.get("part", numbers.get("parameter", "")))
    kind = part.partition(" ")[0].rpartition(".")[2]
    mark = ""
    if "part" in numbers:
        is_first = any(numbers["part"] == step.part for step in steps)
        is_among = any(names_part(finding, step) for step in steps)
        mark = "!" if is_first else "~" if is_among else "?"
    text = f"{finding.name} {kind}{mark}".strip()
    return text if finding.affects_verdict else f"({text})"


def line(outcomes: Sequence[Outcome]) -> str:
    """Return the line of a cell."""

    def total(name: str) -> int:
        """Add up a count of all campaigns."""
        return sum(getattr(outcome, name) for outcome in outcomes)

    def median(name: str) -> float:
        """Return the median of the campaigns that have a figure."""
        values = [value for o in outcomes if (value := getattr(o, name)) is not None]
        return float(np.median(values)) if values else math.nan

    cell, verdicts = outcomes[0], Counter(outcome.verdict for outcome in outcomes)
    ratio = max((o.ratio for o in outcomes if not math.isnan(o.ratio)), default=math.nan)
    shots = steps = ""
    if total("wrong") or total("lost"):
        shots = f"{total('found'):5}/{total('wrong'):<4}{total('lost'):3}"
    if total("steps"):
        named = (total(name) for name in ("parts", "places", "sizes"))
        steps = "".join(f"{count:5}" for count in named) + f"/{total('steps')}"
    others = [f"{word} {count}" for word, count in verdicts.items() if word not in VERDICTS]
    findings = Counter(text for outcome in outcomes for text in outcome.findings)
    columns = (
        f"{cell.mechanism:12} {cell.cell:43} {cell.shots:3}",
        f"{median('real_um'):7.1f}/{median('stated_um'):<6.1f}{ratio:6.2f}",
        f"{'/'.join(str(verdicts[word]) for word in VERDICTS):>7}{total('is_wrong_pass'):5}",
        f"{shots:14}",
        f"{steps:18}",
        f"{median('seconds'):5.2f}{max(outcome.seconds for outcome in outcomes):6.2f}",
        " " + ", ".join([*others, *(f"{text} {n}" for text, n in findings.most_common())]),
    )
    return " |".join(columns)


def chosen(patterns: Sequence[str]) -> Iterator[str]:
    """Yield the listed situations that match a pattern, and those in words of their own."""
    for pattern in patterns:
        listed = [c for c in dict.fromkeys((*KEY_CELLS, *MORE_CELLS)) if fnmatchcase(c, pattern)]
        yield from listed or [pattern]


def judge_checks(
    mechanism: str, shots: int, seed: int, folder: Path, cells: Sequence[str] = CHECKS
) -> dict[str, str]:
    """Identify a clean robot, and return what comes of a check by few shots in each situation.

    Empty if the identification did not pass.
    """
    nominal, streams = find_robot(ROBOTS[mechanism]), streams_of(mechanism, seed)
    planned = planned_shots(mechanism, shots, seed, folder)
    clean = Situation.parse("clean")
    robot = draw_robot(nominal, clean, planned, streams)
    result: Any = identify(measure(nominal, robot, clean, planned, streams).shots, nominal)
    if result.judgement.verdict != "pass":
        return {}
    later = Streams((*streams.key, 1))
    robot = settled_robot(robot, later)
    rows = planned.fitted[np.linspace(0, len(planned.fitted) - 1, CHECK_SHOTS).astype(int)]
    sets, pairs = ("check",) * CHECK_SHOTS, (None,) * CHECK_SHOTS
    few = PlannedShots(planned.joints[rows], planned.poses[rows], sets, pairs, CHECK_SHOTS)
    options = IdentificationOptions(tolerances=nominal.tolerances)
    came: dict[str, str] = {}
    for words in cells:
        situation = Situation.parse(words)
        if not situation.suits(mechanism):
            continue
        measured = measure(nominal, robot, situation, few, later)
        outcome = check(nominal.kinematics, measured.shots, result.uncertainty.posterior, options)
        came[words] = check_label(outcome, measured)
    return came


def check_label(outcome: Any, measured: Measured) -> str:
    """Return a check's decision, and whether it names what is wrong: `fail part!`, `pass`.

    `arm!` is another part of the arm that changed, `part?` and `shots?` are wrong ones.
    """
    text, named = str(outcome.decision), shots_named([outcome.says])
    if outcome.parts:
        changed = {step.part for step in measured.steps}
        arms, named_arms = ({p.split()[-1] for p in parts} for parts in (changed, outcome.parts))
        is_right = bool(changed & {*outcome.parts})
        text += " part!" if is_right else " arm!" if arms & named_arms else " part?"
    if named:
        text += " shots!" if named == measured.wrong else " shots?"
    return text


def print_cells(asked: argparse.Namespace, run_all: Parallel) -> Iterator[dict[str, Any]]:
    """Print a line for each cell, and yield what came of its campaigns."""
    print(HEADING, flush=True)
    cells = [Situation.parse(cell) for cell in dict.fromkeys(chosen(asked.cells or KEY_CELLS))]
    for mechanism, shots, cell in product(asked.mechanisms, asked.shots, cells):
        if cell.suits(mechanism):
            at = (mechanism, cell.name, shots)
            outcomes = run_all(delayed(run)(*at, seed, asked.plans) for seed in asked.seeds)
            print(line(outcomes), flush=True)
            yield from map(asdict, outcomes)


def print_checks(asked: argparse.Namespace, run_all: Parallel) -> Iterator[dict[str, Any]]:
    """Print a line for each situation of a check, and yield what came of each robot's checks."""
    cells = [*chosen(asked.cells or CHECKS)]
    for mechanism, shots in product(asked.mechanisms, asked.shots):
        at = (mechanism, shots)
        jobs = (delayed(judge_checks)(*at, seed, asked.plans, cells) for seed in asked.seeds)
        robots = run_all(jobs)
        passed = [came for came in robots if came]
        print(f"{mechanism} {shots}: {len(passed)} of {len(robots)} passed and were checked")
        for words in cells:
            counts = Counter(came[words] for came in passed if words in came)
            if counts:
                came = ", ".join(f"{text} {count}" for text, count in counts.most_common())
                print(f"{mechanism:12} {words:43} {came}", flush=True)
        for seed, of_robot in zip(asked.seeds, robots, strict=True):
            yield {"mechanism": mechanism, "shots": shots, "seed": seed, "checks": of_robot}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--cells", nargs="+", help="words of situations, or patterns: 'wrong *'")
    parser.add_argument("--mechanisms", nargs="+", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--shots", nargs="+", type=int, default=[60], help="30, 60, 120")
    for option, default in (("campaigns", 4), ("seed", 1), ("jobs", 2)):
        parser.add_argument(f"--{option}", type=int, default=default)
    parser.add_argument("--plans", type=Path, default=PLANS_FOLDER, help="folder of the plans")
    parser.add_argument("--json", type=Path, help="file to which a line a campaign is added")
    parser.add_argument("--check", action="store_true", help="check robots instead")
    asked = parser.parse_args()
    asked.seeds = range(asked.seed, asked.seed + asked.campaigns)
    show = print_checks if asked.check else print_cells
    for outcome in show(asked, Parallel(asked.jobs)):
        if asked.json:
            with asked.json.open("a", encoding="utf-8") as file:
                file.write(json.dumps(outcome) + "\n")


if __name__ == "__main__":
    main()
