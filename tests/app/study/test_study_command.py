"""pkmcal study: from plan, scenario and model to tables and a verdict on σ."""

import csv
import json
import shutil

import pytest

from app.study.running import Part, simulated_parts
from campaigns.campaign import now_utc
from campaigns.files.lock import campaign_lock

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


def table_of(folder, name=TABLE):
    return (folder / "study" / name).read_text(encoding="utf-8")


def test_document_and_tables_tell_of_every_campaign_and_only_new_ones_are_computed(folder, studied):
    code, document = studied(folder, "--campaigns", 10)
    assert code == 0
    assert document["schema"] == "pkmcal/study/3"
    assert (document["plan"], document["scenario"]) == ("plan", "paper-simulation")
    assert (document["shots"], document["campaigns"]) == (50, 10)
    assert (document["failed"], document["lost"], document["computed"]) == (0, 0, 10)
    names, plate = tuple(document["parameters"]), document["parameters"]["plate_mm"]
    assert {"arm0.x_mm", "arm3.backlash_deg", "plate_mm"} <= {*names}
    assert 0.5 < plate["ratio"] < 2.0
    assert 0.7 < document["position_mm"] / document["stated_mm"] < 1.3
    assert document["path"] == str(folder / "study" / TABLE)
    written = json.loads((folder / "study" / f"{NAME}.json").read_text())
    assert document == written | {"next": None, "before_next": None, "next_reason": None}
    with (folder / "study" / f"{NAME}.csv").open(encoding="utf-8") as file:
        rows = {row.pop("parameter"): row for row in csv.DictReader(file)}
    assert rows["plate_mm"] == {key: repr(value) for key, value in plate.items()}
    assert tuple(rows) == names
    _, again = studied(folder, "--campaigns", 10)
    assert again["computed"] == 0
    assert again["parameters"] == document["parameters"]
    _, more = studied(folder, "--campaigns", 12)
    assert (more["computed"], more["campaigns"]) == (2, 12)
    _, fewer = studied(folder, "--campaigns", 5)
    assert (fewer["computed"], fewer["campaigns"]) == (0, 5)
    assert len(table_of(folder).splitlines()) == 1 + 12


@pytest.mark.parametrize("changed", [("--seed", 2), ("--plan", "other.csv")])
def test_table_of_another_study_is_refused_and_left_alone(folder, pkmcal, studied, changed):
    studied(folder, "--campaigns", 3)
    before = table_of(folder)
    if changed[0] == "--plan":
        other = folder / "elsewhere" / "plan.csv"
        other.parent.mkdir()
        shots = (folder / "plan.csv").read_text(encoding="utf-8").splitlines()
        identified = [n for n, line in enumerate(shots) if ",identification," in line]
        left = [line for n, line in enumerate(shots) if n not in identified[:2]]
        other.write_text("\n".join(left) + "\n", encoding="utf-8")
        changed = ("--plan", other)
    code, out, err = pkmcal("study", folder, "--campaigns", 3, "--workers", 1, *changed)
    assert (code, out) == (2, "")
    assert "belongs to another study" in err
    assert table_of(folder) == before


@pytest.fixture
def small_parts(monkeypatch):
    monkeypatch.setattr("app.study.running.CAMPAIGNS_A_PART", 4)


def stopped_after_one_part(simulate, parts, executor):
    yield next(simulated_parts(simulate, parts, None))
    raise KeyboardInterrupt


def loses_the_second_part(simulate, parts, executor):
    yield Part(parts[1], lost="killed")
    yield from simulated_parts(simulate, [parts[0], *parts[2:]], None)


def with_workers(monkeypatch, workers):
    monkeypatch.setattr("app.study.running.simulated_parts", workers)


@pytest.mark.usefixtures("small_parts")
def test_study_goes_on_where_it_was_stopped(folder, pkmcal, studied, monkeypatch):
    studied(folder, "--campaigns", 10)
    whole = table_of(folder)
    shutil.rmtree(folder / "study")
    with monkeypatch.context() as patched:
        with_workers(patched, stopped_after_one_part)
        code, _, err = pkmcal("study", folder, "--campaigns", 10, "--workers", 1)
    assert code == 130
    assert "interrupted" in err
    assert len(table_of(folder).splitlines()) == 5
    torn = table_of(folder)[:-100]
    (folder / "study" / TABLE).write_text(torn, encoding="utf-8")
    _, document = studied(folder, "--campaigns", 10)
    assert document["computed"] == 7
    assert table_of(folder) == whole


@pytest.mark.usefixtures("small_parts")
def test_lost_campaigns_make_the_study_unfinished(folder, pkmcal, studied, monkeypatch):
    with monkeypatch.context() as patched:
        with_workers(patched, loses_the_second_part)
        code, out, err = pkmcal("study", folder, "--campaigns", 10, "--workers", 1, "--json")
    assert code == 1
    document = json.loads(out)
    assert document["lost"] == 4
    assert "4 campaigns lost: killed → the same command" in err
    code, document = studied(folder, "--campaigns", 10)
    assert code == 0
    assert (document["lost"], document["computed"]) == (0, 4)


def test_screen_and_picture_name_every_parameter(folder, pkmcal):
    picture = folder / "study.svg"
    _, out, _ = pkmcal("study", folder, "--campaigns", 5, "--workers", 1, "--plot", picture)
    assert all(name in out for name in ("arm0.x_mm", "arm3.backlash_deg", "plate_mm"))
    assert "stated σ are true, as far as 5 campaigns show" in out
    assert "positions over the workspace (rms): real " in out
    for line in out.splitlines():
        if not line.startswith(("written", "drawn", "positions", "stated σ")):
            assert len(line) <= 80
    drawn = picture.read_text(encoding="utf-8")
    for words in ("errors of all parameters, in stated σ", "arm0.x_mm", "plate_mm"):
        assert f">{words}</text>" in drawn


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--campaigns", "1"], ["--campaigns", "1"]),
        (["--campaigns", "5", "--workers", "many"], ["--workers", "many"]),
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
    for word in words:
        assert word in line


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
    code, *_ = pkmcal("study", folder, "--campaigns", 3, "--workers", 1)
    assert code == 0
