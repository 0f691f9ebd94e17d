"""The mechanic's list held against robots as they were drawn, built of rods.

Off are all arms alike, also those that place the frame.
"""

from dataclasses import replace

import numpy as np
import pytest
from drawn_robots import MECHANICS, drawn_robot, identified, workspace_of
from family_cases import ALL_MEMBERS

from campaigns.estimation.rigid_transforms import fit_transform
from campaigns.evaluation.mechanical_advice import MechanicalAdvice, mechanical_advice
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.workflow.advising import dimensions_of

ROBOTS = 34
"""Of each of six mechanisms: 204."""
FEWEST = {"i4l": 0.5}
"""Instructions a robot on average; carriages of an I4L are barely told."""
EVERY = 3


def advised(robot, found) -> MechanicalAdvice:
    told = dimensions_of(replace(robot.member.shipped, mechanics=MECHANICS), found)
    if told.refusal(found.verdict, found.doubts):
        return MechanicalAdvice()
    return mechanical_advice(told, workspace_of(robot.member))


def mean_error_mm(robot, changes):
    """Of the true robot less some changes, by a controller of nominal parameters."""
    nominal, wanted = robot.member.nominal, workspace_of(robot.member)[::EVERY]
    true = robot.contracted.parameters
    left = true | {name: true.get(name, 0.0) - by for name, by in changes.items()}
    joints = nominal.inverse(wanted).values_or_raise()
    sides = np.random.default_rng(1).choice([-1.0, 1.0], joints.shape)
    reached = Kinematics.of(robot.member.mechanism, left).forward(joints, wanted, sides)
    points, aims = reached.values_or_raise()[:, :3], wanted[:, :3]
    return np.linalg.norm(fit_transform(points, aims).apply(points) - aims, axis=1).mean()


def off_by_sigma(robot, advice):
    """How far what each repair brings the true robot is from what was said, in its σ."""
    done, before = dict[str, float](), mean_error_mm(robot, {})
    for said in advice.instructions:
        done |= {name: done.get(name, 0.0) + by for name, by in said.change.items()}
        after = mean_error_mm(robot, done)
        yield (before - after - said.gain_mm) / said.gain_std_mm
        before = after


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("member", ALL_MEMBERS, ids=lambda each: each.name)
def test_no_instruction_has_the_wrong_sign_or_part_and_repairs_bring_what_was_said(member):
    named, wrong, off = 0, list[str](), list[float]()
    for number in range(ROBOTS):
        rng = np.random.default_rng([number, 11])
        robot = drawn_robot(member, rng)
        advice = advised(robot, identified(robot, rng))
        named += len(advice.instructions)
        wrong += [s.says for s in advice.instructions if s.size * robot.truth(s) <= 0.0]
        off += off_by_sigma(robot, advice)
    assert not wrong
    assert named > ROBOTS * FEWEST.get(member.name, 1.0)
    assert np.mean(np.abs(off) < 2.0) > 0.9
