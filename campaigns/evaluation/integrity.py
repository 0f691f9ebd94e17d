"""Integrity: whether a campaign's files still belong together, as an auditor would check it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pydantic import JsonValue


@dataclass(frozen=True, slots=True)
class Check:
    """Statement about the files, and whether it holds; None: there is nothing to compare."""

    statement: str
    holds: bool | None
    detail: str
    decides: bool = True
    """Whether nothing can pass when it does not hold."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedDigests:
    """Digests that an identification stated, beside those of what is there now."""

    robot: str
    nominal_now: str
    journal: str
    journal_now: str | None
    """Of the same records as they are now."""
    parameters: str
    """Of what it found."""
    file_now: str | None
    loaded: str | None
    validated_with: str | None
    by_targets: bool = False
    """Whether targets were corrected with it then, and nothing was loaded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignDigests:
    """Everything that is compared; None where there is nothing."""

    plan_now: str | None
    plan_measured: str | None
    is_import: bool
    identified: IdentifiedDigests | None
    limits_now: Mapping[str, JsonValue]
    limits_recorded: JsonValue
    """As they stood when the robot was validated after."""


def integrity_checks(found: CampaignDigests) -> tuple[Check, ...]:
    """Every link of the chain from plan to controller, and the limits."""
    return (*_measured(found), *_identified(found.identified), _limits(found))


def _measured(found: CampaignDigests) -> Iterator[Check]:
    if not found.is_import:
        statement = "plan.csv is the plan that was measured"
        yield _same(statement, found.plan_now, found.plan_measured)


def _identified(found: IdentifiedDigests | None) -> Iterator[Check]:
    if found is None:
        yield Check("the results belong to one identification", None, "nothing was identified")
        return
    statement = "the nominal robot is the one that was identified from"
    yield _same(statement, found.nominal_now, found.robot)
    statement = "the journal is unchanged up to the identification"
    yield _same(statement, found.journal_now, found.journal)
    yield _same("the parameter file holds what was identified", found.file_now, found.parameters)
    if found.by_targets:
        statement = "targets were corrected with it when it was validated after"
    else:
        yield _same("what was loaded last is what was identified", found.loaded, found.parameters)
        statement = "the controller held it when it was validated after"
    yield _same(statement, found.validated_with, found.parameters)


def _limits(found: CampaignDigests) -> Check:
    """Limits may be set late, but a reader should know."""
    statement = "the limits are those that stood when the robot was validated after"
    if found.limits_recorded is None:
        return Check(statement, None, "nothing to compare", decides=False)
    holds = found.limits_recorded == found.limits_now
    detail = "as in the journal" if holds else "changed in campaign.yaml since"
    return Check(statement, holds, detail, decides=False)


def _same(statement: str, one: str | None, other: str | None) -> Check:
    if not one or not other:
        return Check(statement, None, "nothing to compare")
    if one == other:
        return Check(statement, holds=True, detail=f"sha256 {one[:16]}…")
    return Check(statement, holds=False, detail=f"sha256 {one[:16]}… is not {other[:16]}…")
