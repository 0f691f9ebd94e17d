"""The result of an identification: one type that is written to the journal, read back and shown.

Its fields are the keys of the document `pkmcal/identification/2`; parameters are in mm, deg, ppm.
Renaming a field changes the document, and old journals could no longer be read.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.errors import FindingUnreadable
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.region import Region
from campaigns.evaluation.summary import BeforeAfter, spread
from campaigns.fit.effects import Layer
from campaigns.fit.events import Event
from campaigns.fit.rigid_transforms import Transform, from_paper_angles, paper_angles_rad
from campaigns.identification.findings import HOLD_OUT, Finding, HoldOut
from campaigns.journal.records import adapter_of, read_body
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.mechanism import Kinematics
from campaigns.kinematics.parameters import Parameters
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "pkmcal/identification/2"
STRONG = 0.9
"""Correlation from which two parameters are named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiedParameter:
    """Parameter before and after, in its file unit."""

    nominal: float
    value: float
    std: float | None
    """1 σ; None if it was held, or if no shot determines it."""
    free: bool
    group: str = ""

    @property
    def delta(self) -> float:
        """Identified minus nominal."""
        return self.value - self.nominal


@dataclass(frozen=True, slots=True)
class Excluded:
    """Shot or pair that was left out, and why; a size only where other shots contradict it."""

    reason: str
    shot: int | None = None
    pair: int | None = None
    size_mm: float | None = None
    """Distance from the place that the other shots predict."""

    @property
    def what(self) -> str:
        """Its name for people: `shot 7`, `pair 3`, or `shot 7 of pair 3`."""
        words = {"shot": self.shot, "of pair" if self.shot is not None else "pair": self.pair}
        return " ".join(f"{word} {number}" for word, number in words.items() if number is not None)


@dataclass(frozen=True, slots=True)
class Scatter:
    """Noise beside the tracker's stated noise: of the robot's point and of its joints, 1 σ.

    Where the tracker stated nothing, the scatter also contains noise of the instrument that cannot
    be distinguished from the robot's.
    """

    point_mm: float
    joint: float
    """deg of cranks, mm of carriages."""
    instrument: dict[str, float]
    """Estimated factors of the data sheet's σ, "along" and "across" the beam; empty if stated."""
    says: str


@dataclass(frozen=True, slots=True)
class Share:
    """Share of one source in the uncertainty of positions: rms over the workspace, 1 σ."""

    source: str
    words: str
    kind: Literal["A", "B"]
    """A: estimated from the scatter of these shots. B: stated, or a tolerance (GUM's two types)."""
    mm: float


@dataclass(frozen=True, slots=True)
class PositionStd:
    """1 σ of positions, the root of the summed variances of x, y and z, over the workspace, mm."""

    mean: float
    max: float
    rms: float
    left_out: int = 0
    """Poses of the sample that the identified robot cannot take."""
    corrected: float | None = None
    """1 σ, rms, where `correct` follows the errors that no parameter describes; None without."""


@dataclass(frozen=True, slots=True)
class ParameterCovariance:
    """Covariance of the robot's parameters by name, in mm, deg and ppm.

    Combinations that no shot determines are held at nominal: they have no part in it.
    """

    names: tuple[str, ...] = ()
    matrix: tuple[tuple[float, ...], ...] = ()
    hold_out_ratio: float = 1.0
    """Factor on the standard uncertainty of positions."""

    @property
    def array(self) -> Array:
        """`matrix` as an array, (F, F)."""
        return np.array(self.matrix).reshape(len(self.names), len(self.names))

    def std(self) -> dict[str, float]:
        """Return 1 σ by name."""
        return dict(zip(self.names, np.sqrt(np.diag(self.array)).tolist(), strict=True))

    def strongest(self, count: int, least: float = 0.0) -> list["Correlation"]:
        """Return the `count` largest correlations, none below `least`."""
        # Held parameters have σ = 0 and no correlation: divide by 1 instead. Below the diagonal
        # each pair of parameters stands once.
        std = np.sqrt(np.diag(self.array))
        scale = np.where(std > 0.0, std, 1.0)
        correlation = np.tril(self.array / np.outer(scale, scale), -1)
        order = np.argsort(-np.abs(correlation), axis=None)[:count]
        rows, columns = np.unravel_index(order, correlation.shape)
        pairs = zip(rows.tolist(), columns.tolist(), strict=True)
        largest = [
            Correlation(self.names[b], self.names[a], float(correlation[a, b])) for a, b in pairs
        ]
        return [pair for pair in largest if abs(pair.value) >= least and pair.value]


