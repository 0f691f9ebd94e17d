"""Export: identified parameters as a robot file, with their 1 σ and their provenance."""

# An exported file has to be trusted later, by `load` and by people, without the campaign at hand.
# So it states where its parameters come from, and only an identification that passed is exported,
# for the nominal robot that it was made with: held parameters keep the values of the nominal file.

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, Self

from pydantic import JsonValue, ValidationError

from campaigns.errors import ShotsMissing, VerdictBad
from campaigns.identification.result import RecordedIdentification, Value, read_identification
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import adapter_of
from campaigns.kinematics.parameters import Parameters, Role
from campaigns.robots.reduced_form import ReducedForm
from campaigns.robots.robot import RobotDocument, compensated
from campaigns.version import VERSION
from drivers.values import Identity

FILE_NAME = "robot-compensated.yaml"
PLAIN_FILE = "robot-plain.yaml"
PLAIN = "plain"
"""Name of the form without tilts, skews and gear errors, which every controller takes."""
CalibrationRoute = Literal["parameters", "targets"]
"""Means of calibration: parameters in the controller, or targets corrected for the controller."""

KEPT_AS_PROVENANCE = (
    "plan_digest",
    "journal_digest",
    "journal_records",
    "model",
    "shots",
    "residuals_mm",
    "unseen_mm",
    "verdict",
)


@dataclass(frozen=True, slots=True)
class WrittenSet:
    """Parameter set with which `export` or `correct` wrote a file, as the journal records it."""

    file: str
    """Name of the written file."""
    digest: str
    """Digest of the parameters."""
    wanted: dict[str, float]
    """Parameters by name, mm and deg."""
    by: CalibrationRoute = "parameters"
    sha256: str = ""
    """sha256 of the file's bytes; "" for corrected targets, of which there are many files."""
    projection: ReducedForm | None = None
    """Form of an identified set that was written; None: the whole set."""

    @classmethod
    def of(cls, file: str, parameters: Parameters, **further_fields: Any) -> Self:
        """Return the record of a file that was written with these parameters."""
        return cls(file, parameters.digest(), dict(parameters), **further_fields)


def written_sets(journal: JournalReader) -> Iterator[WrittenSet]:
    """Yield the sets that were written, latest first; unreadable records are left out."""
    for entry in reversed(journal.findings("export")):
        with suppress(ValidationError):
            yield adapter_of(WrittenSet).validate_python(entry.record.body)


def latest_identification(journal: JournalReader) -> RecordedIdentification:
    """Return the last identification of a campaign; raise `ShotsMissing` when there is none.

    Raise `FindingUnreadable` for a last one that another version wrote in another form.
    """
    entries = journal.findings("identification")
    if not entries:
        raise ShotsMissing(
            "nothing has been identified yet", remedy="run `pkmcal identify DIR` first"
        )
    return read_identification(entries[-1].record.body)


def compensated_robot(
    issuer: Mapping[str, JsonValue],
    nominal: RobotDocument,
    identification: RecordedIdentification,
    controller: Identity | None = None,
) -> RobotDocument:
    """Return the nominal robot with the identified parameters, their 1 σ and their provenance.

    `issuer` states the campaign and the identification's record (`issuer.py`). `controller` is the
    one that answered when the shots were taken; None if unknown, as for an
    import. Raise `VerdictBad` for a result that did not pass, or that rests on another nominal
    robot.
    """
    require_usable(nominal, identification)
    provenance = {**issuer, **_provenance(nominal, identification, controller)}
    return with_identified(nominal, identification.value, "compensated", provenance)


def with_identified(
    nominal: RobotDocument, value: Value, suffix: str, provenance: Mapping[str, JsonValue]
) -> RobotDocument:
    """Return the nominal robot, its name with a suffix, with identified parameters and 1 σ."""
    parameters, values = value.parameter_set(nominal.robot.mechanism), value.flat()
    # Lengths are those at the reference temperature. Expansions by warmth are no parameters of a
    # controller: the file states them beside the set, and they are not part of its digest.
    growth = parameters.table.select(Role.GROWTH)
    expansions = {each: values[each] for each in growth if each in value.free}
    reference = value.reference_degC if expansions else None
    name = f"{nominal.robot.name}-{suffix}"
    return compensated(nominal, name, parameters, provenance, expansions, reference)


def require_usable(nominal: RobotDocument, identification: RecordedIdentification) -> None:
    """Raise `VerdictBad` unless a result passed and rests on this very nominal robot."""
    judgement = identification.judgement
    if judgement.verdict != "pass":
        reasons = "; ".join(judgement.reasons)
        raise VerdictBad(
            f"the identification's verdict is '{judgement.verdict}': {reasons}",
            remedy="measure more or correct the campaign, then identify again",
        )
    if identification.provenance.robot_digest != nominal.robot.digest():
        raise VerdictBad(
            "the identification rests on another nominal robot than the campaign's file holds now",
            remedy="bring the robot file back, or identify again",
        )


def _provenance(
    nominal: RobotDocument, identification: RecordedIdentification, controller: Identity | None
) -> dict[str, JsonValue]:
    """Return the origin of the identified parameters, as the robot file states it."""
    document = identification.document()
    return {
        "software": f"pkmcal {VERSION}",
        "nominal_robot": nominal.robot.name,
        "nominal_digest": nominal.robot.digest(),
        "controller_serial": controller.serial or None if controller else None,
        "identified_utc": identification.provenance.at_utc,
        **{key: document[key] for key in KEPT_AS_PROVENANCE},
        **({"pedigree": document["pedigree"]} if identification.provenance.pedigree else {}),
    }
