"""Finished seeds are kept, and only what was made the same way is used again."""

import pytest
from made_up import RECIPES, result, results

from app.cli.reproduce import measure
from app.console import Terminal
from app.papers.corbel2006.trials import PROTOTYPE, SIMULATION, Trial, TrialTable, trials
from campaigns.errors import OutputExists, WriteFailed


@pytest.fixture
def table(tmp_path):
    return TrialTable(tmp_path / "results.jsonl")


def used(table, wanted, monkeypatch):
    """Results of trials of which those that are not kept are lost."""
    monkeypatch.setattr("app.cli.reproduce.local_results", lambda tasks, **_: (r for r in ()))
    return measure(table, wanted, 2, Terminal(as_json=True))[0]


def test_what_was_appended_is_read_again(table):
    for each in results(2):
        table.append([each])
    assert tuple(table.read().values()) == results(2)


def test_nothing_is_kept_at_first(table):
    assert table.read() == {}


def test_line_torn_by_a_crash_is_dropped_and_the_next_is_whole(table, monkeypatch):
    table.append([result(SIMULATION, 1)])
    whole = table.path.read_text()
    table.path.write_text(whole + whole[:100])
    assert tuple(table.read().values()) == (result(SIMULATION, 1),)
    used(table, trials(1), monkeypatch)
    table.append([result(SIMULATION, 2)])
    assert tuple(table.read().values()) == (result(SIMULATION, 1), result(SIMULATION, 2))


@pytest.mark.parametrize("line", ["", "{}", "not json", '{"seed": NaN}', "\x00"])
def test_foreign_line_is_refused_with_its_number(table, line):
    table.append([result(SIMULATION, 1)])
    table.path.write_text(table.path.read_text() + line + "\n")
    with pytest.raises(OutputExists, match=r"results\.jsonl:2: is no result"):
        table.read()


def test_results_that_cannot_be_written_are_an_error(tmp_path):
    with pytest.raises(WriteFailed, match="cannot be written"):
        TrialTable(tmp_path).append([result(SIMULATION, 1)])


def test_only_the_trials_asked_for_are_used(table, monkeypatch):
    table.append(results(3))
    assert used(table, trials(2), monkeypatch) == results(2)
    assert used(table, [Trial(PROTOTYPE, 2)], monkeypatch) == (result(PROTOTYPE, 2),)


def test_result_of_another_recipe_is_made_anew_and_stays_in_the_file(table, monkeypatch):
    other = result(SIMULATION, 1, recipe="0" * 16)
    table.append([other])
    assert used(table, [Trial(SIMULATION, 1)], monkeypatch) == ()
    table.append([result(SIMULATION, 1)])
    assert used(table, [Trial(SIMULATION, 1)], monkeypatch) == (result(SIMULATION, 1),)
    assert other in table.read().values()


def test_later_result_of_the_same_trial_counts(table):
    again = result(SIMULATION, 1, seconds=9.0)
    table.append([result(SIMULATION, 1), again])
    assert table.read() == {("simulation", 1, RECIPES[SIMULATION]): again}
