"""Loading of a parameter file into the controller, and rolling back: a transaction each time."""

# Steps of a load (controllers/load.py has the theory of 6):
#
# 1. Read the file and raise objections to its origin, verdict and changes. 2. Connect. 3. Read what
# the controller holds; if an earlier load has no end in the journal, write this end. 4. Raise
# objections to the controller: another serial number, odd parameters. Stop if it lacks parameters
# of the set. 5. Show the changes and ask. 6. From here on signals only set a flag: back up, write
# `load begun`, write the controller, read back, write `load` or `load failed`.
#
# With --verify the same pairs are measured before the backup and after the read-back. Whatever ends
# the second measurement, the old parameters are put back, with one exception: to a robot that may
# still be moving (`RobotStateUnknown`) nothing is written, as this would change its motion.
#
# A rollback is the same transaction with the backup of the latest effective load as its file.

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import asdict, dataclass, field, replace
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
    load_history,
    record_undone,
    replaced_by,
    standing_loads,
)
from campaigns.controllers.objections import Objection
from campaigns.evaluation.decision import FigureChange
from campaigns.evaluation.validation import ValidationResult
from campaigns.evaluation.verdict import compare_distances, lost_beyond
from campaigns.journal.journal import Journal
from campaigns.journal.records import Finding
from campaigns.measuring.run_state import SILENT, RunObserver, Wishes
from campaigns.measuring.series_log import problem_of
from campaigns.measuring.session import measure_series
from campaigns.measuring.work import Devices
from campaigns.options import LoadOptions
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.reduced_form import form_of
from campaigns.robots.robot import RobotFile, read_robot
from campaigns.workflow import validation
from campaigns.workflow.exporting import issuer_of, plain_form
from drivers.errors import Cancelled, DeviceRefused, DriverError, RobotStateUnknown
from drivers.ports import RobotController
from drivers.values import Identity

STOPPED = (errors.Interrupted, Cancelled, KeyboardInterrupt)
"""Exceptions by which an operator's request to stop ends a measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadTerms:
    """Terms of a load: who approves and observes it, and whether anything is written.

    Attributes:
        approve: Called with the controller's identity and all changes before anything is written;
            an exception that it raises ends the load.
        `tell`: Receives sentences about the load.
        uninterrupted: Context that holds signals off from the backup to the last record.
        dry: Whether nothing is written, neither into the controller nor into the journal.
        prepare: Brings the devices into the state that measuring needs; the robot may move.
        observer: Receives the progress of verification pairs.
        stop_requested: Returns True when measuring pairs shall end.
        goes_on: Called after a stop, when the robot stands: whether measuring goes on.
    """

    approve: Callable[[Identity, tuple[Change, ...]], object] = lambda *_: None
    tell: Callable[[str], None] = lambda _: None
    uninterrupted: AbstractContextManager[object] = field(default_factory=nullcontext)
    dry: bool = False
    prepare: Callable[[Devices], None] = lambda _: None
    observer: RunObserver = SILENT
    stop_requested: Callable[[], bool] = lambda: False
    goes_on: Callable[[], bool] = lambda: False


@dataclass(frozen=True, slots=True)
class LoadVerification:
    """Mean absolute error of the distances of the same pairs before and after writing."""

    pairs: int
    """Number of pairs."""
    before_mm: float
    after_mm: float
    series: tuple[int, int]
    """Numbers of the journal's series, before and after."""
    expanded_mm: float
    """U of the difference of both."""
    change: FigureChange
    """Decision on the difference; the load is kept unless the errors became larger."""


@dataclass(frozen=True, slots=True)
class LoadResult:
    """Result of a load.

    Attributes:
        source: The robot file.
        outcome: `"loaded"`; `"already"` if the controller held the parameters; `"dry"`.
        kept: File with the replaced parameters; None if nothing was written.
        forced: Objections that were overruled by `force`.
        state: What the controller holds now.
        verification: Result of the verification pairs; None if none were requested.
    """

    source: Path
    outcome: Literal["loaded", "already", "dry"]
    kept: Path | None = None
    forced: tuple[str, ...] = ()
    state: ControllerState | None = None
    verification: LoadVerification | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Wanted:
    """Robot file whose parameters shall be in the controller."""

    source: Path
    robot: RobotFile
    objections: tuple[Objection, ...] = ()
    """Objections that `force` overrules by their names."""
    takes_back: int | None = None
    """Record number of the load that is rolled back; None for a load."""


