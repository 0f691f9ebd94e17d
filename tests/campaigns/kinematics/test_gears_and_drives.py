"""A mechanism of one's own with gears and drives: each parameter of a joint is there once."""

from campaigns.kinematics.axes import PLANE
from campaigns.kinematics.implicit import ImplicitMechanism
from campaigns.kinematics.limbs import transmission_fields
from campaigns.kinematics.parameters import ParameterField


class Column(ImplicitMechanism):
    joint_kinds = ("revolute", "prismatic")
    task_axes = PLANE
    arm_fields = (
        ParameterField("joint_offset_deg", "offset, deg", "angle", "offsets"),
        ParameterField("joint_offset_mm", "offset, mm", "place", "offsets"),
        *transmission_fields("deg", "gear"),
        *transmission_fields("mm", "drive"),
    )

    def misfit(self, fields, joints, pose):
        return pose - joints

    def first_joints(self, fields, poses):
        return poses

    def first_pose(self, fields, joints):
        return joints


def test_fields_that_gears_and_drives_have_alike_are_there_once():
    names = Column("column").parameters.of_robot
    assert len({*names}) == len(names)
    assert {"arm0.encoder_gain_ppm", "arm1.encoder_gain_ppm"} <= {*names}
