"""pkmcal study: from plan, scenario and model to tables and a verdict on σ."""

import csv
import json
import shutil

import pytest

from app.main import run_command
from app.study.output import honesty
from app.study.running import SimulatedPart, simulated_parts
from campaigns.campaign import now_utc
from campaigns.files.lock import campaign_lock
from campaigns.studies.summary import ParameterSummary, StudySummary, chance

pytestmark = pytest.mark.usefixtures("small_parts")

NAME = "plan-paper-simulation"
OPTIONS = ("--campaigns", 4, "--workers", 1)


@pytest.fixture
def small_parts(monkeypatch):
    monkeypatch.setattr("app.study.running.CAMPAIGNS_A_PART", 2)


@pytest.fixture
def studied(pkmcal):
    """Studies in this process; gives exit code, document and errors."""

    def run(folder, campaigns):
        options = ("--campaigns", campaigns, "--workers", 1, "--json")
        code, out, err = pkmcal("study", folder, *options)
        return code, json.loads(out), err

    return run


def table_of(folder):
    return (folder / "study" / f"{NAME}.jsonl").read_text(encoding="utf-8")


def stopped_after_one_part(simulate, numbers, executor):
    yield next(simulated_parts(simulate, numbers, None))
    raise KeyboardInterrupt


def loses_the_second_part(simulate, numbers, executor):
    yield SimulatedPart(lost=numbers[2:4], reason="killed")
    yield from simulated_parts(simulate, numbers[:2], None)


@pytest.fixture(scope="session")
def whole_study(planned_once, tmp_path_factory):
    """Folder and document of a study of four campaigns."""
    folder = shutil.copytree(planned_once, tmp_path_factory.mktemp("whole") / "small")
    assert run_command(["study", str(folder), *map(str, OPTIONS)]) == 0
    return folder, json.loads((folder / "study" / f"{NAME}.json").read_text())


@pytest.fixture
def studied_folder(whole_study, tmp_path):
    """A copy of the study for a test that changes it."""
    return shutil.copytree(whole_study[0], tmp_path / "small")


def test_document_and_table_for_programs_hold_every_parameter(whole_study):
    folder, document = whole_study
    assert document["schema"] == "pkmcal/study/3"
    assert (document["plan"], document["scenario"]) == ("plan", "paper-simulation")
    assert (document["shots"], document["campaigns"]) == (40, 4)
    assert (document["failed"], document["lost"], document["computed"]) == (0, 0, 4)
    names, plate = tuple(document["parameters"]), document["parameters"]["plate_mm"]
    assert {"arm0.x_mm", "arm3.backlash_deg", "plate_mm"} <= {*names}
    assert plate["ratio"] == pytest.approx(plate["std"] / plate["stated_std"])
    assert 0.7 < document["position_mm"] / document["stated_mm"] < 1.3
    with (folder / "study" / f"{NAME}.csv").open(encoding="utf-8") as file:
        rows = {row.pop("parameter"): row for row in csv.DictReader(file)}
    assert rows["plate_mm"] == {key: repr(value) for key, value in plate.items()}
    assert tuple(rows) == names


def test_only_campaigns_that_the_table_lacks_are_computed(studied_folder, studied, whole_study):
    for campaigns, computed in ((4, 0), (5, 1), (3, 0)):
        _, document, _ = studied(studied_folder, campaigns)
        assert (document["campaigns"], document["computed"]) == (campaigns, computed)
        if campaigns == 4:
            assert document["parameters"] == whole_study[1]["parameters"]
    assert len(table_of(studied_folder).splitlines()) == 1 + 5


@pytest.mark.parametrize("option", ["--seed", "--plan"])
def test_table_of_another_study_is_refused_and_left_alone(studied_folder, pkmcal, option):
    before, value = table_of(studied_folder), 2
    if option == "--plan":
        lines = (studied_folder / "plan.csv").read_text(encoding="utf-8").splitlines(keepends=True)
        shots = [number for number, line in enumerate(lines) if ",identification," in line]
        del lines[shots[0] : shots[0] + 2]
        value = studied_folder / "elsewhere" / "plan.csv"
        value.parent.mkdir()
        value.write_text("".join(lines), encoding="utf-8")
    code, out, err = pkmcal("study", studied_folder, *OPTIONS, option, value)
    assert (code, out) == (2, "")
    assert "belongs to another study" in err
    assert table_of(studied_folder) == before


def test_study_goes_on_where_it_was_stopped(folder, pkmcal, studied, monkeypatch, whole_study):
    with monkeypatch.context() as patched:
        patched.setattr("app.study.running.simulated_parts", stopped_after_one_part)
        code, _, err = pkmcal("study", folder, *OPTIONS)
    assert code == 130
    assert "interrupted" in err
    cut_off = table_of(folder)[:-100]
    (folder / "study" / f"{NAME}.jsonl").write_text(cut_off, encoding="utf-8")
    _, document, _ = studied(folder, 4)
    assert document["computed"] == 3
    assert table_of(folder) == table_of(whole_study[0])


