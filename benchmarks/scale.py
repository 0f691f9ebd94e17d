"""Time and memory against size: shots of a campaign, campaigns of a study, candidates of a plan.

python -m benchmarks.scale [--shots N] [--campaigns N] [--candidates N] [--picture FILE] [--json]

Sizes go by tens from the least to N. Each work is done by a process of its own: its processor time
and its largest resident memory, what it is begun with included. An exponent is that of time between
a size and the one before it, 1 where time grows as the size does.
"""

import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

from benchmarks import engine
from benchmarks.shared.programs import Cost, cost_of, pkmcal
from benchmarks.shared.prototype import CENTRE, FREE, NOMINAL, REGION, ROBOT
from benchmarks.shared.yardstick import Report, Table, main
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.planning.optimal_plan import OptimalRequest, choose_measurements, draw_candidates
from campaigns.planning.plan_file import PlannedShot, write_plan
from campaigns.planning.plans import PlanRequest, joints_of
from campaigns.shots.shots_csv import ShotRow, write_shots

LEAST = {"shots": 100, "campaigns": 100, "candidates": 1000}
NOISE_MM = 0.01
COLUMNS = ("", "size", "s", "exponent", "MB", "× old")
Costs = dict[str, dict[int, Cost]]
"""By work and size."""


def measure(shots: int, campaigns: int, candidates: int, picture: str, old: str) -> Report:
    asked = {"shots": shots, "campaigns": campaigns, "candidates": candidates}
    found, before = Costs(), Costs()
    code_of_old = patch.dict(os.environ, PYTHONPATH=old)
    with TemporaryDirectory() as scratch:
        for what, largest in asked.items():
            for size in _sizes(LEAST[what], largest):
                name = f"{what}-{size}"
                works = [*WORKS[what](Path(scratch) / name, size)]
                with code_of_old:
                    theirs = [*WORKS[what](Path(scratch) / f"old-{name}", size)] if old else works
                for (name, work), (_, old_work) in zip(works, theirs, strict=True):
                    found.setdefault(name, {})[size] = cost_of(work)
                    if old and getattr(old_work, "func", None) is pkmcal:
                        with code_of_old, suppress(SystemExit):  # it may not know the command
                            before.setdefault(name, {})[size] = cost_of(old_work)
                    print(f"{name}, {size}: {found[name][size].seconds:.4g} s", file=sys.stderr)
    if picture:
        draw(found, Path(picture))
    rows = [*_rows(found, before)]
    return Report(tables=[Table("processor time and memory by size", COLUMNS, rows)])


def of_shots(folder: Path, size: int) -> Iterator[tuple[str, Callable[[], object]]]:
    """What is done with a campaign of so many shots."""
    plan = engine.plan_of(size)
    name, file, room = str(folder), folder / "shots.csv", folder / "run"
    pkmcal("new", name)
    pkmcal("new", planned := f"{name}-planned")
    room.mkdir()
    write_plan(folder / "plan.csv", plan, ROBOT.mechanism)
    write_shots(file, _measured(plan), ROBOT.mechanism)
    yield "plan", partial(pkmcal, "plan", planned, "--shots", str(size))
    yield "engine, all shots", partial(engine.run, room, plan)
    yield "start of run", partial(pkmcal, "run", name, "--dry")
    yield "import", partial(pkmcal, "import", name, str(file))
    for word in ("status", "identify", "check-journal", "report"):
        yield word, partial(pkmcal, word, name, expected=(0, 1))


def of_campaigns(folder: Path, size: int) -> Iterator[tuple[str, Callable[[], object]]]:
    """Study of so many campaigns."""
    pkmcal("new", str(folder))
    pkmcal("plan", str(folder))
    words = ("--campaigns", str(size), "--workers", "1")
    yield "study", partial(pkmcal, "study", str(folder), *words)


def of_candidates(_folder: Path, size: int) -> Iterator[tuple[str, Callable[[], object]]]:
    """Plan by so many candidates."""
    request = OptimalRequest(
        plan=PlanRequest(120, 0, 2, CENTRE),
        uncertainty=TrackerUncertainty(),
        free=FREE,
        candidates=size,
    )

    def plan() -> None:
        rng = np.random.default_rng(1)
        choose_measurements(draw_candidates(REGION, request, rng), request, rng)

    yield "plan, candidates", plan


WORKS = {"shots": of_shots, "campaigns": of_campaigns, "candidates": of_candidates}


def draw(found: dict[str, dict[int, Cost]], file: Path) -> None:
    """Time and memory by size, both axes in tens."""
    from matplotlib.figure import Figure as Picture  # dear, and seldom asked for

    picture = Picture(figsize=(10.0, 5.0), layout="constrained")
    left, right = picture.subplots(1, 2)
    for name, costs in found.items():
        left.loglog([*costs], [each.seconds for each in costs.values()], "o-", label=name)
        right.loglog([*costs], [each.memory_mb for each in costs.values()], "o-")
    left.set(xlabel="size", ylabel="processor time, s")
    right.set(xlabel="size", ylabel="largest memory, MB")
    left.legend(fontsize="small")
    picture.savefig(file)


def _measured(plan: tuple[PlannedShot, ...]) -> list[ShotRow]:
    """Shots as a file has them, of the nominal robot, with a tracker's noise."""
    noise_mm = np.random.default_rng(2).normal(0.0, NOISE_MM, (len(plan), 3))
    places_mm = NOMINAL.forward(joints_of(plan)).values_or_raise()[:, :3]
    points_mm = (places_mm + engine.TRACKER_FROM_BASE_MM + noise_mm).tolist()
    return [
        ShotRow(shot.pair, shot.joints, (x, y, z), shot.purpose)
        for shot, (x, y, z) in zip(plan, points_mm, strict=True)
    ]


def _sizes(least: int, largest: int) -> list[int]:
    tens = range(round(math.log10(max(largest, least) / least)) + 1)
    return [least * 10**power for power in tens if least * 10**power <= max(largest, least)]


def _rows(found: Costs, before: Costs) -> Iterator[tuple[str | float, ...]]:
    for name, costs in found.items():
        logs = np.log([(size, cost.seconds) for size, cost in costs.items()])
        sizes, seconds = np.diff(logs, axis=0, prepend=np.nan).T
        for (size, cost), exponent in zip(costs.items(), (seconds / sizes).tolist(), strict=True):
            old = before.get(name, {}).get(size, Cost(math.nan, math.nan))
            times_old = old.seconds / cost.seconds
            yield name, size, cost.seconds, exponent, cost.memory_mb, times_old


if __name__ == "__main__":
    raise SystemExit(
        main(__doc__, measure, shots=1000, campaigns=1000, candidates=10_000, picture="", old="")
    )
