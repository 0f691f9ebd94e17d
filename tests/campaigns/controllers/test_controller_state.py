"""What a controller holds: forms of the identified set are judged as what they are."""

from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from held_parameters import Controller
from paper_campaign import NOMINAL, PaperCampaign, new_campaign

from campaigns.errors import ConfigInvalid
from campaigns.evidence import Evaluation, evaluate, gather
from campaigns.options import LoadOptions
from campaigns.robots.reduced_form import FORM, ReducedForm, form_of
from campaigns.robots.robot import RobotFile, compensated, read_robot
from campaigns.settings.sections import AcceptanceConfig
from campaigns.workflow import exporting
from campaigns.workflow.exporting import export, export_plain, plain_form
from campaigns.workflow.loading import LoadTerms, load
from campaigns.workflow.validation import Validated

WIDE = AcceptanceConfig(**dict.fromkeys(AcceptanceConfig.model_fields, 1.0))


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> PaperCampaign:
    """Validated before, measured, identified; nothing exported."""
    paper = new_campaign(tmp_path_factory.mktemp("states") / "paper", acceptance=WIDE)
    paper.validate("before")
    paper.run()
    paper.identify()
    return paper


def loaded(paper: PaperCampaign, source: Path) -> RobotFile:
    """Loads a file, after which the controller commands by it."""
    load(paper.campaign, nullcontext(Controller()), LoadOptions(file=source))
    robot = read_robot(source).robot
    paper.controller = robot.kinematics
    return robot


@pytest.fixture(scope="module")
def plain(identified: PaperCampaign) -> Evaluation:
    """A plain form of it, off by 0.02 mm of an arm, loaded and validated after."""
    path = export_plain(identified.campaign).path
    robot = read_robot(path).robot
    stated = dict(robot.provenance or {})
    stated[FORM] |= {"lost_mean_mm": 0.01, "lost_rms_mm": 0.012, "lost_max_mm": 0.03}
    changed = robot.parameters | {"arm2.arm_mm": robot.parameters["arm2.arm_mm"] + 0.02}
    form = compensated(identified.campaign.nominal, "plain", changed, stated)
    path.write_text(form.document.text, encoding="utf-8")
    loaded(identified, path)
    identified.validate("after")
    return evaluate(identified.campaign)


def test_a_form_that_was_exported_and_loaded_passes_as_what_it_is(plain: Evaluation) -> None:
    held = plain.evidence.held("after")
    assert held is not None
    assert (held.kind, held.form.name) == ("form", "plain")
    assert {check.statement for check in plain.checks if check.holds is False} == set()
    assert plain.validated("after").decision == plain.verdict.decision == "pass"
    told = "Validated after with a form of the identified parameters (plain), loses 0.0100 mm on"
    assert any(reason.startswith(told) for reason in plain.verdict.reasons)


def with_form(found: Evaluation, **lost: float) -> Evaluation:
    sets = found.evidence.sets
    forms = {digest: replace(form, **lost) for digest, form in sets.forms.items()}
    return Evaluation(replace(found.evidence, sets=replace(sets, forms=forms)))


def test_a_form_that_loses_more_than_a_limit_shows_nothing(plain: Evaluation) -> None:
    found = with_form(plain, lost_max_mm=1.5)
    assert found.validated("after").decision == found.verdict.decision == "not decided"
    says = "(plain) loses 0.0100 mm on average, 1.5000 mm at most of position"
    assert says in " ".join(found.verdict.reasons)
    assert says in " ".join(found.validated("after").reasons)


def test_load_says_that_a_form_loses_more_than_a_limit(identified: PaperCampaign, plain) -> None:
    told: list[str] = []
    limits = AcceptanceConfig(distance_mean_mm=0.005, distance_max_mm=0.1)
    config = identified.campaign.config.model_copy(update={"acceptance": limits})
    strict = replace(identified.campaign, config=config)
    source = identified.folder / "robot-plain.yaml"
    load(
        strict,
        nullcontext(Controller()),
        LoadOptions(file=source),
        LoadTerms(tell=told.append, dry=True),
    )
    (warned,) = told
    assert "(plain) loses 0.0100 mm on average" in warned
    assert "`pkmcal correct`" in warned