def load(
    campaign: Campaign,
    connection: AbstractContextManager[RobotController | Devices],
    options: LoadOptions | None = None,
    terms: LoadTerms | None = None,
) -> LoadResult:
    """Load a robot file into the controller, or take the latest effective load back.

    Args:
        campaign: The campaign.
        connection: Opens a controller, or a cell if pairs shall be measured. It is entered only
            after the file has been checked.
        options: Options of `pkmcal load`; by default the exported file is loaded.
        terms: Who approves and observes the load; by default it is made without a question.

    Returns:
        The outcome, the backup of the old parameters, and the result of verification pairs.

    Raises:
        ConfigInvalid: The file should not be loaded, or holds parameters that the controller lacks.
        ShotsMissing: No load is in effect that could be rolled back.
        DeviceRefused: The controller refused, and holds the old parameters.
        LoadNotVerified: The controller does not hold what was written; the message says what it
            holds.
        VerdictBad: The verification pairs became worse; the old parameters are back.
        Interrupted: Stopped while pairs were measured; the old parameters are in the controller.

    Example:
        >>> with connected_cell(campaign) as cell:
        ...     result = workflow.load(campaign, nullcontext(cell), LoadOptions(verify=8))
    """
    options, terms = options or LoadOptions(), terms or LoadTerms()
    if options.rollback and not campaign.journal_path.exists():
        raise nothing_to_take_back(campaign)
    with campaign.held():  # no identification may come after the file was judged
        return _load_held(campaign, connection, options, terms)


def _load_held(
    campaign: Campaign,
    connection: AbstractContextManager[RobotController | Devices],
    options: LoadOptions,
    terms: LoadTerms,
) -> LoadResult:
    """Load or roll back in a campaign that is held; raise as `load` does."""
    wanted = None if options.rollback else read_wanted(campaign, options)
    with campaign.opened_journal() as journal:
        if wanted is None and load_history(journal) == ((), None):
            raise nothing_to_take_back(campaign)
        with connection as devices:
            cell = devices if isinstance(devices, Devices) else None
            controller = devices.robot if isinstance(devices, Devices) else devices
            loading = _Loading(campaign, journal, controller, options, terms, cell)
            return loading.roll_back() if wanted is None else loading.load(wanted)


def nothing_to_take_back(campaign: Campaign) -> errors.ShotsMissing:
    """Return the error that no load is in effect."""
    return errors.ShotsMissing(
        f"{campaign.folder}: no load is in effect that could be taken back",
        remedy="there is nothing to roll back; name a robot file with --robot",
    )


def _stopped(holds: str) -> errors.Interrupted:
    """Return the error of a stopped load; `holds` says what the controller holds."""
    return errors.Interrupted(
        f"load: stopped by the operator; {holds}", remedy="the same command begins anew"
    )


def read_wanted(campaign: Campaign, options: LoadOptions) -> Wanted:
    """Read the file to load, with the objections to it; raise `ConfigInvalid` without force."""
    source = options.file or campaign.path(FILE_NAME)
    robot = load_checks.read_parameter_file(source, campaign.robot)
    objections = tuple(load_checks.file_objections(robot, issuer_of(campaign), campaign.robot))
    return Wanted(source, robot, load_checks.overruled(source, objections, options.force))


