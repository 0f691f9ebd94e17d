"""Loading of a parameter file into the controller, and walking back: a transaction each time."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from campaigns import errors
from campaigns.campaign import Campaign
from campaigns.controllers import load_checks
from campaigns.controllers.controller_state import ControllerState, KnownSets
from campaigns.controllers.export import FILE_NAME, PLAIN, PLAIN_FILE
from campaigns.controllers.load import Change, changes, differing, keep, put_back, write_verified
from campaigns.controllers.load_journal import (
    FOUND_AGAIN,
    Load,
    already_back,
    load_history,
    standing_loads,
)
from campaigns.evaluation.verdict import lost_beyond
from campaigns.journal.journal import Journal
from campaigns.journal.records import Finding
from campaigns.measuring.run_state import SILENT, RunObserver
from campaigns.measuring.series_log import problem_of
from campaigns.measuring.session import measure_series
from campaigns.measuring.work import Cell
from campaigns.options import LoadOptions
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.reduced_form import form_of
from campaigns.robots.robot import RobotFile, read_robot
from campaigns.workflow import validation
from campaigns.workflow.exporting import plain_form
from drivers.errors import Cancelled, DeviceRefused, DriverError, RobotStateUnknown
from drivers.ports import RobotController
from drivers.values import Identity

STOPPED = (errors.Interrupted, Cancelled, KeyboardInterrupt)
"""Ways in which the operator's wish to stop ends a measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadTerms:
    """Terms of a load: who is asked and informed, and whether it is one at all.

    `approve` gets which controller and which changes, and raises what keeps them from being
    made; `tell` gets what should be said; `uninterrupted` holds signals off from the first to the
    last record.
    """

    approve: Callable[[Identity, tuple[Change, ...]], object] = lambda *_: None
    tell: Callable[[str], None] = lambda _: None
    uninterrupted: AbstractContextManager[object] = field(default_factory=nullcontext)
    dry: bool = False
    """Whether nothing is written, neither into the controller nor into the journal."""
    prepare: Callable[[Cell], None] = lambda _: None
    """Brings the devices into the state that measuring needs; the robot may move."""
    observer: RunObserver = SILENT
    stop_requested: Callable[[], bool] = lambda: False
    goes_on: Callable[[], bool] = lambda: False
    """Asked when the operator has stopped it, and the robot stands."""


@dataclass(frozen=True, slots=True)
class Verification:
    """Mean error of the distances of the same pairs before and after writing, mm."""

    pairs: int
    before_mm: float
    after_mm: float
    series: tuple[int, int]
    """Of the journal, before and after."""


@dataclass(frozen=True, slots=True)
class LoadResult:
    """Result of a load: the file, where the old parameters are kept, and the verification.

    `kept` is None where nothing was written.
    """

    source: Path
    outcome: Literal["loaded", "already", "dry"]
    kept: Path | None = None
    forced: tuple[str, ...] = ()
    state: ControllerState | None = None
    """Of the controller now; None where nothing was asked of it."""
    verification: Verification | None = None


def load(
    campaign: Campaign,
    connection: AbstractContextManager[RobotController | Cell],
    options: LoadOptions | None = None,
    terms: LoadTerms | None = None,
) -> LoadResult:
    """Load a robot file, the exported one by default, or take the latest effective load back.

    `connection` is made once the file is known to be one for this campaign. Raises `ConfigInvalid`
    for a file that should not be loaded, and for parameters that no controller knows, and
    `ShotsMissing` where no load could be taken back.

    With `verify`, for which the connection is to a cell, so many validation pairs are measured
    before and after. Raises `VerdictBad` when their mean error became larger; then, and after
    whatever else kept them from being measured, the old parameters are back.
    """
    options, terms = options or LoadOptions(), terms or LoadTerms()
    if options.rollback and not campaign.journal_path.exists():
        raise _nothing_to_take_back(campaign)
    wanted = None if options.rollback else _wanted(campaign, options)
    with campaign.journal() as journal:
        if wanted is None and load_history(journal) == ((), None):
            raise _nothing_to_take_back(campaign)
        with connection as devices:
            cell = devices if isinstance(devices, Cell) else None
            controller = devices.robot if isinstance(devices, Cell) else devices
            loading = _Loading(campaign, journal, controller, options, terms, cell)
            return loading.roll_back() if wanted is None else loading.load(*wanted)


def _nothing_to_take_back(campaign: Campaign) -> errors.ShotsMissing:
    return errors.ShotsMissing(
        f"{campaign.folder}: no load is in effect that could be taken back",
        remedy="there is nothing to roll back; name a robot file with --robot",
    )


def _stopped(holds: str) -> errors.Interrupted:
    return errors.Interrupted(
        f"load: stopped by the operator; {holds}", remedy="the same command begins anew"
    )


