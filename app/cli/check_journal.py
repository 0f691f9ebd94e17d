"""pkmcal check-journal: whether the journal is what was written, and what is in it."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from pydantic_core import to_jsonable_python

from app.console import BAD, GOOD, Terminal
from app.next import tell_who_works
from campaigns.campaign import Campaign
from campaigns.errors import JournalFailed, OptionsInvalid, VerdictBad
from campaigns.files.text_file import read_text
from campaigns.journal.journal import JournalReader
from campaigns.journal.verification import Inspection, Problem, inspect_journal, require_whole
from drivers.bounded_files import CSV_BYTES

HEAD = 2000
"""So many characters of a report hold what it says of itself."""
PAGE_JOURNAL = re.compile(
    r'name="journal-end" content="(?P<records>\d{1,12}):(?P<digest>[0-9a-f]{64})"'
)

Page = Annotated[
    Path | None,
    typer.Option(
        "--page", metavar="FILE", help="Check whether this report was made from this journal."
    ),
]


def command(terminal: Terminal, campaign: Campaign, *, page: Page = None) -> None:
    """Check whether the journal is intact, and show its contents.

    Reads every record: the chain of digests, its text, the file's pages and rules, and which
    campaign it belongs to. Nothing is changed. Each problem is named with its record.

    With --page: whether a report was made from this journal; exit code 1: it was not.

    Exit code 4: the journal is not intact. With --json the document is printed in that case, too.
    """
    campaign.require_journal()
    tell_who_works(terminal, campaign)
    with terminal.telling("reading every record"):
        found = inspect_journal(campaign.journal_path)
    terminal.say(_contents(found), GOOD if found.whole else BAD)
    for problem in found.problems:
        terminal.say(f"! {problem.problem}", BAD)
    try:
        require_whole(campaign.journal_path, found.problems)
        with campaign.journal_reader() as journal:
            if page is not None:
                require_page_of(journal, page)
    except JournalFailed as error:
        problems = found.problems or (Problem(error.problem),)
        error.details = to_jsonable_python(replace(found, whole=False, problems=problems))
        raise
    if page is not None:
        terminal.say(f"{page} was made from this journal", GOOD)
    terminal.conclude(found)


def require_page_of(journal: JournalReader, page: Path) -> None:
    """Raise `VerdictBad` for a report of another journal, `OptionsInvalid` for no report."""
    text = read_text(page, OptionsInvalid, if_missing="name a report", most_bytes=CSV_BYTES)
    found = PAGE_JOURNAL.search(text[:HEAD])
    if found is None:
        raise OptionsInvalid(
            f"{page}: does not say which journal it was made from",
            remedy="name a report of this version, or write it again with `pkmcal report`",
        )
    if not journal.holds(int(found["records"]), found["digest"]):
        raise VerdictBad(
            f"{page} was not made from this journal, or one of them was changed since",
            remedy="compare the digests under Identities, and write the report again",
        )


def _contents(found: Inspection) -> str:
    state = "the journal is whole" if found.whole else "the journal is not what was written"
    crashed = f", {found.crashed_sessions} of them without an end" if found.crashed_sessions else ""
    older = found.records - found.chained
    unchained = f", {older} of them from before there were digests" if found.whole and older else ""
    return (
        f"{state}: {found.records} records{unchained}, {found.series} series, {found.sessions} "
        f"sessions{crashed}, {found.shots} shots"
    )
