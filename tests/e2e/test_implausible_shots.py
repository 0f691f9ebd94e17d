"""Shots that cannot be the robot's are refused with their cause, by both forms of import."""

from pathlib import Path

import pytest

from app.main import run_command

VECTORS = Path(__file__).parents[1] / "data" / "vectors"
HEADER, *ROWS = (VECTORS / "table1-tracker-noise.csv").read_text(encoding="utf-8").splitlines()
COLUMNS = HEADER.split(",")
POINT, JOINTS = ("x_mm", "y_mm", "z_mm"), ("q0_deg", "q1_deg", "q2_deg", "q3_deg")


def rows(change=lambda row: row):
    for line in ROWS:
        row = dict(zip(COLUMNS, line.split(","), strict=True))
        yield change(row | {name: float(row[name]) for name in (*POINT, *JOINTS)})


def times(factor, names):
    return lambda row: row | {name: factor * row[name] for name in names}


def swapped(row):
    return row | {"q0_deg": row["q1_deg"], "q1_deg": row["q0_deg"]}


def as_csv(folder, change):
    file = folder / "shots.csv"
    lines = [",".join(str(row[name]) for name in COLUMNS) for row in rows(change)]
    file.write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
    return [file]


def as_ascii(folder, change):
    points, joints = folder / "points.txt", folder / "joints.csv"
    found = [*rows(change)]
    points.write_text(
        "".join(
            f"P{number} {' '.join(f'{row[axis]:.9f}' for axis in POINT)}\n"
            for number, row in enumerate(found)
        ),
        encoding="utf-8",
    )
    lines = [
        f"P{number},{','.join(f'{row[joint]:.12f}' for joint in JOINTS)},{row['pair']}"
        for number, row in enumerate(found)
    ]
    joints.write_text("\n".join([f"name,{','.join(JOINTS)},pair", *lines]) + "\n", encoding="utf-8")
    return [points, "--format", "ascii", "--unit", "mm", "--joints", joints]


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):

    folder = tmp_path_factory.mktemp("imports") / "campaign"
    assert run_command(["new", str(folder), "--scenario", "paper-simulation"]) == 0
    return folder


@pytest.mark.parametrize(
    ("form", "change", "cause"),
    [
        (as_csv, swapped, "the joints seem to stand in the order q1, q0"),
        (as_ascii, times(1e-3, POINT), "the points look like metres"),
    ],
    ids=["csv", "ascii"],
)
def test_cause_is_named_and_nothing_is_taken_in(pkmcal, campaign, tmp_path, form, change, cause):
    ended = pkmcal("import", campaign, *form(tmp_path, change))
    assert ended.code == 2
    assert cause in ended.error_line
    assert pkmcal("identify", campaign).code == 2, "nothing has been measured"


def test_what_is_meant_can_be_said(pkmcal, campaign, tmp_path):
    (file,) = as_csv(tmp_path, times(1e-3, POINT))
    assert pkmcal("import", campaign, file, "--unit", "m").code == 0
    assert pkmcal("identify", campaign, "--hold-out", "20%").code == 0


@pytest.mark.parametrize("factor", [pytest.param(1.01, marks=pytest.mark.long), 0.995])
def test_a_scale_in_the_export_is_named_and_never_passed(pkmcal, tmp_path, factor):
    folder = tmp_path / "campaign"
    assert pkmcal("new", folder, "--scenario", "paper-simulation").code == 0
    (file,) = as_csv(tmp_path, times(factor, POINT))
    assert pkmcal("import", folder, file).code == 0
    ended = pkmcal("identify", folder, "--json")
    assert ended.code == 1
    (doubt,) = [each for each in ended.document["doubts"] if each["name"] == "common-scale"]
    assert doubt["numbers"]["share"] == pytest.approx(factor - 1.0, abs=1e-3)
    assert pkmcal("export", folder).code != 0
    assert pkmcal("identify", folder, "--accept-scale", "--hold-out", "20%").code == 0
