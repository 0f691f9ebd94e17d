"""One next step for whatever a campaign has reached, and no advice that leads back."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import pytest
from paper_campaign import MECHANISM, PaperCampaign, new_campaign

from campaigns.campaign import Campaign, open_campaign
from campaigns.campaign_state import present_state, state_of
from campaigns.controllers.export import PLAIN, PLAIN_FILE, WrittenSet
from campaigns.evaluation.decision import Decision
from campaigns.evidence import Evaluation, Evidence, evaluate, gather
from campaigns.identification import findings
from campaigns.identification.checking import RecordedCheck
from campaigns.identification.findings import Finding
from campaigns.identification.result import IdentifiedParameter, RecordedIdentification
from campaigns.kinematics.parameters import Parameters
from campaigns.next_step import Answer, CampaignState, NextStep, next_step
from campaigns.planning.plan_file import write_plan
from campaigns.robots.reduced_form import ReducedForm
from campaigns.way_on import BUILT_SO, way_on
from campaigns.workflow.status import doubtful

FAILING = (
    findings.BEYOND_TOLERANCE,
    findings.SCATTER,
    findings.WORSE,
    findings.NOT_TAKEN,
    findings.WRONG_SHOTS,
    findings.KNOWN_LENGTH,
)
OPEN = (findings.NOTHING_UNSEEN, findings.HOLD_OUT, findings.EXTRAPOLATION, findings.NO_POSITIONS)
CHANGES = (60.0, 20.0, 110.0)
"""Numbers of the first shot after a change."""
DEVICES = {"devices", "run", "validate", "load", "check"}
ANSWERS: tuple[Answer, ...] = ("", "update", "anew")
OFFLINE = ("plan", "program", "before", "import", "identify", "export", "program", "after")
ANEW = "mend what the findings name, then: run DIR --anew"


def is_another_campaign(state: CampaignState, step: NextStep) -> bool:
    """Whether a person has mended something, and measures anew, or has corrected a limit."""
    match step.command:
        case ("import", _, "FILE"):
            return bool(state.measured)
        case ("run" | "report" | "check", *_):
            return bool(step.first)
    return False


@dataclass(frozen=True, slots=True)
class Place:
    """A state, and what of the campaign the next identification depends on."""

    state: CampaignState
    shots: int = 120
    asked: tuple[str, ...] = ()


def identified(
    place: Place, verdict: str, name: str, before_shot: float = 60.0
) -> RecordedIdentification:
    """An identification against which one thing stands."""
    finding = Finding(name, "", "fail", {"before_shot": before_shot})
    return RecordedIdentification(
        model="full",
        converged=True,
        iterations=1,
        parameters={},
        findings=(finding,),
        verdict=verdict,  # type: ignore[arg-type] # one of three words
        reasons=(),
        obstacles=(name,),
        series=1,
        robot_digest="",
        plan_digest="",
        journal_digest="",
        journal_records=1,
        at_utc="",
        asked=place.asked,
    )


def way(place: Place, found: RecordedIdentification) -> NextStep:
    """The step after an identification."""
    imported = place.state.measured == "import"
    return way_on(found, range(place.shots), "DIR", imported=imported)


def outcomes(place: Place, step: NextStep) -> Iterator[Place]:
    """All that may come of typing the step."""
    state, words = place.state, step.command
    if words[0] == "identify":
        yield from identifications(place, step)
    elif words[0] == "check":
        yield from (replace(place, state=replace(place.state, check=each)) for each in ANSWERS)
    elif "after" in words:  # validated, or imported as such
        for after in ("worse", "fail", "not decided", "no limits", "pass"):
            weak = state.holds == "form" and after in {"fail", "not decided"}
            judged = replace(state, after=after, weak=weak, to_correct=False)
            yield replace(place, state=judged)
    else:
        shots = int(words[-1]) if "--shots" in words else place.shots
        done = replace(state, **changed(words))
        yield replace(
            place, state=done, shots=shots, asked=() if words[0] == "run" else place.asked
        )


def changed(words: tuple[str, ...]) -> dict[str, object]:
    """What a step does that has one outcome."""
    match words[0], words[2:]:
        case "plan", ("--shots", _):
            return {"left": "run"}
        case "plan", ("--program", "csv"):
            return {"program": True}
        case "plan", ("--program", "csv", "--stage", "after"):
            return {"program_after": True}
        case "run", _:
            return {"measured": "run", "left": "", "verdict": None, "way_on": None}
        case "export", ("--format", "plain"):
            return {"form": "exported"}
        case "load", ("--rollback",):
            return {"holds": "", "to_correct": True}
        case "load", file:
            return {"holds": "form" if file else "identified"}
        case "import", ("FILE",):
            return {"measured": "import"}
    return {
        "devices": {"answered": True},
        "plan": {"planned": True},
        "export": {"file": "identified"},
        "validate": {"before": True},
        "import": {"before": True},
        "report": {"reported": True},
    }[words[0]]


def identifications(place: Place, step: NextStep) -> Iterator[Place]:
    """Whatever may stand against an identification that is asked for with these words."""
    asked = step.command[2:]
    if asked == ("--update",):
        asked = ()  # what an update leads to is checked again, or measured anew
    here = replace(place, asked=asked, state=replace(place.state, check=""))
    for form in ("", "needed"):  # the rest of the way is the same whatever it was identified with
        yield Place(replace(here.state, verdict="pass", way_on=None, form=form))
    cases = [("fail", name, 0.0) for name in FAILING]
    cases += [("fail", findings.CHANGE, shot) for shot in CHANGES]
    cases += [("not decided", name, 0.0) for name in OPEN]
    for verdict, name, shot in cases:
        if not (name == findings.BEYOND_TOLERANCE and "--accept-large-change" in asked):
            told = way(here, identified(here, verdict, name, shot))
            state = replace(here.state, verdict=verdict, way_on=told)  # type: ignore[arg-type]
            yield replace(here, state=state)


@pytest.mark.slow
def test_no_advice_leads_back_and_all_end() -> None:
    """From an empty folder, over all that may come of each step, to the end of each way."""
    simulated, prior = CampaignState(), ("--fix", "rods")
    under_way, done = set[Place](), dict[Place, int]()

    def walk(place: Place) -> int:
        if place in done:
            return done[place]
        assert place not in under_way, f"a circle at {place}"
        step = next_step(place.state)
        if step is None or is_another_campaign(place.state, step):
            return 0
        if place.state.offline:
            assert not {step.command[0]} & DEVICES, step
        under_way.add(place)
        further = list(outcomes(place, step))
        assert further, step
        assert place not in further, f"{step.says} changes nothing"
        done[place] = 1 + max(map(walk, further))
        under_way.remove(place)
        return done[place]

    walk(Place(simulated, asked=prior))
    walk(Place(CampaignState(answered=False)))
    offline = Place(CampaignState(answered=False, offline=True), asked=prior)
    assert walk(offline) > len(OFFLINE)
    for held in ("identified", "form", ""):
        walk(Place(replace(simulated, measured="import", holds=held), shots=60, asked=prior))
    calibrated = replace(simulated, measured="run", verdict="pass", file="identified")
    for held, answer in product(("identified", "form", ""), (*ANSWERS, "again")):
        for after in ("worse", "fail", "pass", ""):
            now = replace(calibrated, holds=held, check=answer, after=after, reported=bool(after))
            walk(Place(now))
    assert len(done) > 100


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ({"answered": False}, "look through campaign.yaml (tracker.place_mm!), then: devices DIR"),
        ({"measured": "run", "left": "anew"}, "run DIR --anew"),
        ({"left": "run"}, "run DIR"),
        ({}, "identify DIR"),
        ({"verdict": "pass", "file": "other"}, "export DIR --overwrite"),
        ({"verdict": "pass", "check": "update"}, "identify DIR --update"),
        ({"verdict": "pass", "check": "again"}, "check DIR"),
        (
            {"verdict": "pass", "check": "anew"},
            "look for what changed since the shots, and measure again, then: run DIR --anew",
        ),
        ({"verdict": "pass", "file": "identified", "form": "needed"}, "export DIR --format plain"),
        (
            {"verdict": "pass", "file": "identified", "form": "exported"},
            "load DIR --file DIR/robot-plain.yaml",
        ),
        (
            {
                "verdict": "pass",
                "file": "identified",
                "form": "exported",
                "form_file": "elsewhere.yaml",
            },
            "load DIR --file DIR/elsewhere.yaml",
        ),
        (
            {"verdict": "pass", "file": "identified", "to_correct": True},
            "validate DIR --stage after --by targets",
        ),
    ],
)
def test_step_names_a_command_that_can_be_typed(state: dict[str, object], says: str) -> None:
    measured = {} if "answered" in state else {"measured": "run", "planned": True}
    step = next_step(CampaignState(**(measured | state)))  # type: ignore[arg-type]
    assert step is not None
    assert step.says.replace("pkmcal ", "") == says


@pytest.mark.parametrize(
    ("name", "before_shot", "asked", "says"),
    [
        (findings.CHANGE, 60.0, (), "identify DIR --shots 60-"),
        (findings.CHANGE, 70.0, (), "identify DIR --shots -69"),
        (findings.CHANGE, 60.0, ("--fix", "a"), ANEW),
        (findings.NOTHING_UNSEEN, 0.0, (), "identify DIR --hold-out 20%"),
        (findings.EXTRAPOLATION, 0.0, (), "plan DIR --shots 240"),
        (findings.SCATTER, 0.0, (), ANEW),
        (
            findings.BEYOND_TOLERANCE,
            0.0,
            (),
            f"{BUILT_SO}, then: identify DIR --accept-large-change",
        ),
    ],
)
def test_way_on_from_an_identification_follows_what_stands_against_it(
    name: str, before_shot: float, asked: tuple[str, ...], says: str
) -> None:
    place = Place(CampaignState(measured="run"), asked=asked)
    step = way(place, identified(place, "fail", name, before_shot))
    assert step.says.replace("pkmcal ", "") == says


def test_a_change_that_was_taken_back_is_measured_again() -> None:
    place = Place(CampaignState(measured="run"))
    found = identified(place, "fail", findings.CHANGE)
    found.findings[0].numbers["last_shot"] = 80.0
    assert way(place, found).says.replace("pkmcal ", "") == ANEW


def test_evidence_says_what_a_campaign_has_reached(whole: PaperCampaign) -> None:
    """What is there of a whole campaign, with one thing after the other taken away."""
    evidence = gather(open_campaign(whole.folder))
    assert evidence.journal is not None
    assert evidence.plan is not None
    runs = tuple(each for each in evidence.journal.series if each.started.stage == "run")
    unfinished = tuple(replace(each, finished=False) for each in runs)
    left: list[tuple[dict[str, object], str]] = [
        ({}, "report"),
        ({"after": ()}, "validate --stage after"),
        ({"loaded": None}, "load"),
        ({"parameter_file": None}, "export"),
        ({"identification": None}, "identify"),
        ({"journal": replace(evidence.journal, series=unfinished)}, "run"),
        ({"journal": None, "before": ()}, "validate --stage before"),
        ({"read_plan": lambda _: None}, "devices"),
    ]
    for taken, said in left:
        evidence = replace(evidence, **taken)  # type: ignore[arg-type]
        step = next_step(state_of(Evaluation(evidence)))
        assert step is not None
        words = step.command
        assert " ".join((words[0], *words[2:])) == said, taken


def test_another_set_that_was_loaded_since_and_a_spoilt_file_are_put_right(
    whole: PaperCampaign,
) -> None:
    evidence = gather(open_campaign(whole.folder))
    assert evidence.loaded is not None
    since, digest = "2999-01-01T00:00:00+00:00", evidence.campaign.robot.digest()
    nominal = replace(evidence.loaded, digest=digest, at_utc=since)
    for changed, said in (
        ({"loaded": nominal}, "load"),
        ({"parameter_file": None, "spoilt_parameter_file": True}, "export --overwrite"),
    ):
        now = Evaluation(replace(evidence, **changed))  # type: ignore[arg-type]
        step = next_step(state_of(now, reported=True))
        assert step is not None
        assert " ".join((step.command[0], *step.command[2:])) == said
        assert now.verdict.decision == "not decided"


def test_what_is_loaded_after_a_validation_is_validated_too(whole: PaperCampaign) -> None:
    """A form of what was validated, and parameters beside corrected targets."""
    evidence = gather(open_campaign(whole.folder))
    assert evidence.loaded is not None
    assert evidence.sets is not None
    form = ReducedForm(evidence.loaded.digest, 0.1, 0.2, 0.1, PLAIN)
    known = replace(evidence.sets, forms={"f": form})
    series = evidence.after[-1].series
    targets = replace(series, started=replace(series.started, stage="after by targets"))
    by_targets = (replace(evidence.after[-1], series=targets),)
    loaded = replace(evidence.loaded, at_utc="2999-01-01T00:00:00+00:00")
    nominal = replace(series.started, robot_file_digest=evidence.campaign.robot.digest())
    lost = (replace(evidence.after[-1], series=replace(series, started=nominal)),)
    step = next_step(state_of(Evaluation(replace(evidence, after=lost))))
    assert step is not None
    assert step.command[0] == "load"  # the controller did not keep what was loaded before
    for changed, said in (
        ({"loaded": replace(loaded, digest="f")}, "validate --stage after"),
        ({"loaded": loaded, "after": by_targets}, "validate --stage after"),
        ({"loaded": loaded}, None),
        ({"loaded": replace(evidence.loaded, digest="f")}, None),
        ({"parameter_file": SimpleNamespace(digest=lambda: "f")}, None),
    ):
        now = Evaluation(replace(evidence, sets=known, **changed))  # type: ignore[arg-type]
        step = next_step(state_of(now, reported=True))
        since = [c for c in now.checks if "holds now" in c.statement]
        assert [c.holds for c in since] == ([False] if said else []), changed
        words = " ".join((step.command[0], *step.command[2:])) if said and step else None
        assert words == said, changed


def test_a_new_campaign_has_the_state_that_its_evidence_says(
    whole: PaperCampaign, tmp_path: Path
) -> None:
    paper = new_campaign(tmp_path / "c")
    shots = paper.plan(1, 1)

    def found(campaign: Campaign) -> CampaignState:
        state = present_state(campaign, answered=True, reported=True)
        assert state == state_of(evaluate(campaign), answered=True, reported=True)
        return state

    assert not found(paper.campaign).planned
    paper.campaign.plan_path.write_text("shot")
    assert not found(paper.campaign).planned
    write_plan(paper.campaign.plan_path, shots, MECHANISM)
    assert found(paper.campaign).planned
    assert found(whole.campaign).measured == "run"


def test_a_form_that_the_controller_takes_is_loaded_and_else_written(whole: PaperCampaign) -> None:
    """A controller without tilts and backlash; tables are offered again where some were written."""
    evidence = gather(open_campaign(whole.folder))
    found, journal = evidence.identification, evidence.journal
    assert found is not None
    assert journal is not None
    space = evidence.campaign.robot.mechanism.parameters
    terms = {"arm1.axis_tilt_deg": 0.02, "arm2.backlash_deg": 0.01}
    added = {
        name: IdentifiedParameter(nominal=0.0, value=value, std=0.001, free=True)
        for name, value in terms.items()
    }
    found = replace(found, parameters=found.parameters | added)
    identified = Parameters.of(space, found.flat())
    lacking = tuple(
        replace(each, started=replace(each.started, lacks=tuple(terms))) for each in journal.series
    )
    file = SimpleNamespace(digest=identified.digest)
    told = replace(
        evidence,
        identification=found,
        journal=replace(journal, series=lacking),
        parameter_file=file,
        loaded=None,
    )

    def form(of: str = identified.digest(), file: str = PLAIN_FILE) -> WrittenSet:
        own = Parameters.of(space, {k: v for k, v in identified.items() if k not in terms})
        return WrittenSet.of(file, own, projection=ReducedForm(of, 0.1, 0.2, 0.1, PLAIN))

    for forms, said in (
        ((), "export --format plain"),
        ((form("older"),), "export --format plain --overwrite"),
        ((form("older", "elsewhere.yaml"),), "export --format plain"),
        ((form(),), "load --file robot-plain.yaml"),
        ((form(file="elsewhere.yaml"), form()), "load --file elsewhere.yaml"),
    ):
        step = next_step(state_of(Evaluation(replace(told, forms=forms))))
        assert step is not None
        words = " ".join((step.command[0], *step.command[2:]))
        assert words.replace(f"{whole.folder}/", "") == said, forms


@pytest.mark.parametrize(
    ("decision", "parts", "answer"),
    [("fail", ("encoder 2",), "update"), ("fail", (), "anew"), ("not decided", (), "again")],
)
def test_a_bad_check_is_doubtful_until_new_shots_answer_it(
    whole: PaperCampaign, decision: Decision, parts: tuple[str, ...], answer: Answer
) -> None:
    evidence = gather(open_campaign(whole.folder))
    assert evidence.identification is not None
    assert evidence.journal is not None
    check = bad_check(evidence, decision, parts)
    assert told(evidence, check) == answer
    assert told(evidence, replace(check, decision="pass")) == ""
    assert told(evidence, replace(check, of="of other parameters")) == "again"
    (run,) = (each for each in evidence.journal.series if each.to_identify)
    later = replace(evidence.journal, series=(*evidence.journal.series, replace(run, number=99)))
    assert replace(evidence, journal=later, checked=check).unanswered is None


def bad_check(evidence: Evidence, decision: Decision, parts: tuple[str, ...]) -> RecordedCheck:
    """A check of the latest set that is not good."""
    assert evidence.identification is not None
    mechanism = evidence.campaign.robot.mechanism
    digest = Parameters.of(mechanism.parameters, evidence.identification.flat()).digest()
    return RecordedCheck(
        decision=decision, says="not good", shots=8, chi2=99.0, dof=18, p=0.0, parts=parts,
        log_factors={}, series=50, of=digest, at_utc="",
    )  # fmt: skip


def told(evidence: Evidence, check: RecordedCheck) -> Answer:
    """What is said to answer a check, by state and by status alike."""
    evaluation = Evaluation(replace(evidence, checked=check))
    answer = state_of(evaluation).check
    said = [check.says in each for each in doubtful(evaluation)]
    assert said.count(True) == bool(answer)
    changed = "the robot is as it was identified"
    found = [each.holds for each in evaluation.checks if each.statement == changed]
    assert found == ([False] if answer and check.decision == "fail" else [])
    return answer
