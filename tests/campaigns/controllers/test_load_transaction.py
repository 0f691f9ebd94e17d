"""A load is a transaction: refused, found again after a death, verified, and rolled back."""

from collections.abc import Collection, Mapping
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from fake_cell import FakeRobot, FakeTracker
from held_parameters import OLD, Controller, PowerCut
from paper_campaign import ERRORS, NOISE_MM, NOMINAL, PaperCampaign, planned
from par4_space import par4
from virtual_time import StopWish, VirtualClock

from campaigns import errors
from campaigns.campaign import Campaign
from campaigns.controllers.load_journal import load_history
from campaigns.controllers.objections import ObjectionName
from campaigns.journal.records import Finding
from campaigns.measuring.work import Devices
from campaigns.options import LoadOptions
from campaigns.planning.plan_file import write_plan
from campaigns.robots.robot import compensated, read_robot
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.loading import LoadResult, LoadTerms, load
from campaigns.workflow.validation import wrong_stage
from drivers.errors import DeviceRefused, RobotStateUnknown
from drivers.values import Pose

EXPORTED = "robot-compensated.yaml"
CHANGED = (ObjectionName.CHANGED,)
"""Overrules that a set was changed by hand, and is none that the journal holds."""


@pytest.fixture
def campaign(paper: PaperCampaign) -> Campaign:
    """Everything is ready to be loaded."""
    return paper.campaign


@pytest.fixture(scope="session")
def new(exported_once: PaperCampaign) -> dict[str, float]:
    """The exported set."""
    return read_robot(exported_once.folder / EXPORTED).robot.parameters


def loaded(
    campaign: Campaign,
    controller: Controller,
    source: Path | None = None,
    *,
    force: tuple[ObjectionName, ...] = (),
    **terms: object,
) -> LoadResult:
    options = LoadOptions(file=source, force=force)
    return load(campaign, nullcontext(controller), options, LoadTerms(**terms))


def rolled_back(campaign: Campaign, controller: Controller, **terms: object) -> LoadResult:
    options = LoadOptions(rollback=True)
    return load(campaign, nullcontext(controller), options, LoadTerms(**terms))


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
        records = [entry.record for entry in journal.records_of(Finding)]
    return [(each.kind, each.body) for each in records if each.kind.startswith("load")]


def unended(campaign: Campaign) -> bool:
    with campaign.journal_reader() as journal:
        return load_history(journal)[1] is not None


# what is refused


def test_wrong_file_is_refused_with_all_reasons_and_force_keeps_them(campaign: Campaign) -> None:
    controller = Controller()
    source = changed(
        campaign, {"arm0.arm_mm": 340.0 - 0.1}, verdict="fail", controller_serial="R-2"
    )
    with pytest.raises(errors.ConfigInvalid, match=r"'fail'.*arm0.arm_mm changed by -10.1 mm"):
        loaded(campaign, controller, source)
    assert (controller.held, controller.writes, findings(campaign)) == (OLD, 0, [])
    told: list[str] = []
    most = (*CHANGED, ObjectionName.VERDICT, ObjectionName.FAR)
    with pytest.raises(errors.ConfigInvalid, match=r"R-2, connected is R-1 .*`--force serial`"):
        loaded(campaign, controller, source, force=most)
    assert (controller.held, controller.writes, findings(campaign)) == (OLD, 0, [])
    every = (*most, ObjectionName.SERIAL)
    assert loaded(campaign, controller, source, force=every, tell=told.append).outcome == "loaded"
    (_, begun), (kind, body) = findings(campaign)
    assert (kind, len(body["forced"])) == ("load", 4)
    assert (
        "serial: it is for the controller of serial number R-2, connected is R-1"
        in body["forced"][-1]
    )
    assert body["forced"] == begun["forced"]
    assert [text.removeprefix("overruled by --force: ") for text in told] == body["forced"]


def test_far_parameters_of_a_controller_are_not_kept_as_the_old_ones(campaign: Campaign) -> None:
    controller = Controller(OLD | {"plate_mm": 0.1})
    with pytest.raises(errors.ConfigInvalid, match=r"holds is far from nominal: plate_mm changed"):
        loaded(campaign, controller)
    assert controller.writes == 0
    assert not list(campaign.folder.glob("controller-before-*"))


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
    campaign: Campaign, new, death: str, holds: str, ends: str | None
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
    assert told[1:] == told[:1]
    assert controller.held == new
    assert again.outcome == ("already" if ends == "load" else "loaded")
    kinds = [kind for kind, _ in findings(campaign)]
    assert kinds[:2] == ["load begun", ends or "load begun"]
    assert not unended(campaign)


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


# rolled back


