"""Validations measured elsewhere: judged as measured ones, with the set declared to be held."""

import hashlib
import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import Keyboard, change
from paper_campaign import NOISE_MM, NOMINAL, TRACKER_FROM_BASE, TRUE, PaperCampaign
from paper_campaign import validation_shots as planned_shots

from app.main import run_command
from campaigns.assessment import Evaluation
from campaigns.errors import OptionsInvalid, ShotsInvalid
from campaigns.evaluation.validation import SET_OF
from campaigns.evidence import program_path
from campaigns.identification.options import IdentificationOptions
from campaigns.journal.records import Finding
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.resume import series_to_take_up
from campaigns.options import ValidationOptions, ValidationStage
from campaigns.robots.robot import compensated, pose_row, read_robot
from campaigns.shots.import_export import exported_shots, imported_files
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow, write_shots
from campaigns.workflow.correction import correct_file
from campaigns.workflow.identification import identify
from campaigns.workflow.importing import ImportTerms, declared_set, import_shots, import_validation
from campaigns.workflow.validation import Validated, validation_work

pytestmark = pytest.mark.slow
ENCODER_RAD = np.radians(1e-4)
PAIRS = frozenset({ShotSet.VALIDATION})


@pytest.fixture(scope="module")
def identified(exported_once: PaperCampaign) -> Kinematics:
    return read_robot(exported_once.folder / "robot-compensated.yaml").robot.kinematics


def rows(
    paper: PaperCampaign, commanding: Kinematics, only: frozenset[ShotSet] = PAIRS
) -> tuple[ShotRow, ...]:
    """Shots by others of a robot that goes where this set has the joints of each pose."""
    shots = [s for s in planned_shots(np.random.default_rng(6)) if s.purpose in only]
    joints = commanding.inverse(np.array([pose_row(shot.pose) for shot in shots]))
    read = np.round(joints.values_or_raise() / ENCODER_RAD) * ENCODER_RAD
    points = TRACKER_FROM_BASE.apply(TRUE.forward(read).values_or_raise()[:, :3])
    points += paper.rng.normal(0.0, NOISE_MM, points.shape)
    return tuple(
        ShotRow(shot.pair, tuple(q), tuple(point), shot.purpose)
        for shot, q, point in zip(shots, read.tolist(), points.tolist(), strict=True)
    )


def correct(paper: PaperCampaign) -> None:
    """Correct the targets of a program, as its user does."""
    targets = paper.folder / "targets.csv"
    targets.write_text("x_mm,y_mm,z_mm,theta_deg\n0,0,-600,0\n", encoding="utf-8")
    correct_file(paper.campaign, targets, paper.folder / "corrected.csv", overwrite=True)


def imported(
    paper: PaperCampaign,
    stage: ValidationStage,
    shots: Sequence[ShotRow],
    file: Path | None = None,
    **terms: object,
) -> Validated:
    held = declared_set(paper.campaign, stage, file)
    return import_validation(paper.campaign, shots, stage, held, ImportTerms(**terms))


def broken(evaluation: Evaluation) -> list[str]:
    return [check.statement for check in evaluation.checks if check.holds is False]


def test_the_gain_of_a_closed_controller_is_proved_by_shots_measured_elsewhere(
    paper: PaperCampaign, identified: Kinematics
) -> None:
    correct(paper)
    before = imported(paper, "before", rows(paper, NOMINAL.robot.kinematics, frozenset(ShotSet)))
    after = imported(paper, "after", rows(paper, identified, frozenset(ShotSet)))
    assert before.verdict.decision == "fail"
    assert after.verdict.decision == after.campaign_verdict.decision == "pass"
    evaluation = after.evaluation
    assert set(evaluation.after.series) == set(SET_OF)
    (accuracy,) = (gain for gain in evaluation.gains if gain.name == "pose accuracy AP, worst")
    assert 20.0 * accuracy.after.value_mm < accuracy.before.value_mm
    assert evaluation.gains[0].after.value_mm < 0.05 * evaluation.gains[0].before.value_mm
    held = evaluation.evidence.held("after")
    declared = "corrected.csv, without program-after.csv of that set"
    assert (held.kind, held.targets, held.declared) == ("identified", True, declared)
    assert broken(evaluation) == []
    said = "Validated after with targets corrected with what was identified in this campaign "
    assert f"{said}(declared by {declared}, not read)." in evaluation.verdict.reasons


