"""Corrected G-code: the robot follows the wanted path, and the rest of the program stays."""

import itertools

import numpy as np
import pytest
from family_cases import BY_NAME, some_members

from campaigns.controllers import gcode_correction
from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.controllers.gcode import parse_gcode
from campaigns.controllers.gcode_correction import correct_gcode
from campaigns.controllers.gcode_moves import Move, moves_of
from campaigns.errors import TargetsInvalid

"""One that turns, one on rails: that targets are corrected for each is tested with targets."""


def correction_of(member, identified):
    return TargetCorrection(identified, member.nominal, member.limits)


def program(member):
    """A rectangle, a circle and a turn about the middle of the robot's workspace."""
    x, y, z = member.shipped.workspace_centre[:3]
    turn, turned = (" C0", " C10") if len(member.mechanism.task) > 3 else ("", "")
    return (
        "%\r\n(a part)\r\nG21 G90 G17 G94\r\n"
        f"N10 G0 X{x:g} Y{y:g} Z{z:g}{turn} M3 S100 (begin)\r\n"
        f"n20 g1 x{x + 60:g} F1200 ; along x\r\n"
        f"Y{y + 40:g}{turned}\r\n"
        f"X{x:g} M30\r\n"
        "G4 P0.5\r\n"
        f"G3 X{x:g} Y{y - 40:g} J-40{turn} F600\r\n"
        "M5"
    )


def places(text, member):
    moves = moves_of(parse_gcode(text, "out"), "out", member.mechanism.task)
    return np.array([move.end for move in moves if isinstance(move, Move)])


def followed(robot, member, poses, parts=7):
    """Where the robot really is while the controller goes straight between commanded poses."""
    part = np.linspace(0.0, 1.0, parts)[:, None, None]
    between = (poses[:-1] + part * (poses[1:] - poses[:-1])).reshape(-1, poses.shape[1])
    joints = member.nominal.inverse(between).values_or_raise()
    return robot.forward(joints, between).values_or_raise()


def from_program_mm(points, member):
    """Distance of each point from the wanted lines and arc."""
    x, y, z = member.shipped.workspace_centre[:3]
    corners = [(x, y), (x + 60, y), (x + 60, y + 40), (x, y + 40)]
    from_lines = [
        from_segment_mm(points[:, :2], np.array(a), np.array(b))
        for a, b in itertools.pairwise(corners)
    ]
    left = points[:, 0] < x + 0.2
    radius = np.hypot(points[:, 0] - x, points[:, 1] - y)
    from_arc = np.where(left, np.abs(radius - 40.0), np.inf)
    plane = np.minimum(np.min(from_lines, axis=0), from_arc)
    return np.hypot(plane, points[:, 2] - z)


def from_segment_mm(points, start, end):
    way = end - start
    part = np.clip((points - start) @ way / (way @ way), 0.0, 1.0)
    return np.linalg.norm(points - start - part[:, None] * way, axis=1)


@some_members
def test_the_robot_follows_the_wanted_path_within_the_tolerance(member):
    robot = member.perturbed
    text = program(member)
    found = correct_gcode(text, "part.ngc", correction_of(member, robot), tolerance_mm=0.01)
    error = from_program_mm(followed(robot, member, places(found.text, member)), member)
    plain = from_program_mm(followed(robot, member, places(text, member)[:4]), member)
    assert error.max() < 0.011
    assert plain.max() > 0.1
    assert found.pieces == len(places(found.text, member)) > found.targets


@some_members
def test_identical_parameters_change_no_place_and_nothing_a_second_time(member):
    correction = correction_of(member, member.nominal)
    once = correct_gcode(program(member), "part.ngc", correction, tolerance_mm=0.05)
    lines = places(once.text, member)[:4]
    np.testing.assert_allclose(lines, places(program(member), member)[:4], atol=5e-5)
    twice = correct_gcode(once.text, "part.ngc", correction, tolerance_mm=0.05)
    assert twice.text == once.text
    assert once.correction_mm[1] < 1e-9


GOLDEN = (
    "%\r\n(a part)\r\nG21 G90 G17 G94\r\n"
    "N10 G0 X0.0000 Y0.0000 Z-575.0000 C0.0000 M3 S100 (begin)\r\n"
    "n20 G1 X60.0000 Y0.0000 Z-575.0000 C0.0000 F1200 ; along x\r\n"
    "G1 X60.0000 Y40.0000 Z-575.0000 C10.0000\r\n"
    "G1 X0.0000 Y40.0000 Z-575.0000 C10.0000 M30\r\n"
    "G4 P0.5\r\n"
    "G1 X-34.6410 Y20.0000 Z-575.0000 C6.6667 F600\r\n"
    "G1 X-34.6410 Y-20.0000 Z-575.0000 C3.3333\r\n"
    "G1 X0.0000 Y-40.0000 Z-575.0000 C0.0000\r\n"
    "M5"
)


def test_words_comments_and_line_endings_stay_where_they_were():
    member = BY_NAME["par4"]
    correction = correction_of(member, member.nominal)
    found = correct_gcode(program(member), "part.ngc", correction, tolerance_mm=5.4)
    assert found.text == GOLDEN


def test_what_stops_the_program_comes_after_the_last_piece():
    member = BY_NAME["par4"]
    found = correct_gcode(
        "G0 X0 Y0 Z-575 C0\nG53 G1 X200 F100 M0 (then stop)",
        "part.ngc",
        correction_of(member, member.perturbed),
        tolerance_mm=0.001,
    )
    _, first, *others = found.text.split("\n")
    assert len(others) > 1
    assert first.startswith("G53 G1 X")
    assert first.endswith("F100 (then stop)")
    assert all(line.startswith("G53 G1 X") for line in others)
    assert [line.endswith(" M0") for line in others] == [*[False] * (len(others) - 1), True]


@some_members
def test_places_that_cannot_be_taken_are_refused_by_their_line(member):
    x, y, z = member.shipped.workspace_centre[:3]
    turn = " C0" if len(member.mechanism.task) > 3 else ""
    text = f"G0 X{x:g} Y{y:g} Z{z:g}{turn}\n\nG1 X{x + 5000:g}\n"
    with pytest.raises(TargetsInvalid, match=r"part.ngc:3: at X\S+ Y\S+ Z\S+: ") as caught:
        correct_gcode(text, "part.ngc", correction_of(member, member.perturbed))
    assert " → " in str(caught.value)


def test_what_cannot_be_corrected_as_asked_is_refused():
    member = BY_NAME["delta"]
    with pytest.raises(TargetsInvalid, match="give a larger --tolerance"):
        correct_gcode(
            program(member), "part.ngc", correction_of(member, member.perturbed), tolerance_mm=1e-12
        )
    with pytest.raises(TargetsInvalid, match="moves nothing"):
        correct_gcode("M3 S5\n", "part.ngc", correction_of(member, member.nominal))


def test_a_long_program_is_taken_in_parts_and_comes_out_the_same(monkeypatch):
    member = BY_NAME["par4"]
    correction = correction_of(member, member.perturbed)
    whole = correct_gcode(program(member), "part.ngc", correction)
    monkeypatch.setattr(gcode_correction, "LINES", 2)
    assert correct_gcode(program(member), "part.ngc", correction) == whole
    monkeypatch.setattr(gcode_correction, "MOST_PIECES", whole.pieces - 1)
    with pytest.raises(TargetsInvalid, match=f"more than {whole.pieces - 1} pieces"):
        correct_gcode(program(member), "part.ngc", correction)
