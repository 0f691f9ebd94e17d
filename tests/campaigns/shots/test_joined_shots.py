"""Points and joints from two files become shots, by name or order, or it is said what is amiss."""

import math

import numpy as np
import pytest
from refusals import refusal

from campaigns.errors import ShotsInvalid
from campaigns.files.cells import Notation
from campaigns.kinematics.catalog import PAR4
from campaigns.shots.joined_shots import join_rows, read_joints
from campaigns.shots.point_files import read_points
from campaigns.shots.point_layout import PointFormat
from campaigns.shots.shot_sets import ShotSet

POINTS = """\
A Main p1 1.0 2.0 3.0
A Main p2 4.0 5.0 6.0
A Nest p3 7.0 8.0 9.0
A Nest p4 1.5 2.5 3.5
"""
HEADER = "name,q0_deg,q1_deg,q2_deg,q3_deg"
JOINTS = f"{HEADER}\np1,1,2,3,4\np2,5,6,7,8\np3,9,10,11,12\np4,13,14,15,16\n"


@pytest.fixture
def join(tmp_path):
    def read(points=POINTS, joints=JOINTS, by="name", **told):
        (tmp_path / "points.txt").write_text(points)
        (tmp_path / "joints.csv").write_text(joints)
        form = PointFormat(**{"unit": "mm", **told})
        points = read_points(tmp_path / "points.txt", form)
        at_joints = read_joints(
            tmp_path / "joints.csv", PAR4, ShotSet.IDENTIFICATION, notation=form
        )
        rows, note = join_rows(points, at_joints, by)
        return rows, (*points.notes, note)

    return read


@pytest.fixture
def complaint(join, tmp_path):
    def said(*files, **told):
        text = refusal(ShotsInvalid, join, *files, begins=str(tmp_path), **told)
        return text.replace(f"{tmp_path}/", "")

    return said


class TestByName:
    def test_each_shot_gets_the_point_of_its_name(self, join):
        rows = join(joints=f"{HEADER}\np4,1,2,3,4\np1,5,6,7,8\np3,1,1,1,1\np2,2,2,2,2\n")[0]
        assert [row.point_in_tracker_mm[0] for row in rows] == [1.5, 1.0, 7.0, 4.0]
        assert rows[0].joints == tuple(map(math.radians, (1.0, 2.0, 3.0, 4.0)))

    @pytest.mark.parametrize("prefix", ["", "Main::", "A::Main::"])
    def test_name_may_be_whole_or_without_its_first_parts(self, join, prefix):
        joints = JOINTS.replace("p1", f"{prefix}p1")
        assert join(joints=joints)[0][0].point_in_tracker_mm == (1.0, 2.0, 3.0)

    def test_names_that_fit_twice_or_stand_twice_are_refused(self, complaint):
        points = POINTS.replace("Nest p3", "Nest p1")
        said = complaint(points, JOINTS.replace("p3", "Nest::p1"))
        assert "joints.csv:2: name 'p1' fits 2 points: A::Main::p1, A::Nest::p1" in said
        assert "joined by ::" in said
        assert "joints.csv:3: name 'p1' stands twice" in complaint(
            joints=JOINTS.replace("p2", "p1")
        )

    def test_what_fits_nothing_is_listed_both_ways(self, complaint):
        said = complaint(joints=JOINTS.replace("p2", "P2").replace("p4", "x"))
        assert "joints.csv:3: 2 joints without a point in points.txt (P2, x)" in said
        assert "2 points without joints (A::Main::p2, A::Nest::p4)" in said
        assert "did you mean p2?" in said

    @pytest.mark.parametrize(
        ("header", "cells"),
        [
            (",x,y,z", "{0},{1},2,3"),
            ("Object Name,x,y,z", "{0},{1},2,3"),
            ("no,x,y,z,Merkmal", "7{1},{1},2,3,{0}"),
            ("x,y,z,mark,again", "{1},2,3,{0},{0}x"),
        ],
    )
    def test_the_column_that_has_the_joints_names_is_the_name(self, join, header, cells):
        rows = [cells.format(f"p{number}", number) for number in (4, 3, 2, 1)]
        shots, said = join("\n".join([header, *rows]), JOINTS)
        assert [shot.point_in_tracker_mm[0] for shot in shots] == [1.0, 2.0, 3.0, 4.0]
        assert "names by column '" in said[-1]

    def test_of_two_columns_with_the_joints_names_none_is_chosen(self, complaint):
        rows = [f"p{number},p{number},{number},2,3" for number in (1, 2, 3, 4)]
        assert "have no names" in complaint("\n".join(["a,b,x,y,z", *rows]), JOINTS)

    def test_what_has_no_names_is_to_be_joined_by_order(self, complaint):
        text = complaint("1.0 2.0 3.0\n", JOINTS)
        assert "points.txt: the points have no names" in text
        assert "--join order" in text
        said = complaint(POINTS, JOINTS.replace("p1", ""))
        assert "joints.csv:2: name is empty or missing" in said


