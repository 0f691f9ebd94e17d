"""A campaign's evaluation against numbers found another way."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from changed_results import with_fields
from paper_campaign import LOAD_BEGUN, NOISE_MM, NOMINAL, PaperCampaign

from campaigns.assessment import Evaluation, evaluate
from campaigns.campaign import open_campaign
from campaigns.evidence import gather
from campaigns.identification.identify import identify
from campaigns.journal.records import Finding
from campaigns.shots.shots import held_out


def test_pairs_that_the_identification_held_out_itself_are_unseen(whole: PaperCampaign) -> None:
    shots = held_out(gather(whole.campaign).run.shots, 0.2, np.random.default_rng(1))
    found = identify(NOMINAL.robot.kinematics, shots)
    evidence = gather(whole.campaign)
    kept = with_fields(evidence.identification, modelled=found.residuals.modelled)
    errors = Evaluation(replace(evidence, identification=kept)).errors
    assert (len(errors.fitted.numbers), len(errors.unseen.numbers)) == (32, 8 + 8)
    assert errors.unseen.before_mm == pytest.approx(found.residuals.unseen.before[:, 0])
    assert errors.unseen.after_mm == pytest.approx(found.residuals.unseen.after[:, 0])


def test_positions_are_in_the_base_frame_and_drift_and_air_in_their_time(evaluation) -> None:
    positions = evaluation.errors.positions
    after = np.linalg.norm(positions.after_mm, axis=1)
    assert after.max() < 10.0 * NOISE_MM
    assert np.linalg.norm(positions.before_mm, axis=1).max() > 1.0
    assert positions.fitted.sum() == 80
    run = next(series for series in evaluation.time_series if series.name == "run")
    assert len(run.drift_mm) == 2
    assert run.drift_mm[0] == 0.0
    assert np.all(np.diff(run.temperature_s) > 0.0)
    assert run.temperature_degC[0] == pytest.approx(20.0)


def test_a_load_without_an_end_leaves_the_verdict_open(whole, tmp_path) -> None:
    folder = shutil.copytree(whole.folder, tmp_path / "loading")
    settings = (folder / "campaign.yaml").read_text("utf-8")
    limited = settings.replace("  distance_mean_mm:\n", "  distance_mean_mm: 1.0\n")
    (folder / "campaign.yaml").write_text(limited, "utf-8")
    paper = PaperCampaign(folder, open_campaign(folder), np.random.default_rng(4))
    assert evaluate(paper.campaign).verdict.decision == "pass"
    with paper.journal() as journal:
        journal.append(LOAD_BEGUN)
    found = evaluate(paper.campaign)
    assert "was begun at" in found.evidence.journal.unended_load
    assert found.verdict.decision == "not decided"
    with paper.journal() as journal:
        journal.append(Finding("load begun", {"source": "of another version"}))
    assert "cannot read" in gather(paper.campaign).journal.unended_load
    with paper.journal() as journal:
        journal.append(Finding("load failed", {"source": "x", "reason": "y"}))
    assert evaluate(paper.campaign).verdict.decision == "not decided"
