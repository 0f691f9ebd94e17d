"""A load is a transaction: refused with its reason, found again after a death, and walked back."""

import shutil
from collections.abc import Collection, Mapping
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pytest
from fake_cell import FakeRobot, FakeTracker
from held_parameters import OLD, Controller, PowerCut
from paper_campaign import ERRORS, NOMINAL, new_campaign, planned
from par4_space import par4
from virtual_time import StopWish, VirtualClock

from campaigns import errors
from campaigns.campaign import Campaign, open_campaign
from campaigns.controllers.load_journal import load_history
from campaigns.journal.records import Finding
from campaigns.measuring.work import Cell
from campaigns.options import LoadOptions
from campaigns.planning.plan_file import write_plan
from campaigns.robots.robot import compensated, find_robot, read_robot
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.exporting import export
from campaigns.workflow.loading import LoadResult, LoadTerms, load
from campaigns.workflow.validation import wrong_stage
from drivers.errors import DeviceRefused, RobotStateUnknown
from drivers.values import Pose

EXPORTED = "robot-compensated.yaml"


@pytest.fixture(scope="session")
def exported_once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    paper = new_campaign(tmp_path_factory.mktemp("loading") / "paper")
    paper.run(pairs=40, unseen=4)
    paper.identify()
    export(paper.campaign)
    return paper.folder


@pytest.fixture
def campaign(exported_once: Path, tmp_path: Path) -> Campaign:
    """Everything is ready to be loaded."""
    return open_campaign(shutil.copytree(exported_once, tmp_path / "paper"))


def loaded(
    campaign: Campaign,
    controller: Controller,
    source: Path | None = None,
    *,
    force: bool = False,
    **terms: object,
) -> LoadResult:
    options = LoadOptions(file=source, force=force)
    return load(campaign, nullcontext(controller), options, LoadTerms(**terms))


def rolled_back(campaign: Campaign, controller: Controller, **terms: object) -> LoadResult:
    options = LoadOptions(rollback=True)
    return load(campaign, nullcontext(controller), options, LoadTerms(**terms))


def new_set(campaign: Campaign) -> dict[str, float]:
    return read_robot(campaign.path(EXPORTED)).robot.parameters


def changed(
    of: Campaign, values: Mapping[str, float] | None = None, /, **provenance: object
) -> Path:
    """The exported file with other values and another provenance."""
    robot = read_robot(of.path(EXPORTED)).robot
    stated = {**(robot.provenance or {}), **provenance}
    path = of.path(f"changed-{len(list(of.folder.glob('changed-*')))}.yaml")
    geometry = robot.parameters | dict(values or {})
    document = compensated(NOMINAL, "changed", geometry, stated)
    path.write_text(document.document.text, encoding="utf-8")
    return path


def findings(campaign: Campaign) -> list[tuple[str, Mapping[str, object]]]:
    with campaign.journal_reader() as journal:
        found = [entry.record for entry in journal.records_of(Finding)]
    return [(each.kind, each.body) for each in found if each.kind.startswith("load")]


def unended(campaign: Campaign) -> bool:
    with campaign.journal_reader() as journal:
        return load_history(journal)[1] is not None


# what is refused


def another_robots_file(campaign: Campaign) -> Path:
    path = campaign.path("table1.yaml")
    path.write_text(find_robot("par4-table1").document.text, encoding="utf-8")
    return path


REFUSED = {
    "another robot's file": (another_robots_file, "does not say where its parameters come from"),
    "another nominal robot": (
        lambda campaign: changed(campaign, nominal_digest="0" * 64, nominal_robot="line-9"),
        r"rests on another nominal robot \(line-9, sha256 0000",
    ),
    "another campaign's file": (
        lambda campaign: changed(campaign, campaign="press 4"),
        "is of the campaign 'press 4', this one is 'paper'",
    ),
    "verdict fail": (
        lambda campaign: changed(campaign, verdict="fail"),
        "verdict is 'fail', must be 'pass'",
    ),
    "an arm of 520 mm": (
        lambda campaign: changed(campaign, {"arm2.arm_mm": 520.0}),
        r"arm2\.arm_mm changed by \+170 mm, tolerance ± 10 mm",
    ),
    "an offset of 45°": (
        lambda campaign: changed(campaign, {"arm1.joint_offset_deg": 45.0}),
        r"arm1\.joint_offset_deg changed by \+45°, tolerance ± 5°",
    ),
    "a foreign serial": (
        lambda campaign: changed(campaign, controller_serial="R-2"),
        "for the controller of serial number R-2, connected is R-1",
    ),
}


