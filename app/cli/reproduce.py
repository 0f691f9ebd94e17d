"""pkmcal reproduce: the paper's figures anew, ours beside the printed ones."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Json

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from app.console import Terminal
    from app.papers.corbel2006.experiments import Trial
    from app.papers.corbel2006.page import Material
    from app.papers.corbel2006.runner import Failure, Outcome
    from app.papers.corbel2006.trials import TrialResult

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
    int | None,
    typer.Option(min=1, metavar="N", help="Processes.", show_default="one a processor"),
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
    """Do the paper's simulation and experiment again.

    Three experiments on simulated cells, many seeds of each, every seed a whole campaign over
    sockets: Table I's errors with the tracker's noise (Fig. 7), the same with the robot's
    repeatability, and Table II's errors as the prototype (Fig. 8, Tables II to IV). Ours stands
    beside what the paper prints, with the reason where the two differ, on the terminal and on a
    page.

    Finished seeds are kept in DIR: the same command goes on where it was broken off.

    Exit code 1: a median is not as asked, or a seed failed.
    """
    import time

    from app.console import terminal_of
    from app.papers.corbel2006.document import document_of

    terminal = terminal_of(context, as_json=json)
    started_s = time.monotonic()
    made = reproduce(to, seeds_asked(seeds, quick=quick), workers, terminal)
    seconds = time.monotonic() - started_s
    show(terminal, made.material)
    terminal.say(f"{seconds:.0f} s; page: {made.page}")
    material = made.material
    document = document_of(material.comparison, material.verdict, made.failures)
    terminal.document(document | {"page": str(made.page), "seconds": seconds})
    if material.verdict.decision != "pass":
        raise typer.Exit(Exit.NOT_GOOD)


def seeds_asked(seeds: int | None, *, quick: bool) -> int:
    """How many seeds of each experiment; raises `OptionsInvalid`."""
    from campaigns.errors import OptionsInvalid

    if quick and seeds is not None:
        raise OptionsInvalid("--quick and --seeds both say how many seeds", remedy="give one")
    return QUICK_SEEDS if quick else seeds or SEEDS


@dataclass(frozen=True, slots=True, eq=False)
class Reproduced:
    """What was found, and where the page lies."""

    material: "Material"
    failures: "tuple[Failure, ...]"
    page: Path


def reproduce(folder: Path, seeds: int, workers: int | None, terminal: "Terminal") -> Reproduced:
    """Run the seeds that are missing and write the page.

    Raises `CampaignLocked`, `ResultsInvalid`, `WriteFailed` or `Interrupted`.
    """
    from app.papers.corbel2006.comparison import compare
    from app.papers.corbel2006.evidence import evidence
    from app.papers.corbel2006.experiments import trials
    from app.papers.corbel2006.page import Material, page_html, page_of
    from app.papers.corbel2006.verdict import verdict
    from campaigns.campaign import now_utc
    from campaigns.files.lock import campaign_lock
    from campaigns.files.text_file import make_folder, replace_text

    make_folder(folder)
    with campaign_lock(folder, now_utc=now_utc):
        results, failures = _measured(folder, trials(seeds), workers, terminal)
        comparison = compare(results)
        found = verdict(comparison, failures, seeds)
        material = Material(results, comparison, evidence(results), found)
        page = folder / PAGE
        replace_text(page, page_html(page_of(material, now_utc())))
    return Reproduced(material, failures, page)


def rehearsed(room: Path, trial: "Trial") -> "Outcome":
    """One seed, in a process of its own; what it says to people is not shown."""
    from app.papers.corbel2006.runner import Failure
    from drivers.errors import ExplainedError

    try:
        return _rehearsed(room, trial)
    except ExplainedError as error:
        return Failure(trial, str(error))
    except Exception as error:  # noqa: BLE001 - whatever it is, it costs this seed alone
        return Failure(trial, f"unforeseen {type(error).__name__}: {error}")


def _rehearsed(room: Path, trial: "Trial") -> "TrialResult":
    """The whole chain in a campaign of its own; raises whatever went wrong."""
    import time
    from contextlib import redirect_stderr, redirect_stdout
    from io import StringIO
    from tempfile import TemporaryDirectory

    from app.console import Terminal
    from app.new_campaign import create_simulated
    from app.papers.corbel2006.experiments import ROBOT, adapt
    from app.papers.corbel2006.trials import TrialFailed, result_of
    from app.rehearsal import rehearse
    from campaigns.campaign import open_campaign
    from campaigns.options import AS_THE_PAPER

    started_s = time.monotonic()
    with TemporaryDirectory(dir=room) as own:
        folder = Path(own) / "campaign"
        create_simulated(folder, ROBOT, trial.experiment.scenario, trial.seed)
        adapt(folder, trial)
        campaign = open_campaign(folder)
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            _, against = rehearse(campaign, Terminal(as_json=False), AS_THE_PAPER)
        if against:
            raise TrialFailed("; ".join(against), remedy=f"pkmcal dry-run --seed {trial.seed}")
        return result_of(campaign, trial, time.monotonic() - started_s)


def _measured(
    folder: Path, wanted: "Sequence[Trial]", workers: int | None, terminal: "Terminal"
) -> "tuple[tuple[TrialResult, ...], tuple[Failure, ...]]":
    """Results of all trials in their order, kept ones and new ones, and what failed."""
    from joblib import cpu_count

    from app.papers.corbel2006.kept import KeptResults, usable
    from app.papers.corbel2006.runner import Failure

    kept = KeptResults(folder / RESULTS)
    found = usable(kept.read(), wanted)
    left = [trial for trial in wanted if trial not in found]
    failures: list[Failure] = []
    if found:
        terminal.note(f"{len(found)} of {len(wanted)} seeds are kept from before")

    def keep(trial: "Trial", outcome: "Outcome") -> None:
        if isinstance(outcome, Failure):
            failures.append(outcome)
        else:
            kept.append(outcome)
            found[trial] = outcome

    if left:
        _run(left, len(wanted), workers or cpu_count(), keep)
    return tuple(found[trial] for trial in wanted if trial in found), tuple(failures)


def _run(
    left: "Sequence[Trial]", total: int, workers: int, keep: "Callable[[Trial, Outcome], None]"
) -> None:
    """Run the trials that are missing, each result kept as it comes; raises `Interrupted`."""
    import time
    from functools import partial
    from tempfile import TemporaryDirectory

    from rich.console import Console

    from app.interrupt import StopRequest, stop_on_signals
    from app.papers.corbel2006.progress import SeedProgress
    from app.papers.corbel2006.runner import outcomes, worker_processes

    wish, screen = StopRequest(), Console(stderr=True, highlight=False)
    done = total - len(left)
    with (
        stop_on_signals(wish),
        TemporaryDirectory(prefix="pkmcal-reproduce-", ignore_cleanup_errors=True) as room,
        SeedProgress(screen, total, done=done, now_s=time.monotonic) as progress,
        worker_processes(min(workers, len(left))) as pool,
    ):
        for trial, outcome in outcomes(left, partial(rehearsed, Path(room)), pool, wish):
            keep(trial, outcome)
            progress.count(outcome)


def show(terminal: "Terminal", material: "Material") -> None:
    """All tables, why figures differ, and the verdict."""
    from app.console import BAD, GOOD
    from app.papers.corbel2006.misfit import misfit_in_words
    from app.papers.corbel2006.tables import all_tables, reason_lines

    comparison, evidence, verdict = material.comparison, material.evidence, material.verdict
    for table in all_tables(comparison, evidence):
        rows = [[COLOURED.get(cell, cell) for cell in row] for row in table.rows]
        terminal.table(table.title, [column.title for column in table.columns], rows)
    terminal.listing("Why figures differ", reason_lines(comparison.reasons))
    if evidence.pairs is not None:
        terminal.say(evidence.pairs.in_words())
    terminal.say(misfit_in_words(evidence.reaches[0]))
    good = verdict.decision == "pass"
    for line in verdict.lines:
        terminal.say(line, "" if good else BAD)
    terminal.say(verdict.headline, GOOD if good else BAD)
