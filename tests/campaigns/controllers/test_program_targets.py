"""Targets of RAPID, KRL, V+ and CSV: corrected where they stand, or refused by their line."""

import math

import numpy as np
import pytest
from paper_campaign import NOMINAL, TRUE

from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.controllers.program_targets import correct_program, targets_of
from campaigns.errors import TargetsInvalid
from campaigns.mechanisms.catalog import MECHANISMS

PAR4, DELTA = MECHANISMS["par4"].task, MECHANISMS["delta"].task
ROBOT = NOMINAL.robot
CORRECTION = TargetCorrection(TRUE, ROBOT.kinematics, ROBOT.limits)
HALF = math.radians(10.0)
COS, SIN = math.cos(HALF), math.sin(HALF)
RAPID = f"""MODULE Parts ! [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]
  CONST robtarget pick := [[100,-50.5,-600], [0,{COS:.9f},{SIN:.9f},0],
    [0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PERS tooldata t:=[TRUE,[[0,0,0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  TPWrite "Offs [[1,2,3]";
  MoveL pick,v1000,fine,tool0\\WObj:=wobj0;
  MoveAbsJ [[1,2,3,4,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;
  MoveJ [[0,0,-575],[{COS},0,0,{SIN}],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v9,z1,tool0;
ENDMODULE
"""
KRL = """&ACCESS RVP
DEF part()
; PTP {X 1, Y 2, Z 3, A 0, B 0, C 180}
BAS(#BASE, 0)
DECL E6POS XPICK={X 100.0,Y -50.5,Z -600,A 20.0,B 0.0,C -180.0,S 2,T 10,E1 0.0}
PTP {A1 1, A2 2, A3 3, A4 4}
LIN {E6POS: X 0, Y 0, Z -575, A 20, B 0, C 0} C_DIS
END
"""
VPLUS = """.PROGRAM part() ; TRANS(1,2,3,0,180,0)
  TOOL NULL
  SET pick = TRANS(100, -50.5, -600, 5, 180, -15)
  MOVES pick
  MOVE TRANS(0,0,-575,10,0,10)
.END
"""
CSV = 'name,"theta_deg",x_mm,y_mm,z_mm\r\n"a, b",20,100,-50.5,-600\r\n\r\nc,20,0,0,-575,\r\n'
CSV = CSV.replace("-575,\r\n", "-575\r\n")
TEXTS = {"rapid": RAPID, "krl": KRL, "vplus": VPLUS, "csv": CSV}
WANTED = np.array([[100.0, -50.5, -600.0, 2.0 * HALF], [0.0, 0.0, -575.0, 2.0 * HALF]])


def poses(text, language, task=PAR4):
    return np.array([target.pose for target in targets_of(text, "part", language, task)])


@pytest.mark.parametrize("language", TEXTS)
def test_targets_are_corrected_and_nothing_else_changes(language):
    text = TEXTS[language]
    np.testing.assert_allclose(poses(text, language), WANTED, atol=1e-8)
    found = correct_program(text, "part", language, CORRECTION)
    there = TRUE.forward(ROBOT.kinematics.inverse(poses(found.text, language)).values_or_raise())
    away = there.values_or_raise() - WANTED
    assert np.abs(away[:, :3]).max() < 2e-4  # by the decimals that are written
    assert np.abs(away[:, 3]).max() < 2e-6
    assert found.targets == 2
    assert 0.1 < found.correction_mm[0] <= found.correction_mm[1] < 10.0
    lines = list(zip(text.split("\n"), found.text.split("\n"), strict=True))
    changed = [old for old, new in lines if old != new]
    assert len(changed) == 2
    targets = targets_of(text, "part", language, PAR4)
    words = [text[slice(*span)] for target in targets for span in target.spans.values()]
    own = [
        span for t in targets_of(found.text, "part", language, PAR4) for span in t.spans.values()
    ]
    back = found.text
    for (first, last), word in sorted(zip(own, words, strict=True), reverse=True):
        back = back[:first] + word + back[last:]
    assert back == text


