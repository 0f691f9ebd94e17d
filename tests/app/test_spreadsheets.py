"""CSV files that `--excel` writes: spreadsheets open them, commands read them."""

import pytest
from paper_campaign import MECHANISM, new_campaign

from campaigns.planning.plan_file import read_plan
from campaigns.shots.joined_shots import read_joints
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow, read_shots, write_shots

SHOTS = tuple(
    ShotRow(0, (0.5, 0.25, -0.5, shot / 8), (2000.5 + shot, -10.25, 300.0)) for shot in range(2)
)


def cells(path):
    """Cells of a file for spreadsheets, by line."""
    data = path.read_bytes()
    assert data.startswith(b"\xef\xbb\xbf")
    return [line.split(";") for line in data.decode("utf-8-sig").splitlines()]


@pytest.fixture(scope="module")
def paper(whole, tmp_path_factory):
    return whole.copy_to(tmp_path_factory.mktemp("sheets") / "c")


def test_exported_shots_are_the_same_when_a_command_reads_them(pkmcal, paper, tmp_path):
    plain, sheet = tmp_path / "plain.csv", tmp_path / "sheet.csv"
    assert pkmcal("export", paper.folder, "--format", "shots", "--to", plain).code == 0
    ended = pkmcal("export", paper.folder, "--format", "shots", "--to", sheet, "--excel")
    assert ended.code == 0
    assert len({len(row) for row in cells(sheet)}) == 1
    assert not any("." in cell for cell in cells(sheet)[1][:8])
    assert read_shots(sheet, MECHANISM) == read_shots(plain, MECHANISM)
    refused = pkmcal("export", paper.folder, "--excel")
    assert refused.code == 2
    assert "add --format shots" in refused.error_line


def test_a_plan_and_its_programs_are_the_same(pkmcal, tmp_path):
    folder = new_campaign(tmp_path / "c").folder
    words = ("plan", folder, "--shots", "24", "--program", "csv", "--stage", "run")
    assert pkmcal(*words).code == 0
    plan, joints = folder / "plan.csv", next(folder.glob("*joints*.csv"))
    expected = read_plan(plan, MECHANISM)
    at_joints = [shot for _, shot in read_joints(joints, MECHANISM, ShotSet.IDENTIFICATION)]
    assert pkmcal(*words, "--excel").code == 0
    assert cells(plan)[0][:3] == ["shot", "set", "pair"]
    assert read_plan(plan, MECHANISM) == expected
    assert cells(joints)[0][0] == "name"
    again = [shot for _, shot in read_joints(joints, MECHANISM, ShotSet.IDENTIFICATION)]
    assert again == at_joints


def test_corrected_poses(pkmcal, paper, tmp_path):
    poses = tmp_path / "poses.csv"
    poses.write_text("name;x_mm;y_mm;z_mm;theta_deg\np;10,5;-20,25;-575;0\n", encoding="utf-8")
    ended = pkmcal("correct", paper.folder, "--poses", poses, "--excel")
    assert ended.code == 0, ended.err
    corrected = cells(tmp_path / "poses-corrected.csv")
    assert corrected[1][:4] == ["p", "10,5", "-20,25", "-575,0"]
    commanded = float(corrected[1][5].replace(",", "."))
    assert commanded == pytest.approx(10.5, abs=5.0)


def as_in_germany(text):
    return text.replace(",", ";").replace(".", ",")


def with_counts(text):
    head, *lines = text.splitlines()
    return "\n".join([f"no.,{head}", *(f"{n},{line}" for n, line in enumerate(lines, start=1))])


VARIANTS = {
    "semicolons and decimal commas": as_in_germany,
    "tabs below a title": lambda text: f"Cell 7, in May\n\n{text.replace(',', chr(9))}",
    "rows counted": with_counts,
    "quotes and comments": lambda text: (
        "# by hand\n"
        + "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in text.splitlines())
        + "\n// end\n"
    ),
    "units in brackets": lambda text: text.replace("_mm", " [mm]").replace("_deg", " [°]", 1),
    "empty columns and rows": lambda text: text.replace("\n", ",,\n") + ",,,\n",
    "UTF-16": lambda text: text.encode("utf-16"),
    "UTF-32": lambda text: text.encode("utf-32"),
    "a byte-order mark and CRLF": lambda text: text.replace("\n", "\r\n").encode("utf-8-sig"),
}
"""Forms in which programs and people write a table of commas and decimal points."""


def rewritten(path, variant):
    """Write a file's text in another form, beside it; return the new path."""
    text = VARIANTS[variant](path.read_text(encoding="utf-8"))
    other = path.with_name(f"{variant}-{path.name}")
    other.write_bytes(text if isinstance(text, bytes) else text.encode())
    return other


@pytest.mark.parametrize("variant", VARIANTS)
def test_plans_shots_and_joints_are_read_in_any_form(paper, tmp_path, variant):
    plan = tmp_path / "plan.csv"
    plan.write_bytes(paper.campaign.plan_path.read_bytes())
    assert read_plan(rewritten(plan, variant), MECHANISM) == read_plan(plan, MECHANISM)
    shots = tmp_path / "shots.csv"
    write_shots(shots, SHOTS, MECHANISM)
    assert read_shots(rewritten(shots, variant), MECHANISM) == read_shots(shots, MECHANISM)
    joints = tmp_path / "joints.csv"
    joints.write_text("q0_deg,q1_deg,q2_deg,q3_deg,pair\n1.5,2,-3,4.25,0\n5,6,7,8.125,0\n")
    of_file, of_variant = (
        [shot for _, shot in read_joints(path, MECHANISM, ShotSet.IDENTIFICATION)]
        for path in (joints, rewritten(joints, variant))
    )
    assert of_variant == of_file


def test_targets_are_read_in_any_form(pkmcal, paper, tmp_path):
    poses, to, corrected = tmp_path / "poses.csv", tmp_path / "to", []
    poses.write_text("x_mm,y_mm,z_mm,theta_deg\n100,0.5,-600,10\n-120.5,80,-550,-20\n")
    for path in (poses, *(rewritten(poses, variant) for variant in VARIANTS)):
        ended = pkmcal("correct", paper.folder, "--poses", path, "--to", to, "--force")
        assert ended.code == 0, ended.err
        rows = to.read_text(encoding="utf-8").splitlines()
        corrected.append([row.partition(",")[2] for row in rows])  # rows may have got names
    assert corrected == corrected[:1] * (1 + len(VARIANTS))


def test_an_encoding_that_is_given_counts_for_shots(pkmcal, tmp_path):
    folder = new_campaign(tmp_path / "c").folder
    shots = tmp_path / "shots.csv"
    write_shots(shots, SHOTS, MECHANISM)
    shots.write_bytes("# Säule\n".encode("cp1252") + shots.read_bytes())
    refused = pkmcal("import", folder, shots)
    assert "byte 0xe4 is not UTF-8 text" in refused.error_line
    assert "give --encoding" in refused.error_line
    ended = pkmcal("import", folder, shots, "--encoding", "cp1252")
    assert "UTF-8" not in ended.err, "what is refused now is the shots"
    refused = pkmcal("import", folder, shots, "--encoding", "cp1252", "--columns", "x,y,z")
    assert "for point files of other software" in refused.error_line
