"""One next step for whatever a campaign has reached, and no advice that leads back."""

import os
import shlex
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal

import pytest
from changed_results import with_fields
from paper_campaign import MECHANISM, PaperCampaign, new_campaign

from campaigns.assessment import Evaluation, evaluate
from campaigns.campaign import open_campaign
from campaigns.controllers.export import PLAIN, PLAIN_FILE, WrittenSet
from campaigns.evaluation.decision import NO_LIMIT, Decision
from campaigns.evidence import Evidence, Incident, MeasuredSeries, gather, joints_path, program_path
from campaigns.identification import findings
from campaigns.identification.checking import RecordedCheck
from campaigns.identification.findings import Finding
from campaigns.identification.result import IdentifiedParameter, Judgement
from campaigns.journal.records import Event
from campaigns.kinematics.parameters import Parameters
from campaigns.measuring.monitors import WRONG_PLACE
from campaigns.next_step import (
    COVER,
    LOOK,
    CampaignState,
    NextStep,
    next_step,
    remedy_for,
    state_of,
)
from campaigns.options import CheckOptions
from campaigns.planning.plan_file import write_plan
from campaigns.robots.reduced_form import ReducedForm
from campaigns.settings.config import CampaignConfig
from campaigns.settings.sections import OFFLINE
from campaigns.shots.import_export import FILES_KEY, ImportedFile
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.checking import check_work
from campaigns.workflow.status import doubtful
from campaigns.workflow.work import known_sets

FAILING = (
    findings.BEYOND_TOLERANCE,
    findings.SCATTER,
    findings.CHANGE,
    findings.KNOWN_LENGTH,
    findings.NOTHING_UNSEEN,
    findings.EXTRAPOLATION,
)
MEASURED = {"measured": "run", "planned": True}
PASSED = {**MEASURED, "verdict": "pass"}


def identified(name: str, asked: tuple[str, ...] = (), **numbers: float | str) -> Any:
    """An identification against which one thing stands."""
    finding = Finding(name, "", "fail", {"before_shot": 60.0, **numbers})
    judgement = Judgement(verdict="fail", reasons=(), obstacles=(name,), findings=(finding,))
    provenance = SimpleNamespace(asked=asked, pedigree=None, series=1)
    return SimpleNamespace(judgement=judgement, provenance=provenance)


def words_of(step: NextStep) -> str:
    """The command without the folder."""
    command, _, *options = shlex.split(step.text)[1:]
    return " ".join((command, *options))


def outcomes(state: CampaignState, step: NextStep) -> Iterator[CampaignState]:
    """All that may come of typing the step; nothing once somebody measures anew by hand."""
    words = step.text.split()[1:]
    match words[0], tuple(words[2:]):
        case ("import" | "run", (*_, "--force") | ("--anew",)) | ("plan" | "report", _) if (
            step.first and state.verdict
        ):
            return
        case "identify", options:
            here = replace(state, check="")
            is_printer = state.offline and state.measured == "observations"
            for missing in ("yaml", "plain", *(["klipper"] if is_printer else [])):
                yield replace(here, verdict="pass", remedy="", to_export=missing)
            for name in FAILING:
                found = identified(name, () if options == ("--update",) else options)
                remedy, first = remedy_for(found)
                if name == findings.EXTRAPOLATION and state.measured in {"import", "run"}:
                    remedy, first = "plan {folder} {plan_options}", COVER
                yield replace(here, verdict="fail", remedy=remedy, remedy_first=first)
        case "check", _:
            yield from (replace(state, check=answer) for answer in ANSWERS)
        case (("validate" | "import"), options) if "after" in options:
            is_plain = state.file == PLAIN_FILE and "targets" not in options
            for after in ("worse", "fail", "not decided", NO_LIMIT, "pass"):
                yield replace(state, after=after, by_targets=False, plain=is_plain)
        case command, options:
            yield replace(state, **CHANGED[(command, *options[:3])])


