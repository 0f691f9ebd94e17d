"""The command with all or most seeds kept from before, so that no cell is needed."""

import signal
from functools import partial

import pytest
from made_up import RECIPES, result, results

from app.cli import reproduce
from app.exits import AppError
from app.papers.corbel2006 import trials
from app.study.results import tried
from app.study.workers import local_results
from campaigns.files.lock import campaign_lock
from drivers.errors import LinkDown


@pytest.fixture
def folder(tmp_path):
    """Three seeds of every experiment are there."""
    keep(tmp_path, results(3))
    return tmp_path


def keep(folder, found):
    trials.trial_table(folder / reproduce.RESULTS).add(found)


def kept(folder):
    table = trials.trial_table(folder / reproduce.RESULTS)
    return dict(table.read())


@pytest.fixture
def said(pkmcal):
    return lambda *words: pkmcal("reproduce", *words)


@pytest.fixture(autouse=True)
def without_page(monkeypatch, computed):
    """What takes seconds and is tested elsewhere: the evidence, and drawing the page."""
    monkeypatch.setattr(reproduce, "evidence", lambda found: computed)
    monkeypatch.setattr(reproduce.page, "page_html", lambda *_: "a page")


@pytest.fixture
def no_cells(monkeypatch):
    """Trials that end by these results, in this process, in place of whole campaigns."""
    ran = []

    def results_by(result_of):
        def work(room, trial):
            ran.append(trial)
            return (result_of(trial),)

        def here(tasks, processes, work, *, apart):
            assert apart, "a campaign would take over this process's signals and streams"
            return local_results(tasks, 1, work)

        monkeypatch.setattr(reproduce, "rehearsed", work)
        monkeypatch.setattr(reproduce, "local_results", here)
        return ran

    return results_by


def without_beam(trial):
    if trial.experiment is trials.SIMULATION:
        raise LinkDown("no beam", remedy="look")
    return result(trial.experiment, trial.seed)


def test_kept_seeds_are_not_measured_again_and_their_tables_fit_a_terminal(
    said, folder, no_cells, monkeypatch
):
    monkeypatch.setenv("COLUMNS", "100")
    ran = no_cells(lambda trial: pytest.fail(str(trial)))
    ended = said("--to", folder, "--quick")
    assert ended.code == 0, ended.err
    assert ran == []
    assert "9 of 9 seeds are kept from before" in ended.err
    assert "13 of 13 medians are as asked" in ended.out
    assert "3 seeds of each are a look" in ended.out
    assert (folder / "reproduction.html").read_text() == "a page"
    table_lines = [line for line in ended.out.splitlines() if "…" in line]
    assert len(table_lines) > 60
    assert max(map(len, table_lines)) <= 100


def test_only_missing_seeds_are_measured_and_sorted_in_the_file(said, folder, no_cells):
    ran = no_cells(lambda trial: result(trial.experiment, trial.seed))
    assert said("--to", folder, "--seeds", 4).code == 0
    assert [trial.seed for trial in ran] == [4, 4, 4]
    keys = [(each.experiment, each.seed) for each in kept(folder).values()]
    assert len(keys) == 12
    assert keys == sorted(keys)


def test_line_torn_by_a_crash_is_made_anew_and_another_recipe_s_stays(said, folder, no_cells):
    path, other = folder / reproduce.RESULTS, result(trials.SIMULATION, 1, recipe="0" * 16)
    keep(folder, [other])
    whole = path.read_text()
    path.write_text(
        whole.replace(f'"recipe":"{RECIPES[trials.PROTOTYPE]}"', '"recipe":"-"') + whole[:100]
    )
    ran = no_cells(lambda trial: result(trial.experiment, trial.seed))
    assert said("--to", folder, "--seeds", 2).code == 0
    assert ran == [trials.Trial(trials.PROTOTYPE, 1), trials.Trial(trials.PROTOTYPE, 2)]
    assert other in kept(folder).values()


def test_failed_seed_costs_only_itself_and_is_tried_again_next_time(
    said, folder, no_cells, monkeypatch
):
    monkeypatch.setattr(reproduce, "CountedWork", partial(reproduce.CountedWork, quiet_s=0.0))
    no_cells(without_beam)
    ended = said("--to", folder, "--seeds", 4, "--json")
    assert ended.code == 1
    document = ended.document
    failed = {"experiment": "simulation", "seed": 4, "reason": "no beam → look"}
    assert document["failed"] == [failed]
    assert {row["ours"]["seeds"] for row in document["figures"]} == {3, 4}
    last = [line for line in ended.err.splitlines() if line.startswith("seeds: ")][-1]
    assert last.startswith("seeds: 12/12 · ")
    assert last.endswith(" · 1 lost")
    ran = no_cells(lambda trial: result(trial.experiment, trial.seed))
    ran.clear()
    assert said("--to", folder, "--seeds", 4).code == 0
    assert ran == [trials.Trial(trials.SIMULATION, 4)]


