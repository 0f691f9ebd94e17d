"""What models leave of robots with unequal rods and tilted axes, by `pkmcal study`.

python -m benchmarks.plate_tilt [--campaigns N] [--robot NAME] [--json]

A plan of 80 shots, a tracker of 0.015/√3 mm a coordinate, robots built of rods that share no
equation with any model; eight sizes of imperfection in turn, the same robots and noise for each
model. Unseen positions, rms in µm, medians. Exit code 1 when a figure misses its limit. 64
campaigns take about five minutes of one core.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.shared.studies import Studied, mean, options, studied
from benchmarks.shared.yardstick import Figure, Report, Table, main
from campaigns.studies.study import CampaignRow

SHOTS = 80
MODELS = ("standard", "rods", "full", "auto")
REFERENCE_UM: Mapping[str, Sequence[float]] = {
    "standard": (5.2, 25.0, 97.0, 32.9, 129.9, 35.9, 143.9, 43.0),
    "rods": (5.8, 5.8, 6.2, 21.9, 82.7, 22.0, 83.4, 31.7),
    "full": (6.1, 6.1, 6.3, 6.1, 6.4, 6.1, 6.9, 22.1),
}
"""Of a Par4, by an independent first-order model: medians of 8 robots, which scatter by a third."""
ABOVE = 1.15
FLOOR = 1.15 * 6.9 / 5.2
"""What full may leave without scatter, over what the standard model leaves of perfect parts."""
COVERED = (0.93, 0.97)
RIGHTLY = 0.95


def measure(campaigns: int, robot: str) -> Report:
    asked = ("--effects", "imperfect-parts", *options("model", MODELS))
    found = studied(robot, "paper-simulation", SHOTS, asked, campaigns)
    by_model = {one.told["model"]: one for one in found}
    kinds = {model: one.told["by_kind"] for model, one in by_model.items()}
    left = [
        (each["kind"], *(1e3 * kinds[model][place]["position_mm"] for model in MODELS))
        for place, each in enumerate(kinds["standard"])
    ]
    kept = [(each["kind"], each["campaigns"], words(each["kept"])) for each in kinds["auto"]]
    return Report(
        [*limits(left, robot), coverage(kinds["full"]), *choices(by_model)],
        [
            Table("unseen positions, µm, by model", ("parts", *MODELS), left),
            Table("models that auto kept", ("parts", "of", "kept"), kept),
        ],
    )


def limits(left: Sequence[tuple[Any, ...]], robot: str) -> list[Figure]:
    """What is left over its limit, of the worst kind."""
    if robot.startswith("par4"):
        return [
            Figure(
                f"left by {model}, over the reference, at worst",
                max(row[1 + place] / um for row, um in zip(left, REFERENCE_UM[model], strict=True)),
                highest=ABOVE if model == "full" else math.inf,
            )
            for place, model in enumerate(REFERENCE_UM)
        ]
    floor_um, full = left[0][1], [row[3] for row in left if "±" not in row[0]]
    return [Figure("left by full, over perfect parts by 22", max(full) / floor_um, highest=FLOOR)]


def coverage(kinds: Sequence[Mapping[str, Any]]) -> Figure:
    """Share of the full model's 95 % intervals that hold the truth."""
    share = sum(each["covered"] * each["campaigns"] for each in kinds)
    share /= sum(each["campaigns"] for each in kinds)
    return Figure("95 % intervals of full that hold", share, "", *COVERED)


def choices(by_model: Mapping[str, Studied]) -> list[Figure]:
    """How often auto keeps the standard model of perfect parts, and enough of others."""
    rows = {model: studied.rows for model, studied in by_model.items()}
    perfect = [
        row.verdict is not None and row.verdict.model == "standard"
        for row in rows["auto"]
        if row.what == "none"
    ]
    enough = [
        left_mm(auto) <= ABOVE * left_mm(full)
        or (auto.verdict is not None and auto.verdict.model not in {"standard", "rods"})
        for auto, standard, full in zip(rows["auto"], rows["standard"], rows["full"], strict=True)
        if left_mm(full) < 0.5 * left_mm(standard)
    ]
    return [
        Figure("22 kept of perfect parts", mean(perfect), lowest=RIGHTLY),
        Figure("full or as good where it halves", mean(enough), lowest=RIGHTLY),
        Figure("campaigns where full leaves less than half", float(len(enough))),
    ]


def left_mm(row: CampaignRow) -> float:
    return math.nan if row.verdict is None else row.verdict.position_mm


def words(kept: Mapping[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in kept.items())


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, campaigns=64, robot="par4-prototype"))
