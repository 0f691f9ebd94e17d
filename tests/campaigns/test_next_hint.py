"""What is next is what the command itself lets pass, with the options that it asks for."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from paper_campaign import MECHANISM, PaperCampaign, new_campaign

from app.new_campaign import create_for_devices
from campaigns.assessment import evaluate
from campaigns.campaign import Campaign, open_campaign
from campaigns.evidence import joints_path
from campaigns.next_step import COVER, CampaignState, NextStep, state_of
from campaigns.options import PlanOptions
from campaigns.planning.plan_file import write_plan
from campaigns.settings.sections import OFFLINE
from campaigns.workflow.next_hint import next_hint, refused
from campaigns.workflow.planning import plan, replaced_plan

TO_IMPORT = CampaignState(folder="cell", offline=True, planned=True, program=True, before=True)
"""State in which run.txt is to be imported."""
TO_EXPORT = CampaignState(planned=True, measured="run", verdict="pass", to_export="yaml")


@pytest.fixture
def offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Campaign:
    """An offline campaign in the folder `cell` of the present one, with the joints of a program."""
    create_for_devices(tmp_path / "cell", "delta", OFFLINE, OFFLINE)
    monkeypatch.chdir(tmp_path)
    joints_path(tmp_path / "cell", "run").write_text("name,q0_deg,q1_deg,q2_deg\nshot0,10,10,10\n")
    return open_campaign(Path("cell"))


def options_of(step: NextStep | None) -> tuple[str, ...]:
    """Options behind folder and file."""
    assert step is not None
    return step.words[3:]


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("Name;X;Y;Z\nshot0;1.5;2.5;3.5\n", ("--unit", "mm")),
        ("Name;X [m];Y [m];Z [m]\nshot0;1.5;2.5;3.5\n", ()),
        ("Name;X;Y;Z\nshot0;1,5;2,5;3,5\n", ("--unit", "mm")),
        ("Name;X [mm];Y [mm];Z [mm]\nshot0;1,234;2,345;3,456\n", ("--decimal", "comma")),
        ("pair,q0_deg,q1_deg,q2_deg,x_mm,y_mm,z_mm\n0,9,9,9,1,2,3\n0,8,8,8,1,2,3\n", ()),
    ],
)
def test_an_import_has_the_options_that_its_file_needs(
    offline: Campaign, text: str, options: tuple[str, ...]
) -> None:
    assert options_of(next_hint(offline, TO_IMPORT)) == ("--unit", "mm"), "of a file to be saved"
    Path("run.txt").write_text(text)
    step = next_hint(offline, TO_IMPORT)
    assert options_of(step) == options
    assert refused(offline, step.words) is None


def test_points_without_their_joints_are_for_people(offline: Campaign) -> None:
    Path("run.txt").write_text("Name;X [mm];Y [mm];Z [mm]\nshot0;1.5;2.5;3.5\n")
    joints_path(offline.folder, "run").unlink()
    step = next_hint(offline, TO_IMPORT)
    assert "points alone do not state where the joints were → give --joints" in step.first


@pytest.fixture
def done(whole: PaperCampaign, tmp_path: Path) -> Campaign:
    return open_campaign(Path(shutil.copytree(whole.folder, tmp_path / "-done")))


def test_a_file_that_is_there_is_replaced_by_consent_and_the_reason_is_said(done: Campaign) -> None:
    step = next_hint(done, replace(TO_EXPORT, folder=str(done.folder)))
    assert step.words == ("export", str(done.folder), "--force")
    assert "already exists → replace it with --force" in step.why
    done.path("robot-compensated.yaml").unlink()
    step = next_hint(done, replace(TO_EXPORT, folder=str(done.folder)))
    assert (step.words, step.why) == (("export", str(done.folder)), "")


def test_a_plan_that_was_measured_is_kept_beside_the_next_one(done: Campaign) -> None:
    remedy = {"remedy": "plan {folder} {plan_options}", "plan_options": ("--shots", "80")}
    state = CampaignState(
        folder="-done", planned=True, measured="run", verdict="fail", remedy_first=COVER, **remedy
    )
    assert replaced_plan(done)
    step = next_hint(done, state)
    assert step.text == "pkmcal plan ./-done --shots 80 --force"
    assert step.first == COVER
    assert "keeps this plan beside it" in step.why


def test_an_edited_plan_of_a_broken_run_begins_a_series_of_its_own(tmp_path: Path) -> None:
    """As the remedy of `run` says; with the plan as it was the run goes on."""
    paper = new_campaign(tmp_path / "c")
    shots = plan(paper.campaign, PlanOptions(shots=8)).checked.shots
    paper.validate("before")
    paper.measure("run", shots[:5], finished=False)
    exchanged = (
        replace(shots[3], joints=shots[4].joints, pose=shots[4].pose),
        replace(shots[4], joints=shots[3].joints, pose=shots[3].pose),
    )
    for rows, words in ((shots, ()), ((*shots[:3], *exchanged, *shots[5:]), ("--anew",))):
        write_plan(paper.campaign.plan_path, rows, MECHANISM)
        step = next_hint(paper.campaign, state_of(evaluate(paper.campaign)))
        assert step.words == ("run", str(paper.folder), *words), step


def test_a_wrong_line_of_a_plan_that_is_measured_in_part_is_for_people(tmp_path: Path) -> None:
    """Where nothing is measured yet, a new plan is made."""
    paper = new_campaign(tmp_path / "c")
    shots = paper.plan(4, 2)  # its ways were never checked
    paper.validate("before")
    write_plan(paper.campaign.plan_path, shots, MECHANISM)
    step = next_hint(paper.campaign, state_of(evaluate(paper.campaign)))
    assert step.words == ("plan", str(paper.folder))
    paper.measure("run", shots[:5], finished=False)
    step = next_hint(paper.campaign, state_of(evaluate(paper.campaign)))
    assert step.words == ("run", str(paper.folder))
    assert step.first.startswith("shot 3: joint 1 at")
