"""The journal's findings, as the report reads them: what it needs, and nothing is filled in."""

from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict, JsonValue, ValidationError

from campaigns.evaluation.decision import Decision
from campaigns.mechanisms.geometry import BACKLASH_NAMES


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


class ScatterFinding(_Finding):
    """What a test of χ² says of the stated noise, and what it means for σ."""

    value: float
    dof: int
    p: float | None
    believable: bool | None
    scale: float | None
    says: str


class CovarianceFinding(_Finding):
    """Of the parameters whose σ are known, mm and deg."""

    names: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]


class PositionStdFinding(_Finding):
    """Predicted uncertainty of position over the workspace, 1 σ, mm."""

    mean: float
    max: float


class FrameFinding(_Finding):
    """`tracker_from_base` by translation and the angles of the paper's eq. 23."""

    x_mm: float
    y_mm: float
    z_mm: float
    phi_deg: float
    gamma_deg: float
    psi_deg: float


class ModelFinding(_Finding):
    """One of the models that were compared."""

    name: str
    parameters: int
    bic: float | None
    unseen_rms_mm: float | None
    kept: bool
    outcome: str


class IdentificationFinding(_Finding):
    """An identification and what it rests on. Older ones lack what is None or empty here."""

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
    chi2: ScatterFinding | None = None
    covariance: CovarianceFinding | None = None
    position_std_mm: PositionStdFinding | None = None
    frame: FrameFinding | None = None
    known_by_priors_alone: tuple[tuple[str, ...], ...] = ()
    priors: dict[str, float] = {}
    models: tuple[ModelFinding, ...] = ()

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

    def backlash_deg(self) -> tuple[float, ...]:
        """What each gear was found to lose; 0 where that was not asked."""
        found = self.identified_flat()
        return tuple(found.get(name, 0.0) for name in BACKLASH_NAMES)


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
