"""Next command of a campaign, which passes the checks that it makes before it does anything."""

# 1. The state of the campaign proposes a command (`next_step`).
# 2. The command's own checks are made: the functions of `CHECKS` are those that the command calls
#    before anything is measured, fitted or written. No device is opened.
# 3. Where they refuse, the error names options that let the command go ahead (`options`), or in its
#    remedy another command, which is checked in its turn. An error with neither is for people: what
#    it says comes first, and then the command.

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import cast

from campaigns.campaign import Campaign
from campaigns.controllers.export import FILE_NAME, PLAIN, PLAIN_FILE
from campaigns.controllers.load_journal import load_history
from campaigns.errors import PlanInvalid
from campaigns.evidence import REPORT_FILE, refuse_other_report
from campaigns.files.cells import DecimalSign
from campaigns.files.text_file import refuse_overwriting
from campaigns.identification.identify import require_answerable
from campaigns.identification.options import IdentificationOptions
from campaigns.next_step import CampaignState, NextStep, next_step
from campaigns.options import (
    CheckOptions,
    LoadOptions,
    PlanOptions,
    ProgramOptions,
    RunOptions,
    ValidationOptions,
)
from campaigns.robots.printer_config import PRINTER
from campaigns.settings.option import options_of_words
from campaigns.shots.joined_shots import holds_joints
from campaigns.shots.observations_csv import holds_observations
from campaigns.shots.point_files import read_points
from campaigns.shots.point_layout import PointFormat
from campaigns.shots.point_words import LengthUnit
from campaigns.shots.shots_csv import read_shots
from campaigns.workflow.checking import check_to_update_by, check_work
from campaigns.workflow.correction import identified_set
from campaigns.workflow.exporting import FIRMWARE_FILES, usable_identification
from campaigns.workflow.identification import asked_measurements
from campaigns.workflow.loading import nothing_to_take_back, read_wanted
from campaigns.workflow.observation_run import planned_observations
from campaigns.workflow.planning import replaced_observations_plan, replaced_plan
from campaigns.workflow.programs import planned_joints, stage_work
from campaigns.workflow.running import predicted_end, run_preview, run_work
from campaigns.workflow.validation import replaced, validation_work
from drivers.bounded_files import is_there
from drivers.errors import ExplainedError
from drivers.texts import as_word

Words = Sequence[str]
MOST_REFUSALS = 5
"""Number of refusals in a row after which the last one is for people."""
COMMAND = re.compile(r"`pkmcal ((?!status)[a-z-]+ DIR[^`A-Z]*)`")
"""Command in a remedy that can be typed as it stands; `status` remedies nothing."""
UNIT = ("--unit", "mm")
"""Unit of a file that is still to be saved, in which people are asked to save it."""


def next_hint(campaign: Campaign, state: CampaignState) -> NextStep | None:
    """Return the next command by a campaign's state, which it does not refuse; None without any."""
    step = next_step(state)
    if step is None:
        return None
    step = _without_unit(step)
    for _ in range(MOST_REFUSALS):
        refusal = refused(campaign, step.words)
        if refusal is None:
            return step
        further = _answer(campaign, step, refusal, state.plan_options)
        if further is None:
            break
        step = further
    said = f"{refusal.problem} → {refusal.remedy}" if refusal else ""
    return replace(step, first="; ".join(filter(None, (said, step.first))))


def refused(campaign: Campaign, words: Words) -> ExplainedError | None:
    """Return the error by which a command refuses to begin; None if it begins.

    `words` are the command and its words, the campaign's folder the second of them.
    """
    check = CHECKS.get(words[0])
    try:
        if check is not None:
            check(campaign, words)
    except ExplainedError as error:
        return error
    return None


def _answer(
    campaign: Campaign, step: NextStep, refusal: ExplainedError, plan_options: tuple[str, ...]
) -> NextStep | None:
    """Return the command that a refusal names instead; None if it names none.

    `plan_options` are those that plan.csv was made with.
    """
    options = tuple(refusal.options.split())
    if options and options[0] not in step.words:
        # what is overruled has its reason beside it
        why = str(refusal) if "--force" in options and not step.why else step.why
        return replace(step, words=(*step.words, *options), why=why)
    folder = as_word(str(campaign.folder))
    if isinstance(refusal, PlanInvalid):
        step = NextStep(("plan", folder, *plan_options), why=refusal.problem)
        return step if _is_to_plan(campaign) else None
    named = COMMAND.search(refusal.remedy)
    if named is None:
        return None
    words = tuple(folder if word == "DIR" else word for word in named[1].split())
    return NextStep(words, why=refusal.problem) if words != step.words else None


def _is_to_plan(campaign: Campaign) -> bool:
    """Return whether a new plan.csv is needed: this one cannot be run, and none of it is measured.

    A wrong line of a plan that is measured in part is corrected by people.
    """
    try:
        campaign.checked_plan()
    except PlanInvalid:
        return replaced_plan(campaign) is None
    return False


