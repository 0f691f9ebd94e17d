"""What a device cannot answer: refused at once, with the device and the value, by every driver."""

import pytest

from drivers.errors import ImplausibleAnswer
from drivers.plausible import require_weather
from drivers.values import TEMPERATURE, Weather


@pytest.mark.parametrize(
    ("word", "said"), [("1.0e300", "1e+300°"), ("1.0e7", "1e+07°"), ("-360.1", "-360.1°")]
)
def test_joint_of_a_robotline_controller(controller, word, said):
    controller.answers["STATE"] = f"OK 0 0 - 0.0 {word} 0.0 0.0"
    with pytest.raises(ImplausibleAnswer) as refused:
        controller.robot.state()
    assert f"pipe://test: answers what cannot be: joint q1 at {said}" in str(refused.value)
    assert "possible is -360 to 360°" in str(refused.value)


def test_stop_is_confirmed_whatever_the_joints_are(controller):
    controller.answers["STATE"] = "OK 0 0 - 0.0 1.0e300 0.0 0.0"
    controller.robot.stop()
    assert controller.verbs == ["STOP", "STATE"]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -40.1, 70.1])
def test_bounds_hold_no_number_that_is_none(value):
    assert not TEMPERATURE.holds(value)
    assert TEMPERATURE.holds(-40.0)
    assert TEMPERATURE.holds(70.0)
    with pytest.raises(ImplausibleAnswer):
        require_weather("here", Weather(value, 1013.0, 50.0))
