"""Chain from plan to controller: checks that what a campaign's folder holds belongs together.

Most links compare two digests. plan.csv must be the plan that was measured; nominal robot and
journal those that were identified from; the parameter file, the last load and the set that the
controller held in the validation must be the identified set or a form of it. What is stated of the
instruments must be what their records state. A link that does not hold keeps the verdict from being
a pass.
"""

from collections.abc import Iterator
from dataclasses import replace

from campaigns.controllers.controller_state import ControllerState
from campaigns.evaluation.stated_sources import SeriesSources, restated_observations
from campaigns.evaluation.verdict import Check, same_digest
from campaigns.evidence import Evidence, MeasuredSeries
from campaigns.identification.result import RecordedIdentification
from campaigns.planning.plan_file import plan_difference
from campaigns.settings.instrument import NamedInstruments, StatedInstrument


def checks_of_chain(evidence: Evidence) -> Iterator[Check]:
    """Yield the checks of the chain from plan to controller."""
    run, identification, journal = evidence.run, evidence.identification, evidence.journal
    # an import was measured without plan.csv
    without_plan = evidence.observations.files if run is None else _is_imported(run)
    if not without_plan:
        now, measured = _plan_digests_to_compare(evidence)
        of_plan = same_digest("plan.csv is the plan that was measured", now, measured)
        kept = evidence.older_plans.get(measured or "")
        if of_plan.holds is False and kept:
            of_plan = replace(of_plan, detail=f"{of_plan.detail}; {kept} is: rename it to plan.csv")
        yield of_plan
    if identification is None:
        yield Check("the results belong to one identification", None, "nothing was identified")
    else:
        mechanism = evidence.campaign.robot.mechanism
        parameters = identification.value.parameter_set(mechanism).digest()
        yield from _checks_of_bases(evidence, identification)
        yield _check_of_file(evidence, parameters)
        yield from _checks_of_controller(evidence, parameters)
    check = evidence.unanswered
    if check is not None and check.decision == "fail":
        detail = f"check, series {check.series}: {check.says}"
        yield Check("the robot is as it was identified", holds=False, detail=detail)
    yield _check_of_start(evidence)
    yield from checks_of_instrument(evidence)
    if journal is not None and journal.unended_load:
        statement = "it is known what the controller holds"
        yield Check(statement, holds=False, detail="a load was begun and not ended")


def _is_imported(run: MeasuredSeries) -> bool:
    """Return whether the shots to identify from were measured elsewhere."""
    return run.series.started.stage == "import"


def _plan_digests_to_compare(evidence: Evidence) -> tuple[str | None, str | None]:
    """Return the digests of plan.csv and of the measured plan, None for a missing one.

    Both are that of plan.csv if it has every measured shot as it was measured.
    """
    # An operator may add rows to plan.csv during a run, and delete rows that cannot be measured.
    # So equal digests are not demanded: it is the same plan if it has every measured shot as it
    # was measured.
    plan, now = evidence.plan, evidence.plan_digest
    if evidence.run is None:
        return now, None
    intents = [shot.intent for shot in evidence.run.series.shots]
    has_all = {intent.shot for intent in intents} <= {shot.shot for shot in plan or ()}
    if intents and has_all and not plan_difference(intents, plan or ()):
        return now, now
    return now, evidence.run.series.started.plan_digest


def _checks_of_bases(evidence: Evidence, identification: RecordedIdentification) -> Iterator[Check]:
    """Yield the checks that nominal robot, journal and settings are those of the identification."""
    journal, provenance = evidence.journal, identification.provenance
    statement = "the nominal robot is the one that was identified from"
    yield same_digest(statement, evidence.campaign.robot.digest(), provenance.robot_digest)
    statement = "the journal is unchanged up to the identification"
    journal_now = None if journal is None else journal.identified_digest
    yield same_digest(statement, journal_now, provenance.journal_digest)
    statement = "campaign.yaml says what it said when the identification was judged by it"
    if outdated := evidence.campaign.outdated(identification):
        yield Check(statement, holds=False, detail=f"{', '.join(outdated)} changed since")
    else:
        yield Check(statement, holds=True, detail="as then")


def _check_of_file(evidence: Evidence, identified: str) -> Check:
    """Check that the exported robot file, or else a form in the folder, is of the identified set.

    `identified` is the digest of this set.
    """
    statement = "the parameter file contains the identified parameters"
    if evidence.spoilt_parameter_file:
        return Check(statement, holds=False, detail="it cannot be read")
    form_origins = [form.projection.of for form in evidence.forms if form.projection]
    origin = evidence.file_origin or next(iter(form_origins), None)
    return same_digest(statement, origin, identified)


def _checks_of_controller(evidence: Evidence, identified: str) -> Iterator[Check]:
    """Yield the checks that the identified set came to the controller, by whichever route.

    `identified` is the digest of this set.
    """
    # Three routes: the set was loaded; or it was declared, and whatever was loaded earlier says
    # nothing; or targets were corrected with it, and nothing was loaded. So the last load is
    # compared on the first route alone.
    held, loaded = evidence.held("after"), evidence.loaded
    by_targets = held is not None and held.targets
    if not by_targets and not (held and held.declared):
        last = evidence.state(loaded.digest if loaded else None)
        yield _same_origin("what was loaded last is what was identified", last, identified)
    route = "the controller held the identified set"
    if by_targets:
        route = "targets were corrected with the identified set"
    yield _same_origin(f"{route} when the robot was validated after", held, identified)
    if loaded and held and held.origin == identified and evidence.loaded_since:
        statement = "the robot was validated after with what its controller holds now"
        yield Check(statement, holds=False, detail=f"{loaded.source} was loaded since")


def _same_origin(statement: str, held: ControllerState | None, identified: str) -> Check:
    """Check that a set is the identified one, or a form of it; the detail names the form."""
    if held is None or not held.origin:
        return same_digest(statement, held.digest if held else None, identified)
    check = same_digest(statement, held.origin, identified)
    is_qualified = held.form or held.declared
    return replace(check, detail=f"{held.says}, {check.detail}") if is_qualified else check


def _check_of_start(evidence: Evidence) -> Check:
    """Check that the robot was validated before calibration with nominal parameters.

    A campaign passes without it: the gain is then measured from the set that was held.
    """
    statement = "the controller held the nominal parameters when the robot was validated before"
    held = evidence.held("before")
    if held is None:
        return Check(statement, None, "nothing to compare", decides=False)
    return Check(statement, held.kind == "nominal", held.says, decides=False)


def checks_of_instrument(evidence: Evidence) -> Iterator[Check]:
    """Yield the checks that what is stated of the instruments is what their records state."""
    config, sources = evidence.campaign.config, sources_of(evidence)
    names = NamedInstruments.of(config.tracker, config.instruments)
    yield from sources.changed_later(StatedInstrument.of(config.tracker), names)
    yield from sources.restated()
    yield from restated_observations(evidence.observations.restated)


def sources_of(evidence: Evidence) -> SeriesSources:
    """Return the series with what their records state of the instruments."""
    return SeriesSources(
        counted=tuple(item.series for item in evidence.counted()),
        every=evidence.journal.series if evidence.journal else (),
        mechanism=evidence.campaign.robot.mechanism,
        instrument_of=evidence.campaign.instrument_of,
    )
