"""What a controller holds: forms of the identified set are judged as what they are."""

from contextlib import nullcontext
from dataclasses import asdict, replace

import pytest
from held_parameters import Controller
from paper_campaign import NOMINAL, PaperCampaign

from campaigns.assessment import Evaluation, evaluate
from campaigns.errors import ConfigInvalid
from campaigns.evidence import gather
from campaigns.options import LoadOptions
from campaigns.robots.reduced_form import FORM, ReducedForm, form_of
from campaigns.robots.robot import compensated, read_robot
from campaigns.settings.sections import AcceptanceConfig
from campaigns.workflow import exporting
from campaigns.workflow.exporting import export_plain, plain_form
from campaigns.workflow.loading import LoadTerms, load
from campaigns.workflow.validation import Validated

WIDE = AcceptanceConfig(**dict.fromkeys(AcceptanceConfig.model_fields, 1.0))


@pytest.fixture(scope="module")
def plain(shared_paper: PaperCampaign) -> Evaluation:
    """A plain form, off by 0.02 mm of an arm, loaded; validated before and after."""
    paper = shared_paper
    config = paper.campaign.config.model_copy(update={"acceptance": WIDE})
    paper.campaign = replace(paper.campaign, config=config)
    paper.validate("before")
    path = export_plain(paper.campaign).path
    robot = read_robot(path).robot
    stated = dict(robot.provenance or {})
    stated[FORM] |= {"lost_mean_mm": 0.01, "lost_rms_mm": 0.012, "lost_max_mm": 0.03}
    changed = robot.parameters | {"arm2.arm_mm": robot.parameters["arm2.arm_mm"] + 0.02}
    form = compensated(paper.campaign.nominal, "plain", changed, stated)
    path.write_text(form.document.text, encoding="utf-8")
    load(paper.campaign, nullcontext(Controller()), LoadOptions(file=path, force=("changed",)))
    paper.controller = form.robot.kinematics
    paper.validate("after")
    return evaluate(paper.campaign)


def with_form(evaluation: Evaluation, **lost: object) -> Evaluation:
    sets = evaluation.evidence.sets
    forms = {digest: replace(form, **lost) for digest, form in sets.forms.items()}
    return Evaluation(replace(evaluation.evidence, sets=replace(sets, forms=forms)))


def test_a_form_that_was_exported_and_loaded_passes_as_what_it_is(plain: Evaluation) -> None:
    held = plain.evidence.held("after")
    assert held is not None
    assert (held.kind, held.form.name) == ("form", "plain")
    assert {check.statement for check in plain.checks if check.holds is False} == set()
    assert plain.validated("after").decision == plain.verdict.decision == "pass"
    said = "Validated after with a reduced set of the identified parameters (plain), which loses"
    assert any(reason.startswith(f"{said} 0.010 mm on") for reason in plain.verdict.reasons)


def test_a_form_that_loses_more_than_a_limit_shows_nothing(shared_paper, plain) -> None:
    """The verdict says it, and so does the load before."""
    lossy = with_form(plain, lost_max_mm=1.5)
    assert lossy.validated("after").decision == lossy.verdict.decision == "not decided"
    says = "(plain) loses 0.010 mm on average, 1.500 mm at most of position"
    assert says in " ".join(lossy.verdict.reasons)
    told: list[str] = []
    limits = AcceptanceConfig(distance_mean_mm=0.005, distance_max_mm=0.1)
    config = shared_paper.campaign.config.model_copy(update={"acceptance": limits})
    strict = replace(shared_paper.campaign, config=config)
    options = LoadOptions(file=shared_paper.folder / "robot-plain.yaml", force=("changed",))
    load(strict, nullcontext(Controller()), options, LoadTerms(tell=told.append, dry=True))
    warned = next(text for text in told if text.startswith("! "))
    assert "(plain)" in warned


def test_a_form_of_another_identification_is_none_of_this_one(plain: Evaluation) -> None:
    other = with_form(plain, of="0" * 64)
    assert other.evidence.held("after").kind == "other"
    broken = [check.statement for check in other.checks if check.holds is False]
    assert broken == [
        "what was loaded last is what was identified",
        "the controller held the identified set when the robot was validated after",
    ]
    assert other.verdict.decision == "not decided"
    assert other.validated("after").decision == "pass"
    assert Validated("after", plain.after, other).differing_verdict.decision == "not decided"
    assert Validated("after", plain.after, plain).differing_verdict is None


def test_sets_are_recognised_by_digests_and_after_rounding(shared_paper, plain) -> None:
    sets = gather(shared_paper.campaign).sets
    whole = read_robot(shared_paper.folder / "robot-compensated.yaml").robot
    other = sets.match(whole.parameters | {"plate_mm": 90.0})
    assert sets.state(NOMINAL.robot.digest()).kind == "nominal"
    assert sets.state(whole.digest()).kind == "identified"
    assert sets.state(other.digest()).kind == "other"
    rounded = {name: value * (1.0 + 1e-13) for name, value in whole.parameters.items()}
    assert sets.match(rounded).digest() == whole.digest(), "read back in other units"
    later = replace(sets, identified={**sets.identified, "1" * 64: None})
    for digest in (whole.digest(), next(iter(sets.forms))):
        assert later.state(digest).says.endswith(", before the latest identification")
        assert not sets.state(digest).superseded


def test_export_states_the_loss_that_load_offers(paper: PaperCampaign, monkeypatch) -> None:
    """Of the identified set, and of one with backlash, which a plain set lacks."""
    exported = export_plain(paper.campaign)
    form = form_of(read_robot(exported.path).robot.provenance, "plain")
    assert form == exported.form
    assert form.of == [*gather(paper.campaign).sets.identified][-1]
    assert 0.0 < form.lost_rms_mm < form.lost_max_mm < 0.03  # mm: of tilts that noise put there
    nominal = paper.campaign.nominal
    worn = {f"arm{arm}.backlash_deg": 0.02 for arm in range(4)}
    whole = compensated(nominal, "worn", nominal.robot.parameters | worn)
    monkeypatch.setattr(exporting, "identified_robot", lambda _: whole)
    exported = export_plain(paper.campaign, paper.folder / "worn.yaml")
    _, offered = plain_form(paper.campaign, whole.robot)
    assert exported.form == offered
    assert offered.lost_mean_mm > 0.01


def test_a_damaged_form_is_refused_with_the_key() -> None:
    form = asdict(ReducedForm(of="0" * 64, lost_mean_mm=0.1, lost_max_mm=0.2))
    with pytest.raises(ConfigInvalid, match=r"odd\.yaml: projection of: input should be"):
        form_of({FORM: form | {"of": 1}}, "odd.yaml")
