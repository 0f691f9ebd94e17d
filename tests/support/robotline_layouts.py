"""Layouts of robots for the tests of robotline, and the meaning of its golden lines."""

from drivers.values import Coordinate
from drivers.wire import robotline as messages
from drivers.wire.numbered_lines import Refused
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


NAMES = {"Greeting": "ControllerGreeting", "Motion": "MotionBegun", "Done": "CommandDone"}
"""Classes of messages whose golden lines name them otherwise."""


def command_of(case):
    fields = _tuples(case["fields"])
    match case["command"]:
        case "MoveJoints":
            return messages.MoveJoints(fields["joints_deg"], fields["speed_percent"])
        case "MovePose":
            *coordinates, speed_percent = fields.values()
            return messages.MovePose(tuple(coordinates), speed_percent)
        case "ReadArm":
            return messages.ReadPart(f"ARM {fields['arm']}")
        case "ReadPlate":
            return messages.ReadPart("PLATE")
        case "AskState":
            return messages.Order.STATE
        case "Stop" | "Commit" | "Abandon" as name:
            return messages.Order[name.upper()]
        case "Stage":
            return _part_of(fields["part"])
        case name:
            return getattr(messages, NAMES.get(name, name))(**fields)


def outcome_of(case):
    fields = _tuples(case["fields"])
    match case["outcome"]:
        case "Refused":
            return Refused(**fields)
        case "ArmGeometry" | "PlateGeometry":
            return _part_of(fields)
        case "Status":
            return messages.ControllerStatus(*fields.values())
        case name:
            return getattr(messages, NAMES.get(name, name))(**fields)


def _part_of(fields):
    if "plate_mm" in fields:
        return messages.Part("PLATE", (fields["plate_mm"],))
    return messages.Part(f"ARM {fields['arm']}", tuple(fields["values"]))


def _tuples(fields):
    return {name: tuple(v) if isinstance(v, list) else v for name, v in fields.items()}