def test_the_evidence_of_corrected_targets_is_the_program_that_was_run(paper, identified):
    correct(paper)
    program = program_path(paper.folder, "after")
    program.write_text(f"# calibrated by sha256 {declared_set(paper.campaign, 'after').digest}\n")
    evidence = imported(paper, "after", rows(paper, identified)).evaluation.evidence
    sha256 = hashlib.sha256(program.read_bytes()).hexdigest()
    assert evidence.held("after").declared == f"program-after.csv, sha256 {sha256[:16]}…"
    files = imported_files(evidence.after[-1].series.started)
    assert [(file.name, file.sha256) for file in files] == [(program.name, sha256)]


def test_last_export_is_declared_by_default_and_counts_more_than_an_earlier_load(
    paper: PaperCampaign, identified: Kinematics
) -> None:
    with paper.journal() as journal:
        journal.append(Finding("load", {"source": "old.yaml", "digest": "0" * 64, "kept": "k"}))
    told: list[str] = []
    shots = enumerate(rows(paper, identified))
    backwards = [replace(row, time=f"{-place}") for place, row in shots]
    evaluation = imported(paper, "after", backwards, tell=told.append).evaluation
    last = len(backwards) - 1
    assert "have no uncertainty of their own: U rests on default limits" in told.pop(0)
    assert told == [f"shots: sorted by time: shot {last} was measured before shot {last - 1}"]
    held = evaluation.evidence.held("after")
    assert (held.kind, held.targets) == ("identified", False)
    assert held.declared == "robot-compensated.yaml"
    assert broken(evaluation) == []


def test_a_form_that_older_software_exported_is_known_by_its_file(paper: PaperCampaign) -> None:
    whole = read_robot(paper.folder / "robot-compensated.yaml").robot
    lost = {"of": whole.digest(), "lost_mean_mm": 0.01, "lost_max_mm": 0.02}
    changed = whole.parameters | {"arm1.arm_mm": whole.parameters["arm1.arm_mm"] + 0.01}
    form = compensated(NOMINAL, "older", changed, {**whole.provenance, "projection": lost})
    path = paper.folder / "older-plain.yaml"
    path.write_text(form.document.text, encoding="utf-8")
    done = imported(paper, "after", rows(paper, form.robot.kinematics), path)
    held = done.evaluation.evidence.held("after")
    assert (held.kind, held.declared) == ("form", "older-plain.yaml")
    assert broken(done.evaluation) == []


def test_what_export_and_correct_wrote_is_known_again_and_recorded_once(
    paper: PaperCampaign,
) -> None:
    copied = shutil.copy(paper.folder / "robot-compensated.yaml", paper.folder / "sent.yaml")
    correct(paper)
    correct(paper)
    assert declared_set(paper.campaign, "after").by == "targets"
    held = declared_set(paper.campaign, "after", Path(copied))
    assert (held.by, held.file) == ("parameters", "robot-compensated.yaml")
    with paper.campaign.journal_reader() as journal:
        kinds = [entry.record.kind for entry in journal.records_of(Finding)]
    assert kinds == ["identification", "export", "export"]


def test_the_wrong_set_is_refused_and_recorded_where_it_is_overruled(paper: PaperCampaign) -> None:
    shots = rows(paper, NOMINAL.robot.kinematics)
    nominal, exported = paper.folder / "robot.yaml", paper.folder / "robot-compensated.yaml"
    with pytest.raises(OptionsInvalid, match="--stage after: the controller still holds the nom"):
        imported(paper, "after", shots, nominal)
    with pytest.raises(OptionsInvalid, match="--stage before: the controller holds what was ident"):
        imported(paper, "before", shots, exported)
    forced = imported(paper, "after", shots, nominal, anyway=True)
    assert forced.verdict.decision == "fail"
    events = [incident.text for incident in forced.evaluation.evidence.journal.incidents]
    assert any("measured all the same: --stage after" in text for text in events)


