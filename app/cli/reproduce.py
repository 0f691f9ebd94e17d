"""pkmcal reproduce: the paper's figures anew, ours beside the printed ones."""

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from joblib import cpu_count
from rich.console import Console

from app.console import BAD, GOOD, Terminal, terminal_of
from app.exits import Exit
from app.interrupt import StopRequest, end_on_signals
from app.options import Json
from app.papers.corbel2006 import page
from app.papers.corbel2006.comparison import Comparison, Failed, compare
from app.papers.corbel2006.evidence import Evidence, evidence
from app.papers.corbel2006.trials import (
    EXPERIMENTS,
    Trial,
    TrialResult,
    rehearsed,
    trial_table,
    trials,
)
from app.progress import CountedWork
from app.study.running import Job, run_jobs
from app.study.workers import local_results
from campaigns.campaign import now_utc
from campaigns.errors import Interrupted, OptionsInvalid
from campaigns.files.lock import campaign_lock
from campaigns.files.table import texts
from campaigns.files.text_file import make_folder, replace_text
from campaigns.studies.engine import ResultTable

DEFAULT_FOLDER = Path("reproduction")
PAGE, RESULTS = "reproduction.html", "results.jsonl"
SEEDS, QUICK_SEEDS = 20, 3
COLOURED = {"pass": "[green]pass[/]", "missed": "[bold red]missed[/]"}

To = Annotated[Path, typer.Option(metavar="DIR", help="Where page and results are kept.")]
Quick = Annotated[bool, typer.Option("--quick", help=f"Only {QUICK_SEEDS} seeds: a look.")]
Seeds = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Seeds of each experiment.", show_default=str(SEEDS)),
]
Workers = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Processes.", show_default="one a processor")
]


def command(
    context: typer.Context,
    *,
    to: To = DEFAULT_FOLDER,
    quick: Quick = False,
    seeds: Seeds = None,
    workers: Workers = None,
    json: Json = False,
) -> None:
    """Repeat the paper's simulation and experiment.

    Three experiments on simulated cells, many seeds each, every seed a whole campaign over
    sockets: Table I's errors with the tracker's noise (Fig. 7), the same with the robot's
    repeatability, and Table II's errors as the prototype (Fig. 8, Tables II to IV). The results
    are shown beside the paper's, with the reason where the two differ, on the terminal and on a
    page. Finished seeds are kept in DIR: the same command resumes.

    Exit code 1: a median is not as required, or a seed failed.
    """
    terminal = terminal_of(context, as_json=json)
    began_s = time.monotonic()
    comparison, known = reproduce(
        to, seeds_asked(seeds, quick=quick), workers or cpu_count(), terminal
    )
    seconds = time.monotonic() - began_s
    show(terminal, comparison, known)
    terminal.say(f"{seconds:.0f} s; page: {to / PAGE}")
    terminal.document(comparison.document() | {"page": str(to / PAGE), "seconds": seconds})
    if comparison.decision != "pass":
        raise typer.Exit(Exit.NOT_GOOD)


def seeds_asked(seeds: int | None, *, quick: bool) -> int:
    """Number of seeds of each experiment; raises `OptionsInvalid`."""
    if quick and seeds is not None:
        raise OptionsInvalid("--quick and --seeds both say how many seeds", remedy="give one")
    return QUICK_SEEDS if quick else seeds or SEEDS


def reproduce(
    folder: Path, seeds: int, workers: int, terminal: Terminal
) -> tuple[Comparison, Evidence]:
    """Run the seeds that are missing and write the page.

    Raises `CampaignLocked`, `OutputExists`, `WriteFailed` or `Interrupted`.
    """
    make_folder(folder)
    with campaign_lock(folder, now_utc=now_utc):
        results, failed = measure(trial_table(folder / RESULTS), trials(seeds), workers, terminal)
        comparison = compare(results, seeds, failed)
        known = evidence(results)
        replace_text(folder / PAGE, page.page_html(results, comparison, known, now_utc()))
    return comparison, known


def measure(
    table: ResultTable[TrialResult], wanted: Sequence[Trial], workers: int, terminal: Terminal
) -> tuple[tuple[TrialResult, ...], tuple[Failed, ...]]:
    """Results of trials in their order, kept ones and new ones, and what failed."""
    known = table.read()
    recipes = {experiment: experiment.recipe() for experiment in EXPERIMENTS}
    keys = {
        trial: (trial.experiment.name, trial.seed, recipes[trial.experiment]) for trial in wanted
    }
    left = [Job(table, trial) for trial, key in keys.items() if key not in known]
    done = len(wanted) - len(left)
    if done:
        terminal.note(f"{done} of {len(wanted)} seeds are kept from before")
    lost: tuple[tuple[Job[Trial, TrialResult], str], ...] = ()
    if left:
        screen = Console(stderr=True, highlight=False)
        counted = CountedWork(screen, "seeds", len(wanted), done=done, now_s=time.monotonic)
        processes = partial(local_results, processes=min(workers, len(left)), apart=True)
        try:
            with (
                end_on_signals(_StopAtOnce()),
                TemporaryDirectory(prefix="pkmcal-reproduce-", ignore_cleanup_errors=True) as room,
            ):
                work = partial(rehearsed, Path(room))
                lost = run_jobs(left, work, processes, [table], counted)
        except KeyboardInterrupt as stopped:
            raise Interrupted(
                "stopped by the operator; the results of finished seeds are kept",
                remedy="the same command runs the others",
            ) from stopped
    results = tuple(table.rows(key for key in keys.values() if key in known))
    return results, tuple((job.task, why) for job, why in lost)


class _StopAtOnce(StopRequest):
    """Wish to stop that is not waited for: no robot moves here. Asking again changes nothing."""

    def ask(self, number: int) -> None:
        """Break off, whatever the signal."""
        if not self():
            super().ask(number)
            raise KeyboardInterrupt


def show(terminal: Terminal, comparison: Comparison, known: Evidence) -> None:
    """Tables of the page, why they differ, and the verdict."""
    columns = page.figure_columns(comparison)
    for group, rows in comparison.groups:
        cells = [[COLOURED.get(cell, cell) for cell in row] for row in texts(columns, rows)]
        terminal.table(page.title_of(group, rows), [column.head for column in columns], cells)
    if comparison.parameters:
        terminal.rows(page.TITLES["table_2"], page.TABLE_2, comparison.parameters)
    for letter, reason in comparison.reasons.items():
        terminal.say(f"({letter}) {reason}")
    terminal.rows(page.TITLES["floors"], page.FLOORS, known.floors)
    terminal.rows(page.TITLES["reaches"], page.REACHES, (*known.reaches, page.NEEDED))
    good = comparison.decision == "pass"
    for line in comparison.lines:
        terminal.say(line, "" if good else BAD)
    terminal.say(comparison.headline, GOOD if good else BAD)