@dataclass(frozen=True, slots=True, eq=False)
class _Loading:
    """Loading with a connected controller and an open journal."""

    campaign: Campaign
    journal: Journal
    controller: RobotController
    options: LoadOptions
    terms: LoadTerms
    cell: Devices | None = None
    """Cell of the controller if its tracker is connected too, else None."""

    def load(self, wanted: Wanted) -> LoadResult:
        """Load a file."""
        held = self._read_held()
        expected_serial = (wanted.robot.provenance or {}).get("controller_serial")
        checked = self._check_controller(wanted, held, expected_serial)
        form = form_of(wanted.robot.provenance, str(wanted.source))
        for text in lost_beyond(form, self.campaign.config.acceptance):
            self.terms.tell(f"! {text}: `pkmcal correct` loses nothing")
        return self._carry_out(checked, held)

    def roll_back(self) -> LoadResult:
        """Put back the parameters that the latest effective load replaced."""
        held = self._read_held()
        standing = standing_loads(self.journal, held)
        if not standing:
            raise nothing_to_take_back(self.campaign)
        latest = standing[-1]
        source = self.campaign.path(latest.kept)
        robot = read_robot(source).robot
        load_checks.require_same_mechanism(source, robot, self.campaign.robot)
        objections = tuple(load_checks.backup_objections(robot, replaced_by(self.journal, latest)))
        load_checks.overruled(source, objections, self.options.force)
        backup = f"what the controller held before the load of {latest.source}"
        if not differing(held, robot.for_controller):
            self.terms.tell(f"{backup} ({latest.at_utc}) was put back already by other means")
            # recorded nevertheless: the next rollback must find the load below this one
            if not self.terms.dry:
                record_undone(self.journal, latest, robot.digest())
            return LoadResult(source, "already", state=self._state(held))
        self.terms.tell(f"puts back {source.name}: {backup} ({latest.at_utc})")
        wanted = Wanted(source, robot, objections, takes_back=latest.number)
        checked = self._check_controller(wanted, held, latest.controller_serial)
        return self._carry_out(checked, held)

    def _read_held(self) -> dict[str, float]:
        """Read the controller's parameters; write the end of a load that has none."""
        held = dict(self.controller.read_geometry())
        _, unended = load_history(self.journal)
        if unended is not None:
            self.terms.tell(unended.describe(held))
            if not self.terms.dry:
                unended.settle(self.journal, held, FOUND_AGAIN)
        return held

    def _check_controller(
        self, wanted: Wanted, held: Mapping[str, float], expected_serial: object
    ) -> Wanted:
        """Add the objections to the controller's serial number and its present parameters.

        Raise `ConfigInvalid` for any of them without force, and in any case for parameters that
        the controller's kinematics lacks.
        """
        lacking = self.controller.lacks(wanted.robot.parameters.extended_by)
        if lacking:
            overwriting = " --force" if self.campaign.path(PLAIN_FILE).exists() else ""
            command = f"pkmcal export DIR --format {PLAIN}{overwriting}"
            _, form = plain_form(self.campaign, wanted.robot)
            remedy = (
                f"`{command}` writes the nearest set that it can have, which {form.loses}; "
                "`pkmcal correct` loses nothing"
            )
            wanted.robot.require_known(lacking, remedy)
        serial = self.controller.identity().serial
        objections = (
            *load_checks.serial_objections(expected_serial, serial),
            *load_checks.held_objections(held, self.campaign.robot),
        )
        overruled = load_checks.overruled(wanted.source, objections, self.options.force)
        return replace(wanted, objections=(*wanted.objections, *overruled))

    def _carry_out(self, wanted: Wanted, held: dict[str, float]) -> LoadResult:
        """Approve, verify, back up and write; the order is that of the module's head."""
        robot, source = wanted.robot, wanted.source
        forced = tuple(objection.says for objection in wanted.objections)
        for problem in forced:
            self.terms.tell(f"overruled by --force: {problem}")
        parameters, controller = robot.for_controller, self.controller.identity()
        if not differing(held, parameters):
            return LoadResult(source, "already", state=self._state(held))
        pairs = self.options.verify if self.cell else 0
        shots: tuple[PlannedShot, ...] = ()
        if pairs:  # refused here, before anybody is asked, if there are too few
            shots = validation.verification_pairs(self.campaign, (held, parameters), pairs)
        self.terms.approve(controller, changes(held, robot))
        if self.terms.dry:
            return LoadResult(source, "dry", state=self._state(held))
        with self.terms.uninterrupted:
            before = self._measure_before(held, shots) if shots else None
            # backup, then record, then write: at any moment the two before it can undo the third
            kept = keep(self.campaign.folder, self.campaign.nominal, held)
            begun = Load(
                source=source.name,
                digest=robot.digest(),
                kept=kept.name,
                wanted=dict(parameters),
                held=held,
                controller_serial=controller.serial,
                rolls_back=wanted.takes_back,
                verify=pairs,
                forced=forced,
                projection=form_of(robot.provenance, str(source)),
            ).begin(self.journal)
            self._write(begun)
            verification = None if before is None else self._measure_after(begun, shots, *before)
            begun.end(self.journal, None if verification is None else asdict(verification))
        return LoadResult(source, "loaded", kept, forced, self._state(parameters), verification)

    def _state(self, held: Mapping[str, float]) -> ControllerState:
        """Return the state of a controller with these parameters, by the journal's sets."""
        findings = (each.record for each in self.journal.records_of(Finding))
        return KnownSets.of(self.campaign.robot, findings).state_of(held)

    def _measure_before(
        self, held: Mapping[str, float], shots: tuple[PlannedShot, ...]
    ) -> tuple[int, ValidationResult]:
        """Measure with the old parameters; return the series and its figures.

        Whatever ends the measurement is raised with the words that nothing was written.
        """
        nothing = "nothing was written: the controller holds the old parameters"
        try:
            return self._measure("verify before", held, shots)
        except (RobotStateUnknown, errors.LoadNotVerified, errors.TargetOutOfReach) as error:
            raise type(error)(f"{error.problem}; {nothing}", remedy=error.remedy) from error
        except STOPPED as error:
            raise _stopped(nothing) from error

    def _write(self, begun: Load) -> None:
        """Write the controller and read it back; end a failed load in the journal.

        The load stays without an end if the controller's parameters cannot be read, or are a
        mixture. Raise as `write_verified` does.
        """
        try:
            write_verified(self.controller, begun.wanted, begun.held)
        except (DeviceRefused, errors.LoadNotVerified) as error:
            # a second failure must not hide the first one, which says what the controller holds
            with suppress(DriverError, errors.JournalFailed):
                begun.settle(self.journal, self.controller.read_geometry(), error.problem)
            raise

    def _measure_after(
        self, begun: Load, shots: tuple[PlannedShot, ...], series: int, before: ValidationResult
    ) -> LoadVerification:
        """Measure with the new parameters, and compare with the series and its figures before.

        Whatever ends the measurement, the old parameters are put back, unless the robot may still
        be moving. Raise `VerdictBad` if the pairs became worse beyond the uncertainty of the
        difference.
        """
        try:
            again, after = self._measure("verify after", begun.wanted, shots)
        except RobotStateUnknown as error:  # a robot that may move is written nothing
            raise RobotStateUnknown(
                f"{error.problem}; nothing was put back: the controller holds the new parameters "
                f"of {begun.source}, which are not verified",
                remedy=f"{error.remedy}; once it stands, `pkmcal load DIR --rollback` puts the old "
                "ones back",
            ) from error
        except BaseException as error:  # also KeyboardInterrupt: the old set comes back first
            self._take_back(begun, f"not verified: {problem_of(error)}")
            if isinstance(error, STOPPED):
                raise _stopped("the controller holds the old parameters") from error
            raise
        comparison = compare_distances(before, after)
        assert comparison is not None, "pairs were measured in both series"
        verification = LoadVerification(
            begun.verify,
            comparison.before.value_mm,
            comparison.after.value_mm,
            (series, again),
            comparison.expanded_uncertainty_mm,
            comparison.change,
        )
        if verification.change != "larger":
            return verification
        worse = (
            f"distances of {begun.verify} pairs are off by {verification.after_mm:.3f} mm on "
            f"average after loading {begun.source}, before it was {verification.before_mm:.3f} mm "
            f"(U of the difference: {verification.expanded_mm:.3f} mm)"
        )
        self._take_back(begun, worse)
        raise errors.VerdictBad(
            f"{worse}; rolled back, the controller holds the old parameters",
            remedy="identify again, with other shots or parameters",
        )

    def _take_back(self, begun: Load, reason: str) -> None:
        """Put the old parameters back and end the load as failed; raise `LoadNotVerified`."""
        put_back(self.controller, begun.held)
        begun.fail(self.journal, reason)
        self.terms.tell(f"rolled back: the controller holds what it held before ({begun.kept})")

    def _measure(
        self,
        stage: validation.VerificationStage,
        active: Mapping[str, float],
        shots: tuple[PlannedShot, ...],
    ) -> tuple[int, ValidationResult]:
        """Measure pairs as the controller commands them; return the series and its figures.

        `active` are the parameters in the controller.
        """
        cell, terms = self.cell, self.terms
        assert cell is not None, "pairs are measured where they were asked for"
        work = validation.verification_work(self.campaign, stage, active, shots)
        before = self.journal.latest_series(stage)
        # The first round begins a new series: one of an earlier load was measured with other
        # parameters. After a stop that the operator takes back, the next round goes on with it.
        while True:
            anew = self.journal.latest_series(stage) == before
            try:
                terms.prepare(cell)
                series = measure_series(
                    cell,
                    self.journal,
                    work,
                    terms.observer,
                    Wishes(terms.stop_requested),
                    anew=anew,
                )
            except (errors.Interrupted, Cancelled):
                if not terms.goes_on():
                    raise
                cell.robot.reconnect()
                cell.tracker.reconnect()
            else:
                result = validation.evaluated_pairs(
                    self.campaign, self.journal, series, len(shots) // 2
                )
                return series, result
