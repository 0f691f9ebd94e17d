"""Files that cannot be used: one line that names the place, exit code 2, and nothing is touched."""

import pytest
from command_line import contents
from family_cases import VECTORS

SHOTS = VECTORS / "table1-tracker-noise.csv"


def test_a_folder_without_a_campaign(pkmcal, tmp_path):
    empty = tmp_path / "empty"
    empty.mkdir()
    for command in (("plan", empty), ("run", tmp_path / "nowhere", "--yes")):
        ended = pkmcal(*command)
        assert ended.code == 2
        assert "holds no campaign.yaml → name a campaign's folder, or make one" in ended.error_line
    assert contents(empty) == {}
    assert [*tmp_path.iterdir()] == [empty]


def lifted_by_a_metre(plan):
    head, first, row, *rows = plan.splitlines()
    cells = row.split(",")
    cells[5] = str(float(cells[5]) + 1000.0)
    return "\n".join([head, first, ",".join(cells), *rows])


@pytest.mark.parametrize(
    ("command", "file", "edit", "named"),
    [
        ("plan", "campaign.yaml", lambda text: f"{text}trackr: {{}}\n", "did you mean tracker?"),
        ("run", "cell.yaml", lambda text: f"{text}speedup: 3\n", "speed_up"),
        ("plan", "robot.yaml", None, "there is no such file"),
        ("run", "plan.csv", lifted_by_a_metre, "shot "),
        ("run", "plan.csv", None, "pkmcal plan"),
        ("import", "shots.csv", lambda text: text.replace("q3_deg,", "", 1), "q3_deg"),
    ],
)
def test_a_file_that_cannot_be_used(pkmcal, planned, command, file, edit, named):
    path = planned / file
    if command == "import":
        path.write_text(SHOTS.read_text())
    path.write_text(edit(path.read_text())) if edit else path.unlink()
    before = contents(planned)
    ended = pkmcal(command, planned, *{"run": ["--yes"], "import": [path]}.get(command, []))
    assert ended.code == 2, ended.err
    assert file in ended.error_line
    assert named in ended.error_line
    assert contents(planned) == before
    assert not (planned / "campaign.db").exists()
