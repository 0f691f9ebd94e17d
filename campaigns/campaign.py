"""Campaign: a folder with settings, nominal robot, plan and journal, and what follows from them."""

# A campaign's folder holds everything. Three of its files may be edited by people: campaign.yaml
# (settings), the nominal robot file, and plan.csv. Everything that was measured, identified or
# loaded is in campaign.db, the journal, which only grows.
#
# `Campaign` is a small immutable value: the folder's path with the two files that do not change
# during a command, settings and nominal robot, checked when they are read. Plan and journal are
# read again at each use, because other processes write them. The properties translate settings into
# what each part of the work needs: the tracker's view, the restricted space, the pace, limits.
#
# Who changes the campaign holds its lock (`held`, `journal`); readers (`journal_reader`) need
# none, so that status and report work while a run measures. Two journals are refused: that of
# another campaign, whenever it is opened, and, by `open_campaign`, one that lacks records of a
# rescued copy.

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.design.pose_sampling import FeasibleRegion, sample_workspace
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.errors import ConfigInvalid, JournalFailed, ShotsMissing
from campaigns.files.lock import campaign_lock
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.journal import Journal, JournalReader, open_journal, read_journal
from campaigns.journal.journal_files import rescued_copies, take_rescued
from campaigns.journal.records import SeriesStarted
from campaigns.journal.views import AcceptedShot, Series
from campaigns.kinematics.feasibility import platform_radius_mm
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_check import CheckedPlan, Pace, PlanLimits, check_plan
from campaigns.planning.plan_file import PlannedShot, read_plan
from campaigns.planning.plans import PlanRequest, View, region_of, restricted_space
from campaigns.robots.robot import RobotDocument, RobotFile, pose_of, read_robot
from campaigns.settings.config import CampaignConfig, read_campaign
from campaigns.settings.instrument import StatedInstrument
from campaigns.settings.sections import BY_HAND, FILE, OFFLINE, SIMULATED
from drivers.system import HAS_POSIX
from drivers.values import vector

if TYPE_CHECKING:  # most commands read no result: all of the fit would be loaded for them
    from campaigns.identification.result import RecordedIdentification

JournalT = TypeVar("JournalT", bound=JournalReader)

PLAN = "plan.csv"
JOURNAL = "campaign.db"
FULL_JOINT_SPEED_RAD_S = float(np.radians(180.0))
"""Speed of a fast parallel robot's joints at 100 %, only for estimates of time."""


