"""A journal that is harmed during a run: the robot makes no further move.

That each harm is found is tested with the journal's own file.
"""

from pathlib import Path

import pytest
from fake_cell import FakeCell
from lost_files import HARMS
from small_plans import TWO_PAIRS, work
from tested_journal import journal_in

from campaigns.errors import JournalFailed
from campaigns.journal.journal import Journal


def stopped_by(harm: str, folder: Path, *, move: int = 0, measurement: int = 0) -> FakeCell:
    """A run in which the journal is harmed during that move or measurement."""
    cell = FakeCell()

    def do_harm() -> None:
        HARMS[harm](folder / "campaign.db")

    cell.robot.during_move = {move: do_harm}
    cell.tracker.during_measure = {measurement: do_harm}
    with journal_in(folder, cell.calls) as journal, pytest.raises(JournalFailed):
        cell.measure(journal, work(TWO_PAIRS))
    return cell


@pytest.mark.parametrize("move", [1, 2, 6])
def test_no_move_follows_whenever_it_happens(tmp_path: Path, move: int) -> None:
    cell = stopped_by("replace", tmp_path, move=move)
    assert cell.calls[-1] == ("robot.stop",)
    assert len(cell.named("robot.move_joints")) == move
    assert len(cell.named("robot.stop")) == 1


@pytest.mark.parametrize("harm", ["delete", "cut_log"])
def test_harm_at_the_last_measurement_claims_no_series(tmp_path: Path, harm: str) -> None:
    cell = stopped_by(harm, tmp_path, measurement=6)
    assert not cell.named("journal.series-finished")
    assert not cell.named("journal.session-stopped")


def test_harm_after_the_last_record_fails_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, prove = FakeCell(), Journal.prove

    def harm_and_prove(self: Journal) -> None:
        HARMS["cut_log"](tmp_path / "campaign.db")
        prove(self)

    monkeypatch.setattr(Journal, "prove", harm_and_prove)
    with journal_in(tmp_path, cell.calls) as journal, pytest.raises(JournalFailed):
        cell.measure(journal, work())
