"""Every hint is a command that can be typed, whatever options the commands before it had."""

import re
import shlex
import shutil
from dataclasses import fields
from enum import Enum
from typing import get_args, get_type_hints

import pytest
from command_line import SMALL_TESTS, change

from app.main import run_command
from app.monitor.live_state import live_state
from campaigns.identification.options import IdentificationOptions
from campaigns.options import PlanOptions, RunOptions
from campaigns.settings.option import Option

VALUES = {
    "PlanOptions": {"shots": ("10",), "seed": ("3",), "until": ("5",), "placement": ("boundary",)},
    "RunOptions": {"until": ("5",), "skip": ("3",), "retry": ("1",)},
    "IdentificationOptions": {
        "prior": ("arm*.arm_mm=0.05",),
        "shots": ("0-14",),
        "hold_out": ("20%",),
        "free": (),
        "model": ("full", "paper", "paper --free arm1.azimuth_deg"),
    },
    "": {"fix": ("arm2.*",)},
}
"""Values of options that are no words of a list, by class; of any class by the empty name."""
TOGETHER = {
    PlanOptions: "--placement optimal --shots 12 --seed 3 --fix arm2.*",
    RunOptions: "--until 5 --skip 3",
    IdentificationOptions: "--prior arm*.arm_mm=0.05 --fix arm2.* --hold-out 20%",
}
"""Several options in one command."""
SMALL = {"plan.shots": 40, "plan.validation_pairs": 1, **SMALL_TESTS}
FAST = {"speed_up": 10_000}
CONFIRMED = {"run", "validate", "load"}
"""Commands that ask before they move the robot or write into its controller."""


def every_option(options):
    """None, each option alone, and several together."""
    hints = get_type_hints(options, include_extras=True)
    yield from ("", TOGETHER[options])
    for field in fields(options):
        option = getattr(hints[field.name], "__metadata__", (None,))[-1]
        if isinstance(option, Option):
            name = option.name or f"--{field.name.replace('_', '-')}"
            yield from (f"{name} {value}" for value in values_of(options, field, hints))


def values_of(options, field, hints):
    known = {**VALUES[""], **VALUES[options.__name__]}
    if field.name in known:
        return known[field.name]
    kinds = (hints[field.name].__origin__, *get_args(hints[field.name].__origin__))
    enums = (kind for kind in kinds if isinstance(kind, type) and issubclass(kind, Enum))
    return [[*enum][-1].value for enum in enums] or [""]


def typed_by(options):
    return pytest.mark.parametrize("options", [*every_option(options)])


class Typist:
    """Types commands on one campaign, and what is said to be next after them."""

    def __init__(self, pkmcal, folder):
        self.folder = folder
        self._pkmcal = pkmcal

    def types(self, command, options=""):
        yes = ["--yes"] if command in CONFIRMED else []
        return self._pkmcal(command, self.folder, *options.split(), *yes)

    def hints(self, ended):
        """Commands that are next: of the last command, status, its --json and the live page."""
        status, document = self.types("status").out, self.types("status", "--json").document
        page = live_state(self.folder)
        lines = [*ended.err.splitlines(), *status.splitlines(), f"next: {page['next']}"]
        said = [re.search(r"^next: .*?(pkmcal .*?)(?: \(.*)?$", line) for line in lines]
        commands = {match[1] for match in said if match}
        assert len([match for match in said if match]) >= 3, ended
        return commands | {document["next"]}

    def follows(self, ended):
        """Type every hint; a command of the right form ends well, or says what it did not find."""
        for hint in sorted(self.hints(ended)):
            _, command, folder, *words = shlex.split(hint)
            assert folder == str(self.folder)
            there = Typist(self._pkmcal, self.folder.with_name(f"then-{command}"))
            shutil.copytree(self.folder, there.folder)
            answer = there.types(command, shlex.join(words))
            assert answer.code in {0, 1}, (hint, answer.err)
            shutil.rmtree(there.folder)


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    """Folders of one campaign on a fast simulated robot: validated before, and measured."""
    before, measured = (tmp_path_factory.mktemp("hints") / stage for stage in ("a", "b"))
    run_command(["new", str(before), "--robot", "delta", "--scenario", "drawn-robots"])
    change(before / "campaign.yaml", SMALL)
    change(before / "cell.yaml", FAST)
    run_command(["plan", str(before)])
    pairs = ["--only", "distances", "--yes"]
    run_command(["validate", str(before), "--stage", "before", *pairs])
    shutil.copytree(before, measured)
    assert run_command(["run", str(measured), "--yes"]) == 0
    return {"before": before, "measured": measured}


@pytest.fixture
def at(stages, tmp_path, pkmcal):
    """A person at a copy of the campaign at a stage."""

    def come(stage):
        return Typist(pkmcal, shutil.copytree(stages[stage], tmp_path / stage))

    return come


@typed_by(PlanOptions)
def test_hints_after_a_plan_can_be_typed(at, options):
    typist = at("before")
    planned = typist.types("plan", options)
    assert typist.hints(planned) == {f"pkmcal run {typist.folder}"}


@typed_by(RunOptions)
def test_hints_after_a_run_can_be_typed(at, options):
    typist = at("before")
    ran = typist.types("run", options)
    assert typist.hints(ran) == {f"pkmcal identify {typist.folder}"}


@typed_by(IdentificationOptions)
def test_hints_after_an_identification_can_be_typed(at, options):
    typist = at("measured")
    typist.follows(typist.types("identify", options))


def test_hints_after_options_of_all_commands_can_be_typed(at):
    typist = at("before")
    for command, options in zip(("plan", "run", "identify"), TOGETHER.values(), strict=True):
        typist.follows(typist.types(command, options))