def test_lost_campaigns_make_the_study_unfinished(folder, studied, monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr("app.study.running.simulated_parts", loses_the_second_part)
        code, document, err = studied(folder, 4)
    assert (code, document["lost"]) == (1, 2)
    assert "2 campaigns lost: killed → the same command" in err
    code, document, _ = studied(folder, 4)
    assert (code, document["lost"], document["computed"]) == (0, 0, 2)


def test_screen_and_picture_name_every_parameter(studied_folder, pkmcal):
    picture = studied_folder / "study.svg"
    _, out, _ = pkmcal("study", studied_folder, *OPTIONS, "--plot", picture)
    assert "stated σ are true, as far as 4 campaigns show" in out
    drawn = picture.read_text(encoding="utf-8")
    for name in ("arm0.x_mm", "arm3.backlash_deg", "plate_mm"):
        assert name in out
        assert f">{name}</text>" in drawn


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ((0.1, 0.1, 0.95), "stated σ are true, as far as 250 campaigns show (ratios from "),
        ((0.2, 0.1, 0.8), "stated σ are too small: plate_mm found 2.00 × stated"),
        ((0.093, 0.1, 0.9), "stated σ are too small: plate_mm covered 0.90 of 0.95"),
        ((0.05, 0.1, 1.0), "stated σ are larger than need be: plate_mm found 0.50 × stated"),
        ((0.1, 0.1, 1.0), "stated σ are larger than need be: plate_mm covered 1.00 of 0.95"),
    ],
)
def test_the_last_line_names_the_figure_that_is_beyond_chance(figures, words):
    std, stated, covered = figures
    parameter = ParameterSummary("plate_mm", 0.0, std, stated, covered)
    summary = StudySummary(250, 0, (parameter,), (), chance(1, 250), 0.01, 0.01)
    assert honesty(summary).startswith(words)


def test_of_few_campaigns_chance_has_no_lower_limit():
    parameter = ParameterSummary("plate_mm", 0.0, 0.1, 0.1, 1.0)
    summary = StudySummary(2, 0, (parameter,), (), chance(1, 2), 0.01, 0.01)
    assert "(ratios up to 2.2" in honesty(summary)


def without_cell(folder):
    (folder / "cell.yaml").unlink()


def without_noise(folder):
    cell = (folder / "cell.yaml").read_text()
    zero = "{constant_um: 0, per_metre_um: 0}"
    silent = f"{{along: {zero}, azimuth: {zero}, elevation: {zero}}}"
    (folder / "cell.yaml").write_text(cell.replace("{coordinate_mm: 0.008660254}", silent))


def with_joints_out_of_reach(folder):
    lines = (folder / "plan.csv").read_text().splitlines()
    place = next(number for number, line in enumerate(lines) if ",identification," in line)
    cells = lines[place].split(",")
    lines[place] = ",".join([*cells[:7], "-170", "170", "-170", "170", *cells[11:]])
    (folder / "plan.csv").write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("change", "arguments", "words"),
    [
        (None, ["--campaigns", 1], "--campaigns 1"),
        (None, ["--campaigns", 5, "--fix", "arm9.*"], "arm9.* is no parameter"),
        (None, ["--campaigns", 5, "--scenario", "realistc"], "realistc realistic"),
        (None, ["--campaigns", 5, "--plan", "nowhere.csv"], "nowhere.csv pkmcal"),
        (None, ["--campaigns", 5, "--plot", "errors.xyz"], "errors.xyz .svg, .png, .pdf"),
        (without_cell, ["--campaigns", 5], "--scenario paper-simulation"),
        (without_noise, ["--campaigns", 5], "no noise"),
        (with_joints_out_of_reach, ["--campaigns", 5], "plan.csv: shot cannot be assembled"),
    ],
)
def test_what_cannot_be_studied_is_refused_before_anything_is_written(
    folder, pkmcal, change, arguments, words
):
    if change is not None:
        change(folder)
    code, out, err = pkmcal("study", folder, *arguments)
    assert (code, out) == (2, "")
    assert not (folder / "study").exists()
    (line,) = err.splitlines()
    assert line.startswith("pkmcal: ")
    assert " → " in line
    assert all(word in line for word in words.split())


def test_second_study_in_the_same_tables_is_kept_out(folder, pkmcal):
    (folder / "study").mkdir()
    with campaign_lock(folder / "study", now_utc=now_utc):
        code, _, err = pkmcal("study", folder, "--campaigns", 3)
    assert code == 2
    assert "another process" in err
