"""Loading of a parameter file into the controller, and walking back: a transaction each time."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import JsonValue

from campaigns.campaign import Campaign
from campaigns.chain.validation import (
    VerificationStage,
    mean_of_pairs_mm,
    verification_pairs,
    verification_work,
)
from campaigns.controllers import export as parameter_file
from campaigns.controllers.load import Change, changes, differing, keep, put_back, write_verified
from campaigns.controllers.load_checks import (
    Objection,
    file_objections,
    refuse,
    require_same_mechanism,
    serial_objections,
)
from campaigns.controllers.load_journal import (
    EffectiveLoad,
    LoadIntent,
    UnendedLoad,
    already_back,
    begin,
    end,
    fail,
    load_history,
    settle,
)
from campaigns.errors import Interrupted, JournalFailed, LoadNotVerified, ShotsMissing, VerdictBad
from campaigns.journal.journal import Journal
from campaigns.measuring.run_state import SILENT, RunObserver
from campaigns.measuring.series_log import problem_of
from campaigns.measuring.session import Work, measure_series
from campaigns.measuring.shot_taker import Cell
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.robot import RobotFile, read_robot
from drivers.errors import Cancelled, DeviceRefused, DriverError
from drivers.ports import RobotController
from drivers.values import Identity


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadTerms:
    """Terms of a load: who is asked and told, and what is allowed.

    `approve` is told which controller and which changes, and raises what keeps them from being
    made; `tell` gets what should be said; `uninterrupted` holds signals off from the first to the
    last record.
    """

    approve: Callable[[Identity, tuple[Change, ...]], object] = lambda *_: None
    tell: Callable[[str], None] = lambda _: None
    uninterrupted: AbstractContextManager[object] = field(default_factory=nullcontext)
    force: bool = False
    """Whether objections are overruled, which the journal keeps."""
    dry: bool = False
    """Whether nothing is written, neither into the controller nor into the journal."""


@dataclass(frozen=True, slots=True)
class Verification:
    """Mean error of the distances of the same pairs before and after writing, mm."""

    pairs: int
    before_mm: float
    after_mm: float
    series: tuple[int, int]
    """Of the journal, before and after."""

    def document(self) -> dict[str, JsonValue]:
        """As the journal and `load --json` have it."""
        return {
            "pairs": self.pairs,
            "before_mm": self.before_mm,
            "after_mm": self.after_mm,
            "series": list(self.series),
        }


@dataclass(frozen=True, slots=True)
class LoadResult:
    """Result of a load: the file, where the old parameters are kept, and the verification.

    `kept` is None where nothing was written.
    """

    source: Path
    outcome: Literal["loaded", "already", "dry"]
    kept: Path | None = None
    forced: tuple[str, ...] = ()
    verification: Verification | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Wanted:
    """File to be written, what speaks against it, and which load it takes back."""

    source: Path
    robot: RobotFile
    objections: tuple[Objection, ...] = ()
    takes_back: EffectiveLoad | None = None


@dataclass(frozen=True, slots=True)
class _PairErrors:
    """Mean error of the distances of a series' pairs, mm."""

    series: int
    mean_mm: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VerificationSetup:
    """How pairs are measured before and after writing.

    `prepare` brings the devices into the state that measuring needs; the robot may move. `goes_on`
    is asked when the operator has stopped it, and the robot stands.
    """

    pairs: int
    prepare: Callable[[Cell], None]
    observer: RunObserver = SILENT
    stop_requested: Callable[[], bool] = lambda: False
    goes_on: Callable[[], bool] = lambda: False


@dataclass(frozen=True, slots=True, eq=False)
class _Verifier:
    """Measures the same pairs with the cell before and after writing."""

    campaign: Campaign
    journal: Journal
    cell: Cell
    setup: VerificationSetup

    def shots(
        self, held: Mapping[str, float], wanted: Mapping[str, float]
    ) -> tuple[PlannedShot, ...]:
        """Pairs that both parameter sets reach; raises `OptionsInvalid` when there are too few."""
        return verification_pairs(self.campaign, (held, wanted), self.setup.pairs)

    def measured(
        self, stage: VerificationStage, active: Mapping[str, float], shots: tuple[PlannedShot, ...]
    ) -> _PairErrors:
        """Errors of the pairs as the controller commands them now."""
        work = verification_work(self.campaign, stage, active, shots)
        before = self._latest(stage)
        while True:
            try:
                series = self._series(work, anew=self._latest(stage) == before)
            except (Interrupted, Cancelled):
                if not self.setup.goes_on():
                    raise
                self.cell.robot.reconnect()
                self.cell.tracker.reconnect()
            else:
                return _PairErrors(series, mean_of_pairs_mm(self.campaign, self.journal, series))

    def _series(self, work: Work, *, anew: bool) -> int:
        self.setup.prepare(self.cell)
        observer, stop_requested = self.setup.observer, self.setup.stop_requested
        return measure_series(self.cell, self.journal, work, observer, stop_requested, anew=anew)

    def _latest(self, stage: VerificationStage) -> int:
        """Number of the latest series of a stage; 0: there is none."""
        latest = self.journal.latest_series(stage)
        return 0 if latest is None else latest.number


