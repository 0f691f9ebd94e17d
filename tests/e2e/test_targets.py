"""Corrected targets on the simulated cell: nothing is loaded, and the robot is as good."""

import numpy as np
import pytest
from command_line import change

from app.main import run_command
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Finding, Intent

SMALL = {
    "plan.shots": 60,
    "plan.validation_pairs": 12,
    "validation.repeatability_approaches": 3,
    "validation.rotation_steps": 5,
    "validation.line_points": 5,
    "acceptance.distance_max_mm": 5.0,
}
"""The limit accepts what the robot's path leaves."""
IMPERFECT = {
    "speed_up": 10_000,
    "robot.repeatability": None,
    "robot.thermal": None,
    "controller.computes_plate_tilt": True,
    "controller.computes_transmission": True,
}
"""A robot that no 22 parameters explain, and that comes back to where it was; its controller can be
given all that was identified."""
HARDLY_ANY_NOISE = {
    f"tracker.noise.{of}.{key}": value
    for of in ("along", "azimuth", "elevation")
    for key, value in (("constant_um", 0.1), ("per_metre_um", 0.0))
}
"""For validation: what differs then is the correction, or the path."""


def calibrated(folder, robot="par4-prototype"):
    assert run_command(["new", str(folder), "--robot", robot, "--scenario", "realistic"]) == 0
    change(folder / "campaign.yaml", SMALL)
    backlash = "backlash_mm" if robot == "linear-delta" else "backlash_arcmin"
    change(folder / "cell.yaml", {**IMPERFECT, f"robot.{backlash}": None})
    for words in (("plan",), ("run", "--yes"), ("identify",), ("export",)):
        assert run_command([words[0], str(folder), *words[1:]]) == 0, words
    change(folder / "cell.yaml", HARDLY_ANY_NOISE)
    return folder


@pytest.fixture(scope="module")
def quiet(tmp_path_factory):
    """A calibrated Par4 whose controller keeps its nominal parameters."""
    return calibrated(tmp_path_factory.mktemp("quiet") / "quiet")


def figures(document):
    distances, rotation = document["distances_mm"], document["rotation_mm"]
    return {
        "distances, mean": distances["mean_abs"],
        "distances, largest": distances["max_abs"],
        **({} if rotation is None else {"rotation": rotation}),
        **{f"straightness, {axis}": mm for axis, mm in document["straightness_mm"].items()},
        "frame, mean": document["frame_mm"]["mean"],
    }


@pytest.mark.long
def test_errors_are_those_of_loaded_parameters(pkmcal, quiet, record_property):
    before = pkmcal("validate", quiet, "--stage", "before", "--yes", "--json").document
    targets = pkmcal("validate", quiet, "--stage", "after", "--by", "targets", "--yes", "--json")
    with read_journal(quiet / "campaign.db") as journal:
        series = journal.latest_series("after by targets")
        intents = [entry.record for entry in journal.records_of(Intent, series.number)]
        finding = [entry.record.body for entry in journal.records_of(Finding)][-1]
    assert (finding["stage"], finding["by"]) == ("after", "targets")
    moved = [
        np.linalg.norm(np.subtract(each.commanded.coordinates, each.target.coordinates)[:3])
        for each in intents
    ]
    assert 0.1 < np.mean(moved) < 10.0
    assert pkmcal("report", quiet).code in {0, 1}
    page = (quiet / "report.html").read_text(encoding="utf-8")
    assert "targets were corrected with the identified set when the robot was validated" in page
    assert "what was loaded last" not in page
    assert pkmcal("load", quiet, "--yes").code == 0
    refused = pkmcal("validate", quiet, "--stage", "after", "--by", "targets", "--yes")
    assert refused.code == 2
    assert "does not hold the nominal parameters" in refused.error_line
    loaded = pkmcal("validate", quiet, "--stage", "after", "--yes", "--json")
    assert pkmcal("load", quiet, "--rollback", "--yes").code == 0
    was, by_targets, by_load = map(figures, (before, targets.document, loaded.document))
    record_property("before, by targets and loaded, mm", (was, by_targets, by_load))
    for name, figure in by_load.items():
        assert by_targets[name] == pytest.approx(figure, rel=0.1), name
    assert by_load["distances, mean"] < 0.2 * was["distances, mean"]


def test_corrected_targets_are_measured_without_a_load_but_not_before_calibration(pkmcal, exported):
    refused = pkmcal("validate", exported, "--stage", "before", "--by", "targets", "--yes")
    assert refused.code == 2
    assert "before calibration no target is corrected" in refused.error_line
    words = ("--stage", "after", "--by", "targets", "--only", "distances", "--yes", "--json")
    assert pkmcal("validate", exported, *words).document["distances_mm"]["max_abs"] < 0.1
    with read_journal(exported / "campaign.db") as journal:
        findings = [entry.record for entry in journal.records_of(Finding)]
    assert (findings[-1].body["stage"], findings[-1].body["by"]) == ("after", "targets")
    assert not [finding for finding in findings if finding.kind.startswith("load")]


@pytest.mark.long
def test_errors_of_joints_in_mm_are_those_of_loaded_parameters(pkmcal, tmp_path):
    other = calibrated(tmp_path / "other", "linear-delta")
    words = ("validate", other, "--stage", "after", "--yes", "--json")
    by_targets = figures(pkmcal(*words, "--by", "targets").document)
    assert pkmcal("load", other, "--yes").code == 0
    by_load = figures(pkmcal(*words).document)
    for name, figure in by_load.items():
        assert by_targets[name] == pytest.approx(figure, rel=0.1, abs=2e-4), name
