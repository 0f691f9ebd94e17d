"""Only kinematics and its robot files know a mechanism: nothing else names it or its shape.

Looked through are the work, the door and the part of the instruments that any robot speaks.
Kinematics, robot files, what names the pins of our kinematics module for LinuxCNC, what reads and
writes the files of printers' firmware, and the simulated cell, which is built of one mechanism's
parts, are left out.
"""

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
LOOKED_THROUGH = (
    "campaigns/**/*.py",
    "app/**/*.py",
    "app/**/*.jinja",
    "drivers/*.py",
    "drivers/robotline.py",
    "drivers/wire/robotline*.py",
)
LEFT_OUT = (
    "campaigns/kinematics/",
    "campaigns/controllers/linuxcnc_export.py",
    "drivers/linuxcnc_bridge.py",
    "campaigns/controllers/delta_firmware.py",
    "campaigns/robots/printer_config.py",
)

TELLTALE = {
    "a mechanism's name": r"\bpar4\w*|\bPar4\w*|\bPAR4\w*|\b[Hh]4\b|\b[Ii]4[RrLl]\b"
    r"|\b(?:LINEAR_)?DELTA\b|\bDelta\b|[\"'](?:linear-)?delta[\"']",
    "a platform's turn": r"\btheta\w*|\bTHETA\w*|θ",
    "a platform's parameter": r"\bplate_mm\b|\bpinion_mm\b",
    "a fourth arm": r"\barm3\b|\bq3(?:_\w+)?\b",
    "a number of arms": r"\b(?:three|four|3|4) (?:rotary )?(?:arms|joints|motors|forearms)\b"
    r"|\b\w*(?:JOINTS|ARMS|MOTORS) = \d"
    r"|\brange\(4\)|\([NMn](?:, n)?, 4\)",
    "a number of parameters": r"\b(?:15|20|21|22|29) (?:free )?(?:parameters|values|pins)\b",
    "a unit or an arm in a name": r"endswith\(f?\(?[\"'][._]*(?:deg|mm)\b|removeprefix\([\"']arm"
    r"|startswith\(f?[\"']arm|endswith\([\"']\.?\w+_(?:deg|mm)[\"']",
    "a turn's place": r"\[(?:\.\.\.|:|\w+), 3(?:, None)?\]",
}
EXAMPLE = "an example in a text for people"
LETTER = "the letter of a platform's turn, drawn only where poses have one or a test of it was made"
POSE = "a pose has a turn where the platform turns, and says None elsewhere"
ALLOWED = (
    ("app/new_campaign.py", 'DEFAULT_ROBOT = "par4-prototype"', "the default of an option"),
    ("app/cli/import_shots.py", "name,q0_deg…q3_deg,pair,set", EXAMPLE),
    ("app/report/figures.py", 'GREEK = {"theta": "θ"}', LETTER),
    ("app/cli/import_shots.py", "and may go on with set, theta_deg", EXAMPLE),
    ("app/new_campaign.py", "or a Delta printer's printer.cfg", EXAMPLE),
    ("app/cli/export.py", "the firmware of a Delta printer", EXAMPLE),
    ("campaigns/identification/result.py", '["delta"] = parameter.delta', "a parameter's change"),
    ("drivers/values.py", "theta_rad: float | None = None", POSE),
    ("drivers/values.py", "if self.theta_rad is None", POSE),
)
"""File, a part of the line, and why it may stand there."""


@cache
def texts():
    """Texts by file, of Python without what explains it: comments and docstrings."""
    return {
        name: code_in(path)
        for pattern in LOOKED_THROUGH
        for path in ROOT.glob(pattern)
        if not (name := path.relative_to(ROOT).as_posix()).startswith(LEFT_OUT)
    }


def code_in(path):
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        return text
    return re.sub(r"(?m)(?:^ *|  )# .*$", "", re.sub(r'"""[\s\S]*?"""', "", text))


def line_at(text, place):
    return text[text.rfind("\n", 0, place) + 1 :].partition("\n")[0].strip()


def is_allowed(name, line):
    return any(name == file and part in line for file, part, _ in ALLOWED)


@pytest.mark.parametrize("kind", TELLTALE)
def test_nothing_else_knows(kind):
    found = [
        f"{name}: {line}"
        for name, text in texts().items()
        for line in {line_at(text, hit.start()) for hit in re.finditer(TELLTALE[kind], text)}
        if not is_allowed(name, line)
    ]
    assert not found, "\n".join([f"{kind} outside of the mechanism's file:", *found])
