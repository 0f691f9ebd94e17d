"""Identification result: one type that is written to the journal, read back and shown.

Its fields are the keys of the document `pkmcal/identification/1`; parameters are in mm and deg.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from html import escape
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.errors import FindingUnreadable
from campaigns.estimation.estimators import Estimator, Outliers
from campaigns.estimation.information import ChiSquareTest, HoldOut, Uncertainty, WorkspaceSample
from campaigns.estimation.rigid_transforms import Transform, from_paper_angles, paper_angles_rad
from campaigns.estimation.variance_components import VarianceComponents
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.diagnostics import Doubt, limits_met
from campaigns.evaluation.identification import Combination
from campaigns.evaluation.region import Region
from campaigns.evaluation.summary import BeforeAfter, spread
from campaigns.files.table import Column, html_table
from campaigns.identification.known_lengths import KnownLengths
from campaigns.journal.records import adapter_of, read_body
from campaigns.mechanisms.mechanism import Axis
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "pkmcal/identification/1"
STRONG = 0.9
"""Correlations from here on are worth being told."""
STRONGEST = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedParameter:
    """One parameter before and after; `std` is 1 σ, None when unknown."""

    nominal: float
    value: float
    std: float | None
    free: bool
    total_std: float | None = None
    """With what all shots have in common; None in results of older software too."""

    @property
    def delta(self) -> float:
        """Identified minus nominal."""
        return self.value - self.nominal


PARAMETER_COLUMNS: tuple[Column[tuple[str, IdentifiedParameter]], ...] = (
    Column("parameter", lambda row: row[0], kind="code"),
    Column("nominal", lambda row: row[1].nominal, decimals=4),
    Column("identified", lambda row: row[1].value, decimals=4),
    Column("σ", lambda row: row[1].std, decimals=4),
)


@dataclass(frozen=True, slots=True)
class Excluded:
    """Shot or pair that was left out, and why; sizes only of an outlier."""

    reason: str
    shot: int | None = None
    pair: int | None = None
    size_mm: float | None = None
    """How far it is from where the others put it."""
    size_sigma: float | None = None
    limit_sigma: float | None = None
    """What would still be believed."""

    @property
    def what(self) -> str:
        """`shot 7`, `pair 3`, or `shot 7 of pair 3`."""
        words = {"shot": self.shot, "of pair" if self.shot is not None else "pair": self.pair}
        return " ".join(f"{word} {number}" for word, number in words.items() if number is not None)

    @property
    def is_outlier(self) -> bool:
        """Outlier: it could have been fitted, but the others contradict it."""
        return self.size_mm is not None


@dataclass(frozen=True, slots=True)
class ComparedModel:
    """One of several models: its price, what it knows of hold-out pairs, and what became of it."""

    name: str
    parameters: int
    bic: float | None
    """Schwarz's criterion; None where it could not be fitted."""
    unseen_rms_mm: float | None
    kept: bool
    outcome: str


@dataclass(frozen=True, slots=True)
class RippleRate:
    """How often the ripples of a set come, by the robot file's key."""

    key: str
    value: float


@dataclass(frozen=True, slots=True)
class NoiseTest:
    """Test of the stated noise by χ², what it means for σ, and both in words."""

    value: float
    dof: int
    p: float | None
    believable: bool | None
    scale: float | None
    """Square root of the variance factor, which multiplied every σ."""
    says: str

    @classmethod
    def of(cls, noise: ChiSquareTest, says: str) -> "NoiseTest":
        """From the test."""
        return cls(noise.chi2, noise.dof, noise.p, noise.consistent, noise.sigma0, says)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotScatter(VarianceComponents):
    """Robot's own scatter, that of the joints in their file unit, deg or mm; and in words."""

    says: str

    def components(self, joint: Axis) -> VarianceComponents:
        """The same with that of the joints in rad, or in mm of a carriage."""
        return VarianceComponents(self.point_mm, joint.from_file(self.joint))


