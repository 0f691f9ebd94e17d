"""A run whose one reflector is carried to the other half of the plate, in the simulated cell."""

import csv

import pytest
from command_line import change

from campaigns.journal.journal import read_journal

HALF_2 = {"name": "half 2", "body": "half 2", "place_mm": [0, 0, 0], "std_mm": 5}


def rewritten(plan, pairs_on_half_2):
    """Name the other half in the rows of these pairs."""
    with plan.open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row["reflector"] = "half 2" if row["pair"] in pairs_on_half_2 else ""
    with plan.open("w") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


@pytest.fixture
def in_turn(planned):
    with (planned / "plan.csv").open() as file:
        pairs = list(dict.fromkeys(row["pair"] for row in csv.DictReader(file) if row["pair"]))
    rewritten(planned / "plan.csv", pairs[1::2])
    change(planned / "campaign.yaml", {"objects": [HALF_2]})
    return planned


def test_turns_are_determined_by_halves_in_turn(pkmcal, in_turn):
    ended = pkmcal("run", in_turn, "--yes")
    assert ended.code == 0, ended.err
    assert "measured from here on: the reflector on half 2, carried there" in ended.err
    assert "beam" not in ended.err
    with read_journal(in_turn / "campaign.db") as journal:
        shots = journal.shots(1)
    assert 0.3 < sum(shot.outcome.reflector == "half 2" for shot in shots) / len(shots) < 0.6
    predicted = [s.outcome for s in shots if s.outcome.reflector and s.outcome.residual_mm]
    assert len(predicted) > 5
    said = pkmcal("--verbose", "identify", in_turn).out
    assert "rotation: determined" in said
    assert "of half 2 that were not fitted" in said


def test_an_object_that_campaign_yaml_does_not_have_is_refused_before_anything_moves(
    pkmcal, in_turn
):
    change(in_turn / "campaign.yaml", {"objects": []})
    ended = pkmcal("run", in_turn, "--yes")
    assert ended.code == 2
    assert "reflector 'half 2' is not among the objects" in ended.error_line
    change(in_turn / "campaign.yaml", {"objects": [HALF_2 | {"place_mm": None}]})
    assert pkmcal("run", in_turn, "--dry").code == 0
