"""State of a controller: which parameter set it holds, by the sets in the journal."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from pydantic import TypeAdapter, ValidationError

from campaigns.controllers.load import differing
from campaigns.errors import ConfigInvalid, FindingUnreadable
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.journal.records import Finding
from campaigns.kinematics.parameters import Parameters
from campaigns.robots.reduced_form import ReducedForm, form_of
from campaigns.robots.robot import RobotFile

StateKind = Literal["nominal", "identified", "form", "other"]


@dataclass(frozen=True, slots=True)
class ControllerState:
    """State of a controller by the digest of what it holds.

    `origin`: digest of the identified set that it is, or is a form of; "" for any other.
    """

    kind: StateKind
    digest: str
    origin: str = ""
    form: ReducedForm | None = None
    targets: bool = False
    """Whether targets were corrected with it for a controller that keeps the nominal set."""
    superseded: bool = False
    """Whether the campaign was identified again since."""
    declared: str = ""
    """File by which somebody says so; "": it was read from the controller."""

    @property
    def says(self) -> str:
        """What the controller holds."""
        words = "targets corrected with " if self.targets else ""
        words += self.form.says if self.form else self._named
        words += ", before the latest identification" if self.superseded else ""
        return f"{words} (declared by {self.declared}, not read)" if self.declared else words

    @property
    def _named(self) -> str:
        other = f"neither nominal nor identified parameters (sha256 {self.digest[:16]}…)"
        named = {
            "nominal": "the nominal parameters",
            "identified": "what was identified in this campaign",
        }
        return named.get(self.kind, other)


@dataclass(frozen=True, slots=True, eq=False)
class KnownSets:
    """Parameter sets that a controller may hold: nominal, identified, exported and loaded."""

    nominal: Parameters
    identified: Mapping[str, RecordedIdentification]
    """The campaign's identifications by the digests of what they found, latest last."""
    forms: Mapping[str, ReducedForm]
    """By the digests of sets that were exported or loaded."""
    sets: tuple[Parameters, ...]
    """All of them, the nominal one first."""

    @classmethod
    def of(cls, nominal: RobotFile, findings: Iterable[Finding]) -> "KnownSets":
        """Return the sets in findings, but for findings of another form."""
        identified: dict[str, RecordedIdentification] = {}
        forms: dict[str, ReducedForm] = {}
        sets = {nominal.digest(): nominal.parameters}
        for finding in findings:
            with suppress(FindingUnreadable, ConfigInvalid, ValidationError, KeyError):
                if finding.kind == "identification":
                    identification = read_identification(finding.body)
                    parameters = identification.parameter_set(nominal.mechanism)
                    sets[parameters.digest()] = parameters
                    identified.pop(parameters.digest(), None)
                    identified[parameters.digest()] = identification
                elif finding.kind in {"load begun", "load", "export"}:
                    wanted, digest = finding.body.get("wanted"), str(finding.body.get("digest"))
                    if isinstance(wanted, Mapping):
                        values = TypeAdapter(dict[str, float]).validate_python(wanted)
                        sets[digest] = Parameters.of(nominal.parameters.table, values)
                    form = form_of(finding.body, finding.kind)
                    if form is not None:
                        forms[digest] = form
        return cls(nominal.parameters, identified, forms, tuple(sets.values()))

    def held(self, values: Mapping[str, float]) -> Parameters:
        """Return the known set that a controller holds, perhaps in other units; else its own."""
        for candidate in self.sets:
            if not differing(values, candidate):
                return candidate
        return Parameters.of(self.nominal.table, values)

    def are_one(self, digest: str, other: str) -> bool:
        """Return whether two sets are the same to a controller, which may use other units."""
        by_digest = {each.digest(): each for each in self.sets}
        both = digest in by_digest and other in by_digest
        return digest == other or (both and not differing(by_digest[digest], by_digest[other]))

    def state_of(self, values: Mapping[str, float]) -> ControllerState:
        """Return the state of a controller that holds these values."""
        return self.state(self.held(values).digest())

    def state(self, digest: str) -> ControllerState:
        """Return the state of a controller that holds the set of this digest."""
        form = self.forms.get(digest) if digest not in self.identified else None
        origin = form.of if form else digest
        if digest == self.nominal.digest():
            return ControllerState("nominal", digest)
        if origin not in self.identified:
            return ControllerState("other", digest)
        superseded = origin != [*self.identified][-1]
        kind: StateKind = "form" if form else "identified"
        return ControllerState(kind, digest, origin, form, superseded=superseded)