@dataclass(frozen=True, slots=True)
class Correlation:
    """Correlation of two parameters."""

    first: str
    second: str
    value: float


@dataclass(frozen=True, slots=True)
class StoredPosterior:
    """Posterior of all unknowns in tolerances: the prior of a check and of an update."""

    names: tuple[str, ...]
    tolerances: tuple[float, ...]
    """In mm, rad or ratios."""
    mean: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    sizes: dict[str, float]
    """Sizes of the groups in tolerances."""
    factors: dict[str, float]
    """Factors of the noise's parts."""
    rates: tuple[float, ...] = ()
    """Rates of the joints' ripples, in the unit of robot files; (): those of the robot file."""
    undetermined: tuple[tuple[float, ...], ...] = ()
    """Orthonormal directions in tolerances, (k, P), that no shot determined: the datum."""


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
        """Describe a transform."""
        angles_deg = np.degrees(paper_angles_rad(tracker_from_base)).tolist()
        return cls(*tracker_from_base.translation_mm.tolist(), *angles_deg)

    @property
    def tracker_from_base(self) -> Transform:
        """The transform from base to tracker."""
        angles = np.radians([self.phi_deg, self.gamma_deg, self.psi_deg])
        return from_paper_angles(angles, np.array([self.x_mm, self.y_mm, self.z_mm]))


@dataclass(frozen=True, slots=True)
class SessionFrame:
    """Shots of a session with a frame of its own, by number, and that frame if it was fitted."""

    shots: tuple[int, ...]
    frame: Frame | None = None


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
        cls, of: Literal["shots", "pairs"], numbers: Sequence[int], before: Array, after: Array
    ) -> "ResidualTable":
        """Make a table of errors (N, 3) or (N, 1)."""
        return cls(of, tuple(numbers), _rows(before), _rows(after))

    @property
    def before(self) -> Array:
        """Errors of the nominal robot, (N, 3) or (N, 1)."""
        return np.array(self.before_mm)

    @property
    def after(self) -> Array:
        """Errors of the identified robot, (N, 3) or (N, 1)."""
        return np.array(self.after_mm)

    def summary(self) -> BeforeAfter:
        """Return the sizes of the errors before and after."""
        return BeforeAfter(spread(self.before), spread(self.after))


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredLayer:
    """Error by place or by the arms' angles that no parameter describes, for `correct`."""

    kind: Literal["place", "arms"]
    length: float
    """Correlation length: mm of places, rad or mm of joints."""
    usual: float
    turn_mm: float
    shots: tuple[tuple[tuple[float, ...], ...], ...]
    """Coordinates of the shots: one array (M, c) of places, an array (M, 1) of each joint."""
    z: tuple[float, ...]
    """Estimated unknowns of the layer's functions."""

    @classmethod
    def of(cls, layer: Layer, z: Array) -> "StoredLayer":
        """Store a layer with its estimated unknowns (k,)."""
        return cls(
            kind=layer.kind,
            length=layer.length,
            usual=layer.usual,
            turn_mm=layer.turn_mm,
            shots=tuple(map(_rows, layer.shots)),
            z=tuple(z.tolist()),
        )

    def moves_at(self, joints: Array, poses: Array) -> Array:
        """Return the motion of points (N, 3), mm, or of joints (N, n), at joints and poses."""
        shots = tuple(np.array(rows) for rows in self.shots)
        layer = Layer.over(self.kind, shots, self.length, self.usual, self.turn_mm)
        return np.asarray(layer.basis_at(joints, poses) @ np.array(self.z))


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """Diagnosis of the fit beside the parameters, a row for each fitted shot, for pictures."""

    numbers: tuple[int, ...]
    """Numbers of the shots, in the order of time."""
    places_mm: tuple[tuple[float, ...], ...]
    """Places of the nominal robot, (N, 3); 0 where it cannot be assembled."""
    good: tuple[float, ...]
    """Probability of each shot to be good, (N,)."""
    stand_mm: tuple[tuple[float, ...], ...]
    """Slow motion of the stand at each shot, in the tracker's axes, (N, 3)."""
    unexplained_mm: tuple[tuple[float, ...], ...]
    """Errors without a known source at each shot, in the tracker's axes, (N, 3)."""
    rates: tuple[float, ...]
    """Rates of periodic errors that were tried: rad per rad or per mm of the joints, (R,)."""
    rate_log_factors: tuple[float, ...]
    """Log Bayes factor of the best choice of arms at each rate, (R,)."""