def test_rollback_walks_back_through_the_loads_that_took_effect(campaign: Campaign, new) -> None:
    controller, told = Controller(), []
    loaded(campaign, controller)
    second = changed(campaign, {"plate_mm": 101.0})
    loaded(campaign, controller, second, force=CHANGED)
    controller.next_write = "refuse"
    with pytest.raises(DeviceRefused):  # keeps a file, and takes no effect
        loaded(campaign, controller, changed(campaign, {"plate_mm": 102.0}), force=CHANGED)
    rolled_back(campaign, controller, tell=told.append)
    assert controller.held == new
    assert "puts back controller-before-2.yaml: " in told[0]
    rolled_back(campaign, controller, tell=told.append)
    assert controller.held == OLD
    with pytest.raises(errors.ShotsMissing, match="no load is in effect"):
        rolled_back(campaign, controller)
    loaded(campaign, controller)
    rolled_back(campaign, controller)
    assert controller.held == OLD, "a load after a rollback is rolled back by itself"


def test_what_others_put_back_is_said_and_the_load_before_comes_next(
    campaign: Campaign, new
) -> None:
    controller, told = Controller(), []
    loaded(campaign, controller)
    loaded(campaign, controller, changed(campaign, {"plate_mm": 101.0}), force=CHANGED)
    controller.held = new
    assert rolled_back(campaign, controller, tell=told.append).outcome == "already"
    assert "was put back already by other means" in told[0]
    assert rolled_back(campaign, controller).outcome == "loaded"
    assert controller.held == OLD


def test_rollback_of_another_controllers_load_is_refused(campaign: Campaign, new) -> None:
    loaded(campaign, Controller())
    other = Controller(new, serial="R-7")
    with pytest.raises(errors.ConfigInvalid, match="serial number R-1, connected is R-7"):
        rolled_back(campaign, other)
    assert other.writes == 0


# the right stage


def test_a_stage_is_wrong_while_the_other_ones_parameters_are_loaded(
    campaign: Campaign, new
) -> None:
    """Rounding of a controller's own units makes no other set; what is neither is no before."""
    rounded = {name: value * (1.0 + 1e-12) for name, value in new.items()}
    neither = OLD | {"plate_mm": 100.3}
    for held, stage, problem in (
        (OLD, "before", None),
        (OLD, "after", "still holds the nominal parameters"),
        (rounded, "before", "holds what was identified in this campaign"),
        (rounded, "after", None),
        (neither, "before", "holds neither nominal nor identified parameters"),
        (neither, "after", None),
    ):
        wrong = wrong_stage(campaign, held, stage)
        assert (wrong is None) == (problem is None), (stage, problem)
        assert wrong is None or problem in wrong.problem


# verified by pairs


class WholeRobot(FakeRobot):
    """Robot whose controller takes every parameter."""

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        return ()


@pytest.fixture
def cell() -> Devices:
    """A cell in virtual time whose true robot has the errors that were identified."""
    clock, calls = VirtualClock(), []
    robot = WholeRobot(clock, calls)
    true = {name: value + ERRORS.get(name, 0.0) for name, value in OLD.items()}
    return Devices(robot, FakeTracker(clock, calls, robot, truth=par4(true)), clock, clock)


def verified(
    campaign: Campaign, cell: Devices, pairs: int = 2, source: Path | None = None, **terms: object
) -> LoadResult:
    options = LoadOptions(file=source, verify=pairs, force=CHANGED if source else ())
    return load(campaign, nullcontext(cell), options, LoadTerms(**terms))


def test_pairs_that_become_better_are_kept_with_the_load(
    campaign: Campaign, cell: Devices, new
) -> None:
    verification = verified(campaign, cell).verification
    assert verification is not None
    assert verification.after_mm < 0.1 < verification.before_mm
    assert cell.robot.geometry == new
    kind, body = findings(campaign)[-1]
    recorded = {**asdict(verification), "series": [*verification.series]}
    assert (kind, body["verification"]) == ("load", recorded)
    assert cell.tracker.measured == 2 * 2 * 2


def test_pairs_that_become_worse_bring_the_old_parameters_back(
    campaign: Campaign, cell: Devices
) -> None:
    told: list[str] = []
    worse = {name: OLD[name] - error for name, error in ERRORS.items()}
    with pytest.raises(errors.VerdictBad, match=r"off by .* mm on average after .* before it was"):
        verified(campaign, cell, source=changed(campaign, worse), tell=told.append)
    assert cell.robot.geometry == OLD
    assert findings(campaign)[-1][0] == "load failed"
    assert "rolled back: the controller holds what it held before" in told[-1]
    assert not unended(campaign)
    with pytest.raises(errors.ShotsMissing):
        rolled_back(campaign, cell.robot)


