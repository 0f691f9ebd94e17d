"""The Python API: names that a prompt completes, words for enums, single poses for batches."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from remembered import remembered

import pkmcal
from campaigns.errors import ConfigInvalid, OptionsInvalid, OutputExists, PlanInvalid, ShotsMissing
from campaigns.identification.options import IdentificationOptions
from campaigns.kinematics.parameters import Role
from campaigns.robots.robot import RobotFile
from campaigns.robots.robot import find_robot as find_robot_file
from pkmcal import Shots, find_robot, plan, read_shots, sample_workspace, study

identify = remembered(pkmcal.identify)


def test_every_name_is_completed_and_there():
    assert dir(pkmcal) == sorted(pkmcal.__all__)
    assert all(getattr(pkmcal, name) for name in pkmcal.__all__)
    with pytest.raises(AttributeError, match="it has PLANE, POSITION, TURN"):
        _ = pkmcal.solve


@pytest.mark.parametrize("program", ["import pkmcal", "import runpy; runpy.run_module('app')"])
def test_linear_algebra_gets_one_thread_before_numpy_unless_others_are_stated(program):
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    environment = {name: value for name, value in os.environ.items() if name not in names}
    show = f"print('numpy' in sys.modules, *(os.environ[name] for name in {names}))"
    text = f"import atexit, os, sys; atexit.register(lambda: {show}); {program}"
    for stated, shown in (({}, "False 1 1 1"), ({"OMP_NUM_THREADS": "3"}, "False 1 3 1")):
        ended = subprocess.run(
            [sys.executable, "-c", text],
            env=environment | stated,
            cwd=Path(pkmcal.__file__).parent,
            capture_output=True,
            encoding="utf-8",
        )
        assert ended.stdout.splitlines()[-1] == shown, ended.stderr


def test_a_single_pose_is_a_batch_of_one_and_others_are_refused_by_their_shape():
    kinematics = find_robot("par4-prototype").kinematics
    joints = kinematics.inverse([0.0, 0.0, -600.0, 0.0]).values_or_raise()
    assert joints.shape == (1, 4)
    with pytest.raises(ValueError, match=r"joints have shape \(3,\), must have \(N, 4\).*q0, q1"):
        kinematics.forward(joints[0, :3])
    with pytest.raises(ValueError, match=r"points have shape \(1, 2\), must have \(N, 3\)"):
        Shots.of(joints, [[0.0, 1.0]], find_robot("par4-prototype"))


@pytest.mark.parametrize("name", ["par4-prototype", "i4l"])
def test_poses_follow_encoders_by_the_joint_jacobian(name):
    """Gears' terms too; against central differences."""
    nominal = find_robot(name)
    space = nominal.mechanism.parameters
    gears = [n for n in space.select(Role.TRANSMISSION) if space[n].field.group != "compliance"]
    terms = {name: 0.02 * (1 + i) for i, name in enumerate(gears)}
    rate = 7.0 if nominal.mechanism.joints[0].is_revolute else 40.0  # a turn, or mm
    mechanism = nominal.mechanism.with_ripples(rate)
    robot = RobotFile.of(mechanism, nominal.parameters | terms, name="g", limits=nominal.limits)
    poses = sample_workspace(nominal, 4, seed=2)
    joints = robot.kinematics.inverse(poses).values_or_raise()
    slopes = robot.kinematics.joint_jacobian(joints, poses)
    for joint in range(joints.shape[1]):
        step = 1e-6 * np.eye(joints.shape[1])[joint]
        ends = [robot.kinematics.forward(joints + s * step, poses).values for s in (1.0, -1.0)]
        np.testing.assert_allclose(slopes[:, :, joint], (ends[0] - ends[1]) / 2e-6, atol=1e-4)


@pytest.fixture(scope="module")
def measured():
    robot = find_robot("delta")
    return read_shots(Path(__file__).parents[1] / "data/family/delta-noise.csv", robot), robot


def test_options_are_the_words_of_the_command_line(measured):
    shots, robot = measured
    words = {
        "shots": "0-39",
        "hold_out": "20%",
        "fix": "arm1.axis*",
        "prior": ["arm2.arm_mm=0.001"],
    }
    fewer = identify(shots, robot, options=words)
    by_mapping = {"shots": (0, 39), "hold_out": 0.2}
    again = identify(
        shots, robot, fix="arm1.axis*", priors={"arm2.arm_mm": 0.001}, options=by_mapping
    )
    assert again.value.flat() == fewer.value.flat()
    assert "arm0.axis_tilt_deg" in fewer.value.free
    assert "arm1.axis_tilt_deg" not in fewer.value.free
    assert fewer.value.std()["arm2.arm_mm"] <= 0.001
    assert max(fewer.residuals.fitted.numbers) <= 39
    assert fewer.judgement.hold_out.pairs == 4


