"""Loads in the journal: begun, ended, taken back, and found again when the process died."""

# Three kinds of findings, written in this order:
#
#   load begun    just before the controller is written: the wanted set, the held one, the backup
#   load          the new set is in the controller, verified; `rolls_back` names the load undone
#   load failed   the controller holds what it held before
#
# A `load begun` that neither of the others follows is a load without an end: the process died, or
# the outcome was unknown. The next load or validation compares the controller's parameters with
# both recorded sets, and writes the missing end (`settle`). A mixture stays without an end.
# Effective loads form a stack: a rollback removes the load that it names and all later ones. The
# stack begins again at a load that cannot be undone: an unreadable one, or one without a beginning.

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from pathlib import Path

from pydantic import JsonValue

from campaigns.controllers.load import differing
from campaigns.errors import FindingUnreadable, JournalFailed
from campaigns.journal.journal import Journal, JournalReader, read_journal
from campaigns.journal.records import Finding, read_body
from campaigns.robots.reduced_form import FORM, ReducedForm

LOAD_AGAIN = "load again"
FOUND_AGAIN = "found when the controller was read again"


class Holding(Enum):
    """Set that a controller holds after a load without an end; the value is its description."""

    NEW = "the new parameters"
    OLD = "the old parameters"
    OTHER = "neither the old nor the new parameters"


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """Load of a robot file into a controller, as the journal records it."""

    source: str
    """Name of the loaded robot file."""
    digest: str
    """Digest of the loaded set."""
    kept: str
    """Name of the robot file with the replaced parameters."""
    wanted: Mapping[str, float] = field(default_factory=dict)
    """Parameters to write, by name, mm and deg; empty in the record of a load that ended."""
    held: Mapping[str, float] = field(default_factory=dict)
    """Parameters that are replaced, by name, mm and deg; empty as for `wanted`."""
    controller_serial: str | None = None
    rolls_back: int | None = None
    """Record number of the load that this load takes back; None: it takes back none."""
    verify: int = 0
    """Number of verification pairs that were requested."""
    forced: tuple[str, ...] = ()
    """Objections that were overruled."""
    projection: ReducedForm | None = None
    """Form of an identified set that is loaded; None for a whole set, and in old journals."""
    begun: int | None = None
    """Record number of the load's beginning; None in journals that have none."""
    number: int = 0
    """Record number of the load's end, or of its beginning while it has no end."""
    at_utc: str = ""
    """Time of the record of that number."""

    def holding(self, held: Mapping[str, float]) -> Holding:
        """Return which of the load's two sets a controller with these parameters holds."""
        if not differing(held, self.wanted):
            return Holding.NEW
        return Holding.OTHER if differing(held, self.held) else Holding.OLD

    def describe(self, held: Mapping[str, float] | None) -> str:
        """Describe a load without an end in a sentence.

        `held` are the controller's parameters; None: the controller was not asked.
        """
        begun = f"a load of {self.source} was begun at {self.at_utc} and not ended"
        if held is None:
            return f"{begun}; `pkmcal load DIR --dry` says what the controller holds now"
        holding = self.holding(held)
        advice = {
            Holding.NEW: ", without the verification asked for" if self.verify else "",
            Holding.OLD: "",
            Holding.OTHER: ": don't move the robot; load again, or put the old ones back with "
            "`pkmcal load DIR --rollback`",
        }
        return f"{begun}; the controller holds {holding.value} now{advice[holding]}"

    def _ended_body(self) -> dict[str, JsonValue]:
        """Return the body of the record that the load took effect."""
        return {
            "source": self.source,
            "digest": self.digest,
            "kept": self.kept,
            "controller_serial": self.controller_serial,
            "begun": self.begun,
            "rolls_back": self.rolls_back,
            "forced": list(self.forced),
            FORM: asdict(self.projection) if self.projection else None,
        }

    def begin(self, journal: Journal) -> "Load":
        """Write the beginning of the load into the journal; return the load with its number.

        Both sets are in the record: it alone has to decide, after a crash, what a controller holds.
        """
        body = self._ended_body() | {"verify": self.verify}
        del body["begun"]
        sets: dict[str, JsonValue] = {"wanted": {**self.wanted}, "held": {**self.held}}
        begun = journal.append(Finding("load begun", body | sets))
        return replace(self, begun=begun, number=begun)

    def end(self, journal: Journal, verification: dict[str, JsonValue] | None) -> None:
        """Write that the load took effect, and the result of its verification pairs."""
        journal.append(Finding("load", self._ended_body() | {"verification": verification}))

    def fail(self, journal: Journal, reason: str) -> None:
        """Write that the load took no effect: the controller holds what it held before."""
        body: dict[str, JsonValue] = {"source": self.source, "begun": self.begun, "reason": reason}
        journal.append(Finding("load failed", body))

    def settle(self, journal: Journal, held: Mapping[str, float], reason: str) -> None:
        """Write the missing end by what the controller holds; a mixture stays without an end."""
        holding = self.holding(held)
        if holding is Holding.NEW:
            body = self._ended_body() | {"verification": None, "reason": reason}
            journal.append(Finding("load", body))
        elif holding is Holding.OLD:
            self.fail(journal, reason)


