"""State of a controller: which parameter set it holds, by the sets in the journal."""

# A controller returns numbers, not names. Digests are sha256 of exact values, while a controller
# that keeps a length in other units returns it rounded. So numbers are first replaced by the
# matching set of the journal, by the tolerance of a read-back (load.py), and then by its digest.

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
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
    """State of a controller: kind and origin of the parameter set that it holds."""

    kind: StateKind
    digest: str
    """Digest of the held set."""
    origin: str = ""
    """Digest of the identified set that is held, whole or in a form; "" if none is."""
    form: ReducedForm | None = None
    """Form of the identified set that is held; None: another set, or the whole one."""
    targets: bool = False
    """Whether targets were corrected with the set, while the controller keeps the nominal one."""
    superseded: bool = False
    """Whether the campaign was identified again since."""
    declared: str = ""
    """File that an operator named as the held set; "": it was read from the controller."""

    @property
    def says(self) -> str:
        """Description of what the controller holds, for reports and errors."""
        words = "targets corrected with " if self.targets else ""
        words += self.form.says if self.form else self._named
        words += ", before the latest identification" if self.superseded else ""
        return f"{words} (declared by {self.declared}, not read)" if self.declared else words

    @property
    def _named(self) -> str:
        """Name of the held set, without forms, targets and declarations."""
        other = f"neither nominal nor identified parameters (sha256 {self.digest[:16]}…)"
        named = {
            "nominal": "the nominal parameters",
            "identified": "what was identified in this campaign",
        }
        return named.get(self.kind, other)


@dataclass(frozen=True, slots=True, eq=False)
class KnownSets:
    """Parameter sets that a controller may hold: nominal, identified, exported and loaded."""

    nominal: RobotFile
    identified: Mapping[str, RecordedIdentification]
    """The campaign's identifications by the digests of their parameters, latest last."""
    forms: Mapping[str, ReducedForm]
    """Reduced forms by the digests of the exported or loaded sets."""
    sets: tuple[Parameters, ...]
    """All parameter sets, the nominal one first."""

    @classmethod
    def of(cls, nominal: RobotFile, findings: Iterable[Finding]) -> "KnownSets":
        """Collect the sets in findings; findings that cannot be read are passed over."""
        identified: dict[str, RecordedIdentification] = {}
        forms: dict[str, ReducedForm] = {}
        sets = {nominal.digest(): nominal.parameters}
        for finding in findings:
            # one finding of an older version must not hide all others
            with suppress(FindingUnreadable, ConfigInvalid, ValidationError, KeyError):
                if finding.kind == "identification":
                    identification = read_identification(finding.body)
                    parameters = identification.value.parameter_set(nominal.mechanism)
                    sets[parameters.digest()] = parameters
                    # taken out first, so that a set that is found again becomes the latest one
                    identified.pop(parameters.digest(), None)
                    identified[parameters.digest()] = identification
                elif finding.kind in {"load begun", "load", "export"}:
                    wanted, digest = finding.body.get("wanted"), str(finding.body.get("digest"))
                    if isinstance(wanted, Mapping):
                        values = TypeAdapter(dict[str, float]).validate_python(wanted)
                        # a loaded set may lack a place of the reflector: the whole set stays
                        loaded = Parameters.of(nominal.parameters.table, values)
                        sets.setdefault(digest, loaded)
                    form = form_of(finding.body, finding.kind)
                    if form is not None:
                        forms[digest] = form
        return cls(nominal, identified, forms, tuple(sets.values()))

    def match(self, values: Mapping[str, float]) -> Parameters:
        """Return the set that agrees with a controller's values but for rounding.

        `values` are in mm and deg. Without a match they are returned as a set of their own.
        """
        for candidate in self.sets:
            if not differing(values, replace(self.nominal, parameters=candidate).for_controller):
                return candidate
        return Parameters.of(self.nominal.parameters.table, values)

    def are_one(self, digest: str, other: str) -> bool:
        """Return whether the sets of two digests differ by no more than a controller's rounding.

        Unequal digests of which one belongs to no known set count as different.
        """
        by_digest = {each.digest(): each for each in self.sets}
        both = digest in by_digest and other in by_digest
        return digest == other or (both and not differing(by_digest[digest], by_digest[other]))

    def state_of(self, values: Mapping[str, float]) -> ControllerState:
        """Return the state of a controller that holds these values."""
        return self.state(self.match(values).digest())

    def state(self, digest: str) -> ControllerState:
        """Return the state of a controller that holds the set of this digest."""
        # a set that was also identified as it stands counts as identified, not as a form
        form = self.forms.get(digest) if digest not in self.identified else None
        origin = form.of if form else digest
        if digest == self.nominal.digest():
            return ControllerState("nominal", digest)
        if origin not in self.identified:
            return ControllerState("other", digest)
        superseded = origin != [*self.identified][-1]
        kind: StateKind = "form" if form else "identified"
        return ControllerState(kind, digest, origin, form, superseded=superseded)