def test_a_form_of_another_identification_is_none_of_this_one(plain: Evaluation) -> None:
    found = with_form(plain, of="0" * 64)
    assert found.evidence.held("after").kind == "other"
    broken = [check.statement for check in found.checks if check.holds is False]
    assert broken == [
        "what was loaded last is what was identified",
        "the controller held the identified set when the robot was validated after",
    ]
    assert found.verdict.decision == "not decided"


def test_states_are_told_by_digests(identified: PaperCampaign, plain: Evaluation) -> None:
    sets = gather(identified.campaign).sets
    path, whole = export(identified.campaign)
    path.unlink()
    other = sets.match(whole.parameters | {"plate_mm": 90.0})
    assert sets.state(NOMINAL.robot.digest()).kind == "nominal"
    assert sets.state(whole.digest()).kind == "identified"
    assert sets.state(other.digest()).kind == "other"
    rounded = {name: value * (1.0 + 1e-13) for name, value in whole.parameters.items()}
    assert sets.match(rounded).digest() == whole.digest(), "read back in other units"


def test_a_stage_says_where_the_campaign_is_judged_otherwise(plain: Evaluation) -> None:
    stage, result = "after", plain.after
    assert Validated(stage, result, plain).otherwise is None
    other = with_form(plain, of="0" * 64)
    assert other.validated(stage).decision == "pass"
    found = Validated(stage, result, other).otherwise
    assert found is not None
    assert found.decision == "not decided"
    assert Validated("before", plain.before, other).otherwise is None


def test_what_was_identified_again_since_is_told(plain: Evaluation) -> None:
    sets = plain.evidence.sets
    again = replace(sets, identified={**sets.identified, "1" * 64: None})
    whole, form = [*sets.identified][-1], next(iter(sets.forms))
    for digest in (whole, form):
        assert again.state(digest).superseded
        assert again.state(digest).says.endswith(", before the latest identification")
        assert not sets.state(digest).superseded


def test_an_exported_form_says_what_it_is_and_loses(identified: PaperCampaign) -> None:
    path = export_plain(identified.campaign, identified.folder / "again.yaml").path
    form = form_of(read_robot(path).robot.provenance, path.name)
    assert form is not None
    assert form.of == [*gather(identified.campaign).sets.identified][-1]
    assert 0.0 < form.lost_rms_mm < form.lost_max_mm < 0.03  # mm: of tilts that noise put there
    older = {"of": form.of, "lost_mean_mm": 0.02, "lost_max_mm": 0.1}
    assert "(plain), loses 0.0200 mm on average" in form_of({FORM: older}, "old").says


def test_export_states_the_loss_that_load_offers(identified: PaperCampaign, monkeypatch) -> None:
    """Also of a set with backlash, which a plain set lacks."""
    nominal = identified.campaign.nominal
    worn = {f"arm{arm}.backlash_deg": 0.02 for arm in range(4)}
    whole = compensated(nominal, "worn", nominal.robot.parameters | worn)
    monkeypatch.setattr(exporting, "identified_robot", lambda _: whole)
    found = export_plain(identified.campaign, identified.folder / "worn.yaml")
    form = form_of(read_robot(found.path).robot.provenance, "worn")
    assert form is not None
    _, offered = plain_form(identified.campaign, whole.robot)
    assert found.form == form == offered
    assert offered.lost_mean_mm > 0.01
    assert offered.loses in offered.says


def test_a_form_that_cannot_be_read_is_refused_with_the_key(identified: PaperCampaign) -> None:
    form = asdict(ReducedForm(of="0" * 64, lost_mean_mm=0.1, lost_max_mm=0.2))
    robot = compensated(NOMINAL, "odd", NOMINAL.robot.parameters, {FORM: form | {"of": 1}}).robot
    with pytest.raises(ConfigInvalid, match=r"odd\.yaml: projection of: input should be"):
        form_of(robot.provenance, "odd.yaml")