CHANGED: dict[tuple[str, ...], dict[str, Any]] = {
    ("plan",): {"planned": True, "misplaced": ""},
    ("plan", "--program", "csv"): {"program": True},
    ("plan", "--program", "csv", "--stage"): {"program_after": True},
    ("validate", "--stage", "before"): {"before": True},
    ("import", "before.txt", "--stage", "before"): {"before": True},
    ("import", "run.txt", "--unit", "mm"): {"measured": "import"},
    ("import", "observations.csv"): {"measured": "observations"},
    ("import", "DIR/observations.csv"): {"measured": "observations"},
    ("run",): {"measured": "run", "unmeasured": False},
    ("export",): {"to_export": ""},
    ("export", "--format", "klipper"): {"to_export": "", "file": "klipper.cfg"},
    ("export", "--format", "plain"): {"to_export": "", "file": PLAIN_FILE},
    ("load",): {"holds": True},
    ("load", "--robot", f"DIR/{PLAIN_FILE}"): {"holds": True},
    ("load", "--rollback"): {"holds": False, "by_targets": True},
    ("report",): {"reported": True},
}
"""What a step changes that has one outcome, by its words."""
ANSWERS: tuple[Literal["", "update", "anew"], ...] = ("", "update", "anew")


def test_no_advice_leads_back_and_all_end() -> None:
    """From an empty folder, over all that may come of each step, to the end of each way."""
    under_way, done = set[CampaignState](), set[CampaignState]()

    def walk(state: CampaignState) -> None:
        if state in done:
            return
        assert state not in under_way, f"a circle at {state}"
        step = next_step(state)
        under_way.add(state)
        for further in outcomes(state, step) if step else ():
            assert further != state, f"{step} changes nothing"
            if state.offline and step:
                assert step.text.split()[1] not in {"devices", "run", "validate", "load", "check"}
            walk(further)
        under_way.remove(state)
        done.add(state)

    walk(CampaignState())
    walk(CampaignState(planned=True, before=True, misplaced="1 m off"))
    walk(CampaignState(offline=True))
    walk(CampaignState(to_observe=True))
    walk(CampaignState(offline=True, objects=True))
    walk(CampaignState(offline=True, objects=True, to_observe=True))
    walk(CampaignState(**MEASURED, unmeasured=True))  # type: ignore[arg-type]
    for check, by_targets in product((*ANSWERS, "again"), (False, True)):
        walk(CampaignState(**PASSED, check=check, by_targets=by_targets))  # type: ignore[arg-type]
    assert len(done) > 100


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ({}, f"{LOOK}; `devices DIR` asks both devices, then: plan DIR"),
        ({"answered": True}, f"{LOOK}, then: plan DIR"),
        (
            {**MEASURED, "unmeasured": True, "worker": "process 7"},
            "wait, or follow with `watch DIR` (process 7 works on this campaign), then: status DIR",
        ),
        ({**PASSED, "file": "elsewhere.yaml"}, "load DIR --robot DIR/elsewhere.yaml"),
    ],
)
def test_step_names_a_command_that_can_be_typed(state: dict[str, Any], says: str) -> None:
    step = next_step(CampaignState(**state))
    assert step is not None
    assert step.says.replace("pkmcal ", "") == says


@pytest.mark.parametrize(
    ("identification", "command"),
    [
        (identified(findings.CHANGE), "identify {folder} --only-shots 60-"),
        (identified(findings.CHANGE, ("--fix", "a")), ""),
        (identified(findings.CHANGE, last_shot=80.0), ""),
        (identified(findings.NOTHING_UNSEEN), "identify {folder} --hold-out 20%"),
        (identified(findings.SCATTER), ""),
        (identified(findings.BEYOND_TOLERANCE, parameter="scale"), ""),
        (
            identified(findings.BEYOND_TOLERANCE, parameter="arm1.arm_mm"),
            "identify {folder} --force",
        ),
    ],
)
def test_remedy_follows_the_first_finding(identification: Any, command: str) -> None:
    """An empty command stands for new shots."""
    assert remedy_for(identification)[0] == command


@pytest.fixture(scope="module")
def evidence(whole: PaperCampaign) -> Evidence:
    """Evidence of a whole campaign; tests replace parts of it."""
    return gather(open_campaign(whole.folder))


