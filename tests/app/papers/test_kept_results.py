"""Finished seeds are kept, and only what was made the same way is used again."""

import pytest
from made_up import result, results

from app.papers.corbel2006.experiments import PROTOTYPE, SIMULATION, Trial, trials
from app.papers.corbel2006.kept import KeptResults, ResultsInvalid, usable
from campaigns.errors import WriteFailed


@pytest.fixture
def path(tmp_path):
    return tmp_path / "results.jsonl"


def test_what_was_appended_is_read_again(path):
    for each in results(2):
        KeptResults(path).append(each)
    assert KeptResults(path).read() == results(2)


def test_nothing_is_kept_at_first(path):
    assert KeptResults(path).read() == ()


def test_line_torn_by_a_crash_is_dropped_and_the_next_is_whole(path):
    kept = KeptResults(path)
    kept.append(result(SIMULATION, 1))
    whole = path.read_text()
    path.write_text(whole + whole[:100])
    assert kept.read() == (result(SIMULATION, 1),)
    kept.append(result(SIMULATION, 2))
    assert kept.read() == (result(SIMULATION, 1), result(SIMULATION, 2))


@pytest.mark.parametrize("line", ["", "{}", "not json", '{"seed": NaN}', "\x00"])
def test_foreign_line_is_refused_with_its_number(path, line):
    KeptResults(path).append(result(SIMULATION, 1))
    path.write_text(path.read_text() + line + "\n")
    with pytest.raises(ResultsInvalid, match=r"results\.jsonl:2: is no result"):
        KeptResults(path).read()


def test_results_that_cannot_be_written_are_an_error(tmp_path):
    with pytest.raises(WriteFailed, match="a result cannot be written"):
        KeptResults(tmp_path).append(result(SIMULATION, 1))


def test_only_the_trials_asked_for_are_used():
    found = usable(results(3), trials(2))
    assert set(found) == set(trials(2))
    assert found[Trial(PROTOTYPE, 2)] == result(PROTOTYPE, 2)


def test_result_of_another_recipe_is_made_anew():
    other = result(SIMULATION, 1, recipe="0" * 16)
    assert usable([other], [Trial(SIMULATION, 1)]) == {}


def test_later_result_of_the_same_trial_counts():
    again = result(SIMULATION, 1, seconds=9.0)
    assert usable([result(SIMULATION, 1), again], [Trial(SIMULATION, 1)])[Trial(SIMULATION, 1)] == (
        again
    )