def now_utc() -> str:
    """Return the present time in UTC, ISO 8601 with milliseconds, for records."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


HAND_S = 30.0
"""Time for a shot that somebody takes by hand, s."""


@dataclass(frozen=True, slots=True)
class CampaignFolder:
    """Campaign's folder with its settings: what can be read without the robot's file.

    A robot file may name a program, which need not run to read the journal.

    Attributes:
        folder: The campaign's folder.
        config: Settings of campaign.yaml.
    """

    folder: Path
    config: CampaignConfig

    @property
    def plan_path(self) -> Path:
        """Path of plan.csv."""
        return self.folder / PLAN

    @property
    def journal_path(self) -> Path:
        """Path of the journal, campaign.db."""
        return self.folder / JOURNAL

    @property
    def is_simulated(self) -> bool:
        """Whether both devices are simulated."""
        urls = (self.config.controller.url, self.config.tracker.url)
        return all(url.startswith(SIMULATED) for url in urls)

    @property
    def is_by_hand(self) -> bool:
        """Whether a person works a device by hand, and is asked at each shot."""
        return BY_HAND in (self.config.controller.url, self.config.tracker.url)

    @property
    def watched_file(self) -> Path | None:
        """Path of the file into which the tracker's software writes; None for other trackers."""
        url = self.config.tracker.url
        return (self.folder / url.removeprefix(FILE)).absolute() if url.startswith(FILE) else None

    @property
    def is_offline(self) -> bool:
        """Whether no device is connected: programs are written, and measured shots imported."""
        return OFFLINE in (self.config.controller.url, self.config.tracker.url)

    def require_devices(self) -> None:
        """Raise `ConfigInvalid` for a campaign that has no devices to connect to.

        Also where this system lacks what stops a robot at any time; a simulated one needs no such.
        """
        if self.is_offline:
            raise ConfigInvalid(
                f"{self.folder} is an offline campaign, without a controller and a tracker to "
                "connect to",
                remedy="`pkmcal import DIR FILE` imports what was measured, with "
                "--stage before or after for a validation, check for a check; what `pkmcal export` "
                "writes is put into the controller by hand; "
                "`pkmcal status DIR` says what is next",
            )
        if not (HAS_POSIX or self.is_simulated):
            raise ConfigInvalid(
                f"{self.folder}: devices are driven from Linux or macOS alone: this system lacks "
                "the signals and keys by which a robot is stopped at any time",
                remedy="measure from such a computer; `pkmcal status DIR`, import, "
                "identify, export and report work here",
            )

    def path(self, name: str) -> Path:
        """Return the path of a file in the campaign's folder."""
        return self.folder / name

    @property
    def identification_settings(self) -> dict[str, JsonValue]:
        """Settings that an identification rests on, without those at their defaults."""
        # Acceptance limits are not among them: they may be agreed late. A result whose verdict
        # rests on limits keeps them itself (`RecordedIdentification.outdated_by`).
        keys = {"space", "known_lengths", "objects"}
        return self.config.model_dump(mode="json", include=keys, exclude_defaults=True)

    def outdated(self, identification: "RecordedIdentification") -> tuple[str, ...]:
        """Return the keys of settings that changed since an identification was judged by them."""
        limits_mm = self.config.acceptance.distances_mm
        return identification.outdated_by(self.identification_settings, limits_mm)

    @property
    def instrument(self) -> TrackerUncertainty:
        """Tracker's standard uncertainty, by the limits of its data sheet in campaign.yaml.

        It serves for plans, and for what is measured from now on; for a series that is there
        `instrument_of` does.
        """
        return StatedInstrument.of(self.config.tracker).uncertainty

    def instrument_of(self, started: SeriesStarted) -> StatedInstrument:
        """Return the tracker's limits that count for a series: those recorded when it began."""
        return StatedInstrument.recorded(started, self.config.tracker)

    @property
    def pace(self) -> Pace:
        """Speed and times by which the duration of a plan is estimated."""
        config = self.config
        speed = FULL_JOINT_SPEED_RAD_S * config.controller.speed_percent / 100.0
        measure_s = config.tracker.measuring_time_s
        if self.is_by_hand or self.watched_file is not None:
            measure_s = max(measure_s, HAND_S)
        return Pace(speed, config.settle.time_s, measure_s)

    @contextmanager
    def held(self) -> Iterator[None]:
        """Keep other processes from changing the campaign during the block.

        Raise `CampaignLocked` if another process holds it.
        """
        with campaign_lock(self.folder, now_utc=now_utc):
            yield

    @contextmanager
    def journal(self) -> Iterator[Journal]:
        """Open the journal for writing during the block, and hold the campaign.

        The journal is made if there is none. Raise `CampaignLocked`, `JournalFailed`.
        """
        with self.held(), self.opened_journal() as journal:
            yield journal

    def opened_journal(self) -> Journal:
        """Return the journal for writing, made if there is none; the caller holds the campaign.

        Raise `JournalFailed` for a journal that cannot be opened, or is another campaign's.
        """
        path = self.journal_path
        opened = open_journal(
            path,
            now_utc=now_utc,
            # a record must be on the disk before a robot moves by it; a power cut also stops a
            # simulated robot, which therefore need not wait
            waits_for_disk=not self.is_simulated,
        )
        return self._checked(opened)

    def journal_reader(self) -> JournalReader:
        """Return the journal for reading.

        Raise `ShotsMissing` if there is none yet, and `JournalFailed` for a journal that cannot be
        read, or is another campaign's.
        """
        self.require_journal()
        return self._checked(read_journal(self.journal_path))

    def _checked(self, journal: JournalT) -> JournalT:
        """Return a journal that is this campaign's; close any other, and raise `JournalFailed`."""
        try:
            self.require_own(journal.series())
        except BaseException:
            journal.close()
            raise
        return journal

    def require_own(self, all_series: Iterable[Series]) -> None:
        """Raise `JournalFailed` if any series of a journal is another campaign's.

        Series from before campaigns had an identity are accepted.
        """
        for series in all_series:
            settings = series.started.configuration
            identity = str(settings.get("identity") or "")
            if identity and identity != self.config.identity:
                raise JournalFailed(
                    f"{self.journal_path}: series {series.number} is of another campaign, "
                    f"'{settings.get('name')}' of identity {identity}; campaign.yaml says "
                    f"{self.config.identity or 'none'}",
                    remedy="bring campaign.db back from a backup; if it is campaign.yaml that was "
                    f"exchanged, write `identity: {identity}` into it",
                )

    def require_nothing_rescued(self) -> None:
        """Raise `JournalFailed` while a rescued journal has records that campaign.db lacks."""
        # A rescued copy is made when another program deletes or damages campaign.db during a run.
        # Work that went on with the shorter journal would split the campaign in two.
        for copy in rescued_copies(self.journal_path):
            try:
                with read_journal(copy) as rescued:
                    self.require_own(rescued.series())
                    number, digest = rescued.last_number(), rescued.digest()
            except JournalFailed:  # not whole, or another campaign's
                continue
            if number and not self._holds(number, digest):
                raise JournalFailed(
                    f"{copy}: a rescued journal with {number} records, not all of which "
                    "campaign.db has",
                    remedy=f"{take_rescued(copy.name)}; or bring campaign.db back from a backup "
                    f"that has more, and move {copy.name} elsewhere",
                )

    def _holds(self, number: int, digest: str) -> bool:
        """Return whether the journal can be read and has all records up to this number."""
        try:
            with read_journal(self.journal_path) as journal:
                return journal.holds(number, digest)
        except JournalFailed:
            return False

    def require_journal(self) -> None:
        """Raise `ShotsMissing` if there is no journal yet."""
        if not self.journal_path.exists():
            raise self.nothing_measured()

    def measured_series(self, journal: JournalReader) -> Series:
        """Return the series to identify from, the latest run or import; raise `ShotsMissing`."""
        series = self.series_to_identify(journal)
        if series is None:
            raise self.nothing_measured()
        return series

    def series_to_identify(self, journal: JournalReader) -> Series | None:
        """Return the latest run or import; None if no tracker has measured anything yet."""
        # A run may be unfinished: its accepted shots are good. An import without an end broke off
        # while it was written. Shots at bars of known length alone determine no robot: they are
        # added to those of another series (`known_length_shots`).
        runs, imports = journal.series("run"), journal.series("import")
        whole = [each for each in imports if each.finished and not each.of_known_lengths]
        return max((*runs, *whole), key=lambda series: series.number, default=None)

    def known_length_shots(self, journal: JournalReader) -> tuple[AcceptedShot, ...]:
        """Return the shots of the latest whole import of known lengths alone; () without one."""
        imports = (each for each in journal.series("import") if each.finished)
        shots = [each.shots for each in imports if each.of_known_lengths]
        return shots[-1] if shots else ()

    def nothing_measured(self) -> ShotsMissing:
        """Return the error that there are no shots yet."""
        return ShotsMissing(
            f"{self.folder}: nothing has been measured yet",
            remedy="measure with `pkmcal run DIR`, or `pkmcal import DIR FILE`",
        )


