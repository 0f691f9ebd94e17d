"""Print the lowest versions that pyproject.toml allows of what the product needs, one a line.

As a file of constraints for pip: `pip install --constraint`. What users may install beside it
(`cluster`, `pandas`) is among them; tools of the developers have no bounds that count.
"""

import re
import sys
import tomllib
from itertools import chain
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent / "pyproject.toml"
EXTRAS = ("cluster", "pandas")
BOUND = re.compile(r"([A-Za-z0-9._-]+)>=([0-9.]+)")


def constraints() -> list[str]:
    """Return each dependency with its bound; raise `ValueError` for one without."""
    lines = ["pyparsing<3.3"]  # a Matplotlib of then calls it by names that it warns of since
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    extras = (project["optional-dependencies"][name] for name in EXTRAS)
    for line in chain(project["dependencies"], *extras):
        if not (bound := BOUND.fullmatch(line)):
            raise ValueError(f"{line}: must be NAME>=VERSION")
        lines.append("==".join(bound.groups()))
    return lines


if __name__ == "__main__":
    sys.stdout.write("".join(f"{line}\n" for line in constraints()))