def test_options_as_an_object_are_completed_as_words_are(measured):
    shots, robot = measured
    robot = replace(robot, tolerances={"places_mm": 2.0})
    by_words = identify(shots, robot, options={"hold_out": "20%"})
    by_object = identify(shots, robot, options=IdentificationOptions(hold_out=0.2))
    assert by_object.uncertainty.position_std_mm == by_words.uncertainty.position_std_mm is not None
    assert by_object.uncertainty.region == by_words.uncertainty.region
    assert by_object.value.flat() == by_words.value.flat()
    assert by_object.judgement.verdict == by_words.judgement.verdict
    workspace = sample_workspace(robot, 20)
    at_few = identify(shots, robot, options=IdentificationOptions(workspace=workspace))
    assert at_few.uncertainty.position_std_mm != by_words.uncertainty.position_std_mm


def test_a_result_is_a_report_and_a_table(measured):
    result = identify(*measured)
    assert (result.provenance.model, result.judgement.hold_out) == ("full", None)
    report = result.report()
    assert report.startswith(f"verdict: {result.judgement.verdict}\n")
    assert "uncertainty of positions, 1 σ, rms over the workspace, mm" in report
    table = result.to_frame()
    assert list(table.index) == list(result.value.parameters)
    assert table.loc["arm0.arm_mm", "value"] == result.value.parameters["arm0.arm_mm"].value


def test_notebooks_show_tables_whose_texts_are_escaped(measured):
    shots, robot = measured
    result = identify(shots, robot)
    judgement = replace(result.judgement, reasons=("<script>a & b",))
    text = replace(result, judgement=judgement)._repr_html_()
    assert text.startswith(f"<p>{judgement.verdict}: &lt;script&gt;a &amp; b</p><table>")
    assert text.count("<tr>") == 1 + len(result.value.free)
    assert all(f"<tr><td>{name}</td>" in text for name in result.value.free)
    made = plan(robot, (2400.0, -300.0, -600.0), shots=20, seed=3)
    assert made._repr_html_().count("<tr>") == 1 + len(made.precision.std)
    sets = ["identification"] * 2 + ["validation"] * 2
    few = Shots.of(shots.joints[:4], np.ones((4, 3)), robot, sets=sets, pairs=[None, None, 3, 3])
    assert "<p>4 shots of 3 joints</p>" in few._repr_html_()
    assert "<td>identification</td><td>2</td><td>0</td>" in few._repr_html_()
    assert "<td>validation</td><td>2</td><td>1</td>" in few._repr_html_()
    values = robot.parameters
    assert repr(values) == f"<Parameters: {len(values)} of 3 arms>"
    assert len(str(values).splitlines()) == len(values)
    assert values._repr_html_() == f"<pre>{values}</pre>"


def test_each_figure_has_its_word(measured):
    shots, robot = measured
    result = identify(shots, robot, options={"hold_out": "20%"})
    titles = {
        "errors": [""],
        "space": ["before, from above", "before, from the side", "after, from above"],
        "correlations": ["", ""],
        "gain": ["before (open) and after (filled)", "after alone"],
    }
    for kind, starts in titles.items():
        figure = result.plot(kind)
        drawn = [axes.get_title() or axes.get_title("left") for axes in figure.axes]
        assert all(map(str.startswith, drawn, starts)), kind
    pairs = result.plot("gain").axes[1].lines[1]
    assert list(pairs.get_ydata()) == list(result.residuals.unseen.after[:, 0])
    with pytest.raises(OptionsInvalid, match="'spaces' is no figure → did you mean space"):
        result.plot("spaces")
    with pytest.raises(ShotsMissing, match="no pairs were held out"):
        identify(shots, robot).plot("gain")


def test_arrows_lie_in_the_axes_of_the_base(measured):
    """The tracker is turned by 90° about z: an error along its x is one along y of the robot."""
    shots, robot = measured
    about_z = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = replace(shots, points_in_tracker_mm=shots.points_in_tracker_mm @ about_z)
    drawn = []
    for of in (shots, turned):
        arrows = identify(of, robot).plot("space").axes[0].collections[0]
        drawn.append(np.column_stack([arrows.U, arrows.V]))
    np.testing.assert_allclose(drawn[0], drawn[1], atol=0.02 * np.abs(drawn[0]).max())


