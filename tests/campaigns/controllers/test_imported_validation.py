"""Validations measured elsewhere: judged as measured ones, with what is declared to be held."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Keyboard, change
from family_cases import ALL_MEMBERS
from paper_campaign import NOMINAL, TRACKER_FROM_BASE, PaperCampaign, new_campaign, validation_shots

from app.main import run_command
from app.new_campaign import create_simulated
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import OptionsInvalid, ShotsInvalid
from campaigns.evaluation.validation import SET_OF
from campaigns.evidence import evaluate
from campaigns.identification.options import IdentificationOptions
from campaigns.journal.records import Finding
from campaigns.kinematics.mechanism import Kinematics
from campaigns.measuring.resume import series_to_take_up
from campaigns.options import ValidationOptions
from campaigns.robots.robot import compensated, pose_row, read_robot
from campaigns.settings.sections import AcceptanceConfig
from campaigns.shots.import_export import exported_shots
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow, write_shots
from campaigns.workflow.correction import correct_file
from campaigns.workflow.exporting import export, export_plain
from campaigns.workflow.identification import identify
from campaigns.workflow.importing import ImportTerms, declared_set, import_shots, import_validation
from campaigns.workflow.validation import replaced, validation_work

LIMITS = AcceptanceConfig(
    distance_mean_mm=0.1,
    distance_max_mm=0.2,
    rotation_mm=0.5,
    straightness_mm=0.5,
    repeatability_mm=0.1,
)
pytestmark = pytest.mark.slow
ENCODER_RAD = np.radians(1e-4)


@pytest.fixture(scope="session")
def exported_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    paper = new_campaign(tmp_path_factory.mktemp("closed") / "paper", acceptance=LIMITS)
    paper.run()
    paper.identify()
    export(paper.campaign)
    return paper.folder


@pytest.fixture
def paper(exported_once: Path, tmp_path: Path) -> PaperCampaign:
    """A campaign whose identified set is exported; its controller cannot be asked."""
    folder = shutil.copytree(exported_once, tmp_path / "paper")
    return PaperCampaign(folder, open_campaign(folder), np.random.default_rng(9))


def rows(
    paper: PaperCampaign, commanding: Kinematics, only: frozenset[ShotSet] = frozenset(ShotSet)
) -> tuple[ShotRow, ...]:
    """What others measured of a robot that goes where this set has the joints of each pose."""
    shots = [s for s in validation_shots(np.random.default_rng(6)) if s.purpose in only]
    joints = commanding.inverse(np.array([pose_row(shot.pose) for shot in shots]))
    read = np.round(joints.values_or_raise() / ENCODER_RAD) * ENCODER_RAD
    measured = [paper.outcome(shot.shot, 1, q) for shot, q in zip(shots, read, strict=True)]
    return tuple(
        ShotRow(shot.pair, each.joints, each.point_in_tracker_mm, shot.purpose)
        for shot, each in zip(shots, measured, strict=True)
    )


def pairs_of(paper: PaperCampaign, commanding: Kinematics) -> tuple[ShotRow, ...]:
    return rows(paper, commanding, frozenset({ShotSet.VALIDATION}))


def identified(paper: PaperCampaign) -> Kinematics:
    return read_robot(paper.folder / "robot-compensated.yaml").robot.kinematics


def correct(paper: PaperCampaign, to: str = "corrected.csv") -> None:
    """Correct the targets of a program, as its user does."""
    targets = paper.folder / "targets.csv"
    targets.write_text("x_mm,y_mm,z_mm,theta_deg\n0,0,-600,0\n", encoding="utf-8")
    correct_file(paper.campaign, targets, paper.folder / to, overwrite=True)


def taken_in(of: PaperCampaign | Campaign, stage, shots: Sequence[ShotRow], file=None, **options):
    campaign = of if isinstance(of, Campaign) else of.campaign
    held = declared_set(campaign, stage, file)
    return import_validation(campaign, shots, stage, held, ImportTerms(**options))


def test_the_gain_of_a_closed_controller_is_proved_by_shots_measured_elsewhere(
    paper: PaperCampaign,
) -> None:
    correct(paper)
    before = taken_in(paper, "before", rows(paper, NOMINAL.robot.kinematics))
    after = taken_in(paper, "after", rows(paper, identified(paper)))
    assert before.verdict.decision == "fail"
    assert after.verdict.decision == after.campaign_verdict.decision == "pass"
    found = evaluate(paper.campaign)
    assert set(found.after.series) == set(SET_OF)
    ap, rp = "pose accuracy AP, worst", "pose repeatability RP, worst"
    gained = {each.name: each for each in found.gains}
    assert 20.0 * gained[ap].after.value_mm < gained[ap].before.value_mm
    assert max(gained[rp].before.value_mm, gained[rp].after.value_mm) < 0.1
    assert found.gains[0].after.value_mm < 0.05 * found.gains[0].before.value_mm
    held = found.evidence.held("after")
    assert (held.kind, held.targets, held.declared) == ("identified", True, "corrected.csv")
    assert not [check for check in found.checks if check.holds is False]
    told = (
        "Validated after with targets corrected with what was identified in this campaign "
        "(declared by corrected.csv, not read)."
    )
    assert told in found.verdict.reasons


def test_what_is_declared_counts_more_than_an_earlier_load(paper: PaperCampaign) -> None:
    before = Finding("load", {"source": "old.yaml", "digest": "0" * 64, "kept": "k"})
    with paper.journal() as journal:
        journal.append(before)
    done = taken_in(paper, "after", pairs_of(paper, identified(paper)))
    assert not [check for check in done.evaluation.checks if check.holds is False]


def test_a_form_that_older_software_exported_is_known_by_its_file(paper: PaperCampaign) -> None:
    whole = read_robot(paper.folder / "robot-compensated.yaml").robot
    lost = {"of": whole.digest(), "lost_mean_mm": 0.01, "lost_max_mm": 0.02}
    changed = whole.parameters | {"arm1.arm_mm": whole.parameters["arm1.arm_mm"] + 0.01}
    form = compensated(NOMINAL, "older", changed, {**whole.provenance, "projection": lost})
    path = paper.folder / "older-plain.yaml"
    path.write_text(form.document.text, encoding="utf-8")
    done = taken_in(paper, "after", pairs_of(paper, form.robot.kinematics), path)
    held = done.evaluation.evidence.held("after")
    assert (held.kind, held.declared) == ("form", "older-plain.yaml")
    assert not [check for check in done.evaluation.checks if check.holds is False]


def test_without_correction_the_last_export_counts(paper: PaperCampaign) -> None:
    told: list[str] = []
    pairs = enumerate(pairs_of(paper, identified(paper)))
    backwards = [replace(row, time=f"{-place}") for place, row in pairs]
    done = taken_in(paper, "after", backwards, tell=told.append)
    last = len(backwards) - 1
    assert told == [f"shots: sorted by time: shot {last} was measured before shot {last - 1}"]
    held = done.evaluation.evidence.held("after")
    assert (held.kind, held.targets) == ("identified", False)
    assert held.declared == "robot-compensated.yaml"
    assert not [check for check in done.evaluation.checks if check.holds is False]


def test_what_export_and_correct_wrote_is_known_again_and_recorded_once(
    paper: PaperCampaign,
) -> None:
    copied = shutil.copy(paper.folder / "robot-compensated.yaml", paper.folder / "sent.yaml")
    correct(paper)
    correct(paper, "another.csv")
    assert declared_set(paper.campaign, "after").by == "targets"
    held = declared_set(paper.campaign, "after", Path(copied))
    assert (held.by, held.file) == ("parameters", "robot-compensated.yaml")
    with paper.campaign.journal_reader() as journal:
        kinds = [entry.record.kind for entry in journal.records_of(Finding)]
    assert kinds == ["identification", "export", "export"]


def test_the_wrong_set_is_refused_and_what_is_taken_in_anyway_is_told(paper: PaperCampaign) -> None:
    shots = pairs_of(paper, NOMINAL.robot.kinematics)
    nominal, exported = paper.folder / "robot.yaml", paper.folder / "robot-compensated.yaml"
    with pytest.raises(OptionsInvalid, match="--stage after: the controller still holds the nom"):
        taken_in(paper, "after", shots, nominal)
    with pytest.raises(OptionsInvalid, match="--stage before: the controller holds what was ident"):
        taken_in(paper, "before", shots, exported)
    done = taken_in(paper, "after", shots, nominal, anyway=True)
    assert done.verdict.decision == "fail"
    events = [each.text for each in done.evaluation.evidence.journal.incidents]
    assert any("measured all the same: --stage after" in text for text in events)


def test_what_was_measured_before_is_replaced_only_with_consent(paper: PaperCampaign) -> None:
    pairs = pairs_of(paper, NOMINAL.robot.kinematics)
    others = rows(paper, NOMINAL.robot.kinematics, frozenset({ShotSet.ROTATION}))
    first = taken_in(paper, "before", pairs).result.distances.mean.value_mm
    assert replaced(paper.campaign, "after") is None
    with pytest.raises(OptionsInvalid, match=r"--stage before: measured already .* distances;"):
        taken_in(paper, "before", pairs[2:])
    found = replaced(paper.campaign, "before")
    assert found is not None
    assert "--force" in found.remedy
    both = taken_in(paper, "before", others)
    assert both.whole.distances.mean.value_mm == first, "other tests are no replacement"
    taken_in(paper, "before", pairs[2:], anyway=True)
    assert len(evaluate(paper.campaign).before.distances.pairs) == len(pairs) // 2 - 1
    events = [each.text for each in evaluate(paper.campaign).evidence.journal.incidents]
    assert any("measured all the same: --stage before: measured already" in each for each in events)


def test_what_was_measured_once_proves_nothing_of_itself(paper: PaperCampaign) -> None:
    with paper.campaign.journal_reader() as journal:
        kept, _ = exported_shots(
            journal.latest_series("run"), journal.shots(1), paper.campaign.robot.mechanism
        )
    seen = [replace(row, purpose=ShotSet.VALIDATION) for row in kept if row.pair is not None]
    for anyway in (False, True):
        with pytest.raises(ShotsInvalid, match=r"shot 0 is a copy of shot 1 of series 1 \(run\)"):
            taken_in(paper, "after", seen, anyway=anyway)
    before = pairs_of(paper, NOMINAL.robot.kinematics)
    taken_in(paper, "before", before)
    with pytest.raises(ShotsInvalid, match=r"of series 2 \(before\)"):
        taken_in(paper, "after", before, anyway=True)
    taken_in(paper, "before", before, anyway=True)
    identifying = [replace(row, purpose=ShotSet.IDENTIFICATION) for row in before if row.pair]
    with pytest.raises(ShotsInvalid, match=r"of series 3 \(before\)"):
        import_shots(paper.campaign, identifying, ImportTerms(anyway=True))


@pytest.mark.parametrize(("answer", "code"), [("n\n", 2), ("y\n", 3)])
def test_at_a_terminal_it_is_asked_whether_before_is_measured_again(
    paper: PaperCampaign, capsys, monkeypatch, answer: str, code: int
) -> None:
    """Whoever agrees gets as far as the controller, which is not there."""
    taken_in(paper, "before", pairs_of(paper, NOMINAL.robot.kinematics))
    monkeypatch.setattr("sys.stdin", Keyboard(answer))
    words = ["validate", str(paper.folder), "--stage", "before", "--only", "distances", "--yes"]
    assert run_command(words) == code
    assert "in its place. Measure it again? [y/N]" in capsys.readouterr().err


def test_shots_of_no_test_are_refused(paper: PaperCampaign) -> None:
    shots = [ShotRow(None, (0.1, 0.2, 0.3, 0.4), (1.0, 2.0, 3.0))]
    with pytest.raises(ShotsInvalid, match="shot 1 of the file is of the set identification"):
        taken_in(paper, "after", shots)


def test_rows_without_a_set_are_pairs_of_a_validation(paper: PaperCampaign, capsys) -> None:
    path = paper.folder / "after.csv"
    write_shots(path, pairs_of(paper, identified(paper)), NOMINAL.robot.mechanism)
    text = path.read_text(encoding="utf-8").replace(",validation", "")
    path.write_text(text.replace(",set", ""), encoding="utf-8")
    words = ["import", str(paper.folder), str(path), "--stage", "after", "--json"]
    assert run_command(words) == 1, "the other tests are asked for, and were not measured"
    ended = capsys.readouterr()
    assert "after.csv: there is no column time: the order of rows is taken" in ended.err
    document = json.loads(ended.out)
    assert document["distances_mm"]["max_abs"] < 0.1
    assert document["held"]["declared"] == "robot-compensated.yaml"
    assert document["campaign"]["decision"] == document["decision"] == "not decided"


def test_a_form_for_a_controller_of_few_parameters_is_judged_as_what_it_is(tmp_path: Path) -> None:
    """A linear Delta: pairs before, to identify, exported for Klipper, pairs after."""
    member = next(each for each in ALL_MEMBERS if each.name == "linear-delta")
    create_simulated(tmp_path / "delta", member.name, "paper-simulation")
    campaign, rng = open_campaign(tmp_path / "delta"), np.random.default_rng(3)

    def pairs(held: Kinematics, count: int, seed: int, unseen: int) -> list[ShotRow]:
        joints = held.inverse(member.poses(2 * count, seed)).values_or_raise()
        points = TRACKER_FROM_BASE.apply(member.perturbed.forward(joints).values[:, :3])
        points += rng.normal(0.0, 0.005, points.shape)
        rows = zip(joints.tolist(), points.tolist(), strict=True)
        sets = [ShotSet.VALIDATION] * 2 * unseen + [ShotSet.IDENTIFICATION] * 2 * (count - unseen)
        return [
            ShotRow(place // 2, tuple(joint), tuple(point), purpose)
            for place, ((joint, point), purpose) in enumerate(zip(rows, sets, strict=True))
        ]

    before = taken_in(campaign, "before", pairs(member.nominal, 12, 5, 12))
    import_shots(campaign, pairs(member.nominal, 60, 6, 12))
    assert identify(campaign, IdentificationOptions()).verdict == "pass"
    form = export_plain(campaign).form
    held = declared_set(campaign, "after")
    robot = Kinematics.of(member.mechanism, held.wanted)
    after = taken_in(campaign, "after", pairs(robot, 12, 7, 12), campaign.path(held.file))
    state = after.evaluation.evidence.held("after")
    assert (state.kind, state.form.name) == ("form", "plain")
    assert state.declared == "robot-plain.yaml"
    assert state.form == form
    assert not [check for check in after.evaluation.checks if check.holds is False]
    assert after.result.distances.mean.value_mm < 0.2 * before.result.distances.mean.value_mm


def test_terminal_program_and_page_tell_one_verdict(paper: PaperCampaign, capsys) -> None:
    path = paper.folder / "after.csv"
    write_shots(path, rows(paper, identified(paper)), NOMINAL.robot.mechanism)
    assert run_command(["import", str(paper.folder), str(path), "--stage", "after", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert run_command(["report", str(paper.folder), "--json"]) == 0
    ended = capsys.readouterr()
    reported = json.loads(ended.out)
    assert told["decision"] == told["campaign"]["decision"] == reported["decision"] == "pass"
    assert told["campaign"]["reasons"] == reported["reasons"]
    assert "verdict: pass: " in ended.err
    page = (paper.folder / "report.html").read_text(encoding="utf-8")
    assert '<p class="decision">Pass</p>' in page
    assert "declared by robot-compensated.yaml, not read" in page


def test_that_no_limit_is_asked_for_is_told_and_what_else_stands_against_the_whole_is_not_good(
    paper: PaperCampaign, capsys
) -> None:
    change(paper.folder / "campaign.yaml", {"acceptance": {}})
    path = paper.folder / "after.csv"
    write_shots(path, rows(paper, identified(paper)), NOMINAL.robot.mechanism)
    words = ["import", str(paper.folder), str(path), "--stage", "after", "--json"]
    assert run_command(words) == 0
    ended = capsys.readouterr()
    assert "the campaign as a whole: no limits specified: " in ended.err
    document = json.loads(ended.out)
    assert document["decision"] == "no limits specified"
    assert document["campaign"]["decision"] == "no limits specified"
    identify(paper.campaign, IdentificationOptions(fix=("arm3.arm_mm",)))
    assert run_command([*words, "--force"]) == 1
    ended = capsys.readouterr()
    assert "the campaign as a whole: not decided: " in ended.err
    assert json.loads(ended.out)["campaign"]["decision"] == "not decided"


def test_a_measured_validation_takes_up_no_imported_one(paper: PaperCampaign) -> None:
    taken_in(paper, "before", pairs_of(paper, NOMINAL.robot.kinematics))
    work, _ = validation_work(
        paper.campaign, dict(NOMINAL.robot.parameters), ValidationOptions(stage="before")
    )
    with paper.campaign.journal_reader() as journal:
        assert series_to_take_up(journal, work) is None
