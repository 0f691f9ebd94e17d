"""pkmcal study: simulate many campaigns of a plan, and compare their σ with the true errors."""

import json
import time

from joblib import cpu_count
from pydantic_core import to_jsonable_python

from app.console import Terminal
from app.options import Plot
from app.study import output
from app.study.running import cluster, local_processes, run_study
from app.study.setup import StudyOptions, study_of
from campaigns.campaign import Campaign, now_utc
from campaigns.files.lock import campaign_lock
from campaigns.files.text_file import make_folder, replace_text
from campaigns.studies.summary import normal_scores
from campaigns.studies.table import StudyTable


def command(
    terminal: Terminal, campaign: Campaign, options: StudyOptions, *, plot: Plot = None
) -> None:
    """Simulate many campaigns of a plan; compare them with the truth.

    Each campaign draws a robot with every source of error at its tolerance, and the tracker's
    noise, and is identified as `pkmcal identify` does. The study shows whether the stated σ are
    true, and the error of positions that remains. Faults and heat are for `pkmcal dry-run`.

    The same command resumes; a larger N adds campaigns. Results depend on the seed, not on the
    workers. Exit code 1: campaigns were lost with their workers.
    """
    # Every finished campaign is a line of the .jsonl file, so that a study can be interrupted and
    # resumed; the .csv and .json files are made of all lines, also those of earlier calls.
    began_s, study = time.monotonic(), study_of(campaign, options)
    to = options.to or campaign.path("study")
    table = StudyTable(to / f"{study.file_name}.jsonl", study.table_head())
    make_folder(to)
    with campaign_lock(to, now_utc=now_utc):
        workers = local_processes(options.workers or cpu_count())
        with cluster(options.scheduler) if options.scheduler else workers as executor:
            studied = run_study(study, table, range(options.campaigns), executor)
        summary = studied.summary()
        answer = output.study_answer(studied, summary, table.path, time.monotonic() - began_s)
        replace_text(to / f"{study.file_name}.csv", output.csv(summary))
        text = json.dumps(to_jsonable_python(answer), allow_nan=False, indent=1)
        replace_text(to / f"{study.file_name}.json", f"{text}\n")
    output.show(terminal, studied, summary)
    terminal.say(f"written: {to / study.file_name}.csv, .json, .jsonl")
    if plot is not None:
        from app.study.pictures import draw_study  # with matplotlib

        draw_study(plot, summary, normal_scores(studied.rows))
        terminal.say(f"drawn: {plot}")
    terminal.conclude(answer, is_good=not studied.lost)
