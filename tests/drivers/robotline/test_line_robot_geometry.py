"""The controller's parameters over robotline: all of them, or none."""

from math import nan

import pytest
from robotline_layouts import TILTING_LAYOUT
from scripted_controller import connected

from drivers.errors import DeviceRefused, LinkDown, WireError

ARM = "{arm}.5 -222.5 0.0 225.0 0.25 350.0 700.0"
FLAT = {
    f"arm{arm}.{name}": value
    for arm in range(4)
    for name, value in {
        "x_mm": arm + 0.5,
        "y_mm": -222.5,
        "z_mm": 0.0,
        "azimuth_deg": 225.0,
        "joint_offset_deg": 0.25,
        "arm_mm": 350.0,
        "forearm_mm": 700.0,
    }.items()
} | {"plate_mm": 100.0}


TILTS = {"arm1.axis_tilt_deg": 0.02, "arm2.parallelogram_skew_deg": -0.01}


@pytest.fixture
def controller():
    """A controller with the parameters of `FLAT`, connected."""
    return with_parameters(connected())


def with_parameters(controller):
    for arm in range(4):
        controller.answers[f"GEOM ARM {arm}"] = f"OK ARM {arm} " + ARM.format(arm=arm)
    controller.answers["GEOM PLATE"] = "OK PLATE 100.0"
    return controller


def test_parameters_are_written_and_read_whole_although_somebody_wants_to_stop():
    wishes = []
    controller = with_parameters(connected(cancelled=lambda: bool(wishes)))
    wishes.append("stop")
    controller.robot.write_geometry(FLAT)
    assert controller.verbs[-1] == "COMMIT"
    controller.robot.reconnect()
    assert controller.robot.read_geometry() == FLAT
    assert controller.robot.identity().serial == "SN-0042"


def test_geometry_of_another_arm_than_asked_closes_the_wire(controller):
    controller.answers["GEOM ARM 1"] = "OK ARM 0 " + ARM.format(arm=0)
    with pytest.raises(WireError, match="answered for ARM 0, asked for ARM 1"):
        controller.robot.read_geometry()
    assert controller.pipes[0].is_closed


def test_geometry_is_staged_whole_with_its_extensions_before_the_commit(controller):
    controller.robot.write_geometry(FLAT)
    staged = [f"STAGE ARM {arm} " + ARM.format(arm=arm) for arm in range(4)]
    expected = [*staged, "STAGE PLATE 100.0", "COMMIT"]
    assert [question.split(" ", 1)[1] for question in controller.questions] == expected
    controller = connected(layout=TILTING_LAYOUT)
    controller.robot.write_geometry(FLAT | TILTS)
    assert [question.split(" ", 1)[1] for question in controller.questions][-4:] == [
        "STAGE PLATE 100.0",
        "STAGE arm1.axis_tilt_deg 0.02",
        "STAGE arm2.parallelogram_skew_deg -0.01",
        "COMMIT",
    ]


def test_committing_may_take_longer_than_other_questions(controller):
    controller.delays_s = {"COMMIT": 10.0}
    controller.robot.write_geometry(FLAT)
    controller.delays_s = {"STAGE": 10.0}
    with pytest.raises(LinkDown):
        controller.robot.write_geometry(FLAT)


@pytest.mark.parametrize("refusing", ["STAGE ARM 2 " + ARM.format(arm=2), "COMMIT"])
def test_refused_geometry_is_abandoned(controller, refusing):
    controller.answers[refusing] = "NO GEOMETRY forearm 2"
    with pytest.raises(DeviceRefused, match="GEOMETRY: forearm 2"):
        controller.robot.write_geometry(FLAT)
    assert controller.verbs[-1] == "ABANDON"


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"arm2.x_mm": None}, "arm2.x_mm"),
        ({"arm4.x_mm": 1.0}, "arm4.x_mm"),
        ({"plate_mm": nan}, "plate_mm"),
    ],
)
def test_geometry_that_is_not_whole_is_never_sent(controller, change, name):
    geometry = {key: value for key, value in (FLAT | change).items() if value is not None}
    with pytest.raises(DeviceRefused, match=f"'{name}'"):
        controller.robot.write_geometry(geometry)
    assert controller.questions == []


def tilting(answer):
    """A controller asked for extensions, all of which it answers with `answer` but for `TILTS`."""
    controller = with_parameters(connected(layout=TILTING_LAYOUT))
    for name in TILTING_LAYOUT.extensions:
        controller.answers[f"GEOM {name}"] = answer.format(name=name)
    return controller


def test_extensions_that_are_not_zero_are_part_of_the_geometry():
    controller = tilting("OK {name} 0.0")
    for name, value in TILTS.items():
        controller.answers[f"GEOM {name}"] = f"OK {name} {value}"
    assert controller.robot.read_geometry() == FLAT | TILTS
    assert controller.robot.lacks(tuple(TILTS)) == ()


@pytest.mark.parametrize("code", ["ARGUMENT no such word", "GEOMETRY", "VERB"])
def test_controller_without_extensions_is_asked_once_a_connection(code):
    controller = tilting(f"NO {code}")
    for _ in range(2):
        assert controller.robot.read_geometry() == FLAT
        assert controller.robot.lacks(["arm0.x_mm", *TILTS]) == tuple(TILTS)
    assert sum("tilt_deg" in question for question in controller.questions) == 1
    controller.robot.reconnect()
    controller.robot.read_geometry()
    assert sum("tilt_deg" in question for question in controller.questions) == 2


def test_another_refusal_is_not_taken_for_a_lack_of_extensions():
    with pytest.raises(DeviceRefused, match="BUSY"):
        tilting("NO BUSY").robot.read_geometry()


def test_controller_is_asked_for_each_kind_of_parameter_by_name():
    controller = tilting("NO ARGUMENT no such word")
    tilts = [name for name in TILTING_LAYOUT.extensions if name.endswith("axis_tilt_deg")]
    controller.answers |= {f"GEOM {name}": f"OK {name} 0.25" for name in tilts}
    assert controller.robot.read_geometry() == FLAT | dict.fromkeys(tilts, 0.25)
    lacking = controller.robot.lacks(["arm0.x_mm", *TILTS, "arm0.not_on_the_wire_deg"])
    assert lacking == ("arm2.parallelogram_skew_deg", "arm0.not_on_the_wire_deg")