def _wanted(
    campaign: Campaign, options: LoadOptions
) -> tuple[Path, RobotFile, tuple[errors.ConfigInvalid, ...]]:
    """Return the file, its robot, and what was overruled of what speaks against it.

    Raises `ConfigInvalid` unless that is overruled.
    """
    source = options.file or campaign.path(FILE_NAME)
    robot = load_checks.read_parameter_file(source, campaign.folder, campaign.robot)
    objections = tuple(load_checks.file_objections(robot, campaign.config.name, campaign.robot))
    if not options.force:
        load_checks.refuse(source, objections)
    return source, robot, objections


@dataclass(frozen=True, slots=True, eq=False)
class _Loading:
    """Loading with a connected controller and an open journal.

    Read, checked, approved, [pairs measured], begun in the journal, written and read back,
    [pairs measured again], ended in the journal; or taken back and ended as failed.
    """

    campaign: Campaign
    journal: Journal
    controller: RobotController
    options: LoadOptions
    terms: LoadTerms
    cell: Cell | None = None
    """Of a controller whose tracker is connected too."""

    def load(
        self, source: Path, robot: RobotFile, objections: tuple[errors.ConfigInvalid, ...]
    ) -> LoadResult:
        """Load a file."""
        held = self._held()
        expected = (robot.provenance or {}).get("controller_serial")
        objections += self._checked(source, robot, held, expected)
        form, limits = form_of(robot.provenance, str(source)), self.campaign.config.acceptance
        for text in lost_beyond(form, limits):
            self.terms.tell(f"! {text}: `pkmcal correct` loses nothing")
        return self._carry_out(source, robot, held, objections)

    def roll_back(self) -> LoadResult:
        """Put back what the latest effective load replaced."""
        held = self._held()
        standing = standing_loads(self.journal, held)
        if not standing:
            raise _nothing_to_take_back(self.campaign)
        latest = standing[-1]
        source = self.campaign.path(latest.kept)
        robot = read_robot(source).robot
        load_checks.require_same_mechanism(source, robot, self.campaign.robot)
        what = f"what the controller held before the load of {latest.source}"
        if not differing(held, robot.parameters):
            self.terms.tell(f"{what} ({latest.at_utc}) was put back already by other means")
            if not self.terms.dry:
                already_back(self.journal, latest, robot.digest())
            return LoadResult(source, "already", state=self._state(held))
        self.terms.tell(f"puts back {source.name}: {what} ({latest.at_utc})")
        objections = self._checked(source, robot, held, latest.controller_serial)
        return self._carry_out(source, robot, held, objections, takes_back=latest.number)

    def _held(self) -> dict[str, float]:
        """Return what the controller holds; say and end a load without an end."""
        held = dict(self.controller.read_geometry())
        _, unended = load_history(self.journal)
        if unended is not None:
            self.terms.tell(unended.describe(held))
            if not self.terms.dry:
                unended.settle(self.journal, held, FOUND_AGAIN)
        return held

    def _checked(
        self, source: Path, robot: RobotFile, held: Mapping[str, float], expected_serial: object
    ) -> tuple[errors.ConfigInvalid, ...]:
        """Return objections by the controller's serial number and parameters, overruled by force.

        Raises `ConfigInvalid` without force, and for parameters that its kinematics lacks.
        """
        lacking = self.controller.lacks(robot.parameters.extended_by)
        if lacking:
            again = " --force" if self.campaign.path(PLAIN_FILE).exists() else ""
            command = f"pkmcal export {self.campaign.folder} --format {PLAIN}{again}"
            _, form = plain_form(self.campaign, robot)
            remedy = (
                f"`{command}` writes the nearest set that it can have, which {form.loses}; "
                "`pkmcal correct` loses nothing"
            )
            robot.require_known(lacking, remedy)
        serial = self.controller.identity().serial
        objections = (
            *load_checks.serial_objections(expected_serial, serial),
            *load_checks.held_objections(held, self.campaign.robot),
        )
        if not self.options.force:
            load_checks.refuse(source, objections)
        return objections

    def _carry_out(
        self,
        source: Path,
        robot: RobotFile,
        held: dict[str, float],
        overruled: tuple[errors.ConfigInvalid, ...],
        takes_back: int | None = None,
    ) -> LoadResult:
        for objection in overruled:
            self.terms.tell(f"overruled by --force: {objection.problem}")
        wanted, controller = robot.parameters, self.controller.identity()
        if not differing(held, wanted):
            return LoadResult(source, "already", state=self._state(held))
        pairs = self.options.verify if self.cell else 0
        shots = validation.verification_pairs(self.campaign, (held, wanted), pairs) if pairs else ()
        self.terms.approve(controller, changes(held, robot))
        if self.terms.dry:
            return LoadResult(source, "dry", state=self._state(held))
        forced = tuple(objection.problem for objection in overruled)
        with self.terms.uninterrupted:
            before = self._measured_before(held, shots) if shots else None
            kept = keep(self.campaign.folder, self.campaign.nominal, held)
            begun = Load(
                source=source.name,
                digest=robot.digest(),
                kept=kept.name,
                wanted=dict(wanted),
                held=held,
                controller_serial=controller.serial,
                rolls_back=takes_back,
                verify=pairs,
                forced=forced,
                projection=form_of(robot.provenance, str(source)),
            ).begin(self.journal)
            self._write(begun)
            verification = None if before is None else self._verified(begun, shots, *before)
            begun.end(self.journal, None if verification is None else asdict(verification))
        return LoadResult(source, "loaded", kept, forced, self._state(wanted), verification)

    def _state(self, held: Mapping[str, float]) -> ControllerState:
        findings = (each.record for each in self.journal.records_of(Finding))
        return KnownSets.of(self.campaign.robot, findings).state_of(held)

    def _measured_before(
        self, held: Mapping[str, float], shots: tuple[PlannedShot, ...]
    ) -> tuple[int, float]:
        """Return series and mean error, mm; whatever ends it says that nothing was written."""
        nothing = "nothing was written: the controller holds the old parameters"
        try:
            return self._measured("verify before", held, shots)
        except (RobotStateUnknown, errors.LoadNotVerified, errors.TargetOutOfReach) as error:
            raise type(error)(f"{error.problem}; {nothing}", remedy=error.remedy) from error
        except STOPPED as error:
            raise _stopped(nothing) from error

    def _write(self, begun: Load) -> None:
        """Write and read back; a failure is ended in the journal where its outcome is known."""
        try:
            write_verified(self.controller, begun.wanted, begun.held)
        except (DeviceRefused, errors.LoadNotVerified) as error:
            with suppress(
                DriverError, errors.JournalFailed
            ):  # what went wrong first is what counts
                begun.settle(self.journal, self.controller.read_geometry(), error.problem)
            raise

    def _verified(
        self, begun: Load, shots: tuple[PlannedShot, ...], series: int, before_mm: float
    ) -> Verification:
        """Measure with the new parameters; raises `VerdictBad` when they are worse."""
        try:
            again, after_mm = self._measured("verify after", begun.wanted, shots)
        except RobotStateUnknown as error:  # a robot that may move is written nothing
            raise RobotStateUnknown(
                f"{error.problem}; nothing was put back: the controller holds the new parameters "
                f"of {begun.source}, which are not verified",
                remedy=f"{error.remedy}; once it stands, `pkmcal load DIR --rollback` puts the old "
                "ones back",
            ) from error
        except BaseException as error:
            self._take_back(begun, f"not verified: {problem_of(error)}")
            if isinstance(error, STOPPED):
                raise _stopped("the controller holds the old parameters") from error
            raise
        if after_mm <= before_mm:
            return Verification(begun.verify, before_mm, after_mm, (series, again))
        worse = (
            f"distances of {begun.verify} pairs are off by {after_mm:.3f} mm on average "
            f"after loading {begun.source}, before it was {before_mm:.3f} mm"
        )
        self._take_back(begun, worse)
        raise errors.VerdictBad(
            f"{worse}; rolled back, the controller holds the old parameters",
            remedy="identify again, with other shots or parameters",
        )

    def _take_back(self, begun: Load, reason: str) -> None:
        """Put the old parameters back and end the load; raises `LoadNotVerified`."""
        put_back(self.controller, begun.held)
        begun.fail(self.journal, reason)
        self.terms.tell(f"rolled back: the controller holds what it held before ({begun.kept})")

    def _measured(
        self,
        stage: validation.VerificationStage,
        active: Mapping[str, float],
        shots: tuple[PlannedShot, ...],
    ) -> tuple[int, float]:
        """Measure pairs as the controller commands them; return series and mean error, mm."""
        cell, terms = self.cell, self.terms
        assert cell is not None, "pairs are measured where they were asked for"
        work = validation.verification_work(self.campaign, stage, active, shots)
        before = self.journal.latest_series(stage)
        while True:
            anew = self.journal.latest_series(stage) == before
            try:
                terms.prepare(cell)
                series = measure_series(
                    cell, self.journal, work, terms.observer, terms.stop_requested, anew=anew
                )
            except (errors.Interrupted, Cancelled):
                if not terms.goes_on():
                    raise
                cell.robot.reconnect()
                cell.tracker.reconnect()
            else:
                mean_mm = validation.mean_of_pairs_mm(
                    self.campaign, self.journal, series, len(shots) // 2
                )
                return series, mean_mm
