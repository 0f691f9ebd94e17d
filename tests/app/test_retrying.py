"""What is tried again after a failure, how often in a row, and how the wait for it ends."""

from types import SimpleNamespace

import pytest
from journal_story import beginning, intent, outcome
from paper_campaign import new_campaign
from virtual_time import StopWish, VirtualClock

from app.retrying import LONGEST_PAUSE_S, RETRIED, Retries
from campaigns.errors import GateRefused, Interrupted, NotSettled
from drivers.errors import EmergencyStop, LinkDown, RobotStateUnknown, WrongDevice

LOST = LinkDown("no answer", remedy="check the cable")


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def retries(tmp_path, clock):
    """Gives so many tries in a row of a campaign that has no journal."""
    campaign = SimpleNamespace(journal_path=tmp_path / "campaign.db")
    return lambda allowed: Retries(campaign, allowed, clock)


@pytest.mark.parametrize("kind", RETRIED)
def test_what_may_be_over_is_tried_again(retries, kind):
    assert retries(1).again_after(kind("a", remedy="b")) == 1.0


@pytest.mark.parametrize("kind", [EmergencyStop, RobotStateUnknown, WrongDevice, GateRefused])
def test_what_somebody_has_to_look_at_is_not(retries, kind):
    assert retries(5).again_after(kind("a", remedy="b")) is None


def test_pauses_grow_to_a_minute_and_the_row_ends(retries):
    row = retries(9)
    pauses_s = [row.again_after(LOST) for _ in range(10)]
    assert pauses_s == [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, *[LONGEST_PAUSE_S] * 3, None]
    assert row.text(LOST) == "connecting again, 9 of 9 in a row, after: no answer"
    assert retries(0).again_after(NotSettled("a", remedy="b")) is None


@pytest.fixture
def begun(tmp_path):
    """A campaign whose run has begun."""
    campaign = new_campaign(tmp_path / "paper").campaign
    with campaign.opened_journal() as journal:
        journal.start_series(beginning())
    return campaign


def happens(campaign, *records):
    with campaign.opened_journal() as journal:
        for record in records:
            journal.append(record, series=1)


def test_an_accepted_shot_begins_another_row(begun, clock):
    row = Retries(begun, 2, clock)
    pauses_s = [row.again_after(LOST), row.again_after(LOST)]
    happens(begun, intent(1), outcome(1))
    pauses_s += [row.again_after(LOST), row.again_after(LOST), row.again_after(LOST)]
    assert pauses_s == [1.0, 2.0, 1.0, 2.0, None]


def test_a_wait_ends_in_its_time_or_with_the_wish_to_stop(retries, clock):
    wish = StopWish(clock)
    retries(1).wait(3.0, wish)
    assert clock.now_s() == pytest.approx(3.0)
    clock.after(0.5, wish.ask)
    with pytest.raises(Interrupted, match="stopped by the operator"):
        retries(1).wait(60.0, wish)
    assert clock.now_s() < 3.6
