"""Draws gain.svg anew: what a dry run proves on distances that its fit never saw.

python docs/pictures/make_gain.py
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

PICTURE = Path(__file__).with_name("gain.svg")
INCH_PX = 96
WIDTH_PX, HEIGHT_PX = 1000, 400
BEFORE, AFTER = "#c8553d", "#2a6f97"


def main() -> None:
    """Rehearse a campaign and draw what it gained."""
    mpl.rcParams["svg.hashsalt"] = "pkmcal"
    drawn(rehearsed()).savefig(PICTURE, metadata={"Date": None})


def rehearsed() -> dict[str, Any]:
    """Document of `pkmcal dry-run`."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(  # noqa: S603 - our own command, no input from anywhere
            [
                Path(sys.executable).with_name("pkmcal"),
                "dry-run",
                "rehearsal",
                "--scenario",
                "realistic",
                "--json",
            ],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            check=True,
        )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def drawn(document: dict[str, Any]) -> Figure:
    """Errors of each unseen distance before and after, and their mean as the robot proved it."""
    unseen = document["identification"]["unseen"]
    before, after = (np.abs(unseen[key]).ravel() for key in ("before_mm", "after_mm"))
    order = np.argsort(before)
    figure = Figure(figsize=(WIDTH_PX / INCH_PX, HEIGHT_PX / INCH_PX), layout="constrained")
    axes = figure.subplots()
    for row, pair in enumerate(order):
        axes.plot([row, row], [before[pair], after[pair]], color="#cccccc", zorder=1)
    rows = np.arange(len(order))
    axes.scatter(rows, before[order], color=BEFORE, zorder=2, label="as built")
    axes.scatter(rows, after[order], color=AFTER, zorder=2, label="calibrated")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylabel("error of the distance, mm")
    axes.set_xticks([])
    axes.set_xlabel(f"{len(order)} pairs of points that the fit never saw")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="upper left")
    means = [document[stage]["distances_mm"]["mean_abs"] for stage in ("before", "after")]
    figure.suptitle(
        f"A simulated Par4: mean error of distances {means[0]:.2f} mm → {means[1]:.3f} mm"
    )
    return figure


if __name__ == "__main__":
    main()
