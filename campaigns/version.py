"""Version of the software, and the commit that it was built from."""

import subprocess
from contextlib import suppress
from pathlib import Path

VERSION = "0.1.0"
COMMIT_FILE = "commit.txt"
"""Name of a file that is written beside this one when a wheel or an sdist is built."""
WITHIN_S = 5.0


def commit(package: Path = Path(__file__).parent) -> str:
    """Return the short name of the commit of this software; "" if unknown."""
    # an installed package has the file; a checkout has none, and git answers
    built, checkout = package / COMMIT_FILE, package.parent
    if built.is_file():
        return built.read_text(encoding="utf-8").strip()
    if not (checkout / ".git").exists():
        return ""
    command = ["git", "-C", str(checkout), "rev-parse", "--short", "HEAD"]
    with suppress(OSError, subprocess.SubprocessError):
        done = subprocess.run(  # noqa: S603 - our own words
            command, capture_output=True, encoding="utf-8", check=True, timeout=WITHIN_S
        )
        return done.stdout.strip()
    return ""
