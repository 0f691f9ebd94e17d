"""The examples to copy run as they stand, and find what they say they do."""

import ast
import json
import re
import runpy
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from family_cases import BY_NAME
from pages import ROOT, blocks
from scipy.optimize import brentq, fsolve
from scipy.spatial.transform import Rotation

import pkmcal
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.robots.robot import RobotFile, find_robot, read_robot
from pkmcal import sample_workspace


@pytest.fixture
def example(tmp_path, monkeypatch, capsys):
    """Runs one in an empty folder, as a program or a module: its names, and what it printed."""
    monkeypatch.chdir(tmp_path)

    def run(name, as_name=None):
        made = runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name=as_name)
        return made, capsys.readouterr().out

    return run


def test_a_robot_is_identified_from_a_table_of_shots(example, tmp_path):
    made, said = example("identify")
    found, true = made["found"], made["true"]
    lengths = [name for name in found.value.free if name.endswith(("arm_mm", "plate_mm"))]
    off = [
        (found.value.parameters[n].value - true.parameters[n]) / found.value.std()[n]
        for n in lengths
    ]
    assert len(lengths) == 9
    assert np.abs(off).max() < 4.0
    assert "<Shots: 80 (20 validation, 60 identification) of 4 joints>" in said
    assert "<IdentificationResult: pass, 80 parameters, hold-out 0.0" in said
    assert "uncertainty of positions, 1 σ, rms over the workspace, mm" in said
    assert "hold-out pairs, after" in (tmp_path / "identify.svg").read_text()


@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda e: e.stem)
def test_examples_to_copy_import_pkmcal_alone(example):
    if example.stem == "corbel2006":  # a benchmark of the whole program, not one to copy
        return
    words = re.findall(r"^\s*(?:from|import) (\w+)", example.read_text("utf-8"), re.MULTILINE)
    assert not {*words} & {*pkmcal.PACKAGES}


