"""Turns of other software: one rotation, however it is written."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from campaigns.errors import ShotsInvalid
from campaigns.kinematics.catalog import find_mechanism
from campaigns.shots.shots_csv import parse_shots, shots_text
from campaigns.shots.turn_forms import has_unknown_turns

HEXAPOD = find_mechanism("hexapod")
HEADER = "pair," + "".join(f"q{leg}_mm," for leg in range(6)) + "x_mm,y_mm,z_mm"
SHOT = "150,160,170,180,190,200,1,2,3"


def turn_of(names, cells, turns=None):
    """Return the turn that is read from a file with these columns beside a pair's."""
    lines = [f"{HEADER},{names}", f"0,{SHOT},{cells}", f"0,{SHOT},{cells}"]
    return parse_shots("\n".join(lines), "f.csv", HEXAPOD, turns=turns)[0].turn


# By matrices about single axes, not by the reader's own words for an order.
def about(axis, degrees):
    return Rotation.from_rotvec(np.radians(degrees) * np.eye(3)["xyz".index(axis)])


ROLL, PITCH, YAW = 10.0, -20.0, 33.0
AS_ZYX = about("z", YAW) * about("y", PITCH) * about("x", ROLL)
AS_XYZ = about("x", ROLL) * about("y", PITCH) * about("z", YAW)
X, Y, Z, W = AS_ZYX.as_quat()


@pytest.mark.parametrize(
    ("names", "cells", "turns", "wanted"),
    [
        ("a_deg,b_deg,c_deg", f"{YAW},{PITCH},{ROLL}", "zyx", AS_ZYX),
        ("w_deg,p_deg,r_deg", f"{ROLL},{PITCH},{YAW}", "zyx", AS_ZYX),
        ("roll_deg,pitch_deg,yaw_deg", f"{ROLL},{PITCH},{YAW}", "zyx", AS_ZYX),
        ("rx_deg,ry_deg,rz_deg", f"{ROLL},{PITCH},{YAW}", "xyz", AS_XYZ),
        ("rx_deg,ry_deg,rz_deg", f"{ROLL},{PITCH},{YAW}", "zyx", AS_ZYX),
        ("qw,qx,qy,qz", f"{W},{X},{Y},{Z}", None, AS_ZYX),
        ("qw,qx,qy,qz", f"{-W},{-X},{-Y},{-Z}", "quaternion", AS_ZYX),
    ],
)
def test_one_rotation_in_every_form(names, cells, turns, wanted):
    np.testing.assert_allclose(turn_of(names, cells, turns), wanted.as_rotvec(), atol=1e-12)


def test_our_own_columns_are_a_rotation_vector_and_are_written_again():
    text = f"{HEADER},rx_deg,ry_deg,rz_deg\n0,{SHOT},1,2,3\n0,{SHOT},,,\n"
    rows = parse_shots(text, "f.csv", HEXAPOD)
    assert rows[0].turn == pytest.approx(np.radians([1, 2, 3]))
    assert rows[1].turn == ()
    assert parse_shots(shots_text(rows, HEXAPOD), "f.csv", HEXAPOD) == rows


@pytest.mark.parametrize(
    ("names", "cells", "turns", "words"),
    [
        ("a_deg,b_deg,c_deg", "1,2,3", None, "c_deg,b_deg,a_deg may be turns in several orders"),
        ("qw,qx,qy,qz", "1,2,3,4", None, "quaternion's length is 5.477, must be 1"),
        ("qw,qx,qy,qz", "1,0,0,0", "zyx", "qw,qx,qy,qz are no zyx"),
        ("w_deg,p_deg,r_deg", "1,2,3", "quaternion", "w_deg,p_deg,r_deg are no quaternion"),
        ("w_deg,p_deg,r_deg", "1,,3", "zyx", "p_deg is empty"),
        ("rx_deg", "1", None, "ry_deg is missing"),
        ("rx_deg,ry_deg,rz_deg,qw,qx,qy,qz", "1,2,3,1,0,0,0", None, "stated twice, by rx_deg"),
    ],
)
def test_turns_that_cannot_be_read_are_refused_with_their_line(names, cells, turns, words):
    with pytest.raises(ShotsInvalid) as refused:
        turn_of(names, cells, turns)
    assert refused.value.problem.startswith("f.csv:2: ")
    assert words in refused.value.problem


def test_file_is_asked_about_only_where_its_angles_have_no_stated_order(tmp_path):
    path = tmp_path / "f.csv"
    for names, is_unknown in {"a_deg,b_deg,c_deg": True, "rx_deg,ry_deg,rz_deg": False}.items():
        path.write_text(f"{HEADER},{names}\n", encoding="utf-8")
        assert has_unknown_turns(path) is is_unknown
    assert not has_unknown_turns(tmp_path / "absent.csv")