def load(
    campaign: Campaign,
    connection: AbstractContextManager[RobotController],
    source: Path | None = None,
    terms: LoadTerms | None = None,
) -> LoadResult:
    """Load a robot file, the exported one by default.

    `connection` is made once the file is known to be one for this campaign. Raises `ConfigInvalid`
    for a file that should not be loaded, and for parameters that no controller knows.
    """
    terms = terms or LoadTerms()
    wanted = _wanted(campaign, source, terms)
    with campaign.journal() as journal, connection as controller:
        return _Loading(campaign, journal, controller, terms).load(wanted)


def load_verified(
    campaign: Campaign,
    connection: AbstractContextManager[Cell],
    setup: VerificationSetup,
    source: Path | None = None,
    terms: LoadTerms | None = None,
) -> LoadResult:
    """Load a robot file and measure validation pairs of the plan before and after.

    Raises `VerdictBad` when their mean error became larger; then,
    and after whatever else kept them from being measured, the old parameters are back.
    """
    terms = terms or LoadTerms()
    wanted = _wanted(campaign, source, terms)
    with campaign.journal() as journal, connection as cell:
        verifier = _Verifier(campaign, journal, cell, setup)
        return _Loading(campaign, journal, cell.robot, terms, verifier).load(wanted)


def roll_back(
    campaign: Campaign,
    connection: AbstractContextManager[RobotController],
    terms: LoadTerms | None = None,
) -> LoadResult:
    """Take back the latest load that took effect and was not taken back yet.

    Raises `ShotsMissing` when there is none.
    """
    terms = terms or LoadTerms()
    if not campaign.journal_path.exists():
        raise _nothing_to_take_back(campaign)
    with campaign.journal() as journal:
        history = load_history(journal)
        if not history.effective and history.unended is None:
            raise _nothing_to_take_back(campaign)
        with connection as controller:
            return _Loading(campaign, journal, controller, terms).roll_back()


def _nothing_to_take_back(campaign: Campaign) -> ShotsMissing:
    return ShotsMissing(
        f"{campaign.folder}: no load is in effect that could be taken back",
        remedy="there is nothing to roll back; name a robot file with --file",
    )


def _wanted(campaign: Campaign, source: Path | None, terms: LoadTerms) -> _Wanted:
    """File with what speaks against it; raises `ConfigInvalid` unless that is overruled."""
    source = source or campaign.path(parameter_file.FILE_NAME)
    robot, nominal = read_robot(source).robot, campaign.robot
    require_same_mechanism(source, robot, nominal)
    objections = tuple(file_objections(robot, campaign.config.name, nominal))
    if not terms.force:
        refuse(source, objections)
    return _Wanted(source, robot, objections)


