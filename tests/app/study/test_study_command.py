"""pkmcal study: from plan, scenario and model to tables and a verdict on σ."""

import csv
import json
import shutil

import pytest

from app.main import run_command
from app.study.running import Part, simulated_parts
from campaigns.campaign import now_utc
from campaigns.files.lock import campaign_lock

pytestmark = pytest.mark.usefixtures("small_parts")

NAME = "plan-paper-simulation"
TABLE = f"{NAME}.jsonl"


@pytest.fixture
def studied(pkmcal):
    """Studies in this process; gives exit code and document."""

    def run(*arguments):
        code, out, err = pkmcal("study", *arguments, "--workers", 1, "--json")
        assert code in {0, 1}, err
        return code, json.loads(out)

    return run


@pytest.fixture
def refused(pkmcal):
    """Gives the line in which a study is refused, before anything is written."""

    def run(folder, *arguments):
        code, out, err = pkmcal("study", folder, *arguments)
        assert (code, out) == (2, "")
        assert not (folder / "study").exists()
        (line,) = err.splitlines()
        assert line.startswith("pkmcal: ")
        assert " → " in line
        return line

    return run


def table_of(folder):
    return (folder / "study" / TABLE).read_text(encoding="utf-8")


@pytest.fixture
def small_parts(monkeypatch):
    monkeypatch.setattr("app.study.running.CAMPAIGNS_A_PART", 2)


def stopped_after_one_part(simulate, parts, executor):
    yield next(simulated_parts(simulate, parts, None))
    raise KeyboardInterrupt


def loses_the_second_part(simulate, parts, executor):
    yield Part(parts[1], lost="killed")
    yield from simulated_parts(simulate, [parts[0], *parts[2:]], None)


@pytest.fixture(scope="session")
def whole_study(planned_once, tmp_path_factory):
    """Exit code, folder and document of a study of six campaigns."""
    folder = shutil.copytree(planned_once, tmp_path_factory.mktemp("whole") / "small")
    code = run_command(["study", str(folder), "--campaigns", "6", "--workers", "1"])
    return code, folder, json.loads((folder / "study" / f"{NAME}.json").read_text())


@pytest.fixture
def studied_folder(whole_study, tmp_path):
    """A copy of the study for a test that changes it."""
    return shutil.copytree(whole_study[1], tmp_path / "small")


def test_document_and_table_for_programs_hold_every_parameter(whole_study):
    code, folder, document = whole_study
    assert code == 0
    assert document["schema"] == "pkmcal/study/3"
    assert (document["plan"], document["scenario"]) == ("plan", "paper-simulation")
    assert (document["shots"], document["campaigns"]) == (50, 6)
    assert (document["failed"], document["lost"], document["computed"]) == (0, 0, 6)
    names, plate = tuple(document["parameters"]), document["parameters"]["plate_mm"]
    assert {"arm0.x_mm", "arm3.backlash_deg", "plate_mm"} <= {*names}
    assert plate["ratio"] == pytest.approx(plate["std"] / plate["stated_std"])
    assert 0.7 < document["position_mm"] / document["stated_mm"] < 1.3
    assert document["path"] == str(folder / "study" / TABLE)
    with (folder / "study" / f"{NAME}.csv").open(encoding="utf-8") as file:
        rows = {row.pop("parameter"): row for row in csv.DictReader(file)}
    assert rows["plate_mm"] == {key: repr(value) for key, value in plate.items()}
    assert tuple(rows) == names


def test_only_campaigns_that_the_table_lacks_are_computed(studied_folder, studied, whole_study):
    _, again = studied(studied_folder, "--campaigns", 6)
    assert again["computed"] == 0
    assert again["parameters"] == whole_study[2]["parameters"]
    _, more = studied(studied_folder, "--campaigns", 8)
    assert (more["computed"], more["campaigns"]) == (2, 8)
    _, fewer = studied(studied_folder, "--campaigns", 5)
    assert (fewer["computed"], fewer["campaigns"]) == (0, 5)
    assert len(table_of(studied_folder).splitlines()) == 1 + 8


@pytest.mark.parametrize("option", ["--seed", "--plan"])
def test_table_of_another_study_is_refused_and_left_alone(studied_folder, pkmcal, option):
    before = table_of(studied_folder)
    value = 2
    if option == "--plan":
        shots = (studied_folder / "plan.csv").read_text(encoding="utf-8").splitlines()
        identified = [n for n, line in enumerate(shots) if ",identification," in line]
        fewer = [line for n, line in enumerate(shots) if n not in identified[:2]]
        value = studied_folder / "elsewhere" / "plan.csv"
        value.parent.mkdir()
        value.write_text("\n".join(fewer) + "\n", encoding="utf-8")
    options = ("--campaigns", 6, "--workers", 1)
    code, out, err = pkmcal("study", studied_folder, *options, option, value)
    assert (code, out) == (2, "")
    assert "belongs to another study" in err
    assert table_of(studied_folder) == before


