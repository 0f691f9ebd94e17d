"""PDF of a page, as a browser prints it, or laid out without one."""

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from campaigns.errors import OptionsInvalid, WriteFailed

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge")
QUIET = ("--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking")
PATIENCE_S = 120.0


def find_printer() -> tuple[str, Callable[[Path, Path], None]]:
    """Who prints, and what writes a PDF of a page: an installed browser, else reportlab.

    Raises `OptionsInvalid` where there is neither.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is not None:
        return Path(browser).name, partial(print_by_browser, browser)
    if find_spec("reportlab") is None:
        raise OptionsInvalid(
            f"--pdf: neither a browser ({', '.join(BROWSERS)}) nor the package reportlab is "
            "installed",
            remedy="`pip install 'pkmcal[pdf]'`, or install one of these browsers, or open "
            "report.html in any browser and print it",
        )
    from app.report.page_layout import print_without_browser

    return "reportlab, plainer than a browser", print_without_browser


def print_by_browser(browser: str, page: Path, pdf: Path) -> None:
    """Print a page on A4; raises `WriteFailed`."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        made = Path(scratch) / "page.pdf"
        # a sandbox is no help for a page of our own, and root has none
        words = [browser, *QUIET, "--no-sandbox", f"--user-data-dir={scratch}/profile"]
        words += [f"--print-to-pdf={made}", "--no-pdf-header-footer", page.resolve().as_uri()]
        try:
            # a browser that is installed, and a file that was just written
            subprocess.run(words, capture_output=True, timeout=PATIENCE_S, check=True)  # noqa: S603
            shutil.copyfile(made, pdf)
        except (OSError, subprocess.SubprocessError) as error:
            raise WriteFailed(
                f"{pdf}: the browser could not print it ({type(error).__name__})",
                remedy="open report.html in a browser and print it from there",
            ) from error
