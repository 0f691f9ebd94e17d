"""pkmcal study: many simulated campaigns, to see how good a plan and how honest its σ is."""

import time
from functools import partial
from json import dumps as json_text

from joblib import cpu_count
from rich.console import Console

from app.console import Terminal
from app.options import Plot
from app.progress import CountedWork
from app.report.drawing import save
from app.study import output
from app.study.pictures import study_picture
from app.study.running import run_study
from app.study.setup import StudyOptions, study_of
from app.study.workers import parts_of_cluster, simulated_parts
from campaigns.campaign import Campaign, now_utc
from campaigns.files.lock import campaign_lock
from campaigns.files.text_file import make_folder, replace_text
from campaigns.studies.summary import normal_scores
from campaigns.studies.table import StudyTable

OUTPUTS = "study"


def command(
    terminal: Terminal, campaign: Campaign, options: StudyOptions, *, plot: Plot = None
) -> None:
    """Simulate many campaigns of a plan, and compare what they identify with the truth.

    Each campaign draws a robot with every source of error at its tolerance, and the tracker's
    noise, and is identified as `pkmcal identify` does. The study shows whether the stated σ are
    true, and the error of positions that remains. Faults and heat are for `pkmcal dry-run`.

    The same command resumes; a larger N adds campaigns. Results depend on the seed, not on the
    workers. Exit code 1: campaigns were lost with their workers.
    """
    began_s, study = time.monotonic(), study_of(campaign, options)
    to = options.to or campaign.path(OUTPUTS)
    table = StudyTable(to / f"{study.file_name}.jsonl", study.table_head())
    make_folder(to)
    with campaign_lock(to, now_utc=now_utc):
        compute = partial(simulated_parts, processes=options.workers or cpu_count())
        if options.scheduler:
            compute = partial(parts_of_cluster, scheduler=options.scheduler)
        studied = run_study(study, table, range(options.campaigns), compute, counting)
        summary = studied.summary()
        seconds = time.monotonic() - began_s
        document = output.document(studied, summary) | {"seconds": seconds, "path": str(table.path)}
        replace_text(to / f"{study.file_name}.csv", output.csv(summary))
        text = json_text(document, allow_nan=False, indent=1)
        replace_text(to / f"{study.file_name}.json", f"{text}\n")
    output.show(terminal, studied, summary)
    terminal.say(f"written: {to / study.file_name}.csv, .json, .jsonl")
    if plot is not None:
        save(study_picture(summary, normal_scores(studied.rows)), plot)
        terminal.say(f"drawn: {plot}")
    terminal.conclude(document, is_good=not studied.lost)


def counting(total: int, done: int) -> CountedWork:
    """Show how far the campaigns are."""
    screen = Console(stderr=True, highlight=False)
    return CountedWork(screen, "campaigns", total, done=done)
