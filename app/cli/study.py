"""pkmcal study: many simulated campaigns, to see how good a plan and how honest its σ is."""

import time
from collections.abc import Sequence
from functools import partial
from json import dumps as json_text
from pathlib import Path

import typer
from joblib import cpu_count
from rich.console import Console

from app.console import WARNING, Terminal, terminal_of
from app.exits import Exit
from app.options import Folder, Json, Plot
from app.progress import CountedWork
from app.report.figures.drawing import save
from app.study import output
from app.study.pictures import study_picture
from app.study.running import Job, run_jobs
from app.study.setup import Study, StudyOptions, left_out, study_of
from app.study.workers import local_results
from campaigns.campaign import now_utc, open_campaign
from campaigns.files.lock import campaign_lock
from campaigns.files.text_file import make_folder, replace_text
from campaigns.studies.engine import ResultTable
from campaigns.studies.study import CampaignRow
from campaigns.studies.summary import StudySummary, normal_scores

OUTPUTS = "study"
CAMPAIGNS_A_TASK = 25


def command(
    context: typer.Context,
    folder: Folder,
    options: StudyOptions,
    *,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Simulate many campaigns of a plan, and compare what they identify with the truth.

    Each campaign draws a robot and the tracker's noise, nothing else: effects that no parameter
    describes (rods, backlash, warm arms) are shown by `pkmcal dry-run`. The study shows whether
    the stated σ are true, how close they come to the least that the shots allow, and the error
    of positions that remains.

    The same command resumes; a larger N adds campaigns. Results depend on the seed, not on the
    workers. Exit code 1: campaigns were lost with their workers.
    """
    terminal, opened = terminal_of(context, as_json=json), open_campaign(folder)
    began_s, study = time.monotonic(), study_of(opened, options)
    if effects := left_out(study.scenario, study.model):
        terminal.note(f"{study.scenario.name}: not simulated here: {', '.join(effects)}", WARNING)
    to = options.to or opened.path(OUTPUTS)
    table = ResultTable(
        to / f"{study.file_name}.jsonl", CampaignRow, "pkmcal study", study.table_head()
    )
    make_folder(to)
    with campaign_lock(to, now_utc=now_utc):
        studied = run(study, table, range(options.campaigns), options.workers or cpu_count())
        summary = studied.summary()
        seconds = time.monotonic() - began_s
        document = output.document(studied, summary) | {"seconds": seconds, "path": str(table.path)}
        replace_text(to / f"{study.file_name}.csv", output.csv(summary))
        text = json_text(document, allow_nan=False, indent=1)
        replace_text(to / f"{study.file_name}.json", f"{text}\n")
    output.show(terminal, studied, summary)
    terminal.say(f"written: {to / study.file_name}.csv, .json, .jsonl")
    if plot is not None:
        draw(terminal, summary, studied.rows, plot)
    terminal.document(document)
    if studied.lost:
        raise typer.Exit(Exit.NOT_GOOD)


def run(
    study: Study, table: ResultTable[CampaignRow], wanted: range, workers: int
) -> output.Studied:
    """Compute what a table lacks of the wanted campaigns.

    Raises `OutputExists` and `WriteFailed`; what had come back until then is kept.
    """
    there = table.read()
    left = [number for number in wanted if number not in there]
    parts = [left[at : at + CAMPAIGNS_A_TASK] for at in range(0, len(left), CAMPAIGNS_A_TASK)]
    jobs = [Job(table, part, len(part)) for part in parts]
    screen, done = Console(stderr=True, highlight=False), len(wanted) - len(left)
    counted = CountedWork(screen, "campaigns", len(wanted), done=done, now_s=time.monotonic)
    processes = partial(local_results, processes=workers)
    lost = run_jobs(jobs, study.simulate, processes, [table], counted)
    count = sum(job.count for job, _ in lost)
    rows = [*table.rows(number for number in wanted if number in there)]
    reasons = dict.fromkeys(reason for _, reason in lost)
    return output.Studied(study, rows, len(left) - count, count, (*reasons,))


def draw(
    terminal: Terminal, summary: StudySummary, rows: Sequence[CampaignRow], path: Path
) -> None:
    """Draw errors, ratios and coverage; raises `WriteFailed`."""
    save(study_picture(summary, normal_scores(rows)), path)
    terminal.say(f"drawn: {path}")
