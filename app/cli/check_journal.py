"""pkmcal check-journal: whether the journal is what was written, and what is in it."""

from dataclasses import asdict

import typer

from app.console import BAD, GOOD, terminal_of
from app.next import tell_who_works
from app.options import Folder, Json
from app.wiring import raw_readers
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import JournalFailed
from campaigns.journal.inspection import Inspection, Problem, inspect_journal, require_whole
from campaigns.journal.journal import read_journal


def command(context: typer.Context, folder: Folder, *, json: Json = False) -> None:
    """Say whether the journal is whole, and what is in it.

    Every record is read: the chain of digests, its text, the file's pages and rules, whose campaign
    it is, and whether joints and points are what the devices' raw answers beside them say. Nothing
    is changed. Each problem is named with its record.

    Exit code 4: it is not whole. With --json the document is printed then, too.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    campaign.require_journal()
    tell_who_works(terminal, campaign)
    path = campaign.journal_path
    found = inspect_journal(path, raw_readers(campaign))
    foreign = _foreign(campaign) if found.whole else None
    if foreign is not None:
        terminal.document(_document(campaign, found, (Problem(foreign.problem),)))
        raise foreign
    terminal.say(_contents(found), GOOD if found.whole else BAD)
    for problem in found.problems:
        terminal.say(f"! {problem.problem}", BAD)
    terminal.document(_document(campaign, found, found.problems))
    require_whole(path, found)


def _foreign(campaign: Campaign) -> JournalFailed | None:
    """What speaks against a whole journal's being this campaign's."""
    with read_journal(campaign.journal_path) as journal:
        try:
            campaign.require_own(journal.series())
        except JournalFailed as foreign:
            return foreign
    return None


def _contents(found: Inspection) -> str:
    state = "the journal is whole" if found.whole else "the journal is not what was written"
    crashed = f", {found.crashed} of them without an end" if found.crashed else ""
    older = found.records - found.chained
    unchained = f", {older} of them from before there were digests" if older else ""
    return (
        f"{state}: {found.records} records{unchained}, {found.series} series, {found.sessions} "
        f"sessions{crashed}, {found.shots} shots; {found.compared} measurements compared with "
        "their raw answers"
    )


def _document(
    campaign: Campaign, found: Inspection, problems: tuple[Problem, ...]
) -> dict[str, object]:
    return {
        **asdict(found),
        "path": campaign.journal_path,
        "whole": not problems,
        "crashed_sessions": found.crashed,
        "problems": problems,
    }
