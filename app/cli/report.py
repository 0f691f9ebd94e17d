"""pkmcal report: write the whole campaign on one page."""

import re
import shutil
import subprocess
import tempfile
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.console import BAD, WARNING, Terminal
from app.next import tell_next, tell_who_works
from app.options import Excel, for_spreadsheets
from app.report.terminal_text import say_gain, say_verdict, show_warnings
from app.report.values import COLUMNS, reported_values, values_csv
from campaigns.assessment import evaluate
from campaigns.campaign import Campaign, now_utc
from campaigns.errors import OptionsInvalid, OutputExists, WriteFailed
from campaigns.evidence import REPORT_FILE, refuse_other_report
from campaigns.files.text_file import head_of, replace_text
from campaigns.planning.plan_file import move_aside
from drivers.bounded_files import is_file, is_there
from drivers.system import is_root

if TYPE_CHECKING:
    from app.report.page import Page

VERDICT = re.compile(rb'id="verdict" class="([a-z-]+)"')
"""Place of the verdict on a page."""
TABLE_SUFFIX = ".csv"
"""End of the name of a report's figures."""

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge")
BROWSER_OPTIONS = (
    "--headless",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
)
PRINTING_TIMEOUT_S = 120.0


def command(
    terminal: Terminal,
    campaign: Campaign,
    *,
    to: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Default: report.html in DIR.")
    ] = None,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Also a PDF beside it, printed by an installed browser.")
    ] = False,
    csv: Annotated[
        bool, typer.Option("--csv", help="Also a CSV file of the figures beside it, a row each.")
    ] = False,
    excel: Excel = False,
    open_: Annotated[bool, typer.Option("--open", help="Open it in the browser.")] = False,
) -> None:
    """Write the report: the whole campaign on one page.

    Verdict, before and after, figures, parameters, records, in one HTML file that needs no
    network. `--pdf` also prints it on A4. What the campaign still lacks is named on the page. An
    older report is replaced, any other file is not; one that said pass or fail and no longer would
    is kept under another name.

    `--csv` writes the figures with their U, σ, limits and decisions for other programs: names and
    units in columns, each row with the campaign's name. `--json` prints the same as `values`.

    Exit code 1: the verdict is fail.
    """
    if excel and not csv:
        raise OptionsInvalid("--excel is for a CSV file", remedy="add --csv, or leave it out")
    if csv:
        _refuse_other_table(to or campaign.path(REPORT_FILE))
    browser = find_browser() if pdf else None  # before the work: without one nothing is written
    tell_who_works(terminal, campaign)
    with terminal.telling("reading the campaign and drawing the figures"):
        page, path, former = report(campaign, to)
    _show(terminal, page, path, former)
    values = reported_values(page.evaluation)
    if csv:
        table = path.with_suffix(TABLE_SUFFIX)
        replace_text(table, values_csv(campaign.config.name, values))
        for_spreadsheets(table, excel=excel)
        terminal.say(f"written: {table}")
    if open_ and not webbrowser.open(path.resolve().as_uri()):
        terminal.note("no browser opens it here: copy the file to where one is", WARNING)
    if browser is not None:
        with terminal.telling(f"printing by {browser}"):
            print_by_browser(browser, path, path.with_suffix(".pdf"))
        terminal.say(f"written: {path.with_suffix('.pdf')}")
    verdict = page.evaluation.verdict
    answer = {
        "path": path,
        "decision": verdict.decision,
        "reasons": verdict.reasons,
        "missing": page.missing,
        "figures": page.figures,
        "values": values,
        "former": former,
    }
    following = tell_next(terminal, campaign, reported=True, evaluation=page.evaluation)
    terminal.conclude(answer, following, is_good=verdict.decision != "fail")


def _show(terminal: Terminal, page: "Page", path: Path, former: "FormerReport | None") -> None:
    """Print a page's verdict, what stands against it, and the page's address."""
    verdict = page.evaluation.verdict
    say_verdict(terminal, verdict)
    # the reasons of a pass are on the page's first screen: they repeat what has passed
    if verdict.decision != "pass" or terminal.is_verbose:
        for reason in verdict.reasons:
            terminal.say(f"  {reason}")
    show_warnings(terminal, page.evaluation.evidence.warnings)
    say_gain(terminal, page.evaluation)
    if former is not None:
        terminal.say(f"! {former.says}", BAD)
    journal = page.evaluation.evidence.journal
    if journal is not None and journal.unended_load:
        terminal.say(f"! {journal.unended_load}", BAD)
    for text in page.missing:
        terminal.note(f"missing: {text}")
    terminal.say(f"Open {path.resolve().as_uri()}")


