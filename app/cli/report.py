"""pkmcal report: the whole campaign on one page."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from app.folder import Campaign
    from app.report.page import Page

FILE_NAME = "report.html"
HEAD = 1000
"""So many characters of a file show whether it is a report."""


def command(
    context: typer.Context,
    folder: Folder,
    *,
    to: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Default: report.html in DIR.")
    ] = None,
    json: Json = False,
) -> None:
    """Write the report: verdict, before and after, figures, parameters, records.

    One HTML file that needs no network. The browser's print makes a PDF of it on A4. What the
    campaign does not have yet is named on the page. An older report is replaced, any other file
    is not.
    """
    from app.console import terminal_of
    from app.folder import open_campaign

    terminal = terminal_of(context, as_json=json)
    page, path = write(open_campaign(folder), to)
    terminal.say(f"verdict: {page.decision}: {' '.join(page.reasons)}")
    for text, _ in page.missing:
        terminal.note(f"missing: {text}")
    terminal.say(f"written: {path}")
    terminal.document(report_document(page, path))


def report(campaign: "Campaign", to: Path | None = None) -> Path:
    """Write the report; raises `JournalFailed`, `OutputExists` or `WriteFailed`."""
    return write(campaign, to)[1]


def write(campaign: "Campaign", to: Path | None = None) -> "tuple[Page, Path]":
    """Write the report; gives also what is on it."""
    from app.folder import now_utc
    from app.report.collect import collect
    from app.report.contents import contents_of
    from app.report.page import page_html, page_of
    from app.work_builders import tracker_uncertainty_of
    from campaigns.files.text_file import replace_text

    path = to or campaign.path(FILE_NAME)
    _refuse_other_file(path)
    contents = contents_of(collect(campaign), tracker_uncertainty_of(campaign.config))
    page = page_of(contents, now_utc())
    replace_text(path, page_html(page))
    return page, path


def report_document(page: "Page", path: Path) -> dict[str, object]:
    """The report as `--json` tells of it."""
    from app.report.parts import Picture

    return {
        "path": str(path),
        "decision": page.decision,
        "reasons": list(page.reasons),
        "missing": [text for text, _ in page.missing],
        "figures": [
            part.name
            for section in page.sections
            for part in section.parts
            if isinstance(part, Picture)
        ],
    }


def _refuse_other_file(path: Path) -> None:
    """Replace nothing but an older report; raises `OutputExists`."""
    from campaigns.errors import OutputExists

    if not path.exists():
        return
    is_report = path.is_file() and b'name="generator" content="pkmcal' in path.read_bytes()[:HEAD]
    if not is_report:
        raise OutputExists(
            f"{path} already exists and is no report", remedy="name another, or move this one away"
        )
