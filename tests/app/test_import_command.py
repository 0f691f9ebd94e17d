"""`pkmcal import`: which files it takes by itself, and what it refuses."""

import re
import shutil

import numpy as np
import pytest
from command_line import Keyboard
from paper_campaign import NOISE_MM, TRACKER_FROM_BASE, TRUE

from app.new_campaign import create_for_devices
from campaigns.assessment import evaluate
from campaigns.campaign import open_campaign
from campaigns.evidence import joints_path
from campaigns.identification import observations
from campaigns.journal.records import Event
from campaigns.journal.views import Series

JOINTS = np.random.default_rng(5).uniform(5.0, 45.0, (12, 3))


@pytest.fixture
def folder(tmp_path):
    create_for_devices(tmp_path / "cell", "delta", "offline", "offline")
    return tmp_path / "cell"


def table(folder, *, shift_mm=0.0, unit_mm=1.0):
    """Joints, deg, and points of the nominal robot."""
    robot = open_campaign(folder).robot
    points = robot.kinematics.forward(np.radians(JOINTS)).values_or_raise()[:, :3]
    return np.hstack([JOINTS, (points + 2000.0 + shift_mm) / unit_mm])


def write_points(folder, *, unit_mm=1.0, header="Name;X;Y;Z\n"):
    rows = table(folder, unit_mm=unit_mm)[:, 3:].tolist()
    lines = [f"shot{n};{x:.7f};{y:.7f};{z:.7f}\n" for n, (x, y, z) in enumerate(rows)]
    path = folder.parent / "points.txt"
    path.write_text(header + "".join(lines))
    joints = [f"shot{n},{','.join(map(repr, row))}\n" for n, row in enumerate(JOINTS.tolist())]
    joints_path(folder, "run").write_text("name,q0_deg,q1_deg,q2_deg\n" + "".join(joints))
    return path


def write_shots(path, rows, sessions=None):
    head = "pair,q0_deg,q1_deg,q2_deg,x_mm,y_mm,z_mm" + (",session" if sessions else "")
    lines = [f"{n // 2},{','.join(map(repr, row))}" for n, row in enumerate(rows.tolist())]
    if sessions:
        lines = [f"{line},{session}" for line, session in zip(lines, sessions, strict=True)]
    path.write_text("\n".join([head, *lines]) + "\n")
    return path


def imported(folder) -> tuple[Series, ...]:
    with open_campaign(folder).journal_reader() as journal:
        return journal.series("import")


def test_points_are_joined_with_the_joints_that_plan_wrote(pkmcal, folder):
    points = write_points(folder)
    ended = pkmcal("import", folder, points, "--unit", "mm", "--json")
    assert ended.code == 0, ended.err
    taken = {"series": 1, "shots": len(JOINTS), "next": f"pkmcal identify {folder}"}
    assert ended.document == ended.document | taken
    assert "1 header line skipped: 'Name;X;Y;Z'" in ended.err
    assert len(imported(folder)[-1].shots) == len(JOINTS)


@pytest.mark.parametrize(
    ("typed", "right", "mm"),
    [("m", "mm", 1.0), ("um", "inch", 25.4), ("cm", "m", 1000.0), ("inch", "m", 1000.0)],
)
def test_wrong_unit_is_refused_with_the_right_one(pkmcal, folder, typed, right, mm):
    points = write_points(folder, unit_mm=mm)
    refused = pkmcal("import", folder, points, "--unit", typed)
    assert f"import with --unit {right}" in refused.error_line
    assert pkmcal("import", folder, points, "--unit", right).code == 0


def test_unit_of_a_wrong_header_can_be_replaced(pkmcal, folder):
    points = write_points(folder, unit_mm=25.4, header="Name;X [m];Y [m];Z [m]\n")
    assert "import with --unit inch" in pkmcal("import", folder, points).error_line
    assert pkmcal("import", folder, points, "--unit", "inch").code == 0


def test_points_without_joints_are_refused(pkmcal, folder):
    points = write_points(folder)
    joints_path(folder, "run").unlink()
    refused = pkmcal("import", folder, points)
    assert "points.txt: points alone do not state where the joints were" in refused.error_line


@pytest.mark.parametrize(
    ("words", "remedy"),
    [
        (["--robot", "held.yaml"], "give --stage before or after, or leave"),
        (["--columns", "name,x,y,z"], "add --format ascii, or"),
    ],
)
def test_options_that_do_not_go_together_are_refused(pkmcal, folder, words, remedy):
    refused = pkmcal("import", folder, "shots.csv", *words)
    assert refused.code == 2
    assert remedy in refused.error_line