def test_a_result_has_the_identified_robot_which_is_saved_and_read_back(measured, tmp_path):
    shots, robot = measured
    result = identify(shots, robot)
    saved = tmp_path / "identified.yaml"
    result.robot.save(saved)
    again = find_robot(saved)
    assert (
        again.parameters
        == result.robot.parameters
        == {name: value for name, value in result.value.flat().items() if name in again.parameters}
    )
    assert again.parameters.std == result.robot.parameters.std == result.value.std()
    assert again.provenance == {"model": "full", "verdict": result.judgement.verdict}
    poses = sample_workspace(robot, 5)
    joints = again.kinematics.inverse(poses).values_or_raise()
    assert np.array_equal(joints, result.robot.kinematics.inverse(poses).values_or_raise())
    assert "nominal" not in result.document()
    with pytest.raises(OutputExists):
        result.robot.save(saved)
    made = robot.of(robot.mechanism, robot.parameters, name="made", limits=robot.limits)
    renamed, changed = replace(robot, name="other"), replace(robot, tolerances={"arms_mm": 1})
    of_others = (replace(result, nominal=renamed), replace(result, nominal=changed))
    for kept in (each.robot for each in (identify(shots, made), *of_others)):
        assert kept.parameters["arm0.arm_mm"] != robot.parameters["arm0.arm_mm"]
        with pytest.raises(ConfigInvalid, match="made or changed in memory"):
            kept.save(tmp_path / "changed.yaml")


def test_a_data_frame_without_pandas_names_the_extra(measured, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match=r"pandas, which is not installed .*'\.\[pandas\]'"):
        measured[0].to_frame(measured[1])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"modell": "paper"}, "'modell' is not an option → did you mean model?"),
        ({"model": "complete"}, "model is 'complete' → use full or paper"),
        ({"hold_out": "much"}, "--hold-out is 'much' → give a share"),
        ({"sessions": "perhaps"}, "sessions is 'perhaps' → use True or False"),
        ({"free": 3}, "free is 3 → give a name or a list of names"),
        ({"fix": "arm9.*"}, "arm9.* is no parameter"),
    ],
)
def test_unknown_options_and_values_are_refused_with_the_known_ones(measured, options, said):
    with pytest.raises(OptionsInvalid) as caught:
        identify(*measured, options=options)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ({"shots": 3}, PlanInvalid, "shots is 3, must be even"),
        ({"shots": 2}, PlanInvalid, "2 shots to identify from place no frame"),
        ({"placement": "edge"}, OptionsInvalid, "placement is 'edge' → use boundary or optimal"),
        ({"tracker_mm": (2400.0, -300.0)}, ValueError, r"tracker_mm have shape \(2,\)"),
    ],
)
def test_a_plan_that_cannot_be_made_is_refused_with_value_and_limit(arguments, error, says):
    with pytest.raises(error, match=says):
        plan(find_robot("delta"), **{"tracker_mm": (2400.0, -300.0, -600.0), **arguments})


def test_a_study_of_a_plan_compares_errors_with_what_the_plan_states():
    robot, tracker_mm = find_robot("delta"), (2400.0, -300.0, -600.0)
    planned = plan(robot, tracker_mm, shots=30, validation_pairs=2)
    assert planned.precision.position_std_mm.max() < 0.2
    result = study(robot, planned.shots, tracker_mm, campaigns=4)
    assert result.campaigns == 4
    assert 0.3 < result.position_mm / result.stated_mm < 2.0


def test_shots_are_a_table_of_pandas_with_the_columns_of_files():
    robot = find_robot("delta")
    joints = np.radians([[10.0, 20.0, 30.0], [30.0, 10.0, 20.0]])
    shots = Shots.of(joints, np.eye(3)[:2], robot, sets="validation", pairs=[0, 0])
    table = shots.to_frame(robot)
    assert table["set"].tolist() == ["validation", "validation"]
    np.testing.assert_allclose(table[["q0_deg", "q1_deg", "q2_deg"]], np.degrees(joints))
    np.testing.assert_array_equal(table[["x_mm", "y_mm", "z_mm"]], np.eye(3)[:2])


@pytest.mark.parametrize(
    ("offers", "said"), [("OTHER", "is 'no mechanism', must be a Mechanism"), ("NONE", "NONE")]
)
def test_a_package_that_offers_no_mechanism_is_refused(tmp_path, monkeypatch, offers, said):
    (tmp_path / "own_mechanism.py").write_text('OTHER = "no mechanism"\n')
    info = tmp_path / "own_mechanism-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-mechanism\nVersion: 1.0\n")
    entry = f"[pkmcal.mechanisms]\nown-delta = own_mechanism:{offers}\n"
    (info / "entry_points.txt").write_text(entry)
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "own.yaml"
    shipped = find_robot_file("delta").document.text
    file.write_text(shipped.replace("mechanism: delta", "mechanism: own-delta"))
    with pytest.raises(ConfigInvalid, match=f"gives no mechanism .*{said}"):
        find_robot(file)
