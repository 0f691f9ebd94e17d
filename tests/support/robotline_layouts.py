"""Layouts of robots for the tests of robotline."""

from drivers.values import Coordinate
from drivers.wire import robotline as messages
from sim.geometry import PAR4
from sim.servers.robotline_server import layout_of

PAR4_LAYOUT = layout_of(PAR4)
TILTING_LAYOUT = layout_of(PAR4, PAR4.extensions)
THREE_CARRIAGES = messages.RobotLayout.of(
    joints=[Coordinate(f"q{arm}", is_angle=False) for arm in range(3)],
    coordinates=[Coordinate(name, is_angle=False) for name in "xyz"],
    parameters=[
        (f"arm{arm}.{stem}_mm", arm, stem) for arm in range(3) for stem in ("x", "forearm")
    ],
)
"""Joints in mm, no turn, no parameter beside those of the arms."""
FIVE_BAR_ON_A_RAIL = messages.RobotLayout.of(
    joints=[Coordinate("q0", is_angle=True), Coordinate("q1", is_angle=False)],
    coordinates=[Coordinate(c, is_angle=False, is_fixed=c == "z") for c in "xyz"],
    parameters=[("arm0.x_mm", 0, "x")],
)
"""A crank and a carriage that move a point in a plane."""
SIX_LEGS = messages.RobotLayout.of(
    joints=[Coordinate(f"q{leg}", is_angle=False) for leg in range(6)],
    coordinates=[Coordinate(c, is_angle=c[0] == "r") for c in ("x", "y", "z", "rx", "ry", "rz")],
    parameters=[(f"arm{leg}.x_mm", leg, "x") for leg in range(6)],
)
"""A platform that turns freely."""
PAR4_LINES = messages.grammar(PAR4_LAYOUT)
