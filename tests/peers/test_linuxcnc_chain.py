"""The whole chain with the real LinuxCNC: it moves, the hidden robot follows its joints, and the
identified parameters go into its own kinematics.
"""

from pathlib import Path

import pytest
from hal_files import parameters_of
from linuxcnc_bench import NEEDS_LINUXCNC, world_controller
from linuxcnc_campaign import Campaign, made_campaign, tell

from campaigns.robots.robot import find_robot, read_robot

pytestmark = [*NEEDS_LINUXCNC, pytest.mark.timeout(240)]

VARIANTS = {"par4-prototype": "cartesian", "delta": "delta", "linear-delta": "linear-delta"}
SMALL = {"plan.shots": 48, "plan.validation_pairs": 5, "settle.time_s": 0.05}
BAD_BEFORE_MM = 1.0
GOOD_AFTER_MM = 0.05


OFTEN = "linear-delta"
"""A minute each: the others are for `make long`."""


@pytest.fixture(
    params=[
        pytest.param(each, marks=[] if each == OFTEN else pytest.mark.long) for each in VARIANTS
    ]
)
def name(request):
    return request.param


@pytest.fixture
def linuxcnc(tmp_path, name):
    with world_controller(tmp_path, VARIANTS[name], times_as_fast=10) as running:
        yield running


def test_campaign_on_linuxcnc_makes_its_own_cartesian_moves_exact(tmp_path, linuxcnc, name, capsys):
    nominal = find_robot(name).robot
    folder = made_campaign(tmp_path / "campaign", linuxcnc, name, SMALL)
    pkmcal = Campaign(folder, linuxcnc, capsys)

    identity = pkmcal("devices")["controller"]["identity"]
    assert f"type={nominal.mechanism.name}" in identity
    pkmcal("plan")
    before = pkmcal.validated("before")
    pkmcal("run", "--yes")
    assert pkmcal("identify")["verdict"] == "pass"
    pkmcal("export")
    exported = pkmcal("export", "--format", "linuxcnc")["path"]
    pkmcal.load()
    after = pkmcal.validated("after", codes=(0,))

    with capsys.disabled():
        tell(f"{name}: distances before {before}, after {after}")
    assert before["max_abs"] > BAD_BEFORE_MM
    assert after["max_abs"] < GOOD_AFTER_MM
    compensated = dict(read_robot(folder / "robot-compensated.yaml").robot.parameters)
    calib = linuxcnc.config / "calib.hal"
    for text in (calib.read_text(), Path(exported).read_text()):
        assert parameters_of(text, nominal.mechanism) == compensated

    pkmcal.load("--rollback")
    back = parameters_of(calib.read_text(), nominal.mechanism)
    assert back == dict(nominal.parameters)
