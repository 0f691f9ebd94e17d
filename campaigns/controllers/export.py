"""Export: what was identified as a robot file, with its uncertainty and where it comes from."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, Self

from pydantic import JsonValue, ValidationError

from campaigns.errors import ShotsMissing, VerdictBad
from campaigns.identification.result import RecordedIdentification, read_identification
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
"""Form of a set without tilts, skews and gears, which every controller takes."""
CalibrationRoute = Literal["parameters", "targets"]
"""What calibrates the robot: parameters in its controller, or targets corrected for it."""

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
    """Set that `export` or `correct` wrote a file with, as the journal has it; mm and deg.

    `sha256` is that of the file's bytes; "" of corrected targets, of which there are many.
    """

    file: str
    digest: str
    wanted: dict[str, float]
    by: CalibrationRoute = "parameters"
    sha256: str = ""
    projection: ReducedForm | None = None

    @classmethod
    def of(cls, file: str, parameters: Parameters, **more: Any) -> Self:
        """Set of these parameters. Any: the fields beyond."""
        return cls(file, parameters.digest(), dict(parameters), **more)


def written_sets(journal: JournalReader) -> Iterator[WrittenSet]:
    """Return sets that were written, latest first, but for those of another form."""
    for entry in reversed(journal.findings("export")):
        with suppress(ValidationError):
            yield adapter_of(WrittenSet).validate_python(entry.record.body)


def latest_identification(journal: JournalReader) -> RecordedIdentification:
    """Return the last identification of a campaign; raise `ShotsMissing` when there is none."""
    entries = journal.findings("identification")
    if not entries:
        raise ShotsMissing(
            "nothing has been identified yet", remedy="run `pkmcal identify DIR` first"
        )
    return read_identification(entries[-1].record.body)


def compensated_robot(
    campaign: str,
    nominal: RobotDocument,
    identification: RecordedIdentification,
    controller: Identity | None = None,
) -> RobotDocument:
    """Return the nominal robot with the identified parameters, their 1 σ and their provenance.

    `controller` answered when the shots were taken; None if unknown, as of an import.
    Raises `VerdictBad` for a result that did not pass, or that rests on another nominal robot.
    """
    require_usable(nominal, identification)
    robot, provenance = nominal.robot, _provenance(campaign, nominal, identification, controller)
    name = f"{robot.name}-compensated"
    parameters, values = identification.parameter_set(robot.mechanism), identification.flat()
    growth = parameters.table.select(Role.GROWTH)
    expansions = {each: values[each] for each in growth if each in identification.free}
    reference = identification.reference_degC if expansions else None
    return compensated(nominal, name, parameters, provenance, expansions, reference)


def require_usable(nominal: RobotDocument, identification: RecordedIdentification) -> None:
    """Raise `VerdictBad` for a result that did not pass, or that rests on another nominal robot."""
    if identification.verdict != "pass":
        reasons = "; ".join(identification.reasons)
        raise VerdictBad(
            f"the identification's verdict is '{identification.verdict}': {reasons}",
            remedy="measure more or correct the campaign, then identify again",
        )
    if identification.robot_digest != nominal.robot.digest():
        raise VerdictBad(
            "the identification rests on another nominal robot than the campaign's file holds now",
            remedy="bring the robot file back, or identify again",
        )


def _provenance(
    campaign: str,
    nominal: RobotDocument,
    identification: RecordedIdentification,
    controller: Identity | None,
) -> dict[str, JsonValue]:
    document = identification.document()
    return {
        "campaign": campaign,
        "software": f"pkmcal {VERSION}",
        "nominal_robot": nominal.robot.name,
        "nominal_digest": nominal.robot.digest(),
        "controller_serial": controller.serial or None if controller else None,
        "identified_utc": identification.at_utc,
        **{key: document[key] for key in KEPT_AS_PROVENANCE},
        **({"pedigree": document["pedigree"]} if identification.pedigree else {}),
    }