def advised(evidence: Evidence, **changes: Any) -> str:
    """Words of the step that follows from changed evidence, once the report is made."""
    step = next_step(state_of(Evaluation(replace(evidence, **changes)), reported=True))
    assert step is not None
    return words_of(step).replace(f"{evidence.campaign.folder}/", "")


def test_evidence_says_what_a_campaign_has_reached(evidence: Evidence) -> None:
    """What is there of a whole campaign, with one thing after the other taken away."""
    runs = tuple(each for each in evidence.journal.series if each.started.stage == "run")
    unfinished = tuple(replace(each, finished=False) for each in runs)
    assert words_of(next_step(state_of(Evaluation(evidence)))) == "report"
    taken: dict[str, object] = {}
    for part, says in (
        ({"after": ()}, "validate --stage after"),
        ({"loaded": None}, "load"),
        ({"parameter_file": None}, "export"),
        ({"identification": None}, "identify"),
        ({"journal": replace(evidence.journal, series=unfinished)}, "run"),
        ({"journal": None, "before": ()}, "validate --stage before"),
        ({"plan": None}, "plan"),
    ):
        taken |= part
        assert advised(evidence, **taken) == says, part


def test_spoilt_parameter_file_is_exported_again(evidence: Evidence) -> None:
    spoilt = {"parameter_file": None, "spoilt_parameter_file": True}
    assert advised(evidence, **spoilt) == "export"
    assert Evaluation(replace(evidence, **spoilt)).verdict.decision == "not decided"


def test_what_is_loaded_after_a_validation_is_validated_too(evidence: Evidence) -> None:
    """The nominal set, a form of what was validated, and parameters beside corrected targets."""
    nominal = evidence.campaign.robot.digest()
    form = ReducedForm(evidence.loaded.digest, 0.1, 0.2, 0.1, PLAIN)
    known = replace(evidence, sets=replace(evidence.sets, forms={"f": form}))
    last = evidence.after[-1]

    def after(**started: str) -> tuple[MeasuredSeries, ...]:
        changed = replace(last.series, started=replace(last.series.started, **started))
        return (replace(last, series=changed),)

    lost = after(robot_file_digest=nominal)
    assert advised(known, after=lost) == "load", "the controller did not keep what was loaded"
    later = replace(evidence.loaded, at_utc="2999-01-01T00:00:00+00:00")
    for changes, says in (
        ({"loaded": replace(later, digest=nominal)}, "load"),
        ({"loaded": replace(later, digest="f")}, "validate --stage after"),
        ({"loaded": later, "after": after(stage="after by targets")}, "validate --stage after"),
        ({"loaded": later}, "report"),
        ({"loaded": replace(evidence.loaded, digest="f")}, "report"),
        ({"parameter_file": SimpleNamespace(digest=lambda: "f")}, "report"),
    ):
        assert advised(known, **changes) == says, changes
        checks = Evaluation(replace(known, **changes)).checks
        since = [check.holds for check in checks if "holds now" in check.statement]
        assert since == ([] if says == "report" else [False]), changes


def test_a_validation_counts_until_the_controller_holds_another_set(evidence: Evidence) -> None:
    """Unless it was rolled back: that validation is the reason, and leads to corrected targets."""
    nominal = evidence.campaign.robot.digest()
    verdict = state_of(Evaluation(evidence)).after
    assert verdict
    assert state_of(Evaluation(evidence), held=evidence.sets.state(nominal)).after == ""
    later = "2999-01-01T00:00:00+00:00"
    rollback = replace(evidence.loaded, digest=nominal, at_utc=later, rolls_back=1)
    state = state_of(Evaluation(replace(evidence, loaded=rollback)))
    assert (state.after, state.holds, state.by_targets) == (verdict, False, True)


def test_a_new_campaign_is_planned_once_its_plan_can_be_read(tmp_path: Path) -> None:
    paper = new_campaign(tmp_path / "c")
    paper.campaign.plan_path.write_text("shot")
    assert not state_of(evaluate(paper.campaign)).planned
    write_plan(paper.campaign.plan_path, paper.plan(1, 1), MECHANISM)
    assert state_of(evaluate(paper.campaign)).planned


