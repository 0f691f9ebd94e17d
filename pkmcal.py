"""The program's way in: its own packages, or a line that says what hides them.

They have plain names, such as `app`: a folder of that name on Python's path would be taken instead.
"""

import sys
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGES = ("app", "campaigns", "drivers", "sim")
BAD_INPUT = 2
"""Exit code, as `app.exits` has it."""


def main() -> None:
    """Run the command line; leaves with its exit code."""
    for package in PACKAGES:
        spec = find_spec(package)
        found = (
            [*(spec.submodule_search_locations or [spec.origin or "?"])] if spec else ["nothing"]
        )
        if HERE / package not in {Path(place).resolve() for place in found}:
            sys.stderr.write(
                f"pkmcal: {found[0]} stands in the way of pkmcal's own package {package} "
                f"→ take its folder out of PYTHONPATH, or start elsewhere\n"
            )
            sys.exit(BAD_INPUT)
    from app.main import main as run

    run()


if __name__ == "__main__":
    main()
