"""A journal that is deleted during a run: exit code 4, nothing is claimed, and the run goes on."""

import pytest
from command_line import change, ended, started
from test_interrupted import FAST, SLOW, is_at_work, wait_until

from campaigns.journal.journal import read_journal
from campaigns.journal.records import Outcome

pytestmark = pytest.mark.long


def test_a_run_whose_journal_is_deleted_ends_with_4_and_goes_on_from_the_one_that_was_rescued(
    planned, pkmcal
):
    path = planned / "campaign.db"
    change(planned / "cell.yaml", SLOW)
    process = started("run", planned, "--yes", "--json")
    try:
        wait_until(lambda: is_at_work(planned), process)
        path.unlink()
        stopped = ended(process)
    finally:
        process.kill()
        process.communicate()
    assert stopped.code == 4
    assert stopped.document["error"]["problem"].endswith("while this process worked with it")
    assert "has all" not in stopped.err
    assert "are whole in campaign-rescued-1.db" in stopped.error_line
    (planned / "campaign-rescued-1.db").rename(path)
    for name in ("campaign.db-wal", "campaign.db-shm"):
        (planned / name).unlink(missing_ok=True)
    with read_journal(path) as journal:
        kept = {(e.record.shot, e.record.attempt) for e in journal.records_of(Outcome)}
    change(planned / "cell.yaml", FAST)
    assert pkmcal("run", planned, "--yes").code == 0
    with read_journal(path) as journal:
        assert len(journal.shots(1)) == 33
        assert kept <= {(e.record.shot, e.record.attempt) for e in journal.records_of(Outcome)}
