"""Makes the pictures of screens anew: a run's screen, the live page and the report.

python docs/pictures/make_screens.py

Needs chromium. About two minutes.
"""

import io
import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from ruamel.yaml import YAML

from app.run_screen import RunScreen
from campaigns.measuring.run_state import EngineState, PositionUncertainty, Progress

HERE = Path(__file__).parent
PKMCAL = [sys.executable, "-m", "app.main"]
BROWSER = shutil.which("chromium") or "chromium"
QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--hide-scrollbars",
    "--virtual-time-budget=4000",
)
RUN = Progress(
    34,
    163,
    EngineState.MEASURING,
    34,
    "identification",
    (310.0, 420.0),
    0.023,
    0.012,
    uncertainty=PositionUncertainty(30, "arm3.forearm_mm", 0.086, 0.013),
)


def main() -> None:
    """Make all of them."""
    console = Console(record=True, width=80, height=24, file=io.StringIO(), force_terminal=True)
    screen = RunScreen(console, "run")
    for done, residual_mm in enumerate((0.02, 0.03, 0.018, 0.025, 0.022, 0.023), start=29):
        screen.progress(replace(RUN, done=done, residual_mm=residual_mm))
    screen.event("shot 12, attempt 1: beam broken: the tracker lost its target")
    screen.event("the beam is back")
    console.print(screen.picture(datetime(2026, 3, 2, 14, 26, tzinfo=UTC)))
    console.save_svg(str(HERE / "run.svg"), title="pkmcal run cell-7")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "cell-7"
        pkmcal("new", folder, "--scenario", "realistic")
        change(folder / "cell.yaml", lambda tree: tree.update(speed_up=12))
        pkmcal("plan", folder)
        live_pages(folder)
        report_page(Path(scratch) / "rehearsed")


def report_page(folder: Path) -> None:
    """Draw the top of a report, of a whole calibration of a simulated robot."""
    pkmcal("dry-run", folder, "--scenario", "realistic")
    screenshot((folder / "report.html").as_uri(), "report", 1000, 900)


def live_pages(folder: Path) -> None:
    """Draw the live page on a desktop and a phone, while a run is going on."""
    watch = subprocess.Popen(  # noqa: S603 - our own command
        [*PKMCAL, "watch", str(folder), "--json"], stdout=subprocess.PIPE, encoding="utf-8"
    )
    run = subprocess.Popen([*PKMCAL, "run", str(folder), "--yes", "--plain"])  # noqa: S603 - the same
    try:
        assert watch.stdout is not None
        url = json.loads(watch.stdout.readline())["url"]
        time.sleep(20.0)
        screenshot(url, "live-desktop", 1280, 700)
        screenshot(url, "live-phone", 500, 900)
        run.wait(300.0)
    finally:
        run.kill()
        watch.terminate()
        watch.wait(20.0)


def screenshot(url: str, name: str, width: int, height: int) -> None:
    """Picture of a page in a window of that size."""
    words = [BROWSER, *QUIET, f"--window-size={width},{height}"]
    subprocess.run(  # noqa: S603 - a browser that is installed, and a page of ours
        [*words, f"--screenshot={HERE / name}.png", url], check=True, capture_output=True
    )


def change(path: Path, how: Callable[[Any], None]) -> None:
    """Change a YAML file."""
    yaml = YAML()
    tree = yaml.load(path.read_text(encoding="utf-8"))
    how(tree)
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(tree, file)


def pkmcal(*words: object) -> None:
    """Run a command."""
    subprocess.run([*PKMCAL, *map(str, words)], check=False)  # noqa: S603 - our own command


if __name__ == "__main__":
    main()
