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
PAR4_LINES = messages.grammar(PAR4_LAYOUT)