def _without_unit(step: NextStep) -> NextStep:
    """Return an import without the unit of a file that is there: the file may state another."""
    words = step.words
    if words[0] != "import" or not is_there(Path(words[2])):
        return step
    return replace(step, words=(*words[:3], *(word for word in words[3:] if word not in UNIT)))


def _check_plan(campaign: Campaign, words: Words) -> None:
    """Raise what `plan` raises before it chooses poses."""
    programs = options_of_words(ProgramOptions, words)
    if programs.program and options_of_words(PlanOptions, words) == PlanOptions():
        for stage in ("run", "before") if programs.stage is None else (programs.stage,):
            stage_work(campaign, stage)
        return
    if "--force" in words:
        return
    of_observations = "--observe" in words and replaced_observations_plan(campaign)
    if objection := replaced_plan(campaign) or of_observations:
        raise objection


def _check_run(campaign: Campaign, words: Words) -> None:
    """Raise what `run` raises before it connects to the cell."""
    campaign.require_devices()
    if planned_observations(campaign) and not is_there(campaign.plan_path):
        return
    checked = campaign.checked_plan()
    work = run_work(campaign, checked, options_of_words(RunOptions, words))
    predicted_end(campaign, work)
    run_preview(campaign, checked.seconds, work, anew="--anew" in words)


def _check_validation(campaign: Campaign, words: Words) -> None:
    """Raise what `validate` raises before it connects to the cell.

    The controller is taken to hold the set of the stage.
    """
    campaign.require_devices()
    options = options_of_words(ValidationOptions, words)
    if objection := replaced(campaign, options.stage, options.tests):
        raise objection
    is_nominal = options.stage == "before" or options.by == "targets"
    robot = campaign.robot if is_nominal else identified_set(campaign)
    validation_work(campaign, robot.parameters, options)


def _check_import(campaign: Campaign, words: Words) -> None:
    """Raise what `import` raises when it reads a file; one that is still to be made is as asked."""
    file, mechanism = Path(words[2]), campaign.robot.mechanism
    if not is_there(file) or file.suffix == PRINTER or holds_observations(file):
        return
    if holds_joints(file, mechanism):
        read_shots(file, mechanism)
        return
    options = dict(pairwise(words))
    planned_joints(campaign, file, options.get("--stage", "run"))
    unit = cast("LengthUnit | None", options.get("--unit"))
    decimal = cast("DecimalSign | None", options.get("--decimal"))
    read_points(file, PointFormat(unit=unit, decimal=decimal))


def _check_identification(campaign: Campaign, words: Words) -> None:
    """Raise what `identify` raises before it fits."""
    campaign.require_journal()
    with campaign.journal_reader() as journal:
        if "--update" in words:
            check_to_update_by(campaign, journal)
            return
        options = options_of_words(IdentificationOptions, words)
        asked = asked_measurements(campaign, journal, options)
    if asked.shots is not None:
        require_answerable(campaign.robot.kinematics, asked.shots, asked.options, asked.measured)


def _check_export(campaign: Campaign, words: Words) -> None:
    """Raise what `export` raises before it computes a file."""
    form = dict(pairwise(words)).get("--format")
    names = {PLAIN: PLAIN_FILE, **{str(word): name for word, name in FIRMWARE_FILES.items()}}
    file = campaign.path(names.get(form or "", FILE_NAME))
    refuse_overwriting(file, overwrite="--force" in words)  # first: the journal may be long
    with campaign.journal_reader() as journal:
        usable_identification(campaign, journal)


def _check_load(campaign: Campaign, words: Words) -> None:
    """Raise what `load` raises before it connects to the controller."""
    campaign.require_devices()
    options = options_of_words(LoadOptions, words)
    if not options.rollback:
        read_wanted(campaign, options)
        return
    with campaign.journal_reader() as journal:
        if load_history(journal) == ((), None):
            raise nothing_to_take_back(campaign)


def _check_check(campaign: Campaign, words: Words) -> None:
    """Raise what `check` raises before it connects to the cell."""
    campaign.require_devices()
    work = check_work(campaign, options_of_words(CheckOptions, words))
    run_preview(campaign, 0.0, work, anew="--anew" in words)


def _check_report(campaign: Campaign, _: Words) -> None:
    """Raise what `report` raises before it reads the campaign."""
    refuse_other_report(campaign.path(REPORT_FILE))


CHECKS: Mapping[str, Callable[[Campaign, Words], None]] = {
    "plan": _check_plan,
    "run": _check_run,
    "validate": _check_validation,
    "import": _check_import,
    "identify": _check_identification,
    "export": _check_export,
    "load": _check_load,
    "check": _check_check,
    "report": _check_report,
}
"""Checks by which a command refuses to begin, by its name."""