def standing_loads(journal: JournalReader, held: Mapping[str, float]) -> tuple[Load, ...]:
    """Return the effective loads; a load without an end counts as the controller shows it.

    `held` are the controller's parameters by name, mm and deg.
    """
    effective, unended = load_history(journal)
    if unended is None:
        return effective
    holding = unended.holding(held)
    is_rollback = unended.rolls_back is not None
    # A mixture that a load left is put right by undoing this load: it counts as effective. One
    # that a rollback left is put right by repeating the rollback, so the stack stays as it was.
    if holding is Holding.OLD or (holding is Holding.OTHER and is_rollback):
        return effective
    return _after(effective, unended)


def load_history(journal: JournalReader) -> tuple[tuple[Load, ...], Load | None]:
    """Return the loads that took effect and were not taken back, and the load without an end.

    The second is None if the latest load has an end. Raise `FindingUnreadable` for a begun load in
    another form.
    """
    effective: tuple[Load, ...] = ()
    unended: Load | None = None
    for entry in journal.records_of(Finding):
        kind, body, number = entry.record.kind, entry.record.body, entry.number
        if kind not in {"load begun", "load failed", "load"}:
            continue
        unended = None  # whatever follows a beginning, also another beginning, replaces it
        if kind == "load begun":
            begun = replace(read_load(body), begun=number)
            if not (begun.wanted and begun.held):
                raise FindingUnreadable(
                    "the journal's load, wanted, held: missing", remedy=LOAD_AGAIN
                )
            unended = replace(begun, number=number, at_utc=entry.at_utc)
        elif kind == "load":
            try:
                ended = replace(read_load(body), number=number, at_utc=entry.at_utc)
                effective = _after(effective, ended)
            except FindingUnreadable:
                effective = ()  # nothing below an unreadable load can be restored safely
    return effective, unended


def unended_in(path: Path) -> str:
    """Describe the load without an end that the journal in a file has; "" without one.

    Also "" for a journal that is missing or cannot be read: that is another error's matter.
    """
    try:
        with read_journal(path) as journal:
            _, unended = load_history(journal)
    except (JournalFailed, FindingUnreadable):
        return ""
    return unended.describe(None) if unended else ""


def read_load(body: Mapping[str, JsonValue]) -> Load:
    """Return the load of a record's body; raise `FindingUnreadable` for another form."""
    return read_body(body, Load, "load", LOAD_AGAIN)


def record_undone(journal: Journal, load: Load, digest: str) -> None:
    """Write that a load was undone by other means than ours; `digest` is of the restored set."""
    body: dict[str, JsonValue] = {"source": load.kept, "digest": digest, "kept": load.kept}
    journal.append(Finding("load", body | {"rolls_back": load.number}))


def replaced_by(journal: JournalReader, load: Load) -> Mapping[str, float]:
    """Return the parameters that a load replaced, by name, mm and deg; empty in old journals."""
    begun = (each for each in journal.findings("load begun") if each.number == load.begun)
    return next((read_load(each.record.body).held for each in begun), {})


def _after(effective: tuple[Load, ...], load: Load) -> tuple[Load, ...]:
    """Return the loads in effect after one more load, which may have taken others back."""
    if load.rolls_back is not None:
        return tuple(each for each in effective if each.number < load.rolls_back)
    return () if load.begun is None else (*effective, load)
