"""Whether the campaign's files still belong together: what an auditor would check by hand."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from app.report.evidence import Evidence
from campaigns.mechanisms.geometry import AXIS_TILT_NAMES, PARAMETER_NAMES
from campaigns.planning.plan_file import plan_digest
from campaigns.robots.robot import RobotFile


@dataclass(frozen=True, slots=True)
class Check:
    """A statement about the files, and whether it holds; None: there is nothing to compare."""

    statement: str
    holds: bool | None
    detail: str
    decides: bool = True
    """Whether nothing can pass when it does not hold."""


def integrity_checks(evidence: Evidence) -> tuple[Check, ...]:
    """Every link of the chain from plan to controller, and the limits."""
    return (*_measured(evidence), *_identified(evidence), _limits(evidence))


def identified_digest(nominal: RobotFile, flat: Mapping[str, float]) -> str:
    """The digest of a parameter set, as the file that holds it states it."""
    known = {name: flat[name] for name in (*PARAMETER_NAMES, *AXIS_TILT_NAMES) if name in flat}
    return RobotFile.from_flat(known, name=nominal.name, limits=nominal.limits).digest()


def _measured(evidence: Evidence) -> Iterator[Check]:
    plan = None if evidence.plan is None else plan_digest(evidence.plan)
    run = None if evidence.run is None else evidence.run.series.started
    if run is None or run.stage == "run":
        measured = None if run is None else run.plan_digest
        yield _same("plan.csv is the plan that was measured", plan, measured)


def _identified(evidence: Evidence) -> Iterator[Check]:
    found, nominal = evidence.identification, evidence.campaign.nominal.robot
    if found is None:
        yield Check("the results belong to one identification", None, "nothing was identified")
        return
    statement = "the nominal robot is the one that was identified from"
    yield _same(statement, nominal.digest(), found.robot_digest)
    journal = None if evidence.journal is None else evidence.journal.identified_digest
    statement = "the journal is unchanged up to the identification"
    yield _same(statement, journal, found.journal_digest)
    identified = identified_digest(nominal, found.identified_flat())
    in_file = None if evidence.parameter_file is None else evidence.parameter_file.digest()
    yield _same("the parameter file holds what was identified", in_file, identified)
    loaded = None if evidence.loaded is None else evidence.loaded.digest
    yield _same("what was loaded last is what was identified", loaded, identified)
    after = None if evidence.after is None else evidence.after.series.started.robot_file_digest
    yield _same("the controller held it when it was validated after", after, identified)


def _limits(evidence: Evidence) -> Check:
    """Limits may be set late, but a reader should know."""
    statement = "the limits are those that stood when the robot was validated after"
    recorded = None if evidence.after is None else evidence.after.series.started.configuration
    if not recorded or "acceptance" not in recorded:
        return Check(statement, None, "nothing to compare", decides=False)
    now = evidence.campaign.config.acceptance.model_dump(mode="json")
    holds = recorded["acceptance"] == now
    detail = "as in the journal" if holds else "changed in campaign.yaml since"
    return Check(statement, holds, detail, decides=False)


def _same(statement: str, one: str | None, other: str | None) -> Check:
    if not one or not other:
        return Check(statement, None, "nothing to compare")
    if one == other:
        return Check(statement, holds=True, detail=f"sha256 {one[:16]}…")
    return Check(statement, holds=False, detail=f"sha256 {one[:16]}… is not {other[:16]}…")