@dataclass(frozen=True, slots=True)
class Campaign(CampaignFolder):
    """Campaign in a folder: its settings and its nominal robot.

    Attributes:
        nominal: Nominal robot with the text of its file.
    """

    nominal: RobotDocument

    @property
    def robot(self) -> RobotFile:
        """Nominal robot."""
        return self.nominal.robot

    @property
    def robot_identity(self) -> str:
        """Identity of the real robot: its serial number, or else the nominal robot's name."""
        return self.config.instruments.robot_serial or self.robot.name

    @property
    def centre(self) -> Array:
        """Pose in the middle of the workspace, (t,), mm and rad, over which detours lead."""
        return self.robot.mechanism.home_at(self.config.validation.centre_mm)

    @property
    def view(self) -> View:
        """View of the reflector from the tracker."""
        tracker = self.config.tracker
        centre_mm = self.config.validation.centre_mm
        # unless stated otherwise, the reflector faces the tracker at the workspace's centre
        away_mm = np.subtract(tracker.place_mm, centre_mm)
        facing = tracker.reflector_facing or vector(away_mm)
        return View(tracker.place_mm, facing, tracker.acceptance_rad)

    @property
    def space(self) -> RestrictedSpace:
        """Space in which the plate may be, by `space` in campaign.yaml."""
        robot = self.robot
        radius_mm = platform_radius_mm(robot.mechanism, robot.kinematics.p, robot.limits)
        return restricted_space(self.config.space, radius_mm)

    @property
    def region(self) -> FeasibleRegion:
        """Region of poses that robot, tracker's view and restricted space allow."""
        return region_of(self.robot, self.view, pose_of(self.centre), self.space)

    def workspace_sample(self) -> Array | None:
        """Return poses (N, t) at which every step judges positions; None if there are hardly any.

        They are spread over the robot's reach, whether the tracker sees them or not: the robot
        will work there, too.
        """
        robot = self.robot
        return sample_workspace(robot.kinematics, robot.limits, self.centre, self.space)

    def plan_request(self, shots: int | None = None) -> PlanRequest:
        """Return the request for a plan by campaign.yaml; `shots` overrides its number of shots."""
        plan = self.config.plan
        centre = pose_of(self.centre)
        return PlanRequest(
            shots or plan.shots, plan.validation_pairs, plan.drift_shots, centre, self.space
        )

    def read_plan(self) -> tuple[PlannedShot, ...]:
        """Return the shots of plan.csv; raise `PlanInvalid`."""
        return read_plan(self.plan_path, self.robot.mechanism)

    def checked_plan(
        self,
        shots: tuple[PlannedShot, ...] | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> CheckedPlan:
        """Check a plan, by default plan.csv, for the nominal robot; raise `PlanInvalid`.

        `tell` receives words on the progress.
        """
        names = [nest.name for nest in self.config.nests]
        known_lengths = self.config.known_lengths
        limits = PlanLimits(self.robot_model, self.view, self.pace, names, known_lengths)
        return check_plan(self.read_plan() if shots is None else shots, limits, tell)

    @property
    def robot_model(self) -> RobotModel:
        """Nominal robot in its space, by which ways are checked."""
        robot = self.robot
        return RobotModel(robot.kinematics, robot.limits, self.centre, self.space)


def open_folder(folder: Path | str) -> CampaignFolder:
    """Open the campaign of a folder without its robot's file, whose program need not be trusted.

    Raise `ConfigInvalid` for campaign.yaml, and `JournalFailed` as `open_campaign` does.
    """
    opened = CampaignFolder(Path(folder), read_campaign(Path(folder)))
    opened.require_nothing_rescued()
    return opened


def open_campaign(folder: Path | str) -> Campaign:
    """Open the campaign of a folder.

    Args:
        folder: The campaign's folder, with campaign.yaml and the robot file that it names.

    Returns:
        The campaign: `robot`, `config`, `read_plan()`, `journal_reader()`. The steps in `workflow`
        and `evaluate` take it.

    Raises:
        ConfigInvalid: campaign.yaml or the robot file is missing, or cannot be used as written.
        JournalFailed: A rescued journal in the folder has records that campaign.db lacks.

    Example:
        >>> campaign = open_campaign("cell-7")
        >>> campaign.robot.mechanism.name
        'par4'
    """
    folder = Path(folder)
    config = read_campaign(folder)
    campaign = Campaign(folder, config, read_robot(folder / config.robot))
    turns = any(axis.is_revolute for axis in campaign.robot.mechanism.task)
    for name in ("rotation_mm", "rotation_deg"):
        limit = getattr(config.acceptance, name)
        if limit is not None and not turns:
            raise ConfigInvalid(
                f"{folder / 'campaign.yaml'}: acceptance.{name} is {limit:g}, but the plate of a "
                f"{campaign.robot.mechanism.name} does not turn",
                remedy="delete that limit",
            )
    campaign.require_nothing_rescued()
    return campaign
