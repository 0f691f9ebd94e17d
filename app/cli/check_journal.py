"""pkmcal check-journal: check that the journal is unchanged, and count its contents."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from pydantic_core import to_jsonable_python

from app.console import BAD, GOOD, Terminal
from app.next import tell_who_works
from campaigns.campaign import CampaignFolder
from campaigns.errors import JournalFailed, OptionsInvalid, VerdictBad
from campaigns.files.text_file import read_text
from campaigns.journal.journal import JournalReader
from campaigns.journal.verification import Inspection, Problem, inspect_journal
from drivers.bounded_files import CSV_BYTES

HEAD_CHARACTERS = 2000
"""Characters at the beginning of a report that hold its metadata."""
PAGE_JOURNAL = re.compile(
    r'name="journal-end" content="(?P<records>\d{1,12}):(?P<digest>[0-9a-f]{64})"'
)

Page = Annotated[
    Path | None,
    typer.Option(
        "--page", metavar="FILE", help="Check whether this report was made from this journal."
    ),
]


def command(terminal: Terminal, campaign: CampaignFolder, *, page: Page = None) -> None:
    """Check whether the journal is intact, and show its contents.

    Reads every record: the chain of digests, its text, the file's pages and rules, and which
    campaign it belongs to. Nothing is changed. Each problem is named with its record.

    With --page: whether a report was made from this journal; exit code 1: it was not.

    Exit code 4: the journal is not intact. With --json the document is printed in that case, too.
    """
    campaign.require_journal()
    tell_who_works(terminal, campaign)
    with terminal.telling("reading every record"):
        inspection = inspect_journal(campaign.journal_path)
    terminal.say(_contents(inspection), GOOD if inspection.whole else BAD)
    for problem in inspection.problems:
        terminal.say(f"! {problem.problem}", BAD)
    # A broken journal ends with the exit code of its error, but a program still gets the document:
    # the error carries it, and `app.main` prints it. Opening the journal finds each problem of
    # the inspection again, and a journal of another campaign.
    try:
        with campaign.journal_reader() as journal:
            if page is not None:
                require_page_of(journal, page)
    except JournalFailed as error:
        problems = inspection.problems or (Problem(error.problem),)
        error.details = to_jsonable_python(replace(inspection, whole=False, problems=problems))
        raise
    if page is not None:
        terminal.say(f"{page} was made from this journal", GOOD)
    terminal.conclude(inspection)


def require_page_of(journal: JournalReader, page: Path) -> None:
    """Raise `VerdictBad` for a report of another journal, `OptionsInvalid` for no report."""
    text = read_text(page, OptionsInvalid, if_missing="name a report", most_bytes=CSV_BYTES)
    # the report states how many records the journal had and the digest of the last of them; a
    # journal that has grown since still holds that record
    stated = PAGE_JOURNAL.search(text[:HEAD_CHARACTERS])
    if stated is None:
        raise OptionsInvalid(
            f"{page}: does not say which journal it was made from",
            remedy="name a report of this version, or write it again with `pkmcal report`",
        )
    if not journal.holds(int(stated["records"]), stated["digest"]):
        raise VerdictBad(
            f"{page} was not made from this journal, or one of them was changed since",
            remedy="compare the digests under Identities, and write the report again",
        )


def _contents(journal: Inspection) -> str:
    """Return whether the journal is intact, and how much it holds."""
    state = "the journal is intact" if journal.whole else "the journal is not what was written"
    crashed = ""
    if journal.crashed_sessions:
        crashed = f" ({journal.crashed_sessions} without an end)"
    older = journal.records - journal.chained
    unchained = ""
    if journal.whole and older:
        unchained = f", {older} of them from before there were digests"
    return (
        f"{state}: {_count(journal.records, 'record')}{unchained}, {journal.series} series, "
        f"{_count(journal.sessions, 'session')}{crashed}, {_count(journal.shots, 'shot')}"
    )


def _count(number: int, word: str) -> str:
    """Return a number with its word, in the plural unless it is 1."""
    return f"{number} {word}{'' if number == 1 else 's'}"