def test_second_import_says_that_it_alone_would_count(pkmcal, folder, tmp_path, monkeypatch):
    first = write_shots(tmp_path / "first.csv", table(folder))
    rng = np.random.default_rng(6)
    other = table(folder) + np.hstack([np.zeros((12, 3)), 0.01 * rng.normal(size=(12, 3))])
    second = write_shots(tmp_path / "second.csv", other)
    assert pkmcal("import", folder, first).code == 0
    refused = pkmcal("import", folder, second)
    assert refused.code == 2
    assert "series 1 of 12 shots (import) is there already" in refused.error_line
    assert "--force takes them in its place; to use both" in refused.error_line
    assert len(imported(folder)) == 1
    assert pkmcal("import", folder, second, "--force").code == 0
    assert len(imported(folder)) == 2
    monkeypatch.setattr("sys.stdin", Keyboard("y\n"))
    assert pkmcal("import", folder, first).code == 0, "asked, and answered"
    assert len(imported(folder)) == 3


def test_which_of_two_sets_of_coordinates_counts_is_asked(pkmcal, folder, monkeypatch):
    points = write_points(folder, header="Name;X;Y;Z;Nominal X;Nominal Y;Nominal Z\n")
    head, *lines = points.read_text().splitlines()
    points.write_text("\n".join([head, *(f"{line};1;2;3" for line in lines)]) + "\n")
    words = ("import", folder, points, "--unit", "mm")
    assert "2 sets of X Y Z" in pkmcal(*words).error_line
    monkeypatch.setattr("sys.stdin", Keyboard("actual\n"))
    assert pkmcal(*words).code == 0
    assert len(imported(folder)[-1].shots) == 12


def test_samples_are_imported_as_they_are_and_reported_as_stops(pkmcal, folder, tmp_path):
    samples = np.repeat(table(folder), 4, axis=0)
    samples[:, 3:] += 0.004 * np.random.default_rng(2).normal(size=(48, 3))
    ended = pkmcal("import", folder, write_shots(tmp_path / "shots.csv", samples))
    assert ended.code == 0, ended.err
    assert "shots.csv: 48 rows are 12 stops: consecutive rows at equal joints are" in ended.err
    assert len(imported(folder)[-1].shots) == 48, "the journal keeps all of them"
    once = pkmcal("import", folder, write_shots(tmp_path / "shots.csv", table(folder)), "--force")
    assert "stops" not in once.err


@pytest.mark.slow
def test_samples_that_an_older_version_fitted_one_by_one_are_reported_as_they_were_fitted(
    pkmcal, folder, tmp_path, monkeypatch
):
    samples = np.repeat(table(folder), 2, axis=0)
    samples[:, 3:] += 0.004 * np.random.default_rng(2).normal(size=(24, 3))
    pkmcal("import", folder, write_shots(tmp_path / "shots.csv", samples))

    def fitted():
        pkmcal("identify", folder)
        return len(evaluate(open_campaign(folder)).errors.positions.before_mm)

    assert fitted() == 12
    monkeypatch.setattr(observations, "by_stops", lambda shots, axes: shots)
    assert fitted() == 24


def test_column_session_makes_stations_of_the_tracker(pkmcal, folder, tmp_path):
    rows = table(folder)
    rows[6:, 3:] += 500.0
    shots = write_shots(tmp_path / "shots.csv", rows, sessions=[1] * 6 + [2] * 6)
    ended = pkmcal("import", folder, shots)
    assert ended.code == 0, ended.err
    assert "2 stations of the tracker by column session: identify --sessions" in ended.err
    assert [shot.session for shot in imported(folder)[-1].shots] == [1] * 6 + [2] * 6
    assert f"next: pkmcal identify {folder} --sessions" in ended.err.splitlines()
    refused = pkmcal("identify", folder).error_line
    assert f"the tracker stood elsewhere → `pkmcal identify {folder} --sessions`" in refused
    one_station = write_shots(tmp_path / "one.csv", rows)
    assert pkmcal("import", folder, one_station, "--force").code == 2


def without_points(path, *names):
    """Leave out the points of these names."""
    lines = [line for line in path.read_text().splitlines() if line.split(";")[0] not in names]
    path.write_text("\n".join(lines) + "\n")


def events(folder) -> list[str]:
    with open_campaign(folder).journal_reader() as journal:
        return [each.record.text for each in journal.records_of(Event)]


