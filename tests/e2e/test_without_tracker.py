"""A campaign without a tracker: heights of a bed and widths of a part, from `new` to `export`."""

import re
import shlex
from dataclasses import replace

import pytest
from observation_files import rows_of
from printers import BED_MM, Printer, printer, printer_text, rings

from campaigns.robots.robot import find_robot
from campaigns.shots.observations_csv import write_observations
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import rows_of_shots
from campaigns.shots.shots_csv import write_shots

OBJECTS = """objects:
  - {name: bed}
  - {name: part, shrinkage_percent: 0.2, shrinkage_std_percent: 0.01}
"""
MECHANISM = printer().mechanism
PLACES = rings(BED_MM, 3)


@pytest.fixture
def cell(pkmcal, tmp_path, monkeypatch):
    """An offline campaign of a printer, whose bed and part stand in campaign.yaml."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "printer.yaml").write_text(printer_text(), encoding="utf-8")
    assert pkmcal("new", "cell", "--robot", "printer.yaml", "--offline").code == 0
    settings = tmp_path / "cell" / "campaign.yaml"
    settings.write_text(settings.read_text().replace("objects: []\n", OBJECTS))
    return tmp_path / "cell"


def observe(path, rows, force=False):
    write_observations(path, rows, MECHANISM, overwrite=force)


def follow(pkmcal, ended, most=8):
    """Type what is next until nothing is; gives what was typed."""
    typed = []
    while (said := re.search(r"^next: pkmcal (.*)$", ended.err + ended.out, re.M)) is not None:
        assert len(typed) < most, typed
        typed.append(said[1])
        ended = pkmcal(*shlex.split(said[1]))
        assert ended.code in {0, 1}, (typed, ended.err)
    return typed


def test_hints_alone_lead_from_a_new_campaign_to_a_report(pkmcal, cell):
    drawn = Printer(1)
    observe(
        cell.parent / "observations.csv",
        rows_of(drawn.heights(PLACES)) + rows_of(drawn.widths(60.0)),
    )
    assert follow(pkmcal, pkmcal("status", "cell")) == [
        "import cell observations.csv",
        "identify cell",
        "identify cell --hold-out 20% --for flat,xy",
        "export cell --format klipper",
        "report cell",
    ]
    assert (cell / "klipper.cfg").exists()
    status = pkmcal("status", "cell", "--json").document
    assert status["observations"] == [
        {"name": "observations.csv", "objects": {"bed": len(PLACES), "part": 12}}
    ]
    assert status["next"] is None
    page = (cell / "report.html").read_text()
    assert "Observations without a tracker, and what they determine" in page
    assert "4 heights of bed that were not fitted" in page
    assert "No tracker has measured" in page
    assert "There is no validation" not in page  # nothing could validate
    assert "older model" not in page
    assert pkmcal("history", "cell").code == 0
    assert pkmcal("export", "cell").code == 0
    exported = find_robot(str(cell / "robot-compensated.yaml")).robot
    after, before = (drawn.errors_of(each.kinematics) for each in (exported, printer()))
    assert after["flat"] < 0.4 * before["flat"]
    assert after["xy"] < 0.6 * before["xy"]
    (cell / "poses.csv").write_text("x_mm,y_mm,z_mm\n0,0,5\n50,0,5\n")
    assert pkmcal("correct", "cell", "--poses", cell / "poses.csv").code == 0


def test_heights_alone_are_judged_flat_and_no_more(pkmcal, cell):
    observe(cell.parent / "heights.csv", rows_of(Printer(2).heights(rings(BED_MM, 4))))
    assert pkmcal("import", "cell", "heights.csv").code == 0
    whole = pkmcal("identify", "cell", "--json")
    assert (whole.code, whole.document["verdict"]) == (1, "not decided")
    assert whole.document["next"] == "pkmcal identify cell --hold-out 20% --for flat"
    flat = pkmcal("identify", "cell", "--hold-out", "20%", "--for", "flat", "--json").document
    assert flat["verdict"] == "pass"
    assert [reason.partition(":")[0] for reason in flat["reasons"]] == ["flat"]
    assert "no tracker has measured" in pkmcal("export", "cell", "--format", "shots").error_line
    tested = {each["name"]: each["is_tested"] for each in flat["determined"]}
    assert (tested["flat"], tested["xy"]) == (True, False)
    assert "does not turn" in pkmcal("identify", "cell", "--for", "rotation").error_line
    for words in (("--only-shots", "0-5"), ("--model", "paper")):
        assert "are for shots" in pkmcal("identify", "cell", *words).error_line
    asked = pkmcal("identify", "cell", "--hold-out", "20%", "--fix", "rods", "--json").document
    assert asked["next"] == "pkmcal identify cell --hold-out 20% --for flat"


def test_a_file_counts_until_another_of_its_name_takes_its_place(pkmcal, cell):
    path = cell.parent / "heights.csv"
    rows = rows_of(Printer(3).heights(PLACES))
    observe(path, rows)
    assert pkmcal("import", "cell", "heights.csv").code == 0
    refused = pkmcal("import", "cell", "heights.csv")
    assert refused.code == 2
    assert f"heights.csv: a file of that name with {len(rows)} observations" in refused.error_line
    assert "--force" in refused.error_line
    copied = cell.parent / "again.csv"
    copied.write_bytes(path.read_bytes())
    assert "again.csv:2: is a copy of heights.csv:2" in pkmcal("import", "cell", copied).error_line
    observe(path, rows[:10], force=True)
    assert pkmcal("import", "cell", "heights.csv", "--force").code == 0
    status = pkmcal("status", "cell", "--json").document
    assert status["observations"] == [{"name": "heights.csv", "objects": {"bed": 10}}]


def test_a_std_lowered_after_the_measurement_passes_nothing_and_gives_no_certificate(pkmcal, cell):
    assert pkmcal("set", "cell", "certificate.number=C-1").code == 0
    path, rows = cell.parent / "heights.csv", rows_of(Printer(3).heights(PLACES))
    rows = [replace(row, std_source="default") for row in rows]
    observe(path, rows)
    assert "by which no certificate is issued" in pkmcal("import", "cell", "heights.csv").err
    assert pkmcal("identify", "cell", "--hold-out", "20%", "--for", "flat").code == 0
    first = pkmcal("report", "cell", "--json").document
    (missing,) = [text for text in first["missing"] if "lacks" in text]
    assert f"σ of {len(rows)} of {len(rows)} observations is what is usual" in missing
    assert not any("stated of the measurement first" in reason for reason in first["reasons"])
    text = path.read_text()
    path.write_text(text.replace(",0.01,default", ',0.002,"Acme 9, typed by A. Bee"'))
    assert path.read_text() != text
    assert pkmcal("import", "cell", "heights.csv", "--force").code == 0
    said = pkmcal("identify", "cell", "--hold-out", "20%", "--for", "flat")
    assert "is not what was stated of the measurement first" in said.out + said.err
    again = pkmcal("report", "cell", "--json").document
    assert again["decision"] != "pass"
    (reason,) = [text for text in again["reasons"] if "stated of the measurement" in text]
    assert "σ 0.002 mm where heights.csv of 20" in reason
    assert "has 0.01 mm" in reason
    (missing,) = [text for text in again["missing"] if "lacks" in text]
    assert "0.002 mm where" in missing
    page = (cell / "report.html").read_text()
    assert "Acme 9, typed by A. Bee" in page
    assert "<title>Calibration report" in page


def test_a_result_is_out_of_date_once_observations_or_objects_change(pkmcal, cell):
    observe(cell.parent / "heights.csv", rows_of(Printer(4).heights(PLACES)))
    for command in (
        ("import", "cell", "heights.csv"),
        ("identify", "cell", "--hold-out", "20%", "--for", "flat"),
    ):
        assert pkmcal(*command).code == 0
    assert (
        pkmcal("status", "cell", "--json").document["next"] == "pkmcal export cell --format klipper"
    )
    observe(cell.parent / "widths.csv", rows_of(Printer(4).widths(60.0)))
    assert (
        pkmcal("import", "cell", "widths.csv", "--json").document["next"] == "pkmcal identify cell"
    )
    assert pkmcal("identify", "cell", "--hold-out", "20%", "--for", "flat,xy").code == 0
    settings = cell / "campaign.yaml"
    settings.write_text(settings.read_text().replace("std_percent: 0.01", "std_percent: 0.3"))
    refused = pkmcal("export", "cell")
    assert refused.code == 1
    assert "objects in campaign.yaml changed since the identification" in refused.error_line


@pytest.mark.parametrize(
    ("changed", "words", "said"),
    [
        ({"object": "bett"}, (), "heights.csv:2: unknown object 'bett'"),
        ({"values": ()}, (), "heights.csv:2: 19 of 19 observations have no value"),
        ({}, ("--stage", "before"), "options of shots and points are not for observations"),
        ({}, ("--unit", "m"), "options of shots and points are not for observations"),
    ],
)
def test_what_cannot_be_taken_is_refused(pkmcal, cell, changed, words, said):
    rows = [replace(row, **changed) for row in rows_of(Printer(3).heights(PLACES))]
    observe(cell.parent / "heights.csv", rows)
    refused = pkmcal("import", "cell", "heights.csv", *words)
    assert refused.code in {1, 2}
    assert said in refused.error_line
    assert not (cell / "campaign.db").exists()


def test_too_few_heights_are_refused(pkmcal, cell):
    observe(cell.parent / "heights.csv", rows_of(Printer(3).heights(PLACES[:5])))
    refused = pkmcal("import", "cell", "heights.csv")
    assert refused.code in {1, 2}
    assert "5 heights of bed" in refused.error_line


def test_heights_beside_shots_are_fitted_with_them(pkmcal, cell):
    drawn = Printer(5)
    shots = [
        replace(row, pair=100 + row.pair) if row.purpose is ShotSet.VALIDATION else row
        for row in rows_of_shots(drawn.points(24, pairs=5))
    ]
    write_shots(cell.parent / "shots.csv", shots, MECHANISM)
    observe(cell.parent / "heights.csv", rows_of(drawn.heights(PLACES)))
    for file in ("shots.csv", "heights.csv"):
        assert pkmcal("import", "cell", file).code == 0
    both = pkmcal("identify", "cell", "--json").document
    assert (both["shots"], both["observations"]) == (34, len(PLACES))
    names = [each["name"] for each in both["determined"]]
    assert set(names) == {"position", "flat", "xy"}


def test_rows_left_out_are_named_by_file_and_line(pkmcal, cell):
    """Two widths that somebody mistyped, in the second rows of their pairs."""
    rows = rows_of(Printer(6).heights(PLACES)) + rows_of(Printer(6).widths(60.0, wrong=(1, 4)))
    observe(cell.parent / "observations.csv", rows)
    assert pkmcal("import", "cell", "observations.csv").code == 0
    said = pkmcal("identify", "cell").out
    lines = [1 + len(PLACES) + 2 * (1 + place) for place in (1, 4)]
    assert f"observations.csv:{lines[0]}, observations.csv:{lines[1]}" in said
