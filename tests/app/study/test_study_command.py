"""pkmcal study: from a campaign's folder to a table and a verdict on σ."""

import json
import shutil

import pytest
import typer
from typer.testing import CliRunner

from app.commands import study
from app.errors import UsageInvalid
from app.folder import open_campaign
from app.main import run_command
from app.study import running
from app.study.setup import study_scenario, study_setup, uncertainty_of
from app.study.workers import Lost
from campaigns.errors import OutputExists
from campaigns.numerics.geometry import FREE_BY_DEFAULT
from sim.scenario import load_scenario


@pytest.fixture(scope="module")
def planned_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "small"
    assert run_command(["new", str(folder), "--scenario", "paper-simulation"]) == 0
    assert run_command(["plan", str(folder), "--shots", "50"]) == 0
    return folder


@pytest.fixture
def folder(planned_once, tmp_path):
    return shutil.copytree(planned_once, tmp_path / "small")


@pytest.fixture
def studied():
    """Runs the command and gives its exit code and document."""
    door = typer.Typer()
    door.command()(study.command)

    def run(*arguments):
        ended = CliRunner().invoke(door, [*map(str, arguments), "--json"])
        if ended.exception is not None and not isinstance(ended.exception, SystemExit):
            raise ended.exception
        return ended.exit_code, json.loads(ended.stdout)

    return run


def table_of(folder):
    return (folder / "study.csv").read_text(encoding="utf-8")


def test_document_and_table_tell_of_every_campaign(folder, studied):
    code, document = studied(folder, "--campaigns", 30)
    assert code == 0
    assert document["schema"] == "pkmcal/study/1"
    assert (document["campaigns"], document["failed"], document["lost"]) == (30, 0, 0)
    assert tuple(document["parameters"]) == FREE_BY_DEFAULT
    assert 0.5 < document["parameters"]["plate_mm"]["ratio"] < 2.0
    assert 0.0 < document["unseen_mean_mm"]["median"] < document["unseen_max_mm"]["q95"] < 0.1
    assert len(table_of(folder).splitlines()) == 31


def test_study_goes_on_where_it_was_stopped(folder, studied, monkeypatch):
    studied(folder, "--campaigns", 60)
    whole = table_of(folder)
    (folder / "study.csv").unlink()

    def stopped_after_one_task(tasks):
        yield next(iter(running.local_results(tasks, 1)))
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(running, "workers_of", lambda _: stopped_after_one_task)
        with pytest.raises(KeyboardInterrupt):
            studied_now(folder, 60)
    assert len(table_of(folder).splitlines()) == 26
    _, document = studied(folder, "--campaigns", 60)
    assert document["computed"] == 35
    assert table_of(folder) == whole


def studied_now(folder, count):
    asked = study.Asked(count, "points", None, FREE_BY_DEFAULT, "1", 1, None)
    study.study(open_campaign(folder), asked, Silent())


class Silent:
    def note(self, text):
        """Nobody listens."""


def test_finished_study_computes_nothing_again(folder, studied):
    studied(folder, "--campaigns", 10)
    _, document = studied(folder, "--campaigns", 10)
    assert document["computed"] == 0


def test_smaller_number_looks_at_the_first_only(folder, studied):
    studied(folder, "--campaigns", 30)
    _, document = studied(folder, "--campaigns", 10)
    assert (document["campaigns"], document["computed"]) == (10, 0)
    assert len(table_of(folder).splitlines()) == 31


def test_lost_campaigns_make_the_study_unfinished(folder, studied, monkeypatch):
    def loses_the_second_task(tasks):
        yield Lost(tasks[1].numbers, "killed")
        yield from running.local_results([tasks[0], *tasks[2:]], 1)

    with monkeypatch.context() as patched:
        patched.setattr(running, "workers_of", lambda _: loses_the_second_task)
        code, document = studied(folder, "--campaigns", 60)
    assert code == 1
    assert (document["campaigns"], document["lost"]) == (35, 25)
    code, document = studied(folder, "--campaigns", 60)
    assert code == 0
    assert (document["campaigns"], document["computed"]) == (60, 25)


def test_other_estimator_needs_a_table_of_its_own(folder, studied):
    studied(folder, "--campaigns", 5)
    with pytest.raises(OutputExists, match="belongs to another study"):
        studied(folder, "--campaigns", 5, "--estimator", "distances")
    other = folder / "distances.csv"
    code, document = studied(folder, "--campaigns", 5, "--estimator", "distances", "--to", other)
    assert code == 0
    assert document["path"] == str(other)


def test_wrong_workers_leave_no_table(folder, studied):
    with pytest.raises(UsageInvalid, match="--workers"):
        studied(folder, "--campaigns", 5, "--workers", "many")
    assert not (folder / "study.csv").exists()


def test_campaign_for_real_devices_needs_a_scenario(folder):
    (folder / "cell.yaml").unlink()
    campaign = open_campaign(folder)
    with pytest.raises(UsageInvalid, match="--scenario paper-simulation"):
        study_scenario(campaign, None)
    assert study_scenario(campaign, "realistic").name == "realistic"


def test_plan_with_hardly_more_pairs_than_parameters_is_refused(folder):
    campaign = open_campaign(folder)
    free = (*FREE_BY_DEFAULT, "arm1.azimuth_deg", "arm2.azimuth_deg", "arm3.azimuth_deg")
    with pytest.raises(UsageInvalid, match="25 pairs for 25 parameters"):
        study_setup(campaign, load_scenario("realistic"), "points", free, seed=1)


def test_noise_is_the_scenarios():
    even = uncertainty_of(load_scenario("paper-simulation").tracker.noise)
    assert even.along_mm == even.across_mm == pytest.approx(0.015 / 3**0.5)
    spherical = uncertainty_of(load_scenario("realistic").tracker.noise)
    assert spherical.along_mm == pytest.approx(0.010 / 3**0.5)
    assert spherical.across_per_mm == pytest.approx(6e-6 / 3**0.5)