@dataclass(frozen=True, slots=True)
class ModelledTable:
    """Shots that were fitted or kept unseen, with their poses by both models, a row each."""

    numbers: tuple[int, ...]
    purposes: tuple[ShotSet, ...]
    pairs: tuple[int | None, ...]
    before: tuple[tuple[float, ...], ...]
    """Poses (N, t) by the nominal kinematics, mm and rad."""
    after: tuple[tuple[float, ...], ...]

    @classmethod
    def of(cls, shots: Shots, before: Array, after: Array) -> "ModelledTable":
        """Make a table of shots and their poses (N, t)."""
        return cls(shots.numbers, shots.purposes, shots.pairs, _rows(before), _rows(after))


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationResult:
    """Parameters with their uncertainty, errors, budget and findings, and the verdict.

    Attributes:
        model: `full` or `paper`.
        parameters: all parameters of the robot by name.
        undetermined: combinations of parameters that no shot determines; they stay at nominal.
        scatter: noise beside what the tracker stated.
        sizes: estimated size of each group of error sources, in its tolerance.
        tracker: errors of the tracker by source: value and 1 σ in mm, deg or ppm.
        events: what happened to shots and parts during the campaign, in the order of time.
        layers: errors that no parameter describes, which `correct` follows.
        diagnosis: what the fit shows of each shot beside its residual.
        excluded: shots and pairs left out, with the reason.
        residuals_mm, unseen_mm: sizes of the errors of fitted shots and of hold-out pairs.
        budget: shares of the sources in the uncertainty of positions; they add up in squares.
        region: part of the workspace that the result is valid for.
        findings: everything that contradicts the result, or is only reported.
        verdict, reasons: whether the result may be used, and why.
    """

    model: Literal["full", "paper"]
    converged: bool
    iterations: int
    parameters: dict[str, IdentifiedParameter]
    undetermined: tuple[tuple[str, ...], ...] = ()
    scatter: Scatter | None = None
    sizes: dict[str, float] = field(default_factory=dict)
    tracker: dict[str, tuple[float, float]] = field(default_factory=dict)
    residuals_mm: BeforeAfter | None = None
    unseen_mm: BeforeAfter | None = None
    fitted: ResidualTable | None = None
    unseen: ResidualTable | None = None
    modelled: ModelledTable | None = None
    events: tuple[Event, ...] = ()
    diagnosis: Diagnosis | None = None
    layers: tuple[StoredLayer, ...] = ()
    excluded: tuple[Excluded, ...] = ()
    covariance: ParameterCovariance | None = None
    position_std_mm: PositionStd | None = None
    budget: tuple[Share, ...] = ()
    region: Region | None = None
    hold_out: HoldOut | None = None
    findings: tuple[Finding, ...] = ()
    frame: Frame | None = None
    sessions: tuple[SessionFrame, ...] = ()
    reference_degC: float | None = None
    """Temperature of the parts for which parameters are stated; None if none was measured."""
    posterior: StoredPosterior | None = None
    verdict: Decision
    reasons: tuple[str, ...]
    obstacles: tuple[str, ...] = ()
    """Names of the findings that stand against a pass."""
    seconds: float = 0.0

    def __repr__(self) -> str:
        unseen = f", hold-out {self.unseen_mm.after.rms:.4f} mm rms" if self.unseen_mm else ""
        return f"<IdentificationResult: {self.verdict}, {len(self.free)} parameters{unseen}>"

    def report(self) -> str:
        """Return parameters, budget and findings as text for a console."""
        # The budget's rows add up in squares: the last line is their root.
        lines = [f"verdict: {self.verdict}", *(f"  {reason}" for reason in self.reasons), ""]
        lines.append(f"{'parameter':28}{'nominal':>12}{'identified':>12}{'± σ':>10}")
        for name in self.free:
            parameter = self.parameters[name]
            std = "held" if parameter.std is None else f"{parameter.std:.4f}"
            lines.append(f"{name:28}{parameter.nominal:12.4f}{parameter.value:12.4f}{std:>10}")
        if self.budget:
            lines += ["", "uncertainty of positions, 1 σ, rms over the workspace, mm"]
            lines += [f"  {share.words:52} {share.kind} {share.mm:9.4f}" for share in self.budget]
            total = math.sqrt(sum(share.mm**2 for share in self.budget))
            lines.append(f"  {'combined':52}   {total:9.4f}")
        if self.scatter is not None:
            lines += ["", self.scatter.says]
        lines += ["", *(f"finding: {finding.says}" for finding in self.findings)]
        return "\n".join(lines).rstrip() + "\n"

    def to_frame(self) -> Any:
        """Return the parameters as a DataFrame; raise `ImportError` without pandas.

        Any: pandas is not among our dependencies.
        """
        rows = [
            {"parameter": name, **asdict(parameter)} for name, parameter in self.parameters.items()
        ]
        return import_module("pandas").DataFrame(rows).set_index("parameter")

    def plot(self) -> "Figure":
        """Return a figure of the errors of each shot by the nominal and the identified robot."""
        from matplotlib.figure import Figure  # slow to import: only commands that draw wait for it

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
        """Names of the parameters that were fitted."""
        return tuple(name for name, parameter in self.parameters.items() if parameter.free)

    @property
    def accepted(self) -> tuple[str, ...]:
        """Findings in spite of which somebody took the result, in words."""
        return tuple(finding.says for finding in self.findings if finding.accepted)

    def nominal_flat(self) -> dict[str, float]:
        """Return the nominal parameters by name."""
        return {name: parameter.nominal for name, parameter in self.parameters.items()}

    def flat(self) -> dict[str, float]:
        """Return the identified parameters by name."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    def parameter_set(self, mechanism: ClosedChain) -> Parameters:
        """Return the identified set with the ripples' rate of the robot that was fitted.

        Parameter files and checks name the set that they belong to by its digest.
        """
        # The rate is no unknown, but a ripple's two amplitudes mean nothing without it.
        values = mechanism.parameters.named_rates(mechanism.rates) | self.flat()
        return Parameters.of(mechanism.parameters, values, self.std())

    def std(self) -> dict[str, float]:
        """Return 1 σ by name, of the parameters that have one."""
        parameters = self.parameters.items()
        return {name: parameter.std for name, parameter in parameters if parameter.std is not None}

    def document(self) -> dict[str, JsonValue]:
        """Return the document `pkmcal/identification/2`."""
        # Fields as they are, and for readers without this software what follows from them: the
        # change of each parameter and the strongest correlations. Reading ignores these again.
        # Any: pydantic determines the types from the dataclass at run time, which mypy cannot.
        values: dict[str, Any] = adapter_of(type(self)).dump_python(self, mode="json")
        for name, parameter in self.parameters.items():
            values["parameters"][name]["delta"] = parameter.delta
        values["excluded"] = [
            {key: value for key, value in asdict(excluded).items() if value is not None}
            for excluded in self.excluded
        ]
        strong = self.covariance.strongest(20, STRONG) if self.covariance else []
        return {"schema": SCHEMA, **values, "correlations": [asdict(pair) for pair in strong]}


@dataclass(frozen=True, slots=True, kw_only=True)
class Pedigree:
    """Pedigree of an updated set: the former set, and the shots that updated it."""

    updates: str
    """Digest of the former set."""
    series: tuple[int, ...]
    shots: int
    position_std_before_mm: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedIdentification(IdentificationResult):
    """Identification with its series, options and files, as the journal holds it."""

    series: int
    shots: int = 0
    asked: tuple[str, ...] = ()
    """Options of its command, as they are typed."""
    robot_digest: str
    plan_digest: str
    journal_digest: str
    """Digest of all records before it."""
    journal_records: int
    at_utc: str
    settings: dict[str, JsonValue] | None = None
    """Settings of campaign.yaml that its verdict rests on, unless they are at their defaults."""
    pedigree: Pedigree | None = None

    @property
    def is_by_older_model(self) -> bool:
        """Whether an older version identified it by a model with fewer sources of error."""
        # the full model of this version states a diagnosis of every fit
        return self.model == "full" and self.diagnosis is None

    @classmethod
    def of(cls, result: IdentificationResult, **provenance: Any) -> "RecordedIdentification":
        """Add the provenance to a result."""
        names = [field_of_result.name for field_of_result in fields(IdentificationResult)]
        return cls(**{name: getattr(result, name) for name in names} | provenance)

    def outdated_by(
        self, settings: Mapping[str, JsonValue], limits_mm: Mapping[str, float]
    ) -> tuple[str, ...]:
        """Return the keys of today's settings that differ from those of the verdict."""
        # Older software recorded no settings: with nothing to compare, nothing counts as changed.
        then = settings if self.settings is None else self.settings
        keys = sorted({*then, *settings})
        changed = [key for key in keys if then.get(key) != settings.get(key)]
        # Limits count only where the verdict rests on them: a hold-out test that failed, and was
        # let pass because the acceptance limits were met.
        passed_by_limits = any(
            finding.name == HOLD_OUT and finding.decision is None for finding in self.findings
        )
        if passed_by_limits and self.hold_out and not self.hold_out.meets(limits_mm):
            changed.append("acceptance")
        return tuple(changed)