def test_wrong_file_is_refused_with_its_reason(campaign: Campaign) -> None:
    controller = Controller()
    for make, reason in REFUSED.values():
        source = make(campaign)
        with pytest.raises(errors.ConfigInvalid, match=reason) as refused:
            loaded(campaign, controller, source)
        assert str(refused.value).startswith(f"{source}: not loaded: ")
        assert "--force" in refused.value.remedy
        assert "\n" not in str(refused.value)
    assert (controller.held, controller.writes, findings(campaign)) == (OLD, 0, [])


def test_set_that_was_not_exported_is_missed_with_the_command_that_writes_it(campaign: Campaign):
    campaign.path(EXPORTED).unlink()
    with pytest.raises(errors.ConfigInvalid, match="there is no such file") as missed:
        loaded(campaign, Controller())
    assert missed.value.remedy.startswith("`pkmcal export ")


def test_robots_own_tolerance_counts(campaign: Campaign) -> None:
    path = campaign.path("robot.yaml")
    stated = path.read_text("utf-8") + "tolerance: {length_mm: 0.5, angle_deg: 5.0}\n"
    path.write_text(stated, encoding="utf-8")
    with pytest.raises(
        errors.ConfigInvalid, match=r"arm0\.arm_mm changed by .*, tolerance ± 0\.5 mm"
    ):
        loaded(open_campaign(campaign.folder), Controller())


def test_every_objection_is_told_at_once_and_kept_where_it_is_overruled(campaign: Campaign) -> None:
    source = changed(campaign, {"arm0.arm_mm": 340.0 - 0.1}, verdict="fail", campaign="press 4")
    with pytest.raises(errors.ConfigInvalid) as refused:
        loaded(campaign, Controller(), source)
    for word in ("press 4", "'fail'", r"arm0.arm_mm changed by -10.1 mm"):
        assert word in refused.value.problem
    assert loaded(campaign, Controller(), source, force=True).outcome == "loaded"
    (_, begun), (kind, body) = findings(campaign)
    assert (kind, len(body["forced"])) == ("load", 3)
    assert body["forced"] == begun["forced"]


def test_only_the_nominal_set_may_be_loaded_without_a_word_and_no_other_mechanisms(
    campaign: Campaign,
) -> None:
    controller = Controller(new_set(campaign))
    assert loaded(campaign, controller, campaign.path("robot.yaml")).outcome == "loaded"
    assert controller.held == OLD
    path = campaign.path("delta.yaml")
    path.write_text(find_robot("delta").document.text, encoding="utf-8")
    with pytest.raises(
        errors.ConfigInvalid, match="it is of a delta, this campaign's robot is a par4"
    ):
        loaded(campaign, Controller(), path, force=True)


@pytest.mark.parametrize("serial", [None, ""])
def test_unknown_serial_objects_to_no_controller(campaign: Campaign, serial: str | None) -> None:
    source = changed(campaign, controller_serial=serial)
    assert loaded(campaign, Controller(serial="R-7"), source).outcome == "loaded"


# found again


@pytest.mark.parametrize(
    ("death", "holds", "ends"),
    [
        ("die", "the controller holds the old parameters now", "load failed"),
        ("take, die", "the controller holds the new parameters now", "load"),
        ("take half, die", "holds neither the old nor the new parameters now", None),
    ],
)
def test_load_that_died_is_found_again(
    campaign: Campaign, death: str, holds: str, ends: str | None
) -> None:
    controller, told = Controller(next_write=death), []
    with pytest.raises(PowerCut):
        loaded(campaign, controller)
    assert unended(campaign)
    loaded(campaign, controller, dry=True, tell=told.append)
    assert unended(campaign), "--dry writes nothing"
    assert f"a load of {EXPORTED} was begun at" in told[0]
    assert holds in told[0]
    again = loaded(campaign, controller, tell=told.append)
    assert told[1] == told[0]
    assert controller.held == new_set(campaign)
    assert again.outcome == ("already" if ends == "load" else "loaded")
    kinds = [kind for kind, _ in findings(campaign)]
    assert kinds[:2] == ["load begun", ends or "load begun"]
    assert not unended(campaign)
    assert loaded(campaign, controller, tell=told.append).outcome == "already"
    assert len(told) == 2, "once it has its end, nothing is told any more"