def test_a_plate_that_does_not_turn_keeps_whatever_orientation_stands_there():
    text = "LIN {X 0, Y 0, Z -575, A 20, B 30, C 40}"
    assert poses(text, "krl", DELTA).tolist() == [[0.0, 0.0, -575.0]]


@pytest.mark.parametrize(
    ("language", "line", "says"),
    [
        ("rapid", "MoveL p,v1,fine,tool0\\WObj:=table;", "its frame is not the base"),
        ("rapid", "MoveL p,v1,fine,grip;", "its tool is not tool0"),
        ("rapid", "MoveL p,v1,fine,grip\\WObj:=wobj0;", "its tool is not tool0"),
        ("rapid", "MoveL Offs(p,0,0,5),v1,fine,tool0;", "worked out by the controller"),
        ("rapid", "p.trans.x := 5;", "worked out by the controller"),
        ("rapid", "p:=[[x,0,-5],[1,0,0,0],[0,0,0,0],[9E9,9E9]];", "is no pose of numbers"),
        ("rapid", "p:=[[1,0,-5],[0.7,0.7,0,0],[0,0,0,0],[9E9]];", "the tool is tilted"),
        ("krl", "$BASE={X 1,Y 0,Z 0,A 0,B 0,C 0}", "its frame is not the base"),
        ("krl", "$TOOL=TOOL_DATA[3]", "its frame is not the base"),
        ("krl", "BAS(#TOOL,2)", "its frame is not the base"),
        ("krl", "FDAT_ACT={TOOL_NO 0,BASE_NO 3}", "its frame is not the base"),
        ("krl", "LIN_REL {Z 5}", "worked out by the controller"),
        ("krl", "XP1.Z = XP1.Z + 5", "worked out by the controller"),
        ("krl", "LIN XP1:{X 1,Y 0,Z 0,A 0,B 0,C 0}", "worked out by the controller"),
        ("krl", "PTP {X 1,Y 2}", "is no pose of numbers"),
        ("krl", "PTP {X 1,Y 2,Z H,A 0,B 0,C 0}", "is no pose of numbers"),
        ("krl", "PTP {X 1,Y 2,Z 3,A 0,B 5,C 0}", "the tool is tilted"),
        ("vplus", "TOOL gripper", "its frame is not the base"),
        ("vplus", "BASE 10,0,0,0", "its frame is not the base"),
        ("vplus", "APPROS pick, 50", "worked out by the controller"),
        ("vplus", "MOVE pallet:part", "worked out by the controller"),
        ("vplus", "MOVE TRANS(x,0,0,0,180,0)", "is no pose of numbers"),
        ("vplus", "MOVE TRANS(1,0,0,0,90,0)", "the tool is tilted"),
        ("csv", "1,2,3,4,5", "5 columns, not 4"),
        ("csv", "1,2,three,4", "'three' is no number"),
    ],
)
def test_refused_by_its_line(language, line, says):
    first = "x_mm,y_mm,z_mm,theta_deg" if language == "csv" else ""
    with pytest.raises(TargetsInvalid) as refused:
        targets_of(f"{first}\n{line}\n", "part", language, PAR4)
    assert str(refused.value).startswith("part:2: ")
    assert says in str(refused.value)
    assert " → " in str(refused.value)


def test_a_target_that_cannot_be_taken_is_named_by_its_line():
    with pytest.raises(TargetsInvalid, match=r"^part:5: "):
        correct_program(KRL.replace("100.0,Y", "900.0,Y"), "part", "krl", CORRECTION)
    with pytest.raises(TargetsInvalid, match="holds no pose"):
        correct_program("PTP {A1 1, A2 2}", "part", "krl", CORRECTION)
    with pytest.raises(TargetsInvalid, match="joints stand beside"):
        targets_of("x_mm,y_mm,z_mm,q0_deg\n", "part", "csv", DELTA)