def read_identification(body: Mapping[str, JsonValue]) -> RecordedIdentification:
    """Read an identification from a journal's finding; raise `FindingUnreadable`."""
    remedy = "run `pkmcal identify DIR` again: another version of the software wrote it"
    schema = body.get("schema", "without a schema")
    if schema != SCHEMA:
        raise FindingUnreadable(f"the identification is {schema}", remedy=remedy)
    return read_body(body, RecordedIdentification, "identification", remedy)


def identified_parameters(
    nominal: Kinematics, fitted: Mapping[str, tuple[float, float | None]]
) -> dict[str, IdentifiedParameter]:
    """Return all parameters of a robot, the `fitted` ones with their values and 1 σ."""
    # Error sources without a nominal value start from zero. One that has no nominal value and was
    # not fitted either is no parameter of this robot, and left out.
    table, old = nominal.mechanism.parameters, nominal.parameters
    return {
        name: IdentifiedParameter(
            nominal=old.get(name, 0.0),
            value=fitted[name][0] if name in fitted else old[name],
            std=fitted[name][1] if name in fitted else None,
            free=name in fitted,
            group=table[name].field.group,
        )
        for name in dict.fromkeys((*table.of_robot, *fitted))
        if name in old or name in fitted
    }


def _rows(errors_mm: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, errors_mm.tolist()))
