"""Writes what was identified as a robot file: parameters, uncertainty, and where they come from."""

from collections.abc import Mapping
from pathlib import Path

from pydantic import JsonValue, TypeAdapter

from campaigns.errors import ShotsMissing, VerdictBad
from campaigns.files.text_file import write_text_unless_there
from campaigns.identification.result import ParameterEntry
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import Finding
from campaigns.mechanisms.geometry import BACKLASH_NAMES
from campaigns.robots.robot import Compensation, RobotDocument, compensated
from campaigns.version import VERSION

FILE_NAME = "robot-compensated.yaml"

KEPT_AS_PROVENANCE = (
    "plan_digest",
    "journal_digest",
    "journal_records",
    "estimator",
    "shots",
    "residuals_mm",
    "unseen_mm",
    "verdict",
)

_PARAMETERS = TypeAdapter(dict[str, ParameterEntry])


def latest_identification(journal: JournalReader) -> Mapping[str, JsonValue]:
    """The last identification of a campaign; raises `ShotsMissing` when there is none."""
    found = [e.record for e in journal.records_of(Finding) if e.record.kind == "identification"]
    if not found:
        raise ShotsMissing("nothing has been identified yet", remedy="run `pkmcal identify` first")
    return found[-1].body


def compensated_robot(
    campaign: str, nominal: RobotDocument, finding: Mapping[str, JsonValue]
) -> RobotDocument:
    """The nominal robot with the identified parameters, their 1 σ and their provenance.

    A backlash is no part of the geometry: it is reported, and stays out of the file.
    Raises `VerdictBad` for a result that did not pass, or that rests on another nominal robot.
    """
    _check_usable(nominal, finding)
    found = _PARAMETERS.validate_python(finding["parameters"])
    parameters = {name: entry for name, entry in found.items() if name not in BACKLASH_NAMES}
    return compensated(
        nominal,
        Compensation(
            f"{nominal.robot.name}-compensated",
            {name: entry.value for name, entry in parameters.items()},
            {name: e.std for name, e in parameters.items() if e.std is not None},
            _provenance(campaign, nominal, finding),
        ),
    )


def write_compensated(path: Path, robot: RobotDocument, *, overwrite: bool) -> None:
    """Write the file; raises `OutputExists` unless `overwrite`, or `WriteFailed`.

    A file that could not be replaced is left as it was.
    """
    write_text_unless_there(path, robot.document.text, overwrite=overwrite)


def _check_usable(nominal: RobotDocument, finding: Mapping[str, JsonValue]) -> None:
    if finding["verdict"] != "pass":
        raise VerdictBad(
            f"the identification's verdict is '{finding['verdict']}': {_reasons(finding)}",
            remedy="measure more or correct the campaign, then identify again",
        )
    if finding["robot_digest"] != nominal.robot.digest():
        raise VerdictBad(
            "the identification rests on another nominal robot than the campaign's file holds now",
            remedy="bring the robot file back, or identify again",
        )


def _provenance(
    campaign: str, nominal: RobotDocument, finding: Mapping[str, JsonValue]
) -> dict[str, JsonValue]:
    return {
        "campaign": campaign,
        "software": f"pkmcal {VERSION}",
        "nominal_robot": nominal.robot.name,
        "nominal_digest": nominal.robot.digest(),
        "identified_utc": finding["at_utc"],
        **{key: finding[key] for key in KEPT_AS_PROVENANCE},
    }


def _reasons(finding: Mapping[str, JsonValue]) -> str:
    reasons = finding["reasons"]
    return "; ".join(str(r) for r in reasons) if isinstance(reasons, list) else ""