@pytest.mark.parametrize(
    ("skip", "names"),
    [
        (["missing"], ["shot2", "shot3", "shot8", "shot9"]),
        (["2", "shot9"], ["shot2", "shot3", "shot8", "shot9"]),
        (["missing", "0"], ["shot0", "shot1", "shot2", "shot3", "shot8", "shot9"]),
    ],
)
def test_what_is_there_is_imported_without_the_pairs_that_lack_a_point(pkmcal, folder, skip, names):
    points = write_points(folder)
    without_points(points, "shot2", "shot9")
    words = ("import", folder, points, "--unit", "mm")
    refused = pkmcal(*words)
    assert "2 joints without a point" in refused.error_line
    assert "--skip missing imports what is there" in refused.error_line
    ended = pkmcal(*words, *(word for each in skip for word in ("--skip", each)))
    assert ended.code == 0, ended.err
    assert f"left out: {len(names)} shots: {', '.join(names)}" in ended.err
    assert len(imported(folder)[-1].shots) == len(JOINTS) - len(names)
    assert events(folder) == [f"{points}: left out of the import: {', '.join(names)}"]


def test_a_point_that_is_to_be_skipped_may_be_there_and_a_wrong_name_is_refused(pkmcal, folder):
    points = write_points(folder)
    words = ("import", folder, points, "--unit", "mm", "--skip")
    assert "--skip 99:" in pkmcal(*words, "99").error_line
    assert pkmcal(*words, "shot4").code == 0
    pairs = {shot.intent.pair for shot in imported(folder)[-1].shots}
    assert len(pairs) == 5
    shots = write_shots(folder.parent / "shots.csv", table(folder))
    assert "delete" in pkmcal("import", folder, shots, "--force", "--skip", "1").error_line


def checked_rows(paper, joints, moved_deg=0.0):
    """Shots of a check at these joints, one of whose encoders has slipped."""
    true = joints + np.radians([0.0, 0.0, moved_deg, 0.0])
    points = TRACKER_FROM_BASE.apply(TRUE.forward(true).values_or_raise()[:, :3])
    points += np.random.default_rng(8).normal(0.0, NOISE_MM, points.shape)
    path = paper.folder.parent / "check.csv"
    head = "pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm"
    rows = np.hstack([np.degrees(joints), points]).tolist()
    path.write_text("\n".join([head, *(f",{','.join(map(repr, row))}" for row in rows)]) + "\n")
    return path


@pytest.mark.slow
def test_a_check_is_imported_and_judged_as_a_measured_one(pkmcal, whole, tmp_path):
    paper = whole.copy_to(tmp_path / "c")
    folder = paper.folder
    joints = np.array([shot.joints for shot in paper.plan(8, 0)[1:-1]]) + 0.001
    good = pkmcal("import", folder, checked_rows(paper, joints), "--stage", "check", "--json")
    assert (good.code, good.document["decision"]) == (0, "pass"), good.err
    assert good.document["shots"] == len(joints)
    again = pkmcal("import", folder, tmp_path / "check.csv", "--stage", "check")
    assert "is a copy of shot 0 of series" in again.error_line
    slipped = checked_rows(paper, joints, moved_deg=0.2)
    bad = pkmcal("import", folder, slipped, "--stage", "check", "--json")
    assert (bad.code, bad.document["decision"]) == (1, "fail"), bad.err
    assert "encoder 2" in bad.document["parts"]
    assert bad.document["next"].endswith(" --update")
    few = checked_rows(paper, joints[:3] + 0.001)
    assert "at least 6" in pkmcal("import", folder, few, "--stage", "check").error_line
    assert pkmcal("check-journal", folder).code == 0
    assert pkmcal("identify", folder, "--update").code in {0, 1}


@pytest.mark.slow
def test_a_check_without_devices_has_a_program_and_needs_an_identification(
    pkmcal, whole, folder, tmp_path
):
    shots = write_shots(tmp_path / "shots.csv", table(folder))
    text = re.sub(r"(?m)^\d+,", ",", shots.read_text())
    (tmp_path / "check.csv").write_text(text)
    words = ("import", folder, tmp_path / "check.csv", "--stage", "check")
    assert "nothing has been measured yet" in pkmcal(*words).error_line
    assert pkmcal("import", folder, shots).code == 0
    assert "nothing has been identified" in pkmcal(*words).error_line
    assert len(imported(folder)) == 1
    copy = shutil.copytree(whole.folder, tmp_path / "c")
    written = pkmcal("plan", copy, "--program", "csv", "--stage", "check", "--json")
    assert written.code == 0, written.err
    (program,) = written.document["programs"]
    assert (program["stage"], program["shots"]) == ("check", 8)
    assert joints_path(copy, "check").read_text().count(",check") == 8