@dataclass(frozen=True, slots=True, eq=False)
class _Loading:
    """Connected controller and open journal, and what is done with them."""

    campaign: Campaign
    journal: Journal
    controller: RobotController
    terms: LoadTerms
    verifier: _Verifier | None = None

    def load(self, wanted: _Wanted) -> LoadResult:
        """Load a file."""
        held = self._held()
        expected = (wanted.robot.provenance or {}).get("controller_serial")
        return self._carry_out(self._checked(wanted, expected), held)

    def roll_back(self) -> LoadResult:
        """Put back what the latest effective load replaced."""
        held = self._held()
        standing = load_history(self.journal).standing(held)
        if not standing:
            raise _nothing_to_take_back(self.campaign)
        latest = standing[-1]
        source = self.campaign.path(latest.record.kept)
        robot = read_robot(source).robot
        require_same_mechanism(source, robot, self.campaign.robot)
        what = f"what the controller held before the load of {latest.record.source}"
        if not differing(held, robot.geometry_flat()):
            self.terms.tell(f"{what} ({latest.at_utc}) was put back already by other means")
            if not self.terms.dry:
                already_back(self.journal, latest, robot.digest())
            return LoadResult(source, "already")
        self.terms.tell(f"puts back {source.name}: {what} ({latest.at_utc})")
        wanted = _Wanted(source, robot, takes_back=latest)
        return self._carry_out(self._checked(wanted, latest.record.controller_serial), held)

    def _held(self) -> dict[str, float]:
        """What the controller holds; tells of a load without an end, and ends it in the journal."""
        held = dict(self.controller.read_geometry())
        unended = load_history(self.journal).unended
        if unended is not None:
            self.terms.tell(unended.told(held))
            if not self.terms.dry:
                settle(self.journal, unended, held, "found when the controller was read again")
        return held

    def _checked(self, wanted: _Wanted, expected_serial: object) -> _Wanted:
        """With what the controller's serial number says; raises `ConfigInvalid`.

        Also for parameters that its kinematics lacks, which no force can put into it.
        """
        wanted.robot.controller_flat(self.controller.lacks(wanted.robot.extended_by))
        found = tuple(serial_objections(expected_serial, self.controller.identity().serial))
        if not self.terms.force:
            refuse(wanted.source, found)
        objections = (*wanted.objections, *found)
        for each in objections:
            self.terms.tell(f"overruled by --force: {each.problem}")
        return _Wanted(wanted.source, wanted.robot, objections, wanted.takes_back)

    def _carry_out(self, wanted: _Wanted, held: dict[str, float]) -> LoadResult:
        values = wanted.robot.geometry_flat()
        if not differing(held, values):
            return LoadResult(wanted.source, "already")
        shots = self.verifier.shots(held, values) if self.verifier else ()
        self.terms.approve(self.controller.identity(), changes(held, wanted.robot))
        if self.terms.dry:
            return LoadResult(wanted.source, "dry")
        with self.terms.uninterrupted:
            verifier = self.verifier
            before = verifier and verifier.measured("verify before", held, shots)
            kept = keep(self.campaign.folder, self.campaign.nominal, held)
            intent = self._intent(wanted, kept, held, shots)
            begun = begin(self.journal, intent)
            self._write(begun, intent)
            found = None
            if verifier and before:
                found = self._verified(begun, intent, shots, verifier, before)
            end(self.journal, begun, intent, None if found is None else found.document())
        return LoadResult(wanted.source, "loaded", kept, intent.forced, found)

    def _intent(
        self,
        wanted: _Wanted,
        kept: Path,
        held: Mapping[str, float],
        shots: tuple[PlannedShot, ...],
    ) -> LoadIntent:
        return LoadIntent(
            source=wanted.source.name,
            digest=wanted.robot.digest(),
            kept=kept.name,
            wanted=wanted.robot.geometry_flat(),
            held=held,
            controller_serial=self.controller.identity().serial,
            rolls_back=wanted.takes_back.number if wanted.takes_back else None,
            verify=len(shots) // 2,
            forced=tuple(each.problem for each in wanted.objections),
        )

    def _write(self, begun: int, intent: LoadIntent) -> None:
        """Write and read back; a failure is ended in the journal where its outcome is known."""
        try:
            write_verified(self.controller, intent.wanted, intent.held)
        except (DeviceRefused, LoadNotVerified) as error:
            unended = UnendedLoad(begun, "", intent)
            with suppress(DriverError, JournalFailed):  # what went wrong first is what counts
                settle(self.journal, unended, self.controller.read_geometry(), error.problem)
            raise

    def _verified(
        self,
        begun: int,
        intent: LoadIntent,
        shots: tuple[PlannedShot, ...],
        verifier: _Verifier,
        before: _PairErrors,
    ) -> Verification:
        """Measure with the new parameters; raises `VerdictBad` when they are worse."""
        try:
            after = verifier.measured("verify after", intent.wanted, shots)
        except BaseException as error:
            self._take_back(begun, intent, f"not verified: {problem_of(error)}")
            raise
        if after.mean_mm <= before.mean_mm:
            series = (before.series, after.series)
            return Verification(intent.verify, before.mean_mm, after.mean_mm, series)
        worse = (
            f"distances of {intent.verify} pairs are off by {after.mean_mm:.3f} mm on average "
            f"after loading {intent.source}, before it was {before.mean_mm:.3f} mm"
        )
        self._take_back(begun, intent, worse)
        raise VerdictBad(
            f"{worse}; rolled back, the controller holds the old parameters",
            remedy="identify again, with other shots or parameters",
        )

    def _take_back(self, begun: int, intent: LoadIntent, reason: str) -> None:
        """Put the old parameters back and end the load; raises `LoadNotVerified`."""
        put_back(self.controller, intent.held)
        fail(self.journal, begun, intent, reason)
        self.terms.tell(f"rolled back: the controller holds what it held before ({intent.kept})")
