"""Measurements of a real robot are read, calibrated, and predicted where they were unseen."""

import csv
import json
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks import real, real_printers, real_ur10
from campaigns.fit.rigid_transforms import Transform

SHIPPED = real_ur10.DATA["ur10"]
LEVEL = 1e-3
"""Probability of chance below which unseen points contradict the fit, as `identify` has it."""


@pytest.fixture
def rows():
    with SHIPPED.open(encoding="utf-8") as text:
        return list(csv.DictReader(text))[:20]


@pytest.fixture
def written(tmp_path):
    def written(rows):
        file = tmp_path / "rows.csv"
        with file.open("w", encoding="utf-8", newline="") as text:
            table = csv.DictWriter(text, rows[0].keys())
            table.writeheader()
            table.writerows(rows)
        return file

    return written


def test_rows_in_any_order_with_other_columns_are_read_in_the_order_of_measuring(rows, written):
    kept = ("row", *real_ur10.POINT, *real_ur10.JOINTS)
    shuffled = [{name: rows[place][name] for name in kept} for place in (7, 0, 19, 3)]
    measured = real_ur10.MeasuredRows.read(written(shuffled))
    assert measured.points[:, 0].tolist() == [float(rows[n]["x_mm"]) for n in (0, 3, 7, 19)]
    assert np.degrees(measured.joints[1, 5]) == pytest.approx(float(rows[3]["q5_deg"]))


@pytest.mark.parametrize(
    ("change", "words"),
    [({"q3_deg": ""}, "line 4: q3_deg is ''"), ({"y_mm": "nan"}, "line 4: y_mm is 'nan'"),
     ({"x_mm": "1,5"}, "line 4: x_mm is '1,5'"), ({"row": "0"}, "line 4: row 0 stands")],
)  # fmt: skip
def test_a_row_that_says_nothing_is_refused_with_its_line(rows, written, change, words):
    rows[2] |= change
    with pytest.raises(real_ur10.DataInvalid, match=words):
        real_ur10.MeasuredRows.read(written(rows))


def test_a_row_that_ends_early_and_a_lacking_column_are_refused(rows, written, tmp_path):
    file = written(rows)
    short = tmp_path / "short.csv"
    short.write_text(file.read_text(encoding="utf-8") + "99,1,2\n", encoding="utf-8")
    with pytest.raises(real_ur10.DataInvalid, match=r"line 22: q2_deg is ''"):
        real_ur10.MeasuredRows.read(short)
    without = [{name: cell for name, cell in row.items() if name != "z_mm"} for row in rows]
    with pytest.raises(real_ur10.DataInvalid, match=r"line 1: no column z_mm"):
        real_ur10.MeasuredRows.read(written(without))


def test_too_few_rows_for_what_is_asked_are_an_error_of_the_command(rows, written, capsys):
    file = written(rows)
    with pytest.raises(SystemExit) as stopped:
        run("--data", str(file), "--shots", "15", "--unseen", "6")
    assert stopped.value.code == 2
    assert "20 rows, 21 are asked for" in capsys.readouterr().err


def run(*words, robot="ur10"):
    before, sys.argv = sys.argv, ["real", robot, *words]
    try:
        return real.main()
    finally:
        sys.argv = before


def test_a_probe_is_found_where_it_is():
    rng = np.random.default_rng(1)
    axes = Rotation.random(12, random_state=1).as_matrix()
    place, probe = rng.normal(0.0, 300.0, (12, 3)), np.array([5.0, -120.0, 80.0])
    tracker_from_base = Transform(Rotation.random(random_state=2).as_matrix(), rng.normal(size=3))
    seen = tracker_from_base.apply(place + axes @ probe)
    assert real_ur10.probe_mm(place, axes, seen) == pytest.approx(probe, abs=1e-6)


def test_unseen_points_of_a_real_robot_are_where_few_shots_say(capsys):
    assert run("--shots", "40", "--unseen", "60", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["before_mm"] > 2.0 * figures["after_mm"]
    assert figures["p"] > LEVEL
    assert 0.7 < figures["chi2_per_row"] < 1.4
    assert figures["verdict"] in ("pass", "not decided", "fail")
    assert figures["stated_mm"] > 0.0


@pytest.mark.slow
def test_unseen_poses_of_a_probe_are_where_few_poses_say(capsys):
    assert run("--shots", "40", "--unseen", "40", "--json", robot="ur10-poses") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["verdict"] in ("pass", "not decided", "fail")
    assert figures["position_mm"] < 0.8
    assert figures["rotation_deg"] < 0.1
    assert figures["position_mm"] < 2.0 * figures["stated_mm"]
    assert figures["rotation_deg"] < 2.0 * figures["stated_deg"]


def test_poses_of_a_file_without_turns_are_refused(rows, written, capsys):
    without = [{n: cell for n, cell in row.items() if not n.startswith("r")} | {"row": row["row"]}
               for row in rows]  # fmt: skip
    with pytest.raises(SystemExit):
        run("--data", str(written(without)), "--shots", "10", "--unseen", "5", robot="ur10-poses")
    assert "no column rx_deg, ry_deg, rz_deg" in capsys.readouterr().err


@pytest.mark.slow
def test_touches_kept_unseen_are_nearer_than_by_the_public_sizes():
    (figures,) = real_printers.calibrate_heights(splits=2, fitted=(30,))
    assert figures.before_mm > 2.0 * figures.after_mm
    assert figures.after_mm < 2.0 * figures.stated_mm
    assert sum(figures.verdicts.values()) == 2
    assert figures.xy_tested == 0
    assert "tested in 0 draws" in real_printers.text_of_heights([figures])


@pytest.mark.slow
def test_a_split_that_never_saw_a_part_of_the_bed_is_not_passed():
    """The error that only the unseen heights show, in one of twelve draws."""
    figures = real_printers.calibrate_heights(fitted=(21,))[0]
    assert figures.worst_mm > 3.0 * figures.after_mm
    assert figures.smallest_p < LEVEL
    assert figures.verdicts["pass"] < 12


@pytest.mark.slow
def test_rods_stay_where_they_are_measured_and_mistyped_widths_are_named():
    lists = real_printers.calibrate_lists()
    assert [each.named for each in lists] == [(), (), (6, 7, 8, 9, 10, 11)]
    for each in lists:
        assert each.verdict == "not decided"
        for rod_mm, std_mm in each.rods_mm:
            assert abs(rod_mm - 290.0) < 2.0 * std_mm < 4.0
        assert each.shrinkage_percent[1] == pytest.approx(0.3, rel=0.05)