@dataclass(frozen=True, slots=True)
class PositionStd:
    """Root of the summed variances of X, Y and Z over the workspace, mm: of the random part.

    None or empty in results of older software.
    """

    mean: float
    max: float
    total_mean: float | None = None
    """With what all shots have in common."""
    total_max: float | None = None
    common: dict[str, float] = field(default_factory=dict)
    """Mean over the workspace of what each of those moves positions by, as the others are."""
    left_out: int = 0
    """Poses of the sample that the parameters cannot assemble."""

    @classmethod
    def of(cls, known: Uncertainty, sample: WorkspaceSample) -> "PositionStd":
        """Over a sample of the workspace."""
        random, total = known.random.of_positions(sample), known.of_positions(sample)
        shifts = known.common_of_positions(sample)
        sizes = {name: float(np.linalg.norm(mm, axis=1).mean()) for name, mm in shifts.items()}
        ends = (float(each) for std in (random, total) for each in (std.mean(), std.max()))
        mean, most, total_mean, total_most = ends
        return cls(mean, most, total_mean, total_most, sizes, sample.left_out)


@dataclass(frozen=True, slots=True)
class Frame:
    """`tracker_from_base` by its translation and the angles of the paper's eq. 23."""

    x_mm: float
    y_mm: float
    z_mm: float
    phi_deg: float
    gamma_deg: float
    psi_deg: float

    @classmethod
    def of(cls, tracker_from_base: Transform) -> "Frame":
        """From a transform."""
        angles_deg = np.degrees(paper_angles_rad(tracker_from_base)).tolist()
        return cls(*tracker_from_base.translation_mm.tolist(), *angles_deg)

    @property
    def tracker_from_base(self) -> Transform:
        """As a transform."""
        angles = np.radians([self.phi_deg, self.gamma_deg, self.psi_deg])
        return from_paper_angles(angles, np.array([self.x_mm, self.y_mm, self.z_mm]))


@dataclass(frozen=True, slots=True)
class SessionFrame:
    """Shots of a session that has a frame of its own, by number, and that frame."""

    shots: tuple[int, ...]
    frame: Frame | None = None
    """None where no frame was estimated, or none of its shots was fitted."""


@dataclass(frozen=True, slots=True)
class ResidualTable:
    """Modelled minus measured with the nominal and the identified kinematics, mm, a row each.

    Rows are of shots (three coordinates in the tracker's axes) or of pairs (one distance).
    """

    of: Literal["shots", "pairs"]
    numbers: tuple[int, ...]
    before_mm: tuple[tuple[float, ...], ...]
    after_mm: tuple[tuple[float, ...], ...]

    @classmethod
    def from_arrays(
        cls, of: Literal["shots", "pairs"], numbers: tuple[int, ...], before: Array, after: Array
    ) -> "ResidualTable":
        """From errors (N, 3) or (N, 1)."""
        return cls(of, numbers, _rows(before), _rows(after))

    @property
    def before(self) -> Array:
        """(N, 3) or (N, 1)."""
        return np.array(self.before_mm)

    @property
    def after(self) -> Array:
        """(N, 3) or (N, 1)."""
        return np.array(self.after_mm)

    def summary(self) -> BeforeAfter:
        """Sizes before and after."""
        return BeforeAfter(spread(self.before), spread(self.after))


