"""A tracker that stands elsewhere than campaign.yaml says."""

from command_line import change
from ruamel.yaml import YAML

from campaigns.journal.journal import read_journal
from campaigns.journal.records import Event


def places_told(folder):
    with read_journal(folder / "campaign.db") as journal:
        events = [entry.record for entry in journal.records_of(Event)]
    return [event.text for event in events if event.kind == "tracker place"]


def test_tracker_elsewhere_is_told_and_the_run_goes_on(planned, pkmcal):
    path = planned / "campaign.yaml"
    x, y, z = YAML(typ="safe").load(path.read_text(encoding="utf-8"))["tracker"]["place_mm"]
    change(path, {"tracker.place_mm": [x + 1600.0, y, z]})
    ran = pkmcal("run", planned, "--yes")
    assert ran.code == 0, ran.err
    told = places_told(planned)
    assert told[-1].startswith("the tracker stands at (")
    assert "1.6 m off; correct tracker.place_mm" in told[-1]
    assert told[-1] in ran.err


def test_tracker_where_it_is_said_to_stand_is_not_spoken_of(measured):
    assert places_told(measured) == []
