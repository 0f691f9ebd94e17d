"""Devices behind a campaign's addresses: which time each of them is judged by."""

import pytest

from app.main import run_command
from app.wiring import connected_cell
from campaigns.campaign import open_campaign
from drivers.errors import NotAMeasurement

CELL = """\
schema: pkmcal/cell/1
name: mine
speed_up: 4
robot: {nominal: par4-prototype}
tracker:
  station: {x_mm: 2000.0, y_mm: -1500.0, z_mm: -200.0}
  noise: {coordinate_mm: 0.01}
faults: [{at_result: 1, kind: early}]
"""


def test_simulated_tracker_of_a_campaign_is_judged_by_the_cells_time(tmp_path):
    folder = tmp_path / "cell"
    assert run_command(["new", str(folder)]) == 0
    (folder / "cell.yaml").write_text(CELL)
    with connected_cell(open_campaign(folder)) as cell:
        cell.tracker.prepare("CCR-1.5in", 0.5)
        with pytest.raises(NotAMeasurement, match="after its measurement was started"):
            cell.tracker.measure()
        assert cell.tracker.measure()