def test_missed_median_is_exit_code_one(said, tmp_path):
    after = result(trials.PROTOTYPE, 1).after.model_copy(update={"rotation_mm": 0.7})
    keep(tmp_path, [*results(1)[:2], result(trials.PROTOTYPE, 1, after=after)])
    ended = said("--to", tmp_path, "--seeds", 1)
    assert ended.code == 1
    assert "missed: Section IV.E.3: motion while only θ turns: rotation, after 0.70" in ended.out


def test_document_for_programs_is_all_of_stdout(said, folder):
    document = said("--to", folder, "--quick", "--json").document
    assert document["schema"] == "pkmcal/reproduction/1"
    assert (document["seeds"], document["verdict"]) == (3, "pass")
    assert document["page"] == str(folder / "reproduction.html")
    asked = [row for row in document["figures"] if row["asked"]]
    assert len(asked) == 13
    assert all(row["passed"] for row in asked)
    rotation = next(row for row in asked if row["name"] == "rotation, after")
    assert rotation["paper"] == {"text": "0.2", "place": "IV.E.3"}
    assert rotation["asked"] == {"low": 0.0, "high": 0.6}
    assert rotation["agrees"] is False
    assert "repeatability" in rotation["reason"]
    assert len(document["table_2"]) == 22


def test_number_of_seeds_is_asked_for_once(said):
    assert [reproduce.seeds_asked(seeds, quick=False) for seeds in (None, 7)] == [20, 7]
    ended = said("--seeds", 5, "--quick")
    assert ended.code == 2
    assert "both say how many" in ended.error_line


@pytest.mark.parametrize("line", ["mine", '{"seed": NaN}'])
def test_folder_with_other_results_is_left_alone(said, tmp_path, line):
    (tmp_path / reproduce.RESULTS).write_text(f"{line}\n")
    ended = said("--to", tmp_path, "--quick")
    assert ended.code == 2
    assert "results.jsonl:1: is no result of `pkmcal reproduce`" in ended.error_line
    assert (tmp_path / reproduce.RESULTS).read_text() == f"{line}\n"


def test_second_command_in_the_same_folder_waits_its_turn(said, folder):
    with campaign_lock(folder, now_utc=lambda: "now"):
        ended = said("--to", folder, "--quick")
    assert ended.code == 2
    assert "another process" in ended.error_line


def test_folder_that_cannot_be_made_is_exit_code_four(said, tmp_path):
    (tmp_path / "file").write_text("")
    assert said("--to", tmp_path / "file" / "new", "--quick").code == 4


def failing(error):
    def rehearse(campaign, terminal, options):
        terminal.say("talk that nobody should see")
        raise error

    return rehearse


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (LinkDown("no answer in 2 s", remedy="look at the cable"), "no answer in 2 s → look at"),
        (ZeroDivisionError("by nothing"), "ZeroDivisionError: by nothing"),
    ],
)
def test_whatever_goes_wrong_in_a_seed_becomes_its_reason(
    tmp_path, monkeypatch, capsys, error, reason
):
    monkeypatch.setattr("app.papers.corbel2006.trials.rehearse", failing(error))
    outcome = tried(partial(trials.rehearsed, tmp_path), 7, trials.Trial(trials.SIMULATION, 1))
    assert (outcome.place, outcome.rows) == (7, ())
    assert outcome.lost.startswith(reason)
    assert capsys.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == [], "its campaign is taken away"


def test_seed_with_a_bad_verdict_is_no_result(tmp_path, monkeypatch):
    bad = ("the hold-out pairs got worse",)
    monkeypatch.setattr(
        "app.papers.corbel2006.trials.rehearse", lambda campaign, terminal, options: ({}, bad)
    )
    with pytest.raises(AppError, match="the hold-out pairs got worse"):
        trials.rehearsed(tmp_path, trials.Trial(trials.SIMULATION, 1))


def test_interrupted_run_keeps_what_is_finished(said, folder, no_cells):
    def stopped_at_the_second(trial):
        if trial.experiment is not trials.SIMULATION:
            signal.raise_signal(signal.SIGINT)
        return result(trial.experiment, trial.seed)

    no_cells(stopped_at_the_second)
    ended = said("--to", folder, "--seeds", 5)
    assert ended.code == 130
    assert "finished seeds are kept → the same command runs the others" in ended.error_line
    assert len(kept(folder)) == 10
    assert not (folder / reproduce.PAGE).exists()
