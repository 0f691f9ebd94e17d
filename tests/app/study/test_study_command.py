"""pkmcal study: from plans, scenarios and estimators to tables and a verdict on σ."""

import csv
import json
import re
import shutil
from importlib.resources import files

import pytest
from par4_space import SPACE

import sim.scenarios
from app.study.errors import COMPARISON
from app.study.results import Result
from app.study.setup import left_out, uncertainty_of
from app.study.workers import local_results
from campaigns.campaign import now_utc
from campaigns.estimation.estimators import Model
from campaigns.files.lock import campaign_lock
from sim.scenarios.scenario import load_scenario

STANDARD = [Model.STANDARD]
TABLE = "plan-paper-simulation-points.jsonl"


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


def test_document_and_table_tell_of_every_campaign_and_only_new_ones_are_computed(folder, studied):
    code, document = studied(folder, "--campaigns", 10)
    assert code == 0
    assert document["schema"] == "pkmcal/study/1"
    (found,) = document["combinations"]
    assert (found["plan"], found["scenario"], found["estimator"]) == (
        *("plan", "paper-simulation", "points"),
    )
    assert (found["shots"], found["pairs"]) == (50, 25)
    assert (found["campaigns"], found["failed"], found["lost"]) == (10, 0, 0)
    assert tuple(found["parameters"]) == SPACE.free_by_default
    plate = found["parameters"]["plate_mm"]
    assert 0.5 < plate["ratio"] < 2.0
    assert plate["variance_over_bound"] == pytest.approx(
        (plate["std"] / plate["bound_std"]) ** 2, rel=1e-3
    )
    assert 0.0 < found["unseen_mean_mm"]["median"] < found["unseen_max_mm"]["q95"] < 0.1
    assert found["path"] == str(folder / "study" / TABLE)
    assert json.loads((folder / "study" / "study.json").read_text()) == document
    _, again = studied(folder, "--campaigns", 10)
    assert again["computed"] == 0
    assert again["combinations"][0]["parameters"] == found["parameters"]
    _, more = studied(folder, "--campaigns", 12)
    assert (more["computed"], more["combinations"][0]["campaigns"]) == (2, 12)
    _, fewer = studied(folder, "--campaigns", 5)
    assert (fewer["computed"], fewer["combinations"][0]["campaigns"]) == (0, 5)
    assert len(table_of(folder).splitlines()) == 1 + 12