@dataclass(frozen=True, slots=True)
class ModelledTable:
    """Shots that were fitted or kept unseen, with their poses by both models, a row each.

    Sets and pairs are those of the identification, which may keep pairs unseen by itself.
    """

    numbers: tuple[int, ...]
    purposes: tuple[ShotSet, ...]
    pairs: tuple[int | None, ...]
    before: tuple[tuple[float, ...], ...]
    """Poses (N, t) by the nominal kinematics, mm and rad."""
    after: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, shots: Shots, before: Array, after: Array) -> "ModelledTable":
        """From shots and their poses (N, t)."""
        return cls(shots.numbers, shots.purposes, shots.pairs, _rows(before), _rows(after))


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationResult:
    """Parameters with their uncertainties, residuals, and whether they may be used.

    What is None or empty by default is missing in results of older software.
    """

    estimator: Estimator
    outliers: Outliers = Outliers.EXCLUDE
    priors: dict[str, float] = field(default_factory=dict)
    """1 σ by name."""
    converged: bool
    message: str = ""
    """How the solver ended."""
    iterations: int
    rank: int
    condition: float | None
    """None: the rank is lost."""
    dof: int
    """Degrees of freedom: measurements and priors, less what was found from them."""
    parameters: dict[str, IdentifiedParameter]
    residuals_mm: BeforeAfter | None = None
    """Of what was fitted and kept."""
    unseen_mm: BeforeAfter | None = None
    """Of distances that were never fitted; None without such."""
    fitted: ResidualTable | None = None
    unseen: ResidualTable | None = None
    modelled: ModelledTable | None = None
    excluded: tuple[Excluded, ...]
    unobservable: tuple[Combination, ...]
    """Held at nominal, for neither shots nor priors tell them."""
    known_by_priors_alone: tuple[Combination, ...] = ()
    models: tuple[ComparedModel, ...] = ()
    """Those that it was chosen from, the standard one first; empty without a choice."""
    ripples: RippleRate | None = None
    """None where the set has no ripples."""
    chi2: NoiseTest | None = None
    covariance: Uncertainty | None = None
    """Of the parameters whose σ are known."""
    coverage_factor_95: float | None = None
    """Half-width of 95 % intervals in stated σ; None where nothing tells σ."""
    position_std_mm: PositionStd | None = None
    region: Region | None = None
    """Part of the workspace that it is valid for; None where σ of positions is not known."""
    known_lengths: KnownLengths | None = None
    """None where none was measured."""
    robot_scatter: RobotScatter | None = None
    """None where the shots do not ask for any."""
    hold_out: HoldOut | None = None
    doubts: tuple[Doubt, ...] = ()
    """All that speak against the result, heeded, accepted or only told."""
    frame: Frame | None = None
    """None where no frame was estimated; of sessions that of the first that was fitted."""
    sessions: tuple[SessionFrame, ...] = ()
    """Empty where all shots share one frame."""
    verdict: Decision
    reasons: tuple[str, ...]
    obstacles: tuple[str, ...] = ()
    """Names of what stands against it; empty for a pass, and in results of older software."""
    seconds: float = 0.0
    """What the solution took."""

    def __repr__(self) -> str:
        unseen = f", hold-out {self.unseen_mm.after.rms:.4f} mm rms" if self.unseen_mm else ""
        found = f"{len(self.free)} of {len(self.parameters)} parameters by {self.estimator.value}"
        return f"<IdentificationResult: {self.verdict}, {found}{unseen}>"

    def _repr_html_(self) -> str:
        """Table of the free parameters, as notebooks show it."""
        rows = [(name, self.parameters[name]) for name in self.free]
        return f"<p>{escape(repr(self))}</p>{html_table(PARAMETER_COLUMNS, rows)}"

    def plot(self) -> "Figure":
        """Figure of what the nominal and the identified robot leave of each shot or pair."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8.0, 3.5), layout="constrained")
        axes = figure.add_subplot(yscale="log", ylabel="error, mm")
        for kind, table, marker in (("fitted", self.fitted, "o"), ("hold-out", self.unseen, "x")):
            if table is not None:
                for state, errors in (("before", table.before), ("after", table.after)):
                    sizes, label = np.linalg.norm(errors, axis=1), f"{kind} {table.of}, {state}"
                    axes.plot(table.numbers, sizes, marker, markersize=4, label=label)
        axes.set_xlabel("number in the plan")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        return figure

    @property
    def free(self) -> tuple[str, ...]:
        """Names of what was looked for."""
        return tuple(name for name, found in self.parameters.items() if found.free)

    @property
    def accepted(self) -> tuple[str, ...]:
        """Doubts with which somebody took it all the same, in words."""
        return tuple(doubt.says for doubt in self.doubts if doubt.accepted)

    def nominal_flat(self) -> dict[str, float]:
        """Parameters that it began with, mm and deg."""
        return {name: found.nominal for name, found in self.parameters.items()}

    def flat(self) -> dict[str, float]:
        """Parameters that it found, mm and deg, and how often their ripples come."""
        rate = {self.ripples.key: self.ripples.value} if self.ripples else {}
        return {name: found.value for name, found in self.parameters.items()} | rate

    def std(self) -> dict[str, float]:
        """1 σ by name, mm and deg, where it is known."""
        return {name: p.std for name, p in self.parameters.items() if p.std is not None}

    def document(self) -> dict[str, JsonValue]:
        """Document `pkmcal/identification/1`."""
        # Any: what a dataclass holds, type by type, pydantic knows and mypy cannot
        values: dict[str, Any] = adapter_of(type(self)).dump_python(self, mode="json")
        values["parameters"] = {
            name: values["parameters"][name] | {"delta": found.delta}
            for name, found in self.parameters.items()
        }
        values["excluded"] = [
            {key: value for key, value in asdict(left).items() if value is not None}
            for left in self.excluded
        ]
        known = self.covariance
        strong = known.strongest(STRONGEST, STRONG) if known else ()
        return {"schema": SCHEMA, **values, "correlations": [asdict(each) for each in strong]}


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedIdentification(IdentificationResult):
    """Identification with what it rests on, as the journal holds it."""

    series: int
    shots: int = 0
    model: str = ""
    """Word of the model that was looked for; empty in results of older software."""
    asked: tuple[str, ...] = ()
    """Options that it was asked for with, as they are typed."""
    robot_digest: str
    plan_digest: str
    journal_digest: str
    """Of all records before it."""
    journal_records: int
    at_utc: str
    settings: dict[str, JsonValue] | None = None
    """Those of campaign.yaml that its verdict rests on, by key, unless they are as by default; None
    in results of older software."""

    @classmethod
    def of(cls, found: IdentificationResult, **provenance: Any) -> "RecordedIdentification":
        """Result with its provenance."""
        values = {each.name: getattr(found, each.name) for each in fields(found)}
        return cls(**values | provenance)

    def outdated_by(
        self, settings: Mapping[str, JsonValue], limits_mm: Mapping[str, float]
    ) -> tuple[str, ...]:
        """Keys of settings by which it would be judged otherwise than it was."""
        then = settings if self.settings is None else self.settings
        keys = sorted({*then, *settings})
        changed = [key for key in keys if then.get(key) != settings.get(key)]
        by_limits = any(doubt.by_limits for doubt in self.doubts)
        if by_limits and self.unseen_mm and not limits_met(self.unseen_mm.after, limits_mm):
            changed.append("acceptance")
        return tuple(changed)


def read_identification(body: Mapping[str, JsonValue]) -> RecordedIdentification:
    """Identification of a journal's finding; raises `FindingUnreadable`."""
    remedy = "identify again: another version of the software wrote it"
    if body.get("warmth"):
        raise FindingUnreadable("the journal's identification lets parts grow", remedy=remedy)
    found = read_body(body, RecordedIdentification, "identification", remedy)
    return _completed(found)


def _completed(found: RecordedIdentification) -> RecordedIdentification:
    """With what results of older software say of their uncertainty in other places."""
    known, hold_out, noise = found.covariance, found.hold_out, found.chi2
    if known is None:
        return found
    ratio = known.hold_out_ratio if hold_out is None else hold_out.applied_ratio
    sigma0 = known.sigma0 if noise is None or noise.scale is None else noise.scale
    return replace(found, covariance=replace(known, sigma0=sigma0, hold_out_ratio=ratio))


def finite(value: float) -> float | None:
    """None for what no document can hold."""
    return value if math.isfinite(value) else None


def _rows(errors_mm: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, errors_mm.tolist()))
