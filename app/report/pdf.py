"""PDF of a page, as a browser prints it."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from campaigns.errors import OptionsInvalid, WriteFailed

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge")
QUIET = ("--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking")
PATIENCE_S = 120.0


def find_browser() -> str:
    """Path of a browser that prints; raises `OptionsInvalid` where there is none."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        raise OptionsInvalid(
            f"--pdf: none of {', '.join(BROWSERS)} is installed",
            remedy="install one of them, or open report.html in any browser and print it",
        )
    return found


def print_pdf(browser: str, page: Path, pdf: Path) -> None:
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