def test_every_plan_meets_every_scenario_and_estimator_beside_the_first_of_its_scenario(
    folder, studied
):
    plan, other = folder / "plan.csv", shutil.copy(folder / "plan.csv", folder / "other.csv")
    code, document = studied(
        *(folder, "--campaigns", 3, "--plan", plan, "--plan", other, "--plan", plan),
        *("--scenario", "realistic", "--scenario", "paper-simulation"),
        *("--estimator", "points", "--estimator", "distances"),
    )
    assert code == 0
    found = document["combinations"]
    assert [(one["scenario"], one["plan"], one["estimator"]) for one in found] == [
        (scenario, plan, estimator)
        for scenario in ("realistic", "paper-simulation")
        for plan in ("plan", "other")
        for estimator in ("points", "distances")
    ]
    assert sum(path.suffix == ".jsonl" for path in (folder / "study").iterdir()) == 8
    assert document["computed"] == 24
    with (folder / "study" / "comparison.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [column.head for column in COMPARISON]
    relative = [float(row["unseen_relative"]) for row in rows]
    assert relative[4] == relative[6] == 1.0, "the same plan by another name, the same draws"
    assert relative[5] == relative[7] > 1.5, "distances tell less than points"
    assert [one["unseen_relative"] for one in found] == relative
    lengths = [
        max(p["std"] for name, p in one["parameters"].items() if name.endswith("_mm"))
        for one in found
    ]
    assert [float(row["worst_length_mm"]) for row in rows] == lengths


def test_plans_are_judged_by_the_unseen_pairs_of_the_campaigns_own(folder, studied):
    blind = folder / "blind.csv"
    lines = (folder / "plan.csv").read_text().splitlines()
    blind.write_text("\n".join(line for line in lines if ",validation," not in line) + "\n")
    _, document = studied(folder, "--campaigns", 3, "--plan", blind)
    assert document["combinations"][0]["unseen_mean_mm"] is not None
    blind.rename(folder / "plan.csv")
    _, document = studied(folder, "--campaigns", 3, "--to", folder / "elsewhere")
    assert document["combinations"][0]["unseen_mean_mm"] is None
    assert document["combinations"][0]["unseen_relative"] is None


@pytest.fixture
def small_tasks(monkeypatch):
    monkeypatch.setattr("campaigns.studies.study.CAMPAIGNS_AT_ONCE", 4)


def stopped_after_one_task(tasks, *, work):
    yield next(iter(local_results(tasks, 1, work)))
    raise KeyboardInterrupt


def loses_the_second_task(tasks, *, work):
    yield Result(1, lost="killed")
    for result in local_results([tasks[0], *tasks[2:]], 1, work):
        yield Result(result.place and result.place + 1, result.rows)


def with_workers(monkeypatch, workers):
    monkeypatch.setattr("app.cli.study.workers_of", lambda text: workers)


@pytest.mark.usefixtures("small_tasks")
def test_study_goes_on_where_it_was_stopped(folder, pkmcal, studied, monkeypatch):
    studied(folder, "--campaigns", 10)
    whole = table_of(folder)
    shutil.rmtree(folder / "study")
    with monkeypatch.context() as patched:
        with_workers(patched, stopped_after_one_task)
        code, _, err = pkmcal("study", folder, "--campaigns", 10)
    assert code == 130
    assert "interrupted" in err
    assert len(table_of(folder).splitlines()) == 5
    torn = table_of(folder)[:-100]
    (folder / "study" / TABLE).write_text(torn, encoding="utf-8")
    _, document = studied(folder, "--campaigns", 10)
    assert document["computed"] == 7
    assert table_of(folder) == whole


@pytest.mark.usefixtures("small_tasks")
def test_lost_campaigns_make_the_study_unfinished(folder, pkmcal, studied, monkeypatch):
    with monkeypatch.context() as patched:
        with_workers(patched, loses_the_second_task)
        code, out, err = pkmcal("study", folder, "--campaigns", 10, "--json")
    assert code == 1
    document = json.loads(out)
    assert document["lost"] == document["combinations"][0]["lost"] == 4
    assert "4 campaigns lost: killed → the same command" in err
    code, document = studied(folder, "--campaigns", 10)
    assert code == 0
    assert (document["lost"], document["computed"]) == (0, 4)


def test_screen_names_every_parameter_of_one_combination_and_the_worst_of_several(folder, pkmcal):
    picture = folder / "study.svg"
    one, several = (
        pkmcal("study", folder, "--campaigns", 5, "--workers", 1, *more)[1]
        for more in ((), ("--estimator", "points", "--estimator", "distances", "--plot", picture))
    )
    assert all(name in one for name in SPACE.free_by_default)
    assert "stated σ are true, as far as 5 campaigns tell" in one
    assert "\npoints" in several
    assert "\ndistances" in several
    assert "arm2" not in several.split("stated σ")[0]
    for line in (one + several).splitlines():
        if not line.startswith(
            (*SPACE.free_by_default, "plan", "points", "distances", "written", "drawn")
        ):
            assert len(line) <= 80
    drawn = picture.read_text(encoding="utf-8")
    for words in ("points (5 campaigns)", "distances (5 campaigns)", *SPACE.free_by_default):
        assert f">{words}</text>" in drawn


def test_what_no_parameter_describes_is_said_to_be_missing(folder, pkmcal):
    _, _, err = pkmcal("study", folder, "--campaigns", 2, "--workers", 1, "--scenario", "realistic")
    missing = "rods of unequal length, tilted axes, backlash, repeatability, warm parts"
    assert f"realistic: not simulated here: {missing}" in err
    assert left_out(load_scenario("paper-simulation"), STANDARD) == ()
    assert left_out(load_scenario("hostile"), STANDARD)[-1] == "faults"


def test_models_that_describe_rods_and_axes_have_robots_with_them():
    realistic = load_scenario("realistic")
    others = ("backlash", "repeatability", "warm parts")
    assert left_out(realistic, [Model.FULL]) == others
    assert left_out(realistic, [Model.RODS]) == ("tilted axes", *others)
    assert left_out(realistic, [Model.FULL, Model.STANDARD])[0] == "rods of unequal length"


@pytest.mark.slow
def test_full_model_s_deviations_are_true_of_robots_with_skews_and_tilts(folder, studied):
    text = files(sim.scenarios).joinpath("drawn-robots.yaml").read_text(encoding="utf-8")
    imperfect = "tolerances:\n    rod_mm: 0.2\n    axis_tilt_mrad: 2.0\n"
    cell = folder / "imperfect.yaml"
    cell.write_text(re.sub(r"tolerances:.*\n", imperfect, text, count=1), encoding="utf-8")
    models = ("--model", "full", "--model", "standard")
    code, document = studied(folder, "--campaigns", 10, "--scenario", cell, *models)
    assert code == 0
    full, standard = document["combinations"]
    assert (full["model"], standard["model"]) == ("full", "standard")
    assert {*full["parameters"]} - {*standard["parameters"]} == {
        *(f"arm{arm}.parallelogram_skew_deg" for arm in range(4)),
        *("arm2.axis_tilt_deg", "arm3.axis_tilt_deg"),
    }
    low, high = full["chance"]["ratio"]
    assert all(low < p["ratio"] < high for p in full["parameters"].values())
    assert full["path"].endswith("points-full.jsonl")
    assert standard["path"].endswith("points.jsonl"), "as before there were models"


@pytest.mark.parametrize(
    ("free", "said"),
    [((), "stated σ are too small"), (("--free", "arm[123].azimuth_deg"), "stated σ are true")],
)
def test_azimuths_that_differ_are_missed_where_nobody_looks_for_them(folder, pkmcal, free, said):
    """But for the first azimuth, which holds the frame."""
    words = ("--campaigns", 15, "--workers", 1, "--scenario", "realistic", *free)
    assert said in pkmcal("study", folder, *words)[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--campaigns", "1"], ["--campaigns", "1"]),
        (["--campaigns", "5", "--workers", "many"], ["--workers is 'many'", "tcp://HOST:PORT"]),
        (["--campaigns", "5", "--estimator", "guess"], ["--estimator", "guess", "points"]),
        (["--campaigns", "5", "--free", "arm9.*"], ["arm9.*", "matches no parameter"]),
        (["--campaigns", "5", "--free", "reflector_constant_mm"], ["no fit of a study finds it"]),
        (["--campaigns", "5", "--scenario", "realistc"], ["realistc", "realistic"]),
        (["--campaigns", "5", "--plan", "nowhere.csv"], ["nowhere.csv", "pkmcal plan"]),
        (["--campaigns", "5", "--free", "arm0.x_mm"], ["arm0.x_mm, arm1.x_mm", "move together"]),
        (
            ["--campaigns", "5", "--free", "arm0.x_mm", "--fix", "arm1.x_mm"],
            ["arm0.x_mm cannot be free in a study", "--free"],
        ),
        (["--campaigns", "5", "--model", "auto"], ["--model auto finds other parameters"]),
        (["--campaigns", "5", "--plot", "errors.xyz"], ["errors.xyz", ".svg, .png, .pdf"]),
        (
            ["--campaigns", "5", "--estimator", "distances", "--free", "arm[123].azimuth_deg"],
            ["50 shots in 25 pairs are too few for 25 parameters by distances", "--fix"],
        ),
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


def test_campaign_without_a_plan_is_refused(folder, refused):
    (folder / "plan.csv").unlink()
    assert "pkmcal plan" in refused(folder, "--campaigns", 5)


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


def test_plans_that_are_called_alike_are_refused(folder, refused):
    (folder / "other").mkdir()
    other = shutil.copy(folder / "plan.csv", folder / "other" / "plan.csv")
    line = refused(folder, "--campaigns", 5, "--plan", folder / "plan.csv", "--plan", other)
    assert "called alike: plan · paper-simulation · points" in line


def test_second_study_in_the_same_tables_is_kept_out(folder, pkmcal):
    (folder / "study").mkdir()
    with campaign_lock(folder / "study", now_utc=now_utc):
        code, _, err = pkmcal("study", folder, "--campaigns", 3)
    assert code == 2
    assert "another process" in err
    code, *_ = pkmcal("study", folder, "--campaigns", 3, "--workers", 1)
    assert code == 0


def test_noise_is_the_scenarios():
    even = uncertainty_of(load_scenario("paper-simulation").tracker.noise)
    assert even.along_mm == even.across_mm == pytest.approx(0.015 / 3**0.5)
    spherical = uncertainty_of(load_scenario("realistic").tracker.noise)
    assert spherical.along_mm == pytest.approx(0.010 / 3**0.5)
    assert spherical.across_per_mm == pytest.approx(6e-6 / 3**0.5)
