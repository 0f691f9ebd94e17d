"""Finished seeds are kept, and only what was made the same way is used again."""

import pytest
from made_up import result, results

from app.cli.reproduce import measure
from app.console import Terminal
from app.papers.corbel2006.trials import PROTOTYPE, SIMULATION, Trial, trial_table, trials
from campaigns.errors import OutputExists


@pytest.fixture
def table(tmp_path):
    return trial_table(tmp_path / "results.jsonl")


def used(table, wanted, monkeypatch):
    """Results of trials of which those that are not kept are lost."""
    monkeypatch.setattr("app.cli.reproduce.local_results", lambda tasks, **_: (r for r in ()))
    return measure(table, wanted, 2, Terminal(as_json=True))[0]


def test_line_torn_by_a_crash_is_dropped_and_the_next_is_whole(table, monkeypatch):
    table.add([result(SIMULATION, 1)])
    whole = table.path.read_text()
    table.path.write_text(whole + whole[:100])
    table.rows.clear()
    assert tuple(table.read().values()) == (result(SIMULATION, 1),)
    used(table, trials(1), monkeypatch)
    table.add([result(SIMULATION, 2)])
    table.rows.clear()
    assert tuple(table.read().values()) == (result(SIMULATION, 1), result(SIMULATION, 2))


def test_foreign_line_is_refused_with_its_number(table):
    table.add([result(SIMULATION, 1)])
    table.path.write_text(table.path.read_text() + '{"seed": NaN}\n')
    with pytest.raises(OutputExists, match=r"results\.jsonl:2: is no result of `pkmcal reproduce`"):
        table.read()


def test_only_the_trials_asked_for_are_used(table, monkeypatch):
    table.add(results(3))
    assert used(table, trials(2), monkeypatch) == results(2)
    assert used(table, [Trial(PROTOTYPE, 2)], monkeypatch) == (result(PROTOTYPE, 2),)


def test_result_of_another_recipe_is_made_anew_and_stays_in_the_file(table, monkeypatch):
    other = result(SIMULATION, 1, recipe="0" * 16)
    table.add([other])
    assert used(table, [Trial(SIMULATION, 1)], monkeypatch) == ()
    table.add([result(SIMULATION, 1)])
    assert used(table, [Trial(SIMULATION, 1)], monkeypatch) == (result(SIMULATION, 1),)
    assert other in table.read().values()
