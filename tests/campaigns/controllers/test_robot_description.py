"""URDF and SDF: a small reader of the tree, whose places are those of our kinematics."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.main import run_command
from campaigns.controllers.robot_description import robot_description
from campaigns.robots.robot import find_robot

ROBOTS = ("par4-prototype", "h4", "i4r", "i4l", "delta", "linear-delta")


def numbers(text):
    return np.array([float(word) for word in text.split()])


def read_urdf(text):
    """Joints by the link that they hold: parent, kind, place, turn, axis and what they follow."""
    tree, found = ET.fromstring(text), {}
    assert {link.get("name") for link in tree.iter("link")} >= {"base"}
    for joint in tree.iter("joint"):
        origin, axis, mimic = (joint.find(name) for name in ("origin", "axis", "mimic"))
        found[joint.find("child").get("link")] = (
            joint.find("parent").get("link"),
            joint.get("type"),
            np.concatenate([numbers(origin.get("xyz")), numbers(origin.get("rpy"))]),
            None if axis is None else numbers(axis.get("xyz")),
            None if mimic is None else (mimic.get("joint"), float(mimic.get("multiplier"))),
        )
    return found


def read_sdf(text):
    model, found = ET.fromstring(text).find("model"), {}
    poses = {link.get("name"): link.find("pose") for link in model.iter("link")}
    for joint in model.iter("joint"):
        child, axis = joint.find("child").text, joint.find("axis")
        if joint.get("type") == "ball" or child == "base":
            continue
        pose = poses[child]
        assert pose.get("relative_to") == joint.find("parent").text
        mimic = None if axis is None else axis.find("mimic")
        found[child] = (
            joint.find("parent").text,
            joint.get("type"),
            numbers(pose.text),
            None if axis is None else numbers(axis.find("xyz").text),
            None if mimic is None else (mimic.get("joint"), float(mimic.find("multiplier").text)),
        )
    return found


def place(joints, link, values):
    """Place (3,) and turn of a link's frame in the base, at values by the joint's link."""
    if link == "base":
        return np.zeros(3), Rotation.identity()
    parent, kind, origin, axis, mimic = joints[link]
    at, turn = place(joints, parent, values)
    here, own = at + turn.apply(origin[:3]), turn * Rotation.from_euler("xyz", origin[3:])
    value = values.get(link, 0.0)
    if mimic is not None:
        value = mimic[1] * values.get(mimic[0].removesuffix("_joint"), 0.0)
    if kind == "revolute":
        return here, own * Rotation.from_rotvec(value * axis)
    return here + (own.apply(value * axis) if kind == "prismatic" else 0.0), own


def values_of(robot, pose, joints):
    scale = [1.0 if axis.is_revolute else 1e-3 for axis in robot.mechanism.joints]
    task = [1.0 if axis.is_revolute else 1e-3 for axis in robot.mechanism.task]
    names = [axis.name for axis in robot.mechanism.task]
    arms = {f"arm{n}": q * k for n, (q, k) in enumerate(zip(joints, scale, strict=True))}
    return arms | {n: x * k for n, x, k in zip(names, pose, task, strict=True)}


@pytest.mark.parametrize("name", ROBOTS)
def test_forward_kinematics_of_the_tree_is_ours(name):
    robot = find_robot(name).robot
    centre = robot.workspace_centre
    away = np.array([30.0, -40.0, 25.0, 0.2])[: len(centre)]
    poses = np.array([centre, centre + away, centre - away])
    joints = robot.kinematics.inverse(poses).values_or_raise()
    at_centre = values_of(robot, centre, joints[0])
    for language, read in (("urdf", read_urdf), ("sdf", read_sdf)):
        text = robot_description(robot, language)
        tree = read(text)
        for pose, own in zip(poses, joints, strict=True):
            values = values_of(robot, pose, own)
            if language == "sdf":
                values = {link: value - at_centre[link] for link, value in values.items()}
            for arm in range(len(own)):
                elbow, _ = place(tree, f"lift{arm}", values)
                on_platform, _ = place(tree, f"plate{arm}", values)
                forearm_m = robot.parameters[f"arm{arm}.forearm_mm"] * 1e-3
                assert tree[f"end{arm}"][2][0] == pytest.approx(forearm_m)
                assert np.linalg.norm(on_platform - elbow) == pytest.approx(forearm_m, abs=1e-8)
    for arm in range(len(joints[0])):  # the loops of SDF are closed as it is loaded
        end, _ = place(tree, f"end{arm}", {})
        assert end == pytest.approx(place(tree, f"plate{arm}", {})[0], abs=1e-8)
    assert text.count('type="ball"') == len(joints[0])
    assert robot_description(robot, "urdf").count("loop closure") == len(joints[0])


def test_identified_robot_is_exported_and_counts_as_nothing_that_a_controller_holds(
    whole, tmp_path
):
    for language in ("urdf", "sdf"):
        to = tmp_path / f"robot.{language}"
        words = ["export", str(whole.folder), "--format", language, "--to", str(to)]
        assert run_command(words) == 0
        assert ET.parse(to).getroot().tag in {"robot", "sdf"}