class TestByOrder:
    def test_names_are_not_looked_at_but_their_number(self, join, complaint):
        rows = join(joints=JOINTS.replace("p1", "p4"), by="order")[0]
        assert [row.point_in_tracker_mm[0] for row in rows] == [1.0, 4.0, 7.0, 1.5]
        said = complaint(POINTS + "A B c 1.0 2.0 3.0\n", by="order")
        assert "joints.csv:5: the last of 4 joints, but points.txt holds 5 points" in said


class TestPairs:
    def test_without_numbers_two_shots_in_a_row_are_a_pair(self, join):
        rows, notes = join()
        assert [row.pair for row in rows] == [0, 0, 1, 1]
        assert "no column pair: each 2 shots of a set in a row are a pair" in notes

    def test_each_set_has_its_own_row(self, join):
        joints = JOINTS.replace("deg\n", "deg,set\n").replace("4\n", "4,validation\n", 1)
        joints = joints.replace("8\n", "8,\n").replace("12\n", "12,validation\n")
        joints = joints.replace("16\n", "16,identification\n")
        rows = join(joints=joints)[0]
        assert [row.pair for row in rows] == [0, 1, 0, 1]
        assert [row.purpose for row in rows] == [ShotSet.VALIDATION, ShotSet.IDENTIFICATION] * 2

    def test_numbers_are_kept(self, join):
        lines = JOINTS.splitlines()
        numbered = [f"{line},{pair}" for line, pair in zip(lines, "p7337", strict=True)]
        joints = "\n".join(numbered).replace("deg,p", "deg,pair")
        assert [row.pair for row in join(joints=joints)[0]] == [7, 3, 3, 7]

    def test_odd_number_of_shots_is_refused(self, complaint):
        points, joints = (text.rsplit("\n", 2)[0] + "\n" for text in (POINTS, JOINTS))
        assert "joints.csv:4: pair 1 has one shot" in complaint(points, joints)


class TestComplaints:
    def test_wrong_joints_are_named_by_line_and_column_and_missing_ones_too(self, complaint):
        assert "joints.csv:2: q0_deg is 'x'" in complaint(joints=JOINTS.replace("p1,1", "p1,x"))
        assert "joints.csv:2: q0_deg is '999'" in complaint(joints=JOINTS.replace("p1,1", "p1,999"))
        said = complaint(joints=JOINTS.replace("q3_deg", "q3"))
        assert "joints.csv:1: unknown column 'q3' → write q3_deg, with the value in deg" in said
        assert "joints.csv: holds no joints" in complaint(joints=HEADER + "\n")
        assert "--unit mm|m|inch" in complaint(unit=None)


class TestNotations:
    POINTS = "p1;510,112;-35,487;175,302\np2;11,112;-35,487;175,302\n"
    HEADER = HEADER.replace(",", ";")
    JOINTS = f"{HEADER}\np1;12,125;13,250;14,500;15,125\np2;1,125;2,250;3,500;4,125\n"

    def test_the_decimal_sign_given_counts_for_the_joints_too(self, join, complaint):
        rows, _ = join(self.POINTS, self.JOINTS, decimal="comma")
        assert rows[0].point_in_tracker_mm == (510.112, -35.487, 175.302)
        assert rows[1].joints == pytest.approx(np.radians([1.125, 2.25, 3.5, 4.125]))
        clear = self.POINTS.replace("11,112", "1111,112")
        said = complaint(clear, self.JOINTS)
        assert "joints.csv:2: q0_deg is '12,125', a decimal comma → give --decimal comma" in said

    def test_the_joints_of_a_sure_notation_need_no_option(self, join):
        joints = self.JOINTS.replace("1,125;2", "0,125;2")
        rows, _ = join(self.POINTS.replace("11,112", "11,1"), joints)
        assert rows[1].joints == pytest.approx(np.radians([0.125, 2.25, 3.5, 4.125]))

    @pytest.mark.parametrize("encoding", ["utf-16", "cp1252"])
    def test_the_encoding_given_counts_for_the_joints_too(self, tmp_path, encoding):
        codec = {"utf-16": "utf-16-le"}.get(encoding, encoding)
        path = tmp_path / "joints.csv"
        path.write_bytes(JOINTS.replace("p1", "Höhe").encode(codec))
        notation = Notation(encoding=encoding)
        rows = read_joints(path, PAR4, ShotSet.IDENTIFICATION, notation=notation)
        assert rows[0][0].text("name") == "Höhe"
        said = refusal(ShotsInvalid, read_joints, path, PAR4, ShotSet.IDENTIFICATION)
        assert "give --encoding" in said