@dataclass(frozen=True, slots=True)
class FormerReport:
    """Report that stood at the place of a new one, with another verdict."""

    decision: str
    path: Path
    """The place of both."""
    kept: Path | None
    """Where it is now; None: it decided nothing, and was replaced."""

    @property
    def says(self) -> str:
        """What the former report said, and where it is."""
        where = "replaced" if self.kept is None else f"kept as {self.kept.name}"
        return f"{self.path.name} said {self.decision} before: {where}"


def report(campaign: Campaign, to: Path | None = None) -> "tuple[Page, Path, FormerReport | None]":
    """Write the report; return its contents, its path, and a report there with another verdict.

    Raise `JournalFailed`, `OutputExists` or `WriteFailed`.
    """
    from app.report.page import page_of  # with matplotlib, 1 s that --help need not wait for

    path = to or campaign.path(REPORT_FILE)
    refuse_other_report(path)
    page = page_of(evaluate(campaign), now_utc())
    former = _keep_former(path, page.evaluation.verdict.decision)
    replace_text(path, page.html)
    return page, path, former


# A report that was delivered may be the only copy of what was said of the robot. A page that
# decided nothing is made again and again on the way, and a pile of those would hide the others.
def _keep_former(path: Path, decision: str) -> FormerReport | None:
    """Move a report aside, with PDF and CSV, that passed or failed where the new one does not.

    Return None without a report, or with the same verdict. Raise `WriteFailed`.
    """
    if not is_file(path):
        return None
    stated = VERDICT.search(path.read_bytes())
    former = stated[1].decode("ascii").replace("-", " ") if stated else decision
    if former == decision:
        return None
    if former not in {"pass", "fail"}:
        return FormerReport(former, path, None)
    kept = move_aside(path)
    move_aside(path.with_suffix(".pdf"))
    if _is_table(path.with_suffix(TABLE_SUFFIX)):
        move_aside(path.with_suffix(TABLE_SUFFIX))
    return FormerReport(former, path, kept)


def _is_table(path: Path) -> bool:
    """Return whether a file begins as the figures of a report do, for spreadsheets or not."""
    heads = [column.head for column in COLUMNS]
    return any(mark.join(heads).encode() in head_of(path) for mark in ",;")


def _refuse_other_table(page: Path) -> None:
    """Raise `OutputExists` if a page's figures would replace another file, or the page itself."""
    path = page.with_suffix(TABLE_SUFFIX)
    if path == page:
        raise OptionsInvalid(
            f"--csv writes {path.name}, which is the page's name too",
            remedy="let the page's name end in .html",
        )
    if is_there(path) and not _is_table(path):
        raise OutputExists(
            f"{path} already exists and has no figures of a report",
            remedy="name another page with --to, or move this file away",
        )


def find_browser() -> str:
    """Return the path of an installed browser; raise `OptionsInvalid` if there is none."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise OptionsInvalid(
            f"--pdf: no browser is installed that can print it ({', '.join(BROWSERS)})",
            remedy="install chromium, or open report.html in any browser and print it",
        )
    return browser


def print_by_browser(browser: str, page: Path, pdf: Path) -> None:
    """Print a page on A4; raise `WriteFailed` if the browser fails."""
    # In a folder of its own, with a profile of its own: a browser that is open already must not
    # take the page over, and what it leaves half written must not lie beside the report.
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        printed = Path(scratch) / "page.pdf"
        words = [browser, *BROWSER_OPTIONS, f"--user-data-dir={scratch}/profile"]
        if is_root():  # Chromium refuses to start its sandbox as root
            words.append("--no-sandbox")
        words += [f"--print-to-pdf={printed}", "--no-pdf-header-footer", page.resolve().as_uri()]
        try:
            # a browser that is installed, and a file that was just written
            subprocess.run(words, capture_output=True, timeout=PRINTING_TIMEOUT_S, check=True)  # noqa: S603
            shutil.copyfile(printed, pdf)
        except (OSError, subprocess.SubprocessError) as error:
            raise WriteFailed(
                f"{pdf}: the browser could not print it ({type(error).__name__})",
                remedy="open report.html in a browser and print it from there",
            ) from error
