"""Loads in the journal: begun, ended, taken back, and found again when the process died."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import Enum

from pydantic import JsonValue

from campaigns.controllers.load import differing
from campaigns.errors import FindingUnreadable
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding, read_body
from campaigns.robots.reduced_form import FORM, ReducedForm

AGAIN = "load again"
FOUND_AGAIN = "found when the controller was read again"


class Holding(Enum):
    """Holding of a controller after a load that did not end; the value says it."""

    NEW = "the new parameters"
    OLD = "the old parameters"
    OTHER = "neither the old nor the new parameters"


@dataclass(frozen=True, slots=True, kw_only=True)
class Load:
    """Load of a robot file; parameters by name, mm and deg. `kept` is the file of the old ones."""

    source: str
    digest: str
    kept: str
    wanted: Mapping[str, float] = field(default_factory=dict)
    """About to be written; the record of a load that ended does not repeat them."""
    held: Mapping[str, float] = field(default_factory=dict)
    """What they replace."""
    controller_serial: str | None = None
    rolls_back: int | None = None
    """Record of the load that this one takes back."""
    verify: int = 0
    """Verification pairs asked for."""
    forced: tuple[str, ...] = ()
    """Objections that were overruled."""
    projection: ReducedForm | None = None
    """What the set is a form of; None: a whole set, and in old journals."""
    begun: int | None = None
    """Record of its beginning; None in journals that have none."""
    number: int = 0
    """Record of its end, or of its beginning while it has none."""
    at_utc: str = ""

    def holding(self, held: Mapping[str, float]) -> Holding:
        """Return what a controller that has these parameters holds of a load that was begun."""
        if not differing(held, self.wanted):
            return Holding.NEW
        return Holding.OTHER if differing(held, self.held) else Holding.OLD

    def told(self, held: Mapping[str, float] | None) -> str:
        """Describe a load without an end; None: no one has asked the controller."""
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

    def _ended(self) -> dict[str, JsonValue]:
        """Return the body of the record that it took effect."""
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
        """Write that it is about to be written, as it stands then."""
        body = self._ended() | {"verify": self.verify}
        del body["begun"]
        sets: dict[str, JsonValue] = {"wanted": {**self.wanted}, "held": {**self.held}}
        begun = journal.append(Finding("load begun", body | sets))
        return replace(self, begun=begun, number=begun)

    def end(self, journal: Journal, verification: dict[str, JsonValue] | None) -> None:
        """Write that it took effect, and what its verification pairs said."""
        journal.append(Finding("load", self._ended() | {"verification": verification}))

    def fail(self, journal: Journal, reason: str) -> None:
        """Write that it took no effect: the controller holds what it held before."""
        body: dict[str, JsonValue] = {"source": self.source, "begun": self.begun, "reason": reason}
        journal.append(Finding("load failed", body))

    def settle(self, journal: Journal, held: Mapping[str, float], reason: str) -> None:
        """Write the end that it lacks, by what the controller holds, if that decides it."""
        holding = self.holding(held)
        if holding is Holding.NEW:
            body = self._ended() | {"verification": None, "reason": reason}
            journal.append(Finding("load", body))
        elif holding is Holding.OLD:
            self.fail(journal, reason)


def standing_loads(journal: JournalReader, held: Mapping[str, float]) -> tuple[Load, ...]:
    """Return the effective loads, with the unended one as the controller's parameters show it."""
    effective, unended = load_history(journal)
    if unended is None:
        return effective
    holding = unended.holding(held)
    going_back = unended.rolls_back is not None
    if holding is Holding.OLD or (holding is Holding.OTHER and going_back):
        return effective
    return _after(effective, unended)


def load_history(journal: JournalReader) -> tuple[tuple[Load, ...], Load | None]:
    """Return loads that took effect and were not taken back, and one without an end.

    Before one that cannot be read, or of a version that wrote no beginning, none can be put back.
    Raises `FindingUnreadable` for a begun load in another form.
    """
    effective: tuple[Load, ...] = ()
    unended: Load | None = None
    for entry in journal.records_of(Finding):
        kind, body, number = entry.record.kind, entry.record.body, entry.number
        if kind not in {"load begun", "load failed", "load"}:
            continue
        unended = None
        if kind == "load begun":
            begun = replace(read_load(body), begun=number)
            if not (begun.wanted and begun.held):
                raise FindingUnreadable("the journal's load, wanted, held: missing", remedy=AGAIN)
            unended = replace(begun, number=number, at_utc=entry.at_utc)
        elif kind == "load":
            try:
                ended = replace(read_load(body), number=number, at_utc=entry.at_utc)
                effective = _after(effective, ended)
            except FindingUnreadable:
                effective = ()
    return effective, unended


def read_load(body: Mapping[str, JsonValue]) -> Load:
    """Load as the journal has it; raises `FindingUnreadable`."""
    return read_body(body, Load, "load", AGAIN)


def already_back(journal: Journal, load: Load, digest: str) -> None:
    """Write that what a load replaced is there again, by other means than ours."""
    body: dict[str, JsonValue] = {"source": load.kept, "digest": digest, "kept": load.kept}
    journal.append(Finding("load", body | {"rolls_back": load.number}))


def _after(effective: tuple[Load, ...], load: Load) -> tuple[Load, ...]:
    """Return loads in effect after one more, which may have taken others back."""
    if load.rolls_back is not None:
        return tuple(each for each in effective if each.number < load.rolls_back)
    return () if load.begun is None else (*effective, load)
