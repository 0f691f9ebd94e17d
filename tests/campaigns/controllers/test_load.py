"""Parameters in a controller: verified there, or the old ones back, and never a silent mixture."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import pytest
from fake_cell import ROBOT
from par4_space import SPACE, with_values

from campaigns.controllers.load import changes, differing, put_back, write_verified
from campaigns.errors import LoadNotVerified
from drivers.errors import DeviceRefused, DriverError, LinkDown

OLD = dict(ROBOT.parameters)
NEW = OLD | {"plate_mm": 101.25, "arm0.arm_mm": 350.5}
DOWN = LinkDown("no answer to COMMIT within 15 s", remedy="check the cable")
REFUSED = DeviceRefused("the robot moves", remedy="wait", code="BUSY")


@dataclass
class Controller:
    """Keeps what it is given. Each write first does the next of `on_write`."""

    held: dict[str, float] = field(default_factory=lambda: dict(OLD))
    on_write: list["Act"] = field(default_factory=list)
    read_errors: list[DriverError | None] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)

    def read_geometry(self) -> dict[str, float]:
        self.calls.append("read")
        if self.read_errors and (error := self.read_errors.pop(0)):
            raise error
        return dict(self.held)

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        return tuple(names)

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        self.calls.append("write")
        act = self.on_write.pop(0) if self.on_write else take
        act(self, geometry)

    def reconnect(self) -> None:
        self.calls.append("reconnect")


Act = Callable[[Controller, Mapping[str, float]], None]


def take(controller: Controller, geometry: Mapping[str, float]) -> None:
    controller.held = dict(geometry)


def ignore(controller: Controller, geometry: Mapping[str, float]) -> None:
    pass


def take_half(controller: Controller, geometry: Mapping[str, float]) -> None:
    controller.held |= {name: geometry[name] for name in SPACE.names[:14]}


def refuse(controller: Controller, geometry: Mapping[str, float]) -> None:
    raise REFUSED


def take_and_break(controller: Controller, geometry: Mapping[str, float]) -> None:
    controller.held = dict(geometry)
    raise DOWN


def take_half_and_break(controller: Controller, geometry: Mapping[str, float]) -> None:
    take_half(controller, geometry)
    raise DOWN


def break_before(controller: Controller, geometry: Mapping[str, float]) -> None:
    raise DOWN


def take_rounded(controller: Controller, geometry: Mapping[str, float]) -> None:
    controller.held = {name: value * (1 + 1e-12) for name, value in geometry.items()}


def failure(controller: Controller) -> LoadNotVerified:
    with pytest.raises(LoadNotVerified) as caught:
        write_verified(controller, NEW, OLD)
    return caught.value


def test_extensions_count_where_they_are_or_were() -> None:
    tilt = {"arm1.axis_tilt_deg": 0.01}
    made = changes(OLD | tilt, with_values(ROBOT, {"arm2.axis_tilt_deg": 0.03}))
    assert [(each.name, each.old, each.new) for each in made[len(OLD) :]] == [
        ("arm1.axis_tilt_deg", 0.01, 0.0),
        ("arm2.axis_tilt_deg", 0.0, 0.03),
    ]
    assert differing(OLD | tilt, OLD) == [("arm1.axis_tilt_deg", 0.01)]
    assert [name for name, _ in differing(OLD, OLD | tilt)] == ["arm1.axis_tilt_deg"]


@pytest.mark.parametrize("act", [take, take_rounded, take_and_break])
def test_written_parameters_are_read_back_by_a_new_connection(act: Act) -> None:
    """Also in other units, and where the answer is lost of a command that took effect."""
    controller = Controller(on_write=[act])
    write_verified(controller, NEW, OLD)
    assert controller.held == pytest.approx(NEW, rel=1e-11)
    assert controller.calls == ["write", "reconnect", "read"]


def test_parameters_that_one_connection_alone_has_are_not_verified() -> None:
    controller = Controller()
    controller.reconnect = lambda: take(controller, OLD)  # until then it was kept in memory
    with pytest.raises(LoadNotVerified, match=r"arm0.arm_mm is 350\.0, not 350\.5"):
        write_verified(controller, NEW, OLD)


@pytest.mark.parametrize(
    ("act", "problem"),
    [
        (take_half, "1 of 29 parameters are not as written: plate_mm is 100.0, not 101.25; "),
        (take_half_and_break, "(no answer to COMMIT within 15 s)"),
        (break_before, "(no answer to COMMIT within 15 s)"),
    ],
)
def test_parameters_that_do_not_verify_are_taken_back(act: Act, problem: str) -> None:
    controller = Controller(on_write=[act])
    error = failure(controller)
    assert controller.held == OLD
    assert problem in error.problem
    assert error.problem.endswith("; the controller holds the old parameters")


def test_old_parameters_that_are_still_there_are_not_written_again() -> None:
    controller = Controller(on_write=[ignore])
    assert "the controller holds the old parameters" in failure(controller).problem
    assert controller.calls == ["write", "reconnect", "read", "read"]


def test_refusal_is_passed_on_for_the_controller_kept_what_it_had() -> None:
    controller = Controller(on_write=[refuse])
    with pytest.raises(DeviceRefused, match="the robot moves"):
        write_verified(controller, NEW, OLD)
    assert controller.held == OLD


def test_controller_that_cannot_be_read_any_more_is_unknown_and_loud() -> None:
    error = failure(Controller(on_write=[break_before], read_errors=[DOWN]))
    assert "what the controller holds cannot be read" in error.problem
    assert error.remedy.startswith("don't move the robot")


@pytest.mark.parametrize("restoring", [refuse, ignore])
def test_old_parameters_that_do_not_come_back_are_loud(restoring: Act) -> None:
    error = failure(Controller(on_write=[take_half, restoring]))
    assert "the old parameters are not back either" in error.problem
    assert error.remedy.startswith("don't move the robot")


def test_a_rollback_that_does_not_verify_is_loud() -> None:
    put_back(Controller(held=dict(NEW)), OLD)
    with pytest.raises(LoadNotVerified) as raised:
        put_back(Controller(held=dict(NEW), on_write=[take_half, take_half]), OLD)
    assert raised.value.remedy.startswith("don't move the robot")


@pytest.mark.parametrize(
    ("held", "differs"),
    [(100.0 + 1e-8, False), (100.0 + 1e-6, True), (float("nan"), True), (None, True)],
)
def test_difference_is_what_exceeds_the_rounding_of_other_units_or_is_no_number(
    held: float | None, differs: bool
) -> None:
    others = {name: value for name, value in OLD.items() if name != "plate_mm"}
    wrong = differing(others if held is None else others | {"plate_mm": held}, OLD)
    assert [name for name, _ in wrong] == (["plate_mm"] if differs else [])
