"""The journal's findings, as the report reads them: what it needs, and nothing is filled in."""

from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict, JsonValue, ValidationError

from campaigns.decision import Decision


class UnreadableFinding(Exception):
    """A finding that another version of the software wrote in another form."""


class _Finding(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class ParameterFinding(_Finding):
    """One parameter, mm or deg; `std` is None when it is not known."""

    nominal: float
    value: float
    delta: float
    std: float | None
    free: bool


class ExcludedFinding(_Finding):
    """A shot or a pair that the identification left out."""

    reason: str
    shot: int | None = None
    pair: int | None = None


class IdentificationFinding(_Finding):
    """An identification and what it rests on."""

    estimator: str
    converged: bool
    iterations: int
    rank: int
    condition: float | None
    dof: int
    parameters: dict[str, ParameterFinding]
    excluded: tuple[ExcludedFinding, ...]
    unobservable: tuple[tuple[str, ...], ...]
    verdict: Decision
    reasons: tuple[str, ...]
    series: int
    robot_digest: str
    plan_digest: str
    journal_digest: str
    journal_records: int
    at_utc: str

    @property
    def free(self) -> tuple[str, ...]:
        """The names of what was identified."""
        return tuple(name for name, found in self.parameters.items() if found.free)

    def nominal_flat(self) -> dict[str, float]:
        """The parameters it began with."""
        return {name: found.nominal for name, found in self.parameters.items()}

    def identified_flat(self) -> dict[str, float]:
        """The parameters it found."""
        return {name: found.value for name, found in self.parameters.items()}


class LoadFinding(_Finding):
    """A parameter file that was written into the controller and read back."""

    source: str
    digest: str
    kept: str


def read_identification(body: Mapping[str, JsonValue]) -> IdentificationFinding:
    """Read it; raises `UnreadableFinding`."""
    try:
        return IdentificationFinding.model_validate(body)
    except ValidationError as error:
        raise UnreadableFinding(_problem(error)) from error


def read_load(body: Mapping[str, JsonValue]) -> LoadFinding:
    """Read it; raises `UnreadableFinding`."""
    try:
        return LoadFinding.model_validate(body)
    except ValidationError as error:
        raise UnreadableFinding(_problem(error)) from error


def _problem(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg'].lower()}"