def test_a_report_counts_until_journal_or_settings_change(
    evidence: Evidence, tmp_path: Path
) -> None:
    campaign = replace(evidence.campaign, folder=tmp_path)
    (tmp_path / "campaign.yaml").write_text("name: paper\n")
    evaluation = Evaluation(replace(evidence, campaign=campaign))
    report, digest = tmp_path / "report.html", evidence.journal.digest
    for text, is_reported in ((digest, True), ("of another journal", False)):
        report.write_text(text)
        assert state_of(evaluation).reported == is_reported
    report.write_text(digest)
    os.utime(report, (0, 0))
    assert not state_of(evaluation).reported


def test_a_tracker_that_stands_elsewhere_is_said_until_its_place_is_set(evidence: Evidence) -> None:
    campaign, journal = evidence.campaign, evidence.journal
    said = Event("tracker place", f"{WRONG_PLACE} (1, 2, 3) mm, campaign.yaml says …; correct it")
    last = journal.series[-1]
    place_mm = list(campaign.config.tracker.place_mm)
    started = replace(last.started, configuration={"tracker": {"place_mm": place_mm}})
    series = (*journal.series[:-1], replace(last, started=started))
    journal = replace(journal, series=series, incidents=(Incident("", last.number, said),))
    misplaced = replace(evidence, journal=journal)
    assert state_of(Evaluation(misplaced)).misplaced.startswith(WRONG_PLACE)
    tracker = campaign.config.tracker.model_copy(update={"place_mm": (1.0, 2.0, 3.0)})
    config = campaign.config.model_copy(update={"tracker": tracker})
    corrected = replace(misplaced, campaign=replace(campaign, config=config))
    assert not state_of(Evaluation(corrected)).misplaced


def test_a_form_that_the_controller_takes_is_loaded_and_else_written(evidence: Evidence) -> None:
    """By a controller without tilts and backlash, before all parameters are exported."""
    terms = {"arm1.axis_tilt_deg": 0.02, "arm2.backlash_deg": 0.01}
    added = {
        name: IdentifiedParameter(nominal=0.0, value=value, std=0.001, free=True)
        for name, value in terms.items()
    }
    parameters = evidence.identification.value.parameters | added
    identification = with_fields(evidence.identification, parameters=parameters)
    whole_set = identification.value.parameter_set(MECHANISM)
    plain = {name: value for name, value in whole_set.items() if name not in terms}
    series = tuple(
        replace(each, started=replace(each.started, lacks=tuple(terms)))
        for each in evidence.journal.series
    )
    lacking = replace(
        evidence,
        identification=identification,
        journal=replace(evidence.journal, series=series),
        parameter_file=None,
        loaded=None,
    )

    def form(of: str = whole_set.digest(), file: str = PLAIN_FILE) -> WrittenSet:
        parameters = Parameters.of(MECHANISM.parameters, plain)
        return WrittenSet.of(file, parameters, projection=ReducedForm(of, 0.1, 0.2, 0.1, PLAIN))

    for forms, says in (
        ((), "export --format plain"),
        ((form("older"),), "export --format plain"),
        ((form("older", "elsewhere.yaml"),), "export --format plain"),
        ((form(),), "load --robot robot-plain.yaml"),
        ((form(file="elsewhere.yaml"), form()), "load --robot elsewhere.yaml"),
    ):
        assert advised(lacking, forms=forms) == says, forms


@pytest.mark.parametrize(
    ("decision", "parts", "wrong", "p", "answer"),
    [
        ("fail", ("encoder 2",), (), 0.5, "update"),
        ("fail", ("encoder 2",), (5,), 0.5, "update"),
        ("fail", (), (), 0.0, "anew"),
        ("fail", (), (3, 5), 0.0, "anew"),
        ("fail", (), (3, 5), 0.5, "again"),
        ("not decided", (), (5,), 0.5, "again"),
        ("not decided", (), (), 1.0, "again"),
    ],
)
def test_a_bad_check_is_doubtful_until_new_shots_answer_it(
    evidence: Evidence,
    decision: Decision,
    parts: tuple[str, ...],
    wrong: tuple[int, ...],
    p: float,
    answer: str,
) -> None:
    digest = evidence.identification.value.parameter_set(MECHANISM).digest()
    check = RecordedCheck(
        decision=decision, says="not good", shots=8, chi2=99.0, dof=18, p=p, parts=parts,
        wrong=wrong, log_factors={}, series=50, of=digest, at_utc="",
    )  # fmt: skip
    assert answer_to(evidence, check) == answer
    assert answer_to(evidence, replace(check, decision="pass")) == ""
    assert answer_to(evidence, replace(check, of="of other parameters")) == "again"
    (run,) = (each for each in evidence.journal.series if each.to_identify)
    later = replace(evidence.journal, series=(*evidence.journal.series, replace(run, number=99)))
    assert replace(evidence, journal=later, checked=check).unanswered is None