@pytest.mark.parametrize("seed", range(4))
def test_equally_good_sets_are_kept_and_said_to_be_undecided(
    campaign: Campaign, cell: Devices, seed: int
) -> None:
    """A robot that scatters shows small differences of the mean error, as often worse as better."""
    scatter = np.random.default_rng(seed)
    seen_mm = cell.tracker.seen_mm
    cell.tracker.seen_mm = lambda: tuple(scatter.normal(seen_mm(), NOISE_MM).tolist())
    provenance = read_robot(campaign.path(EXPORTED)).robot.provenance
    as_good = OLD | {"plate_mm": OLD["plate_mm"] + 1e-5}
    wanted = campaign.path("as-good.yaml")
    document = compensated(NOMINAL, "as good", as_good, dict(provenance or {})).document
    wanted.write_text(document.text, encoding="utf-8")
    verification = verified(campaign, cell, 3, source=wanted).verification
    assert verification is not None
    assert verification.change == "no change shown"
    assert verification.expanded_mm > abs(verification.after_mm - verification.before_mm) > 0.0
    assert cell.robot.geometry == as_good
    kind, body = findings(campaign)[-1]
    assert (kind, body["verification"]["change"]) == ("load", "no change shown")


def test_more_pairs_than_there_are_are_refused_before_anything_moves(
    campaign: Campaign, cell: Devices
) -> None:
    with pytest.raises(errors.OptionsInvalid, match=r"--verify 5: plan.csv has 4 validation pairs"):
        verified(campaign, cell, pairs=5)
    assert cell.tracker.measured == 0
    assert cell.robot.geometry == OLD


def test_robot_stands_at_the_centre_before_writing_whence_a_safe_way_leads(
    campaign: Campaign, cell: Devices
) -> None:
    """With a plate of 92 mm the turn of 44° where the last pair ends would be 49°, beyond 45°."""
    poses = [[0.0, 0.0, -600.0, 0.0], [100.0, 0.0, -600.0, np.radians(44.0)]]
    pair = [planned(shot, ShotSet.VALIDATION, 0, np.array(row)) for shot, row in enumerate(poses)]
    write_plan(campaign.plan_path, pair, NOMINAL.robot.mechanism)
    with pytest.raises(errors.VerdictBad, match="rolled back"):
        verified(campaign, cell, 1, source=changed(campaign, {"plate_mm": 92.0}))
    assert cell.tracker.measured == 2 * 2
    assert cell.robot.geometry == OLD


def test_pair_that_cannot_be_measured_after_writing_brings_the_old_parameters_back(
    campaign: Campaign, cell: Devices
) -> None:
    robot, shots = cell.robot, campaign.read_plan()
    second = [shot.pose for shot in shots if shot.purpose is ShotSet.VALIDATION][2]
    move_pose = robot.move_pose

    def refuse_second_pair(pose: Pose, speed_fraction: float) -> None:
        if pose.x_mm == second.x_mm and robot.geometry != OLD:
            raise errors.TargetOutOfReach("no way there", remedy="none")
        move_pose(pose, speed_fraction)

    robot.move_pose = refuse_second_pair
    with pytest.raises(errors.LoadNotVerified, match=r"^1 of 2 pairs measured.*no way there"):
        verified(campaign, cell, 2)
    assert robot.geometry == OLD
    assert [kind for kind, _ in findings(campaign)] == ["load begun", "load failed"]
    assert findings(campaign)[-1][1]["reason"].startswith("not verified: 1 of 2 pairs")


@pytest.mark.parametrize(
    ("move", "holds", "journal"),
    [
        (1, "nothing was written: the controller holds the old parameters", []),
        (6, "nothing was put back: the controller holds the new parameters", ["load begun"]),
    ],
    ids=["before", "after"],
)
def test_robot_that_cannot_be_stopped_is_written_nothing(
    campaign: Campaign, cell: Devices, new, move: int, holds: str, journal: list[str]
) -> None:
    robot, is_after = cell.robot, bool(journal)
    robot.stop_errors = 2 * [RobotStateUnknown("it still moves", remedy="use the hardware stop")]

    def run_away() -> None:
        robot.keeps_moving, robot.fault = True, "FOLLOWING"

    robot.during_move[move] = run_away
    with pytest.raises(RobotStateUnknown, match=r"^PRESS THE EMERGENCY STOP: ") as loud:
        verified(campaign, cell)
    assert holds in loud.value.problem
    assert robot.geometry == (new if is_after else OLD)
    assert ("--rollback" in loud.value.remedy) is is_after
    assert [kind for kind, _ in findings(campaign)] == journal
    if is_after:
        rolled_back(campaign, Controller(dict(robot.geometry)))
        assert findings(campaign)[-1][0] == "load"


@pytest.mark.parametrize(("move", "kinds"), [(1, []), (6, ["load begun", "load failed"])])
def test_operators_stop_says_that_the_old_parameters_are_in(
    campaign: Campaign, cell: Devices, move: int, kinds: list[str]
) -> None:
    wish = StopWish(cell.clock)
    cell.robot.during_move[move] = wish.ask
    with pytest.raises(errors.Interrupted, match="the controller holds the old parameters"):
        verified(campaign, cell, stop_requested=wish)
    assert cell.robot.geometry == OLD
    assert [kind for kind, _ in findings(campaign)] == kinds
