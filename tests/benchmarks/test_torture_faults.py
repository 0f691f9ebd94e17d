"""Short forms of the torture by faults: one unattended command each, nothing wrong stored."""

import json
import random

import pytest

from benchmarks.torture import faults
from campaigns.campaign import open_campaign

pytestmark = pytest.mark.slow


@pytest.mark.long
@pytest.mark.parametrize("number", [3, 8])
def test_wrong_targets_at_the_first_shots_end_in_a_complete_campaign(tmp_path, number):
    ran = faults.run_small(tmp_path, "first", faults.first_script(number))
    assert (ran.complete, ran.wrong, ran.shots) == (True, 0, 30)


@pytest.mark.long
def test_beam_that_is_broken_for_ten_minutes_at_the_third_measurement_only_costs_time(tmp_path):
    ran = faults.run_small(tmp_path, "break", [faults.broken_beam(3, 600.0)])
    assert (ran.complete, ran.wrong, ran.sessions) == (True, 0, 1)


@pytest.mark.long
def test_shot_that_the_simulator_has_otherwise_is_found_wrong(tmp_path):
    faults.run_small(tmp_path, "clean", [])
    folder = tmp_path / "clean"
    truth = json.loads((folder / "cell-memory.json").read_text(encoding="utf-8"))["taken"]
    with open_campaign(folder).journal_reader() as journal:
        shots = journal.shots(1)
    assert sum(faults.wrong_shots(shots, truth)) == 0
    elsewhere = [told | {"on": "standing"} if at == 4 else told for at, told in enumerate(truth)]
    assert sum(faults.wrong_shots(shots, elsewhere)) == 1
    moved = [told | {"robot_target": truth[0]["robot_target"]} for told in truth[:9]]
    assert sum(faults.wrong_shots(shots[:9], moved)) >= 7


def test_random_scripts_have_eight_faults_at_places_of_their_own_and_no_emergency_stop():
    for seed in range(50):
        script = faults.random_script(random.Random(seed))
        places = [(f.get("device"), *((k, f[k]) for k in f if k.startswith("at_"))) for f in script]
        assert len(set(places)) == len(script) == faults.FAULTS
        assert "emergency_stop" not in {fault["kind"] for fault in script}