def test_what_was_measured_before_is_replaced_only_with_consent(
    paper: PaperCampaign, capsys, monkeypatch
) -> None:
    """At a terminal it is asked; whoever agrees gets as far as the controller, not there."""
    pairs = rows(paper, NOMINAL.robot.kinematics)
    others = rows(paper, NOMINAL.robot.kinematics, frozenset({ShotSet.ROTATION}))
    first = imported(paper, "before", pairs).result.distances.mean.value_mm
    with pytest.raises(OptionsInvalid, match=r"--stage before: measured already .* distances;"):
        imported(paper, "before", pairs[2:])
    words = ["validate", str(paper.folder), "--stage", "before", "--only", "distances", "--yes"]
    for answer, code in (("n\n", 2), ("y\n", 3)):
        monkeypatch.setattr("sys.stdin", Keyboard(answer))
        assert run_command(words) == code
        assert "in its place. Measure it again? [y/N]" in capsys.readouterr().err
    both = imported(paper, "before", others)
    assert both.stage_result.distances.mean.value_mm == first, "other tests are no replacement"
    evaluation = imported(paper, "before", pairs[2:], anyway=True).evaluation
    assert len(evaluation.before.distances.pairs) == len(pairs) // 2 - 1


def test_samples_of_the_stops_of_a_validation_are_averaged(
    paper: PaperCampaign, identified: Kinematics
) -> None:
    """Figures of raw samples are those of their means, and the report has the same."""
    stops = rows(paper, identified)
    noise = np.random.default_rng(3).normal(0.0, NOISE_MM, (len(stops), 5, 3))
    points = np.array([row.point_in_tracker_mm for row in stops])[:, None] + noise
    each = [
        (row, point)
        for row, of_stop in zip(stops, points.tolist(), strict=True)
        for point in of_stop
    ]
    samples = [
        replace(row, pair=place // 2, point_in_tracker_mm=tuple(point))
        for place, (row, point) in enumerate(each)
    ]
    done = imported(paper, "after", samples)
    mean = np.linalg.norm(np.diff(points.mean(axis=1).reshape(-1, 2, 3), axis=1)[:, 0], axis=1)
    assert sorted(done.result.distances.measured_mm) == pytest.approx(sorted(mean))
    assert done.evaluation.after.distances.mean == done.result.distances.mean


def test_what_was_measured_once_proves_nothing_of_itself(paper: PaperCampaign) -> None:
    with paper.campaign.journal_reader() as journal:
        kept, _ = exported_shots(
            journal.latest_series("run"), journal.shots(1), paper.campaign.robot.mechanism
        )
    seen = [replace(row, purpose=ShotSet.VALIDATION) for row in kept if row.pair is not None]
    for anyway in (False, True):
        with pytest.raises(ShotsInvalid, match=r"shot 0 is a copy of shot 1 of series 1 \(run\)"):
            imported(paper, "after", seen, anyway=anyway)
    before = rows(paper, NOMINAL.robot.kinematics)
    imported(paper, "before", before)
    with pytest.raises(ShotsInvalid, match=r"of series 2 \(before\)"):
        imported(paper, "after", before, anyway=True)
    imported(paper, "before", before, anyway=True)
    identifying = [replace(row, purpose=ShotSet.IDENTIFICATION) for row in before if row.pair]
    with pytest.raises(ShotsInvalid, match=r"of series 3 \(before\)"):
        import_shots(paper.campaign, identifying, ImportTerms(anyway=True))
    work, _ = validation_work(
        paper.campaign, dict(NOMINAL.robot.parameters), ValidationOptions(stage="before")
    )
    with paper.campaign.journal_reader() as journal:
        assert series_to_take_up(journal, work) is None, "a measured one takes up no imported one"


def test_rows_without_a_set_are_pairs_of_a_validation(
    paper: PaperCampaign, identified: Kinematics, capsys
) -> None:
    path = paper.folder / "after.csv"
    write_shots(path, rows(paper, identified), NOMINAL.robot.mechanism)
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
    other = [replace(row, purpose=ShotSet.IDENTIFICATION) for row in rows(paper, identified)]
    with pytest.raises(ShotsInvalid, match="shot 1 of the file is of the set identification"):
        imported(paper, "after", other)


def test_campaign_that_is_judged_otherwise_than_its_stage_has_exit_code_1(
    paper: PaperCampaign, identified: Kinematics, capsys
) -> None:
    change(paper.folder / "campaign.yaml", {"acceptance": {}})
    path = paper.folder / "after.csv"
    write_shots(path, rows(paper, identified), NOMINAL.robot.mechanism)
    identify(paper.campaign, IdentificationOptions(fix=("arm3.arm_mm",)))
    assert run_command(["import", str(paper.folder), str(path), "--stage", "after", "--json"]) == 1
    ended = capsys.readouterr()
    assert "the campaign as a whole: not decided\n" in ended.err
    document = json.loads(ended.out)
    assert document["decision"] == "no limits specified"
    assert document["campaign"]["decision"] == "not decided"
