"""`pkmcal sim`: a cell in a process of its own, reached as a real one would be."""

import json
import signal

import pytest
from command_line import change, ended, started

TINY = {"plan.shots": 8, "plan.validation_pairs": 0, "plan.drift_shots": 2}
OVERRULED = ("--force", "origin", "--force", "far-from-nominal")
PACE = {"settle.time_s": 0.001, "controller.speed_percent": 100.0}


@pytest.fixture
def cell_file(planned_once):
    return planned_once / "cell.yaml"


@pytest.fixture
def served(cell_file, request):
    """A served cell and its addresses."""
    process = started(
        "sim", cell_file, "--seed", 5, "--speed-up", 20_000, *getattr(request, "param", ())
    )
    try:
        yield process, json.loads(process.stdout.readline())
    finally:
        process.kill()
        process.communicate()


def made_for(addresses, folder, pkmcal):
    """A small campaign on a served cell."""
    urls = ("--controller", addresses["controller"], "--tracker", addresses["tracker"])
    assert pkmcal("new", folder, *urls).code == 0
    change(folder / "campaign.yaml", TINY | PACE)
    return folder


def test_a_campaign_on_a_served_cell(served, pkmcal, cell_file, tmp_path):
    process, addresses = served
    assert (addresses["scenario"], addresses["seed"]) == ("paper-simulation", 5)
    assert addresses["speed_up"] == 20_000
    for device in ("controller", "tracker"):
        assert addresses[device].startswith("tcp://127.0.0.1:")
    port = addresses["tracker"].rpartition(":")[2]
    refused = pkmcal("sim", cell_file, "--tracker-port", port)
    assert refused.code == 2
    assert port in refused.error_line
    folder = made_for(addresses, tmp_path / "cell-5", pkmcal)
    assert pkmcal("plan", folder).code == 0
    measured = pkmcal("run", folder, "--yes", "--json").document
    assert (measured["series"], measured["shots"]) == (1, 10)
    assert pkmcal("new", tmp_path / "other", "--robot", "par4-table1").code == 0
    load = ("load", folder, "--robot", tmp_path / "other" / "robot.yaml", "--yes", *OVERRULED)
    assert "loaded and verified" in pkmcal(*load).out
    assert not (folder / "cell-memory.json").exists(), "the cell remembers by itself"
    process.send_signal(signal.SIGTERM)
    stopped = ended(process)
    assert (stopped.code, stopped.err) == (0, "")


@pytest.mark.long
@pytest.mark.parametrize("served", [("--serial",)], indirect=True)
def test_a_campaign_on_a_serial_line(served, pkmcal, tmp_path):
    process, addresses = served
    assert addresses["controller"].startswith("serial:///dev/")
    folder = made_for(addresses, tmp_path / "cell-5", pkmcal)
    turn = ("--stage", "before", "--only", "rotation", "--yes")
    assert pkmcal("validate", folder, *turn).code == 0
    process.send_signal(signal.SIGINT)
    assert ended(process).code == 0


def test_a_scenario_that_is_not_there(pkmcal):
    refused = pkmcal("sim", "paper-simulaton")
    assert refused.code == 2
    assert "paper-simulation" in refused.error_line