@pytest.mark.parametrize("death", ["take, die", "take half, die"])
def test_load_that_died_can_be_rolled_back(campaign: Campaign, death: str) -> None:
    controller = Controller(next_write=death)
    with pytest.raises(PowerCut):
        loaded(campaign, controller)
    rolled_back(campaign, controller)
    assert controller.held == OLD
    with pytest.raises(errors.ShotsMissing):
        rolled_back(campaign, controller)


def test_validation_ends_a_load_that_died_and_refuses_a_mixture(campaign: Campaign) -> None:
    controller, told = Controller(next_write="take, die"), []
    with pytest.raises(PowerCut):
        loaded(campaign, controller)
    assert wrong_stage(campaign, controller.held, "after", told.append) is None
    assert "holds the new parameters" in told[0]
    assert not unended(campaign)
    controller.next_write = "take half, die"
    with pytest.raises(PowerCut):
        rolled_back(campaign, controller)
    for stage in ("before", "after"):
        wrong = wrong_stage(campaign, controller.held, stage)
        assert wrong is not None
        assert "neither the old nor the new" in wrong.problem
    rolled_back(campaign, controller)
    assert controller.held == OLD


@pytest.mark.parametrize("act", ["refuse", "ignore"])
def test_load_that_fails_is_ended_as_failed(campaign: Campaign, act: str) -> None:
    controller = Controller(next_write=act)
    with pytest.raises((DeviceRefused, errors.LoadNotVerified)):
        loaded(campaign, controller)
    kind, body = findings(campaign)[-1]
    assert kind == "load failed"
    assert body["reason"]
    assert not unended(campaign)


# walked back


def test_rollback_walks_back_through_the_loads_that_took_effect(campaign: Campaign) -> None:
    controller, told = Controller(), []
    loaded(campaign, controller)
    second = changed(campaign, {"plate_mm": 101.0})
    loaded(campaign, controller, second)
    controller.next_write = "refuse"
    with pytest.raises(DeviceRefused):  # keeps a file, and takes no effect
        loaded(campaign, controller, changed(campaign, {"plate_mm": 102.0}))
    rolled_back(campaign, controller, tell=told.append)
    assert controller.held == new_set(campaign)
    assert (
        f"puts back controller-before-2.yaml: what the controller held before the load of "
        f"{second.name}" in told[0]
    )
    rolled_back(campaign, controller, tell=told.append)
    assert controller.held == OLD
    assert EXPORTED in told[1]
    with pytest.raises(errors.ShotsMissing, match="no load is in effect"):
        rolled_back(campaign, controller)
    assert controller.held == OLD


def test_load_after_a_rollback_is_rolled_back_by_itself(campaign: Campaign) -> None:
    controller = Controller()
    for _ in range(2):
        loaded(campaign, controller)
        rolled_back(campaign, controller)
        assert controller.held == OLD


def test_what_others_put_back_is_said_and_the_load_before_comes_next(campaign: Campaign) -> None:
    controller, told = Controller(), []
    loaded(campaign, controller)
    loaded(campaign, controller, changed(campaign, {"plate_mm": 101.0}))
    controller.held = new_set(campaign)
    assert rolled_back(campaign, controller, tell=told.append).outcome == "already"
    assert "was put back already by other means" in told[0]
    assert rolled_back(campaign, controller).outcome == "loaded"
    assert controller.held == OLD


def test_rollback_of_another_controllers_load_is_refused(campaign: Campaign) -> None:
    loaded(campaign, Controller())
    other = Controller(new_set(campaign), serial="R-7")
    with pytest.raises(errors.ConfigInvalid, match="serial number R-1, connected is R-7"):
        rolled_back(campaign, other)
    assert other.writes == 0


def test_false_parameters_of_a_controller_are_not_kept_as_the_old_ones_without_a_yes(
    campaign: Campaign,
) -> None:
    controller = Controller(OLD | {"plate_mm": 0.1})
    held = dict(controller.held)
    with pytest.raises(
        errors.ConfigInvalid,
        match=r"controller holds is far from nominal: plate_mm changed by -99\.9 mm",
    ) as no:
        loaded(campaign, controller)
    assert "--force" in no.value.remedy
    assert (controller.held, controller.writes) == (held, 0)
    assert not list(campaign.folder.glob("controller-before-*"))
    told: list[str] = []
    assert loaded(campaign, controller, force=True, tell=told.append).outcome == "loaded"
    assert any(
        "overruled by --force: what the controller holds is far from nominal: plate_mm" in text
        for text in told
    )


