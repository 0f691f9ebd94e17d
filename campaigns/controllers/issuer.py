"""Issuer of a file: which campaign, and which identification in its journal, wrote it.

Names of files and campaigns repeat: each year has its cell-7, with a robot-compensated.yaml. So a
file states the campaign's identity and the record of its identification, and before the file is
used the campaign's journal is asked whether it holds this very record.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from pydantic import JsonValue

from campaigns.controllers.export import latest_identification, written_sets
from campaigns.controllers.objections import Objection, ObjectionName
from campaigns.errors import FindingUnreadable, ShotsMissing
from campaigns.journal.journal import JournalReader
from campaigns.kinematics.mechanism import Mechanism
from campaigns.robots.reduced_form import form_of
from campaigns.robots.robot import RobotFile

CAMPAIGN, IDENTITY = "campaign", "identity"
RECORD, RECORD_DIGEST = "identification_record", "identification_digest"
EXPORT = "take the file that `pkmcal export DIR` writes"
EXPORT_AGAIN = "`pkmcal export DIR --force` writes the file of the latest identification"


@dataclass(frozen=True, slots=True)
class Issuer:
    """Campaign that writes files, and what its journal holds of them."""

    name: str
    identity: str
    """Identity in campaign.yaml; "" in campaigns from before there were identities."""
    records: Mapping[int, str] = field(default_factory=dict)
    """Digests of the records of all identifications, by their numbers."""
    sets: frozenset[str] = frozenset()
    """Digests of the parameter sets that were identified last or written to files."""
    latest: str = ""
    """Digest of the set that was identified last; "" without one that can be read."""

    @classmethod
    def of(
        cls, name: str, identity: str, journal: JournalReader | None, mechanism: Mechanism
    ) -> "Issuer":
        """Return the issuer of a campaign's files; `journal` is None if there is none yet."""
        if journal is None:
            return cls(name, identity)
        numbers = [entry.number for entry in journal.findings("identification")]
        records = {number: journal.digest(through=number) for number in numbers}
        try:
            identified = latest_identification(journal).value.parameter_set(mechanism).digest()
        except (ShotsMissing, FindingUnreadable):
            identified = ""
        sets = {written.digest for written in written_sets(journal)} | {identified} - {""}
        return cls(name, identity, records, frozenset(sets), identified)

    def stated(self) -> dict[str, JsonValue]:
        """Return what a file of the latest identification states about its issuer."""
        record = max(self.records, default=0)
        digest = self.records.get(record, "")
        return {CAMPAIGN: self.name, IDENTITY: self.identity, RECORD: record, RECORD_DIGEST: digest}

    def objections(self, robot: RobotFile) -> Iterator[Objection]:
        """Yield objections to a robot file that is not of this campaign's latest identification."""
        stated = robot.provenance
        if not stated:
            text = "it does not say where its parameters come from"
            yield Objection(ObjectionName.ORIGIN, text, EXPORT)
            return
        if stated.get(CAMPAIGN) != self.name:
            text = f"it is of the campaign '{stated.get(CAMPAIGN)}', this one is '{self.name}'"
            yield Objection(ObjectionName.IDENTITY, text, EXPORT)
            return
        if RECORD not in stated:
            text = "it does not say which record of the journal its identification is"
            yield Objection(ObjectionName.ORIGIN, text, EXPORT_AGAIN)
            return
        yield from self._of_journal(robot, stated)

    def _of_journal(self, robot: RobotFile, stated: Mapping[str, JsonValue]) -> Iterator[Objection]:
        """Yield the objection that the journal does not hold what a file states, or has more."""
        number, form = stated[RECORD], form_of(stated, robot.name)
        if is_foreign(stated.get(IDENTITY), self.identity):
            text = (
                f"it is of another campaign of this name, of identity {stated.get(IDENTITY)}; "
                f"this one's is {self.identity or 'not stated'}"
            )
            yield Objection(ObjectionName.IDENTITY, text, EXPORT)
        elif not isinstance(number, int) or self.records.get(number) != stated.get(RECORD_DIGEST):
            text = f"the identification that it states, record {number}, is not in this journal"
            yield Objection(ObjectionName.IDENTITY, text, EXPORT_AGAIN)
        elif robot.digest() not in self.sets:
            text = "this campaign has identified and exported other parameters than the file's"
            yield Objection(ObjectionName.CHANGED, text, EXPORT_AGAIN)
        elif (form.of if form else robot.digest()) != self.latest:
            latest = max(self.records)
            text = f"it is of an earlier identification, record {number}, the latest is {latest}"
            yield Objection(ObjectionName.SUPERSEDED, text, EXPORT_AGAIN)


def is_foreign(stated: object, identity: str) -> bool:
    """Return whether a file that states an identity is another campaign's."""
    return (stated or "") != identity