def answer_to(evidence: Evidence, check: RecordedCheck) -> str:
    """The answer to a check, of which state, status and checks say the same."""
    evaluation = Evaluation(replace(evidence, checked=check))
    answer = state_of(evaluation).check
    said = [check.says in each for each in doubtful(evaluation)]
    assert said.count(True) == bool(answer)
    changed = "the robot is as it was identified"
    holds = [each.holds for each in evaluation.checks if each.statement == changed]
    assert holds == ([False] if answer and check.decision == "fail" else [])
    return answer


def test_a_check_is_of_the_set_that_files_and_other_findings_name(whole: PaperCampaign) -> None:
    campaign = open_campaign(whole.folder)
    work = check_work(campaign, CheckOptions())
    assert known_sets(campaign).state(work.robot_file_digest).kind == "identified"


def test_space_that_the_shots_do_not_cover_is_answered_by_a_plan(evidence: Evidence) -> None:
    """With the options of the last one, and twice as many shots once that was measured."""
    judgement = Judgement(
        verdict="not decided", reasons=("7 %",), obstacles=(findings.EXTRAPOLATION,)
    )
    identification = replace(evidence.identification, judgement=judgement)
    uncovered = replace(
        evidence, identification=identification, plan_options=("--seed", "5", "--until", "0.1")
    )
    shots = 2 * sum(row.purpose is ShotSet.IDENTIFICATION for row in evidence.plan)
    for changes, says in (
        ({"plan": None}, "plan --seed 5 --until 0.1"),
        ({}, f"plan --seed 5 --shots {shots}"),
    ):
        assert advised(uncovered, **changes) == says
    step = next_step(state_of(Evaluation(uncovered)))
    assert step.first == COVER


def test_an_import_that_leaves_space_out_is_followed_by_a_plan_its_program_and_its_points(
    evidence: Evidence, tmp_path: Path
) -> None:
    """Each in its turn: the joints of the program show whether its shots are imported."""
    campaign = replace(evidence.campaign, folder=tmp_path, config=offline(evidence.campaign.config))
    judgement = Judgement(verdict="fail", reasons=("7 %",), obstacles=(findings.EXTRAPOLATION,))
    identification = replace(evidence.identification, judgement=judgement)
    joints = joints_path(tmp_path, "run")
    joints.write_text("name,q0_deg")

    def advised_after(files: tuple[ImportedFile, ...], **changes: Any) -> str:
        (run,) = (each for each in evidence.journal.series if each.to_identify)
        named = {FILES_KEY: [{"name": file.name, "sha256": file.sha256} for file in files]}
        started = replace(run.started, stage="import", configuration=named)
        journal = replace(evidence.journal, series=(replace(run, started=started),))
        imported = {"campaign": campaign, "journal": journal, "identification": identification}
        return advised(evidence, **imported, **changes)

    assert advised_after((), plan=None) == "plan"
    assert advised_after(()) == "plan --program csv"
    program_path(tmp_path, "run").write_text(f"shot,program\n,sha256 {evidence.plan_digest}")
    assert advised_after(()) == "import run.txt --unit mm --force"
    shots = 2 * sum(row.purpose is ShotSet.IDENTIFICATION for row in evidence.plan)
    assert advised_after((ImportedFile.of(joints),)) == f"plan --shots {shots}"


def offline(config: CampaignConfig) -> CampaignConfig:
    """The settings of a campaign without devices."""
    controller = config.controller.model_copy(update={"url": OFFLINE})
    return config.model_copy(update={"controller": controller})
