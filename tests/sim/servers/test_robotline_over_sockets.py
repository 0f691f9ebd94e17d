"""The device and the simulated controller's server together, over TCP and a pseudo-terminal."""

import pytest
from fake_controller import FakeController
from robotline_layouts import PAR4_LAYOUT

from drivers.declaration import RobotSurroundings
from drivers.errors import LimitViolation, LinkDown, WireError
from drivers.ports import SystemClock
from drivers.robotline import LineRobot
from drivers.transport import opener_of
from sim.clock import ScaledClock
from sim.faults import Counted, Fault, FaultScript
from sim.robot.controller import Refusal
from sim.servers.robotline_server import RobotlineSession
from sim.servers.server import CellServer

THIRD_ANSWER = 3


class Served:
    """A fake controller on a real wire, and the robot at its other end."""

    def __init__(self, wire, faults=()):
        self.controller = FakeController()
        self.server = CellServer(ScaledClock(1.0), FaultScript(faults, {}))
        serve = self.server.serve_tcp if wire == "tcp" else self.server.serve_pty
        url = serve(self._session, "controller")
        self.robot = LineRobot(
            RobotSurroundings(
                open_transport=opener_of(url), layout=PAR4_LAYOUT, clock=SystemClock()
            )
        )

    def _session(self, send, already_open):
        return RobotlineSession(self.controller, send)

    def __enter__(self):
        self.server.start()
        self.robot.connect()
        return self

    def __exit__(self, *_):
        self.robot.close()
        self.server.stop()


@pytest.fixture(params=["tcp", "pty"])
def served(request):
    with Served(request.param) as served:
        yield served


def test_whole_conversation_over_a_real_wire(served):
    robot, controller = served.robot, served.controller
    assert robot.identity().serial == controller.serial
    assert robot.state().joints == pytest.approx(controller.joints, abs=1e-15)
    robot.move_joints([0.0, 0.1, 0.2, 0.3], 0.5)
    assert robot.state().moving
    robot.stop()
    assert not robot.state().moving
    controller.refusal = Refusal("LIMIT", "joint 2 to 95°")
    with pytest.raises(LimitViolation, match="joint 2 to 95 deg"):
        robot.move_joints([0.0] * 4, 0.5)
    controller.refusal = None
    geometry = {name: value + 0.1 for name, value in robot.read_geometry().items()}
    robot.write_geometry(geometry)
    assert robot.read_geometry() == geometry
    assert geometry.keys() == set(PAR4_LAYOUT.parameters)


def test_robot_is_stopped_over_a_new_wire_after_the_first_was_lost(served):
    served.robot.move_joints([0.0] * 4, 0.5)
    served.robot.close()
    served.robot.stop()
    assert not served.controller.moving
    served.robot.reconnect()
    assert not served.robot.state().moving


@pytest.mark.parametrize(("fault", "error"), [("close", LinkDown), ("garbage", WireError)])
def test_motion_is_stopped_when_the_wire_breaks_off_or_says_garbage(fault, error):
    faults = [Fault(Counted.CONTROLLER_ANSWER, THIRD_ANSWER, fault, None)]
    with Served("tcp", faults) as served:
        served.robot.move_joints([0.0] * 4, 0.5)
        with pytest.raises(error):
            served.robot.state()
        served.robot.reconnect()
        assert not served.robot.state().moving