# verified by pairs


class WholeRobot(FakeRobot):
    """Robot whose controller takes every parameter."""

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        return ()


@dataclass
class CellOf:
    """A cell in virtual time whose true robot has the errors that were identified."""

    robot: FakeRobot
    tracker: FakeTracker
    cell: Cell


@pytest.fixture
def cell() -> CellOf:
    clock, calls = VirtualClock(), []
    robot = WholeRobot(clock, calls)
    true = {name: value + ERRORS.get(name, 0.0) for name, value in OLD.items()}
    tracker = FakeTracker(clock, calls, robot, truth=par4(true))
    return CellOf(robot, tracker, Cell(robot, tracker, clock, clock))


def verified(
    campaign: Campaign, cell: CellOf, pairs: int = 3, source: Path | None = None, **terms: object
) -> LoadResult:
    options = LoadOptions(file=source, verify=pairs)
    return load(campaign, nullcontext(cell.cell), options, LoadTerms(**terms))


def test_pairs_that_become_better_are_kept_with_the_load(campaign: Campaign, cell: CellOf) -> None:
    found = verified(campaign, cell)
    assert found.verification is not None
    assert found.verification.after_mm < 0.1 < found.verification.before_mm
    assert cell.robot.geometry == new_set(campaign)
    kind, body = findings(campaign)[-1]
    told = {**asdict(found.verification), "series": [*found.verification.series]}
    assert (kind, body["verification"]) == ("load", told)
    assert cell.tracker.measured == 2 * 2 * 3
    with campaign.journal_reader() as journal:
        stages = [series.started.stage for series in journal.series()]
    assert stages == ["run", "verify before", "verify after"]


def test_pairs_that_become_worse_bring_the_old_parameters_back(
    campaign: Campaign, cell: CellOf
) -> None:
    told: list[str] = []
    worse = {name: OLD[name] - error for name, error in ERRORS.items()}
    with pytest.raises(errors.VerdictBad, match=r"off by .* mm on average after .* before it was"):
        verified(campaign, cell, source=changed(campaign, worse), tell=told.append)
    assert cell.robot.geometry == OLD
    assert findings(campaign)[-1][0] == "load failed"
    assert told == [
        "rolled back: the controller holds what it held before (controller-before-1.yaml)"
    ]
    assert not unended(campaign)
    with pytest.raises(errors.ShotsMissing):
        rolled_back(campaign, cell.robot)


def test_pairs_that_cannot_be_measured_bring_the_old_parameters_back(
    campaign: Campaign, cell: CellOf
) -> None:
    def lose(error: BaseException) -> None:
        cell.tracker.during_measure[7] = lambda: _raise(error)

    lose(errors.GateRefused("too far", remedy="look"))
    with pytest.raises(errors.GateRefused):
        verified(campaign, cell)
    assert cell.robot.geometry == OLD
    kind, body = findings(campaign)[-1]
    assert (kind, body["reason"]) == ("load failed", "not verified: too far")


def test_more_pairs_than_there_are_are_refused_before_anything_moves(
    campaign: Campaign, cell: CellOf
) -> None:
    with pytest.raises(errors.OptionsInvalid, match=r"--verify 5: plan.csv has 4 validation pairs"):
        verified(campaign, cell, pairs=5)
    assert cell.tracker.measured == 0
    assert cell.robot.geometry == OLD


def test_robot_stands_at_the_centre_before_writing_whence_a_safe_way_leads(
    campaign: Campaign, cell: CellOf
) -> None:
    """With a plate of 92 mm the turn of 44° where the last pair ends would be 49°, beyond 45°."""
    poses = [[0.0, 0.0, -600.0, 0.0], [100.0, 0.0, -600.0, np.radians(44.0)]]
    pair = [planned(shot, ShotSet.VALIDATION, 0, np.array(row)) for shot, row in enumerate(poses)]
    write_plan(campaign.plan_path, pair, NOMINAL.robot.mechanism)
    with pytest.raises(errors.VerdictBad, match="rolled back"):
        verified(campaign, cell, 1, source=changed(campaign, {"plate_mm": 92.0}))
    assert cell.tracker.measured == 2 * 2
    assert cell.robot.geometry == OLD


