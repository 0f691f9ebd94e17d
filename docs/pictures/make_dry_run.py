"""Draws dry-run.svg anew: what `pkmcal dry-run` answers on a terminal.

python docs/pictures/make_dry_run.py
"""

import io
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.text import Text

PICTURE = Path(__file__).with_name("dry-run.svg")
COMMAND = ("dry-run", "my-first-campaign")
WIDTH = 80
COMBINING_MACRON = "\N{COMBINING MACRON}"
"""Rich gives it a place of its own in a picture, and the columns behind it would not stand."""
WEB_FONTS = re.compile(r"@font-face \{.*?\}", re.DOTALL)


def main() -> None:
    """Run the command and draw its answers."""
    prompt = Text(f"$ pkmcal {' '.join(COMMAND)}\n", style="bold")
    PICTURE.write_text(drawn(prompt + Text.from_ansi(printed())), encoding="utf-8")


def printed() -> str:
    """Return the answers with their colours; progress goes to stderr and is left out."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(  # noqa: S603 - our own command, no input from anywhere
            [Path(sys.executable).with_name("pkmcal"), *COMMAND],
            cwd=folder,
            env=os.environ | {"FORCE_COLOR": "1", "COLUMNS": str(WIDTH)},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            check=True,
            encoding="utf-8",
        )
    return done.stdout.replace(COMBINING_MACRON, "")


def drawn(text: Text) -> str:
    """Return the text as an SVG that looks nothing up elsewhere."""
    console = Console(record=True, width=WIDTH, file=io.StringIO(), force_terminal=True)
    console.print(text)
    return WEB_FONTS.sub("", console.export_svg(title="pkmcal", unique_id="dry-run"))


if __name__ == "__main__":
    main()