def test_study_goes_on_where_it_was_stopped(folder, pkmcal, studied, monkeypatch, whole_study):
    with monkeypatch.context() as patched:
        patched.setattr("app.study.running.simulated_parts", stopped_after_one_part)
        code, _, err = pkmcal("study", folder, "--campaigns", 6, "--workers", 1)
    assert code == 130
    assert "interrupted" in err
    assert len(table_of(folder).splitlines()) == 3
    (folder / "study" / TABLE).write_text(table_of(folder)[:-100], encoding="utf-8")
    _, document = studied(folder, "--campaigns", 6)
    assert document["computed"] == 5
    assert table_of(folder) == table_of(whole_study[1])


def test_lost_campaigns_make_the_study_unfinished(folder, pkmcal, studied, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr("app.study.running.simulated_parts", loses_the_second_part)
        code, out, err = pkmcal("study", folder, "--campaigns", 4, "--workers", 1, "--json")
    assert code == 1
    assert json.loads(out)["lost"] == 2
    assert "2 campaigns lost: killed → the same command" in err
    code, document = studied(folder, "--campaigns", 4)
    assert code == 0
    assert (document["lost"], document["computed"]) == (0, 2)


def test_screen_and_picture_name_every_parameter(studied_folder, pkmcal):
    picture = studied_folder / "study.svg"
    options = ("--campaigns", 6, "--workers", 1)
    _, out, _ = pkmcal("study", studied_folder, *options, "--plot", picture)
    assert all(name in out for name in ("arm0.x_mm", "arm3.backlash_deg", "plate_mm"))
    assert "stated σ are true, as far as 6 campaigns show" in out
    assert "positions over the workspace (rms): real " in out
    drawn = picture.read_text(encoding="utf-8")
    for words in ("errors of all parameters, in stated σ", "arm0.x_mm", "plate_mm"):
        assert f">{words}</text>" in drawn


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--campaigns", "1"], ["--campaigns", "1"]),
        (["--campaigns", "5", "--fix", "arm9.*"], ["arm9.*", "is no parameter"]),
        (["--campaigns", "5", "--scenario", "realistc"], ["realistc", "realistic"]),
        (["--campaigns", "5", "--plan", "nowhere.csv"], ["nowhere.csv", "pkmcal plan"]),
        (["--campaigns", "5", "--model", "full"], ["'study --model' was removed"]),
        (["--campaigns", "5", "--plot", "errors.xyz"], ["errors.xyz", ".svg, .png, .pdf"]),
    ],
)
def test_what_cannot_be_studied_is_refused_before_anything_is_written(
    folder, refused, arguments, words
):
    line = refused(folder, *arguments)
    assert all(word in line for word in words)


def test_campaign_for_real_devices_needs_a_scenario(folder, refused):
    (folder / "cell.yaml").unlink()
    assert "--scenario paper-simulation" in refused(folder, "--campaigns", 5)


def test_shot_at_which_the_robot_cannot_be_assembled_is_named(folder, refused):
    lines = (folder / "plan.csv").read_text().splitlines()
    place = next(n for n, line in enumerate(lines) if ",identification," in line)
    cells = lines[place].split(",")
    lines[place] = ",".join([*cells[:7], "-170", "170", "-170", "170", *cells[11:]])
    (folder / "plan.csv").write_text("\n".join(lines) + "\n")
    line = refused(folder, "--campaigns", 5)
    assert f"plan.csv: shot {cells[0]}: the nominal robot cannot be assembled" in line


def test_scenario_without_noise_is_refused(folder, refused):
    cell = (folder / "cell.yaml").read_text()
    silent = "{" + ", ".join(
        f"{axis}: {{constant_um: 0, per_metre_um: 0}}" for axis in ("along", "azimuth", "elevation")
    )
    (folder / "cell.yaml").write_text(cell.replace("{coordinate_mm: 0.008660254}", silent + "}"))
    assert "no noise" in refused(folder, "--campaigns", 5)


def test_second_study_in_the_same_tables_is_kept_out(folder, pkmcal):
    (folder / "study").mkdir()
    with campaign_lock(folder / "study", now_utc=now_utc):
        code, _, err = pkmcal("study", folder, "--campaigns", 3)
    assert code == 2
    assert "another process" in err
