"""Loads in the journal: begun, ended, taken back, and found again when the process died."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import TypeVar

from pydantic import JsonValue, TypeAdapter, ValidationError

from campaigns.controllers.load import LoadRecord, differing
from campaigns.errors import FindingUnreadable
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding
from campaigns.journal.views import Entry

RecordT = TypeVar("RecordT")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadIntent:
    """Parameters about to be written and those that they replace, by name, mm and deg."""

    source: str
    digest: str
    kept: str
    wanted: Mapping[str, float]
    held: Mapping[str, float]
    controller_serial: str
    rolls_back: int | None = None
    """Record of the load that this one takes back."""
    verify: int = 0
    """Verification pairs asked for."""
    forced: tuple[str, ...] = ()
    """Objections that were overruled."""


class Holding(Enum):
    """Holding of a controller after a load that did not end; the value says it."""

    NEW = "the new parameters"
    OLD = "the old parameters"
    OTHER = "neither the old nor the new parameters"


@dataclass(frozen=True, slots=True)
class UnendedLoad:
    """Load that was begun and has no end in the journal: the process died in between."""

    number: int
    at_utc: str
    intent: LoadIntent

    def holding(self, held: Mapping[str, float]) -> Holding:
        """Holding of a controller that has these parameters."""
        if not differing(held, self.intent.wanted):
            return Holding.NEW
        return Holding.OTHER if differing(held, self.intent.held) else Holding.OLD

    def told(self, held: Mapping[str, float] | None) -> str:
        """Sentence about it; None: nobody has asked the controller."""
        begun = f"a load of {self.intent.source} was begun at {self.at_utc} and not ended"
        if held is None:
            return f"{begun}; `pkmcal load DIR --dry` says what the controller holds now"
        found = self.holding(held)
        advice = {
            Holding.NEW: ", without the verification asked for" if self.intent.verify else "",
            Holding.OLD: "",
            Holding.OTHER: ": don't move the robot; load again, or put the old ones back with "
            "`pkmcal load DIR --rollback`",
        }
        return f"{begun}; the controller holds {found.value} now{advice[found]}"


@dataclass(frozen=True, slots=True)
class EffectiveLoad:
    """Load that took effect, by its place in the journal; `record.kept` is what it replaced."""

    number: int
    at_utc: str
    record: LoadRecord


@dataclass(frozen=True, slots=True)
class LoadHistory:
    """Loads that took effect and were not taken back, oldest first, and one without an end."""

    effective: tuple[EffectiveLoad, ...]
    unended: UnendedLoad | None

    def standing(self, held: Mapping[str, float]) -> tuple[EffectiveLoad, ...]:
        """Effective loads, with the unended one as the controller's parameters show it."""
        unended = self.unended
        if unended is None:
            return self.effective
        found = unended.holding(held)
        going_back = unended.intent.rolls_back is not None
        if found is Holding.OLD or (found is Holding.OTHER and going_back):
            return self.effective
        return _after(self.effective, unended.number, unended.at_utc, _record(unended))


def load_history(journal: JournalReader) -> LoadHistory:
    """History of a journal's loads, also of one from before loads were begun in it.

    Raises `FindingUnreadable` for a begun load in another form.
    """
    effective: tuple[EffectiveLoad, ...] = ()
    unended: UnendedLoad | None = None
    for entry in journal.records_of(Finding):
        kind, body = entry.record.kind, entry.record.body
        if kind == "load begun":
            unended = UnendedLoad(entry.number, entry.at_utc, _read(body, LoadIntent))
        elif kind == "load failed":
            unended = None
        elif kind == "load":
            unended, effective = None, _after_entry(effective, entry)
    return LoadHistory(effective, unended)


def read_load(body: Mapping[str, JsonValue]) -> LoadRecord:
    """Load as the journal has it; raises `FindingUnreadable`."""
    return _read(body, LoadRecord)


def begin(journal: Journal, intent: LoadIntent) -> int:
    """Number of the record that says what is about to be written."""
    return journal.append(Finding("load begun", asdict(intent)))


def end(
    journal: Journal, begun: int, intent: LoadIntent, verification: dict[str, JsonValue] | None
) -> None:
    """Write that a load took effect, and what its verification pairs said."""
    journal.append(Finding("load", _ended(begun, intent) | {"verification": verification}))


def fail(journal: Journal, begun: int, intent: LoadIntent, reason: str) -> None:
    """Write that a load took no effect: the controller holds what it held before."""
    body: dict[str, JsonValue] = {"source": intent.source, "begun": begun, "reason": reason}
    journal.append(Finding("load failed", body))


def already_back(journal: Journal, load: EffectiveLoad, digest: str) -> None:
    """Write that what a load replaced is there again, by other means than ours."""
    kept = load.record.kept
    body: dict[str, JsonValue] = {"source": kept, "digest": digest, "kept": kept}
    journal.append(Finding("load", body | {"rolls_back": load.number}))


def settle(
    journal: Journal, unended: UnendedLoad, held: Mapping[str, float], reason: str
) -> Holding:
    """Write the end of a load that has none, by what the controller holds, where that tells."""
    found = unended.holding(held)
    if found is Holding.NEW:
        body = _ended(unended.number, unended.intent) | {"verification": None, "reason": reason}
        journal.append(Finding("load", body))
    elif found is Holding.OLD:
        fail(journal, unended.number, unended.intent, reason)
    return found


def _ended(begun: int, intent: LoadIntent) -> dict[str, JsonValue]:
    return {
        "source": intent.source,
        "digest": intent.digest,
        "kept": intent.kept,
        "controller_serial": intent.controller_serial,
        "begun": begun,
        "rolls_back": intent.rolls_back,
        "forced": list(intent.forced),
    }


def _record(unended: UnendedLoad) -> LoadRecord:
    return read_load(_ended(unended.number, unended.intent))


def _after_entry(
    effective: tuple[EffectiveLoad, ...], entry: Entry[Finding]
) -> tuple[EffectiveLoad, ...]:
    try:
        record = read_load(entry.record.body)
    except FindingUnreadable:
        return ()  # nobody knows what it replaced, so nothing before it can be walked back to
    return _after(effective, entry.number, entry.at_utc, record)


def _after(
    effective: tuple[EffectiveLoad, ...], number: int, at_utc: str, record: LoadRecord
) -> tuple[EffectiveLoad, ...]:
    """Loads in effect after one more, which may have taken others back."""
    if record.rolls_back is not None:
        return tuple(each for each in effective if each.number < record.rolls_back)
    if record.begun is None:  # written when a rollback was known by the file that it put back
        kept = [each.record.kept for each in effective]
        if record.source in kept:
            return effective[: kept.index(record.source)]
    return (*effective, EffectiveLoad(number, at_utc, record))


def _read(body: Mapping[str, JsonValue], kind: type[RecordT]) -> RecordT:
    try:
        return TypeAdapter(kind).validate_python(body)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise FindingUnreadable(
            f"the journal's load, {'.'.join(map(str, first['loc']))}: {first['msg'].lower()}",
            remedy="load again",
        ) from error
