"""A real browser for tests: Chromium without a window, in a profile of its own."""

import json
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome")
QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--hide-scrollbars",
    "--enable-logging=stderr",
)
TIMEOUT_S = 60.0
MEASURED = re.compile(r'<pre id="measured">(.*?)</pre>', re.DOTALL)


@dataclass(frozen=True)
class Browser:
    """Opens pages; each call is a process that has ended when it returns."""

    path: str

    def console(self, page: Path) -> list[str]:
        """What the page writes to the browser's console, and what it asks for in vain."""
        talk = self._run("--dump-dom", page.as_uri()).stderr
        return [line for line in talk.splitlines() if "CONSOLE" in line]

    def measure(self, page: Path, width: int, expression: str) -> object:
        """The value of an expression on the page in a window of that width."""
        script = f"document.getElementById('measured').textContent = JSON.stringify({expression})"
        copy = page.with_name(f"measured-{width}.html")
        added = f'<pre id="measured" hidden></pre><script>{script}</script></body>'
        copy.write_text(page.read_text(encoding="utf-8").replace("</body>", added), "utf-8")
        dom = self._run(f"--window-size={width},1200", "--dump-dom", copy.as_uri()).stdout
        dom = dom.replace('<pre id="measured" hidden="">', '<pre id="measured">')
        found = MEASURED.search(dom)
        assert found is not None, "the script did not run"
        return json.loads(found[1].replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">"))

    def print_pdf(self, page: Path, pdf: Path) -> None:
        """What the browser's print makes of the page."""
        self._run(f"--print-to-pdf={pdf}", "--no-pdf-header-footer", page.as_uri())

    def _run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            return subprocess.run(
                [self.path, *QUIET, f"--user-data-dir={profile}", *arguments],
                capture_output=True,
                text=True,
                timeout=TIMEOUT_S,
                check=True,
            )


def find_browser() -> Browser | None:
    """The system's Chromium."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    return None if found is None else Browser(found)
