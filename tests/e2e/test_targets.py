"""Corrected targets on the simulated cell: nothing is loaded, and the robot is as good."""

import numpy as np
import pytest
from command_line import change
from scipy.spatial import KDTree

from app.main import run_command
from app.wiring import connected_cell, prepare
from campaigns.campaign import open_campaign
from campaigns.controllers.gcode import parse_gcode
from campaigns.controllers.gcode_correction import correct_gcode
from campaigns.controllers.gcode_moves import Move, moves_of
from campaigns.estimation.point_sets import fitted_frame
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Finding, Intent
from campaigns.robots.robot import pose_of
from campaigns.workflow.correction import target_correction

SMALL = {
    "settle.timeout_s": 300,
    "plan.shots": 60,
    "plan.validation_pairs": 12,
    "validation.repeatability_approaches": 3,
    "validation.rotation_steps": 5,
    "validation.line_points": 5,
    "acceptance.distance_max_mm": 5.0,
}
"""Unequal rods are more than the standard model explains: the limit accepts what that leaves."""
IMPERFECT = {"speed_up": 10_000, "robot.repeatability": None, "robot.thermal": None}
"""A robot that no 22 parameters explain, and that comes back to where it was."""
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


@pytest.fixture(params=["delta", "linear-delta"])
def other(request, tmp_path):
    """The same of mechanisms with three joints, also in mm."""
    return calibrated(tmp_path / request.param, request.param)


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


def test_before_calibration_no_target_is_corrected(pkmcal, exported):
    ended = pkmcal("validate", exported, "--stage", "before", "--by", "targets", "--yes")
    assert ended.code == 2
    assert "before calibration no target is corrected" in ended.error_line


def test_the_report_says_that_targets_were_corrected(pkmcal, exported):
    words = ("--stage", "after", "--by", "targets", "--only", "distances", "--yes")
    assert pkmcal("validate", exported, *words).code == 0
    found = pkmcal("report", exported)
    assert found.code == 0
    page = (exported / "report.html").read_text(encoding="utf-8")
    assert "targets were corrected with it when it was validated after" in page
    assert "what was loaded last" not in page
    assert "after by targets" in page


SQUARE = [(-150.0, -150.0), (150.0, -150.0), (150.0, 150.0), (-150.0, 150.0), (-150.0, -150.0)]
Z_MM = -575.0
PROGRAMS = {
    "square": "G21 G90\nG0 X-150 Y-150 Z-575 C0\nG1 X150 F3000\nY150\nX-150\nY-150\n",
    "circle": "G21 G90\nG0 X150 Y0 Z-575 C0\nG3 I-150 F3000\n",
}
MEASURED = 64
FITS = 30


def along(text, task, count):
    """Commanded poses, evenly along the straight moves of a program."""
    lines = moves_of(parse_gcode(text, "p"), "p", task)
    places = np.array([line.end for line in lines if isinstance(line, Move)])
    length = np.concatenate([[0.0], np.linalg.norm(np.diff(places, axis=0), axis=1).cumsum()])
    at = np.linspace(0.0, length[-1], count)
    return np.column_stack([np.interp(at, length, column) for column in places.T])


def wanted_path(shape, count=400_001):
    if shape == "circle":
        angle = np.linspace(0.0, 2.0 * np.pi, count)
        return np.column_stack([150 * np.cos(angle), 150 * np.sin(angle), np.full(count, Z_MM)])
    part = np.linspace(0.0, 4.0, count)
    corners = np.array(SQUARE)
    columns = [np.interp(part, np.arange(5.0), column) for column in corners.T]
    return np.column_stack([*columns, np.full(count, Z_MM)])


def measured(campaign, poses):
    """Points (N, 3) that the simulated tracker sees at poses that the controller is sent to."""
    points = []
    with connected_cell(campaign) as cell:
        prepare(campaign, cell)
        for pose in poses:
            cell.robot.move_pose(pose_of(pose), 1.0)
            while cell.robot.state().moving:
                cell.clock.sleep_s(0.05)
            cell.clock.sleep_s(0.3)
            points.append(cell.tracker.measure().point_in_tracker_mm)
    return np.array(points)


def path_error_mm(points, shape):
    """Largest distance from the wanted curve, to which the tracker's frame is fitted."""
    path = wanted_path(shape)
    curve = KDTree(path)
    nearest = np.linspace(0, len(path) - 1, len(points)).round().astype(int)
    for _ in range(FITS):
        away, nearest = curve.query(fitted_frame(points, path[nearest]).apply(points))
    return float(away.max())


@pytest.mark.long
def test_errors_of_other_mechanisms_are_those_of_loaded_parameters(pkmcal, other):
    words = ("validate", other, "--stage", "after", "--yes", "--json")
    by_targets = figures(pkmcal(*words, "--by", "targets").document)
    assert pkmcal("load", other, "--yes").code == 0
    by_load = figures(pkmcal(*words).document)
    for name, figure in by_load.items():
        assert by_targets[name] == pytest.approx(figure, rel=0.1, abs=2e-4), name


@pytest.mark.long
@pytest.mark.parametrize("shape", PROGRAMS)
def test_a_program_is_followed_as_well_as_the_robot_can(quiet, shape, record_property):
    campaign = open_campaign(quiet)
    task = campaign.robot.mechanism.task
    plain = correct_gcode(PROGRAMS[shape], "p", unchanged(campaign), tolerance_mm=0.01)
    found = correct_gcode(PROGRAMS[shape], "p", target_correction(campaign), tolerance_mm=0.01)
    before, after = (
        path_error_mm(measured(campaign, along(text, task, MEASURED)), shape)
        for text in (plain.text, found.text)
    )
    record_property(f"{shape}, path error in mm before and after", (before, after))
    record_property("pieces", found.pieces)
    assert after < 0.25 * before


def unchanged(campaign):
    """No correction: the controller's program as it would be without calibration."""
    correction = target_correction(campaign)
    return type(correction)(correction.nominal, correction.nominal, correction.limits)
