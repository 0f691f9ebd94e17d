"""PDF of a page, printed by an installed browser."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from campaigns.errors import OptionsInvalid, WriteFailed

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge")
QUIET = ("--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking")
PATIENCE_S = 120.0


def find_browser() -> str:
    """Return the path of an installed browser; raises `OptionsInvalid` if there is none."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise OptionsInvalid(
            f"--pdf: no browser is installed that can print it ({', '.join(BROWSERS)})",
            remedy="install chromium, or open report.html in any browser and print it",
        )
    return browser


def print_by_browser(browser: str, page: Path, pdf: Path) -> None:
    """Print a page on A4; raises `WriteFailed`."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        made = Path(scratch) / "page.pdf"
        words = [browser, *QUIET, f"--user-data-dir={scratch}/profile"]
        if os.geteuid() == 0:  # Chromium refuses to start its sandbox as root
            words.append("--no-sandbox")
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