@pytest.mark.parametrize("stage", ["before", "after"])
def test_pairs_that_were_skipped_are_not_verified(
    campaign: Campaign, cell: CellOf, stage: str
) -> None:
    robot, shots = cell.robot, campaign.read_plan()
    second = [shot.pose for shot in shots if shot.purpose is ShotSet.VALIDATION][2]
    move_pose = robot.move_pose

    def refuse_second_pair(pose: Pose, speed_fraction: float) -> None:
        if pose.x_mm == second.x_mm and (robot.geometry == OLD) == (stage == "before"):
            raise errors.TargetOutOfReach("no way there", remedy="none")
        move_pose(pose, speed_fraction)

    robot.move_pose = refuse_second_pair
    with pytest.raises(
        errors.LoadNotVerified, match=r"^1 of 2 pairs measured: the load is not verified"
    ) as lost:
        verified(campaign, cell, 2)
    assert "no way there" in lost.value.problem
    assert ("nothing was written" in lost.value.problem) == (stage == "before")
    assert robot.geometry == OLD
    kinds = [kind for kind, _ in findings(campaign)]
    assert kinds == ([] if stage == "before" else ["load begun", "load failed"])
    assert not unended(campaign)


def _raise(error: BaseException) -> None:
    raise error


# the right stage


def test_a_stage_is_wrong_while_the_other_ones_parameters_are_loaded(campaign: Campaign) -> None:
    """Rounding of a controller's own units makes no other set; what is neither is no before."""
    new = new_set(campaign)
    rounded = {name: value * (1.0 + 1e-12) for name, value in new.items()}
    for held in (new, rounded):
        wrong = wrong_stage(campaign, held, "before")
        assert wrong is not None
        assert "holds what was identified in this campaign" in wrong.problem
        assert "--rollback" in wrong.remedy
        assert wrong_stage(campaign, held, "after") is None
    wrong = wrong_stage(campaign, OLD, "after")
    assert wrong is not None
    assert "still holds the nominal parameters" in wrong.problem
    assert wrong_stage(campaign, OLD, "before") is None
    neither = OLD | {"plate_mm": 100.3}
    assert wrong_stage(campaign, neither, "after") is None
    wrong = wrong_stage(campaign, neither, "before")
    assert wrong is not None
    assert "holds neither nominal nor identified parameters" in wrong.problem
    assert f"`pkmcal load {campaign.folder} --robot {campaign.path('robot.yaml')}`" in wrong.remedy


@pytest.mark.parametrize(
    ("move", "holds", "journal"),
    [
        (1, "nothing was written: the controller holds the old parameters", []),
        (8, "nothing was put back: the controller holds the new parameters", ["load begun"]),
    ],
    ids=["before", "after"],
)
def test_robot_that_cannot_be_stopped_is_written_nothing(
    campaign: Campaign, cell: CellOf, move: int, holds: str, journal: list[str]
) -> None:
    robot = cell.robot
    robot.stop_errors = 2 * [RobotStateUnknown("it still moves", remedy="use the hardware stop")]

    def run_away() -> None:
        robot.keeps_moving, robot.fault = True, "FOLLOWING"

    robot.during_move[move] = run_away
    with pytest.raises(RobotStateUnknown, match=r"^PRESS THE EMERGENCY STOP: ") as loud:
        verified(campaign, cell)
    assert holds in loud.value.problem
    assert robot.geometry == (OLD if move == 1 else new_set(campaign))
    assert ("--rollback" in loud.value.remedy) is (move == 8)
    assert [kind for kind, _ in findings(campaign)] == journal
    if move == 8:
        rolled_back(campaign, Controller(dict(robot.geometry)))
        assert findings(campaign)[-1][0] == "load"


@pytest.mark.parametrize(("move", "kinds"), [(1, []), (8, ["load begun", "load failed"])])
def test_operators_stop_says_that_the_old_parameters_are_in(
    campaign: Campaign, cell: CellOf, move: int, kinds: list[str]
) -> None:
    wish = StopWish(cell.cell.clock)
    cell.robot.during_move[move] = wish.ask
    with pytest.raises(errors.Interrupted, match="the controller holds the old parameters"):
        verified(campaign, cell, stop_requested=wish)
    assert cell.robot.geometry == OLD
    assert [kind for kind, _ in findings(campaign)] == kinds
