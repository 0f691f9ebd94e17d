"""One next step for whatever a campaign has reached, and no advice that leads back."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import pytest

from campaigns import next_step as steps
from campaigns.estimation.estimators import Estimator, Model
from campaigns.evaluation import diagnostics, identification
from campaigns.evaluation.diagnostics import Doubt
from campaigns.evaluation.summary import BeforeAfter, Spread
from campaigns.identification.result import RecordedIdentification
from campaigns.next_step import CampaignState, NextStep, next_step, way_on

NUMBERS, SESSIONS = tuple(range(120)), (1,) * 60 + (2,) * 60
REACHED = Spread(mean_abs=0.02, rms=0.03, max_abs=0.06)
LIMITS: Mapping[str, Mapping[str, float]] = {"tight": {"max": 0.05}, "met": {"max": 0.1}, "": {}}
FAILING = (
    diagnostics.LARGE_CHANGE,
    diagnostics.COMMON_SCALE,
    identification.TOO_FEW,
    identification.UNTOLD,
    identification.PRIOR,
    identification.MANY_LEFT_OUT,
    identification.LOST,
    identification.WORSE,
    "a cause that nobody has named yet",
)
OPEN = (
    identification.NOTHING_UNSEEN,
    identification.TOO_FEW,
    diagnostics.LACK,
    diagnostics.HOLD_OUT,
    diagnostics.EXTRAPOLATION,
    "another cause",
)
CHANGES = ("frame", "joint", "length", "drift")
OPTIONS = (
    ("--prior", "arm*.arm_mm=1"),
    ("--model", "auto"),
    ("--shots", "-59"),
    ("--sessions",),
    ("--fix", "held"),
    ("--hold-out", "20%"),
    ("--free", "reflector_constant_mm"),
    *((option,) for option in diagnostics.ACCEPT.values()),
)
"""All that a next step may ask an identification for: each changes it once."""
MENDED = {"run", "import"}
"""Commands before which a person has mended something: what they measure is another campaign."""


@dataclass(frozen=True)
class Place:
    """A state, and what of the campaign the next identification depends on."""

    state: CampaignState
    limits: str = ""
    model: Model = Model.STANDARD


def identified(place: Place, verdict: str, name: str, change: str = "") -> RecordedIdentification:
    """An identification against which one thing stands."""
    numbers = {"kind": change, "before_shot": 60.0, "cause": change}
    doubts = (Doubt(name, "", "fail", numbers),) if change else ()  # type: ignore[arg-type]
    asked = place.state.asked
    return RecordedIdentification(
        estimator=Estimator.POINTS,
        converged=True,
        iterations=1,
        rank=1,
        condition=1.0,
        dof=1,
        parameters={},
        excluded=(),
        unobservable=() if name != identification.UNTOLD else (("held",),),
        unseen_mm=BeforeAfter(REACHED, REACHED),
        doubts=doubts,
        verdict=verdict,  # type: ignore[arg-type] # one of three words
        reasons=(),
        obstacles=(name,) if name else (),
        series=1,
        robot_digest="",
        plan_digest="",
        journal_digest="",
        journal_records=1,
        at_utc="",
        model=place.model.value,
        asked=asked,
    )


def outcomes(place: Place, step: NextStep) -> Iterator[Place]:
    """All that may come of typing the step."""
    state, words = place.state, step.command
    if words[0] == "identify":
        yield from identifications(place, words)
    elif words[0] == "validate" and "after" in words:
        by = "targets" if "targets" in words else state.holds
        for after in ("worse", "fail", "not decided", "no limits", "pass"):
            weak = by == "form" and after in {"fail", "not decided"}
            yield replace(place, state=replace(state, after=after, after_by=by, weak=weak))
    else:
        yield replace(place, state=replace(state, **changed(state, words)))


def changed(state: CampaignState, words: tuple[str, ...]) -> dict[str, object]:
    """What a step does that has one outcome."""
    shots = state.shots or 120
    match words[0], words[2:]:
        case "plan", ("--shots", count):
            return {"left": "run", "shots": int(count)}
        case "run", _:
            return {"measured": "run", "left": "", "shots": shots, "verdict": None, "asked": ()}
        case "export", ("--format", "plain"):
            return {"form": "exported"}
        case "load", ("--rollback",):
            return {"holds": "", "by_targets": True}
        case "load", file:
            return {"holds": "form" if file else "identified"}
    return {
        "devices": {"answered": True},
        "plan": {"planned": True},
        "export": {"file": "identified"},
        "validate": {"before": True},
        "report": {"reported": True},
    }[words[0]]


def identifications(place: Place, words: tuple[str, ...]) -> Iterator[Place]:
    """Whatever may stand against an identification that is asked for with these words."""
    typed = [each for each in OPTIONS if {*each} <= {*words}]
    state = replace(place.state, asked=tuple(word for each in typed for word in each))
    limits = place.limits
    if "acceptance" in (next_step(place.state) or NextStep(())).first:
        limits = "met" if limits else "tight"  # a person may ask for too much at first
    model = Model.AUTO if Model.AUTO.value in words else place.model
    here = Place(state, limits, model)
    for form in ("", "needed"):
        passed = replace(state, verdict="pass", way="", form=form, asked=(), shots=0, detail="")
        yield Place(passed)  # the rest of the way is the same whatever it was identified with
    cases = [("fail", name, "") for name in FAILING]
    cases += [("fail", diagnostics.CHANGE, change) for change in CHANGES]
    cases += [("not decided", name, "") for name in OPEN]
    cases += [("not decided", diagnostics.LACK, cause) for cause in ("reflector", "sag")]
    for verdict, name, change in cases:
        lacks = verdict == "not decided" and name not in {
            identification.NOTHING_UNSEEN,
            identification.TOO_FEW,
            diagnostics.EXTRAPOLATION,
        }
        cannot_be = (
            (name == identification.PRIOR and "--prior" not in words)
            or (name in diagnostics.ACCEPT and diagnostics.ACCEPT[name] in words)
            or (name == identification.UNTOLD and "--fix" in words)
            or (lacks and limits == "met")
        )
        if not cannot_be:
            found = identified(here, verdict, name, change)
            way, detail = way_on(found, state.shots, LIMITS[limits], NUMBERS, SESSIONS)
            told = replace(state, verdict=found.verdict, way=way, detail=detail)
            yield replace(here, state=told)


@pytest.mark.slow
def test_no_advice_leads_back_and_all_end() -> None:
    """From an empty folder, over all that may come of each step, to the end of each way."""
    simulated = CampaignState(asked=("--prior", "arm*.arm_mm=1"))
    under_way, done = set[Place](), dict[Place, int]()

    def walk(place: Place) -> int:
        if place in done:
            return done[place]
        assert place not in under_way, f"a circle at {place}"
        step = next_step(place.state)
        if step is None or (
            step.first and (step.command[0] in MENDED | {"report"} or "space" in step.first)
        ):
            return 0
        under_way.add(place)
        further = list(outcomes(place, step))
        assert further, step
        assert place not in further, f"{step.says} changes nothing"
        done[place] = 1 + max(map(walk, further))
        under_way.remove(place)
        return done[place]

    walk(Place(simulated))
    walk(Place(CampaignState(answered=False)))
    for state in ("identified", "form", ""):
        walk(Place(replace(simulated, measured="import", shots=60, holds=state)))
    assert len(done) > 300


@pytest.mark.parametrize(
    ("state", "says"),
    [
        ({"answered": False}, "look through campaign.yaml (tracker.place_mm!), then: devices DIR"),
        ({"measured": "run", "left": "anew"}, "run DIR --anew"),
        ({"verdict": "not decided", "way": "larger model"}, "identify DIR --model auto"),
        (
            {"verdict": "fail", "way": "a part", "detail": "60-", "asked": ("--shots", "-9")},
            "identify DIR --shots 60-",
        ),
        ({"verdict": "pass", "file": "other"}, "export DIR --overwrite"),
        ({"verdict": "pass", "file": "identified", "form": "needed"}, "export DIR --format plain"),
        (
            {"verdict": "pass", "file": "identified", "form": "exported"},
            "load DIR --file DIR/robot-plain.yaml",
        ),
        (
            {"verdict": "pass", "file": "identified", "by_targets": True},
            "validate DIR --stage after --by targets",
        ),
        (
            {"verdict": "not decided", "way": "set limits", "detail": "mean 0.02"},
            (
                "write what the robot must keep into campaign.yaml, acceptance.distance_mean_mm "
                "and distance_max_mm (unseen pairs: mean 0.02), then: identify DIR"
            ),
        ),
    ],
)
def test_step_names_a_command_that_can_be_typed(state: dict[str, object], says: str) -> None:
    measured = {} if "answered" in state else {"measured": "run", "planned": True}
    step = next_step(CampaignState(**(measured | state)))  # type: ignore[arg-type]
    assert step is not None
    assert step.says.replace("pkmcal ", "") == says
    assert "\n" not in step.says


def test_model_that_was_looked_through_is_not_advised_again() -> None:
    place = Place(CampaignState(measured="run"), model=Model.AUTO)
    found = identified(place, "not decided", diagnostics.LACK)
    assert way_on(found, 120, {}, (), ())[0] == "set limits"
    standard = replace(found, model=Model.STANDARD.value)
    assert way_on(standard, 120, {}, (), ())[0] == "larger model"


def test_change_between_sessions_gets_frames_of_their_own_and_any_other_the_larger_part() -> None:
    place = Place(CampaignState(measured="run"))
    moved = identified(place, "fail", diagnostics.CHANGE, "frame")
    assert way_on(moved, 120, {}, NUMBERS, SESSIONS) == ("own frames", "")
    assert way_on(moved, 120, {}, NUMBERS, (1,) * 120) == ("a part", "-59")
    drift = identified(place, "fail", diagnostics.CHANGE, "drift")
    assert way_on(drift, 120, {}, NUMBERS, SESSIONS) == ("measure again", "")


def test_every_way_has_its_words() -> None:
    ways = set(steps.Way.__args__) - {""}  # type: ignore[attr-defined] # of a Literal
    said = {
        (
            next_step(
                CampaignState(measured="run", verdict="fail", way=way, asked=("--prior", "x=1"))
            )
            or NextStep(())
        ).says
        for way in ways
    }
    assert len(said) == len(ways)