def test_cells_of_the_notebook_run_and_show_tables_and_figures(tmp_path, monkeypatch):
    """Without Jupyter: the value of a cell's last line is what Jupyter would show."""
    notebook = json.loads((ROOT / "examples" / "notebook.ipynb").read_text(encoding="utf-8"))
    monkeypatch.chdir(tmp_path)
    ran, shown = {}, {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            *lines, last = ast.parse("".join(cell["source"])).body
            exec(compile(ast.Module(lines, []), cell["id"], "exec"), ran)
            shown[cell["id"]] = eval(compile(ast.Expression(last.value), cell["id"], "eval"), ran)
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
    for name in ("names", "shots", "identify", "plan"):
        assert "<t" in shown[name]._repr_html_() or "<pre>" in shown[name]._repr_html_(), name
    assert [len(shown[name].axes) for name in ("gain", "space")] == [2, 4]
    result, true = ran["result"], ran["true"]
    assert result.judgement.verdict == "pass"
    arms = [name for name in result.value.free if name.endswith("arm_mm")]
    off = [abs(result.value.parameters[n].value - true.parameters[n]) for n in arms]
    assert (off < 4.0 * np.array([result.value.std()[name] for name in arms])).all()
    assert np.abs(shown["save"]).max() < 0.3


@pytest.mark.long
@pytest.mark.timeout(400)
def test_the_papers_figures_are_reproduced(capsys):
    """One seed: between limits that the percentiles of 20 seeds leave room to."""
    example = runpy.run_path(str(ROOT / "examples" / "corbel2006.py"), run_name="corbel2006")
    results = example["main"](1)
    said = capsys.readouterr().out
    prototype, simulation = (results[example[name]][0] for name in ("PROTOTYPE", "SIMULATION"))
    for name, low, high in (
        ("fitted pairs, before", 30.0, 45.0),
        ("fitted pairs, after", 0.25, 0.6),
        ("rotation, before", 1.7, 3.0),
        ("rotation, after", 0.4, 0.9),
        ("along x, before", 5.3, 6.6),
        ("along x, after", 0.1, 0.7),
        ("mean, after", 0.05, 0.4),
        ("max, after", 0.2, 1.2),
        ("radius of the sphere, before", 0.3, 0.5),
    ):
        assert low < prototype[name] < high, name
    assert simulation["worst of 18 lengths"] < 0.25
    assert simulation["worst of 4 angles"] < 0.015
    assert simulation["unseen pairs, after"] < 0.05
    for title in ("Table I:", "Table II:", "Table III:", "Table IV:", "Fig. 7:", "Fig. 8:"):
        assert said.count(f"\n{title}") == 1


@pytest.mark.long
def test_a_mechanism_of_ones_own_is_planned_and_studied(example, tmp_path):
    made, said = example("own_mechanism")
    robot, pose = made["robot"], np.array(made["pose"])
    joints = robot.kinematics.inverse(pose).values_or_raise()
    np.testing.assert_allclose(robot.kinematics.forward(joints).values[0], pose, atol=1e-9)
    turned = Rotation.from_euler("z", pose[3]).as_matrix()[:2, :2]
    for arm, angle in enumerate(joints[0]):
        x, y, u, v = (
            robot.parameters[f"arm{arm}.{k}_mm"] for k in ("x", "y", "plate_x", "plate_y")
        )
        elbow = np.array([x, y]) + 150.0 * np.array([np.cos(angle), np.sin(angle)])
        assert np.linalg.norm(pose[:2] + turned @ [u, v] - elbow) == pytest.approx(180.0)
    assert "8 campaigns, 0 failed" in said
    assert (tmp_path / "plan.svg").stat().st_size > 1000


def test_a_serial_arm_is_where_its_links_are(example):
    """By frames of SciPy, one link after the other, with a small turn about y."""
    made, said = example("serial_arm", "__main__")
    robot, rng = made["robot"], np.random.default_rng(1)
    values = dict(robot.parameters) | {f"arm{k}.beta_deg": 0.1 * k for k in range(6)}
    bent = RobotFile.of(made["SERIAL_ARM"], values, name="bent", limits=robot.limits).kinematics
    joints = np.radians(made["READY_DEG"]) + rng.uniform(-0.3, 0.3, (5, 6))
    for row, pose in zip(joints, bent.forward(joints).values_or_raise(), strict=True):
        place, frame = np.zeros(3), Rotation.identity()
        for k, angle in enumerate(row):
            frame = frame * Rotation.from_euler("z", angle)
            link = [values[f"arm{k}.a_mm"], 0.0, values[f"arm{k}.d_mm"]]
            place = place + frame.apply(link)
            frame = frame * Rotation.from_euler("x", values[f"arm{k}.alpha_deg"], degrees=True)
            frame = frame * Rotation.from_euler("y", 0.1 * k, degrees=True)
        assert np.abs(pose[:3] - place).max() < 1e-9
        assert (Rotation.from_rotvec(pose[3:]) * frame.inv()).magnitude() < 1e-9
    poses = sample_workspace(robot, 20)
    there = bent.inverse(poses).values_or_raise()
    assert np.abs(bent.forward(there).values_or_raise() - poses).max() < 1e-6
    assert "shots" in said


GCODE = "G21 G90 ; mm\nG0 X0 Y0 Z-575 C0\nM3 S100\nG1 X60 C5 F600 (along x)\nM2\n"


@pytest.fixture
def gcode(example, tmp_path):
    """Corrects G-code for a Par4 that is off: the program, and the two robots."""
    made, _ = example("correct_gcode")
    nominal = find_robot("par4-prototype").robot
    (tmp_path / "nominal.yaml").write_text(find_robot("par4-prototype").document.text)
    text = (tmp_path / "nominal.yaml").read_text()
    (tmp_path / "identified.yaml").write_text(text.replace("plate_mm: 100.0", "plate_mm: 101.0"))
    identified = read_robot(tmp_path / "identified.yaml").robot
    return lambda program: made["correct"](program, "identified.yaml", "nominal.yaml"), (
        identified.kinematics,
        nominal.kinematics,
    )


def test_corrected_gcode_leads_along_the_wanted_line_and_keeps_the_rest(gcode):
    correct, (identified, nominal) = gcode
    lines = correct(GCODE).splitlines()
    assert (lines[0], lines[2], lines[-1]) == ("G21 G90 ; mm", "M3 S100", "M2")
    moves = [line.split() for line in lines if line.startswith(("G0", "G1"))]
    assert [words[0] for words in moves] == ["G0", *["G1"] * 12]
    assert [words[-1] for words in moves if words[-1][0] == "F"] == ["F600"]
    unit = np.array([1.0, 1.0, 1.0, np.pi / 180.0])
    commanded = np.array([[float(word[1:]) for word in words[1:5]] for words in moves]) * unit
    there = identified.forward(nominal.inverse(commanded).values_or_raise()).values_or_raise()
    share = np.linspace(0.0, 1.0, 13)[:, None]
    wanted = [0.0, 0.0, -575.0, 0.0] + share * [60.0, 0.0, 0.0, np.radians(5.0)]
    np.testing.assert_allclose(there, wanted, atol=2e-4)
    assert np.abs(commanded - wanted)[:, :3].max() > 0.1


@pytest.mark.parametrize(
    ("program", "says"),
    [
        (GCODE.replace("M2", "G2 X10 I5"), "line 5: G2 is not followed"),
        (GCODE.replace("M2", "#1 = 5"), "line 5: '#1 = 5' is no word"),
        (GCODE.replace("M2", "G1 X1 M2"), "line 5: M2 beside a move"),
        ("G1 X0 F100\n", "line 1: the first move has no Y"),
        ("G1 X2000 Y0 Z-575 C0 F100\n", "out of reach"),
    ],
)
def test_gcode_that_cannot_be_followed_is_refused(gcode, program, says):
    correct, _ = gcode
    with pytest.raises(Exception, match=re.escape(says)):
        correct(program)


def test_loops_over_corrected_poses_write_each_in_three_languages(tmp_path, monkeypatch, capsys):
    axes = ["x_mm", "y_mm", "z_mm", "theta_deg"]
    head = ",".join(["name", *axes, *(f"commanded_{axis}" for axis in axes)])
    rows = ["pick,1,2,-600,30,1.5,2.5,-600.5,30", "place,0,0,0,0,4,5,-6,0"]
    (tmp_path / "targets-corrected.csv").write_text("\n".join([head, *rows, ""]))
    monkeypatch.chdir(tmp_path)
    written = []
    for block in blocks("python"):
        if block.where.startswith("docs/how-to/closed-controllers"):
            exec(compile(block.text, block.where, "exec"), {})
            moved = [line.split() for line in capsys.readouterr().out.splitlines()]
            written.append(next(words for words in moved if "1.5" in " ".join(words)))
    rapid, krl, vplus = ("".join(words) for words in written)
    assert rapid.startswith("MoveJ[[1.5,2.5,-600.5],[0,0.965925826,0.258819045,0],[0,0,0,0],[9E9")
    assert rapid.endswith(r"fine,tool0\WObj:=wobj0;")
    assert krl == "PTP{X1.5,Y2.5,Z-600.5,A30,B0,C180}"
    assert vplus == "MOVETRANS(1.5,2.5,-600.5,0,180,-30.000000)"


def klipper_settings(text):
    """Values of a configuration by section and key."""
    settings, section = {}, ""
    for line in filter(None, text.splitlines()):
        if line.startswith("["):
            section = line.strip("[]")
        else:
            key, value = line.split(": ")
            settings[f"{section}.{key}"] = value if key == "kinematics" else float(value)
    return settings


def klipper_points(settings, joints, limits, near):
    """Positions that Klipper believes in at joints, from its documented keys; frame by its bed."""
    steppers = [f"stepper_{each}." for each in "abc"]
    angles = np.radians([settings[each + "angle"] for each in steppers])
    endstops = np.array([settings[each + "position_endstop"] for each in steppers])
    outward = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    if rotary := settings["printer.kinematics"] == "rotary_delta":
        radius, height = settings["printer.shoulder_radius"], settings["printer.shoulder_height"]
        arms = np.array([settings[each + "upper_arm_length"] for each in steppers])
        lengths = np.array([settings[each + "lower_arm_length"] for each in steppers])
        sides = zip(arms, lengths, endstops, strict=True)
        at_endstop = np.array([upward(radius, height, *side) for side in sides])
    else:
        radius = settings["printer.delta_radius"]
        lengths = np.array([settings[each + "arm_length"] for each in steppers])
        at_endstop = endstops + np.sqrt(lengths**2 - radius**2)
    points = []
    for moved, place in zip(joints - limits[0 if rotary else 1], near, strict=True):
        if rotary:  # motors count arms upward, readings downward
            centres = outward * (radius + arms * np.cos(at_endstop - moved))[:, None]
            centres[:, 2] = height + arms * np.sin(at_endstop - moved)
        else:
            centres = radius * outward
            centres[:, 2] = at_endstop + moved
        points.append(spheres(centres, lengths, place))
    return np.array(points)


def spheres(centres, lengths, near):
    """Common point of three spheres, by an equation solver that is not ours."""
    return fsolve(lambda point: ((centres - point) ** 2).sum(axis=1) - lengths**2, near, xtol=1e-10)


def upward(radius, height, arm, length, endstop):
    """Angle of an arm, positive upward, with the nozzle in the middle at some height."""

    def away(angle):
        out, up = radius + arm * np.cos(angle), height + arm * np.sin(angle)
        return np.hypot(out, up - endstop) - length

    angles = np.linspace(-1.6, 1.6, 2000)
    signs = np.sign(away(angles))
    last = int(np.flatnonzero(np.diff(signs))[-1])
    return brentq(away, angles[last], angles[last + 1], xtol=1e-14)


@pytest.mark.parametrize("name", [pytest.param("delta", marks=pytest.mark.long), "linear-delta"])
def test_klipper_does_with_its_keys_what_the_converter_promises(example, name):
    made, _ = example("klipper")
    member = BY_NAME[name]
    robot = RobotFile.of(
        member.mechanism, member.perturbed.parameters, name="identified", limits=member.limits
    )
    text, left_mm = made["klipper_keys"](robot)
    poses = sample_workspace(robot, 300)
    joints = robot.kinematics.inverse(poses).values_or_raise()
    bed_mm = np.array([0.0, 0.0, poses[:, 2].min()])
    points = klipper_points(klipper_settings(text), joints, robot.limits.joint, poses - bed_mm)
    errors = fit_transform(points, poses).apply(points) - poses
    nominal = member.nominal.forward(joints, poses).values_or_raise()
    before = fit_transform(nominal, poses).apply(nominal) - poses
    assert np.linalg.norm(errors, axis=1).mean() == pytest.approx(left_mm, abs=2e-5)
    assert np.linalg.norm(errors, axis=1).mean() < 0.5 * np.linalg.norm(before, axis=1).mean()


def urdf_place(joints, link, values):
    """Place (3,) and turn of a link's frame in the base, at values by the joint's link."""
    if link == "base":
        return np.zeros(3), Rotation.identity()
    found = joints[link]
    at, turn = urdf_place(joints, found.find("parent").get("link"), values)
    xyz, rpy = ([float(w) for w in found.find("origin").get(k).split()] for k in ("xyz", "rpy"))
    here, own = at + turn.apply(xyz), turn * Rotation.from_euler("xyz", rpy)
    if found.get("type") == "fixed":
        return here, own
    axis = np.array([float(word) for word in found.find("axis").get("xyz").split()])
    value, mimic = values.get(link, 0.0), found.find("mimic")
    if mimic is not None:
        source = mimic.get("joint").removesuffix("_joint")
        value = float(mimic.get("multiplier")) * values[source]
    if found.get("type") == "revolute":
        return here, own * Rotation.from_rotvec(value * axis)
    return here + own.apply(value * axis), own


@pytest.mark.parametrize("name", ["par4-prototype", "i4r", "linear-delta"])
def test_loops_of_the_converted_tree_close_where_ours_do(example, name):
    made, _ = example("urdf")
    robot = find_robot(name).robot
    text = made["urdf"](robot)
    tree = {j.find("child").get("link"): j for j in ET.fromstring(text).iter("joint")}
    centre = robot.workspace_centre
    away = np.array([30.0, -40.0, 25.0, 0.2])[: len(centre)]
    for pose in (centre, centre + away, centre - away):
        joints = robot.kinematics.inverse(pose).values_or_raise()[0]
        axes = [*robot.mechanism.joints, *robot.mechanism.task]
        names = [f"arm{arm}" for arm in range(len(joints))] + [a.name for a in robot.mechanism.task]
        scaled = [
            value * (1.0 if axis.is_revolute else 1e-3)
            for axis, value in zip(axes, [*joints, *pose], strict=True)
        ]
        values = dict(zip(names, scaled, strict=True))
        for arm in range(len(joints)):
            elbow, _ = urdf_place(tree, f"lift{arm}", values)
            on_platform, _ = urdf_place(tree, f"plate{arm}", values)
            forearm_m = robot.parameters[f"arm{arm}.forearm_mm"] * 1e-3
            assert np.linalg.norm(on_platform - elbow) == pytest.approx(forearm_m, abs=1e-8)
    assert text.count("loop closure") == len(joints)
