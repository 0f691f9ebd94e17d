"""The result of an identification in five parts: it is written to the journal, and read back.

The fields of all parts are the keys of the document `pkmcal/identification/2`, so that no two have
one name; parameters are in mm, deg, ppm. Renaming a field changes the document, and old journals
could no longer be read; moving it to another part does not. Views: `views.py`, and `app/`.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, cast

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.errors import FindingUnreadable
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.region import Region
from campaigns.evaluation.summary import BeforeAfter, spread
from campaigns.fit.effects import Layer
from campaigns.fit.error_sources import SOURCES
from campaigns.fit.events import Event
from campaigns.fit.rigid_transforms import Transform, from_paper_angles, paper_angles_rad
from campaigns.identification import views
from campaigns.identification.determined import Determined
from campaigns.identification.findings import HOLD_OUT, Finding, HoldOut
from campaigns.journal.records import adapter_of, read_body
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import Parameters
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

SCHEMA = "pkmcal/identification/2"
WITHOUT_SHOTS = 0
"""Number of the series of an identification from observations alone; series count from 1."""
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
    """Of the first joint and those of its kind: deg of cranks, mm of carriages."""
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

    def only(self, names: Collection[str]) -> "ParameterCovariance":
        """Return the part of some parameters."""
        places = [place for place, name in enumerate(self.names) if name in names]
        matrix = tuple(tuple(self.matrix[row][column] for column in places) for row in places)
        chosen = tuple(self.names[place] for place in places)
        return ParameterCovariance(chosen, matrix, self.hold_out_ratio)

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
    frame: "Frame | None" = None
    """Frame at the end of the shots; None: an older version stored none."""
    frame_covariance: tuple[tuple[float, ...], ...] = ()
    """Its covariance with all unknowns and with itself, in mrad and mm, (6, P + 6)."""


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


@dataclass(frozen=True, slots=True)
class Value:
    """What was estimated: the robot, where it stood, and the tracker. All that a user may apply."""

    parameters: dict[str, IdentifiedParameter]
    """All parameters of the robot by name, rates of found ripples among them."""
    undetermined: tuple[tuple[str, ...], ...] = ()
    """Combinations of parameters that no shot determines; they stay at nominal."""
    motions: tuple[str, ...] = ()
    """What each of them does, such as "turn of the base about z"; empty where no motion does it,
    () by an older version."""
    sizes: dict[str, float] = field(default_factory=dict)
    """Size of each group of error sources, in its tolerance."""
    tracker: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Errors of the tracker by source: value and 1 σ in mm, deg or ppm."""
    layers: tuple[StoredLayer, ...] = ()
    """Errors that no parameter describes, which `correct` follows."""
    frame: Frame | None = None
    sessions: tuple[SessionFrame, ...] = ()
    reference_degC: float | None = None
    """Temperature of the parts for which parameters are stated; None if none was measured."""

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that were fitted."""
        return tuple(name for name, parameter in self.parameters.items() if parameter.free)

    def frame_of(self, number: int) -> Transform:
        """Return the transform from the base to the tracker at a shot."""
        of_session = (s.frame for s in self.sessions if s.frame and number in s.shots)
        frame: Frame | None = next(of_session, self.frame)
        assert frame is not None, "a result of shots has a frame"
        return frame.tracker_from_base

    def flat(self) -> dict[str, float]:
        """Return the identified parameters by name."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    def parameter_set(self, mechanism: Mechanism) -> Parameters:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """How far the value may be off: covariances, noise, and σ of positions with its budget."""

    scatter: Scatter | None = None
    covariance: ParameterCovariance | None = None
    posterior: StoredPosterior | None = None
    position_std_mm: PositionStd | None = None
    budget: tuple[Share, ...] = ()
    """Shares of the sources in the uncertainty of positions; they add up in squares."""
    region: Region | None = None
    """Part of the workspace for which the uncertainty holds."""
    determined: tuple[Determined, ...] = ()
    """What the shots determine: position, and rotation of a robot that turns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judgement:
    """Whether the value may be used, and why: all that the shots say for or against it."""

    verdict: Decision
    reasons: tuple[str, ...]
    obstacles: tuple[str, ...] = ()
    """Names of the findings that stand against a pass."""
    findings: tuple[Finding, ...] = ()
    hold_out: HoldOut | None = None
    events: tuple[Event, ...] = ()
    """What happened to shots and parts during the campaign, in the order of time."""
    diagnosis: Diagnosis | None = None
    excluded: tuple[Excluded, ...] = ()

    @classmethod
    def of(
        cls, findings: Sequence[Finding], gains: Iterable[str] = (), **observed: Any
    ) -> "Judgement":
        """Judge by all findings; where none is against a pass, the reasons are the `gains`."""
        # failures alone are reasons where there are any: what else is open then decides nothing
        against = tuple(finding for finding in findings if finding.affects_verdict)
        failures = tuple(finding for finding in against if finding.decision == "fail")
        obstacles = failures or against
        return cls(
            verdict="fail" if failures else "not decided" if against else "pass",
            reasons=tuple(finding.says for finding in obstacles) or tuple(gains),
            obstacles=tuple(finding.name for finding in obstacles),
            findings=tuple(findings),
            **observed,
        )

    @property
    def accepted(self) -> tuple[str, ...]:
        """Findings in spite of which somebody took the result, in words."""
        return tuple(finding.says for finding in self.findings if finding.accepted)


@dataclass(frozen=True, slots=True)
class Residuals:
    """Modelled minus measured by the nominal and the identified robot, shot by shot and in sum."""

    residuals_mm: BeforeAfter | None = None
    """Sizes of the errors of fitted shots."""
    unseen_mm: BeforeAfter | None = None
    """Sizes of the errors of hold-out pairs."""
    fitted: ResidualTable | None = None
    unseen: ResidualTable | None = None
    modelled: ModelledTable | None = None

    @classmethod
    def of(
        cls, fitted: ResidualTable, unseen: ResidualTable | None, modelled: ModelledTable
    ) -> "Residuals":
        """Sum up the tables of fitted shots and hold-out pairs."""
        unseen_mm = None if unseen is None else unseen.summary()
        return cls(fitted.summary(), unseen_mm, fitted, unseen, modelled)


@dataclass(frozen=True, slots=True)
class Provenance:
    """How the result was computed."""

    model: Literal["full", "paper"]
    converged: bool
    iterations: int
    seconds: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pedigree:
    """Pedigree of an updated set: the former set, and the shots that updated it."""

    updates: str
    """Digest of the former set."""
    series: tuple[int, ...]
    shots: int
    position_std_before_mm: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedProvenance(Provenance):
    """How the result was computed, and what it rests on: series, options, settings and files."""

    series: int
    shots: int = 0
    observations: int = 0
    """Number of observations of other kinds than points, with those that were held out."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationResult:
    """Result of an identification in five parts, and the ways to look at it."""

    value: Value
    uncertainty: Uncertainty
    judgement: Judgement
    residuals: Residuals
    provenance: Provenance

    report = views.report
    to_frame = views.to_frame
    plot = views.plot
    _repr_html_ = views.repr_html

    def __repr__(self) -> str:
        errors, free = self.residuals.unseen_mm, self.value.free
        unseen = f", hold-out {errors.after.rms:.4f} mm rms" if errors else ""
        return f"<IdentificationResult: {self.judgement.verdict}, {len(free)} parameters{unseen}>"

    # Parameters of undetermined combinations are held together at nominal by the datum: how they
    # correlate follows from that choice. A parameter of no such combination has no part of Z, so
    # that the projection to the datum leaves it and its covariance with others of its kind as they
    # are. The many of imperfect parts and drives are left out, for no figure has room for them.
    @property
    def determined_covariance(self) -> ParameterCovariance | None:
        """Covariance of the geometry that shots determine whatever the datum; None without any."""
        covariance, value = self.uncertainty.covariance, self.value
        if covariance is None:
            return None
        in_datum = {name for names in value.undetermined for name in names}
        small = {group for group, source in SOURCES.items() if source.is_learned}
        names = [
            name
            for name in covariance.names
            if name not in in_datum and value.parameters[name].group not in small
        ]
        return covariance.only(names) if len(names) > 1 else None

    def document(self) -> dict[str, JsonValue]:
        """Return the document `pkmcal/identification/2`: the fields of all parts side by side."""
        # Fields as they are, and for readers without this software what follows from them: the
        # change of each parameter and the strongest correlations. Reading ignores these again.
        # Any: pydantic determines the types from the dataclass at run time, which mypy cannot.
        values: dict[str, Any] = {"schema": SCHEMA}
        for part in fields(IdentificationResult):
            content = getattr(self, part.name)
            values |= adapter_of(type(content)).dump_python(content, mode="json")
        for name, parameter in self.value.parameters.items():
            values["parameters"][name]["delta"] = parameter.delta
        values["excluded"] = [
            {key: value for key, value in asdict(excluded).items() if value is not None}
            for excluded in self.judgement.excluded
        ]
        covariance = self.uncertainty.covariance
        strong = covariance.strongest(20, STRONG) if covariance else []
        return {**values, "correlations": [asdict(pair) for pair in strong]}


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedIdentification(IdentificationResult):
    """Identification with what it rests on, as the journal holds it."""

    provenance: RecordedProvenance

    @property
    def is_by_older_model(self) -> bool:
        """Whether an older version identified it by a model with fewer sources of error."""
        # The full model of this version states a diagnosis of every fit of shots. Without shots it
        # states what the observations determine, which older versions could not identify from.
        is_undiagnosed = self.judgement.diagnosis is None
        has_shots = self.provenance.series != WITHOUT_SHOTS
        return self.provenance.model == "full" and is_undiagnosed and has_shots

    @classmethod
    def of(cls, result: IdentificationResult, **provenance: Any) -> "RecordedIdentification":
        """Add to a result what it rests on, the fields of `RecordedProvenance`."""
        parts = {part.name: getattr(result, part.name) for part in fields(IdentificationResult)}
        recorded = RecordedProvenance(**asdict(result.provenance) | provenance)
        return cls(**parts | {"provenance": recorded})

    def outdated_by(
        self, settings: Mapping[str, JsonValue], limits_mm: Mapping[str, float]
    ) -> tuple[str, ...]:
        """Return the keys of today's settings that differ from those of the verdict."""
        # Older software recorded no settings: with nothing to compare, nothing counts as changed.
        recorded, judgement = self.provenance.settings, self.judgement
        then = settings if recorded is None else recorded
        keys = sorted({*then, *settings})
        changed = [key for key in keys if then.get(key) != settings.get(key)]
        # Limits count only where the verdict rests on them: a hold-out test that failed, and was
        # let pass because the acceptance limits were met.
        passed_by_limits = any(
            finding.name == HOLD_OUT and finding.decision is None for finding in judgement.findings
        )
        if passed_by_limits and judgement.hold_out and not judgement.hold_out.meets(limits_mm):
            changed.append("acceptance")
        return tuple(changed)


def read_identification(body: Mapping[str, JsonValue]) -> RecordedIdentification:
    """Read an identification from a journal's finding; raise `FindingUnreadable`."""
    remedy = "run `pkmcal identify DIR` again: another version of the software wrote it"
    schema = body.get("schema", "without a schema")
    if schema != SCHEMA:
        raise FindingUnreadable(f"the identification is {schema}", remedy=remedy)
    # each part takes its own keys of the document, and leaves those of the others alone
    parts: dict[str, Any] = {
        part.name: read_body(body, cast("type[object]", part.type), "identification", remedy)
        for part in fields(RecordedIdentification)
    }
    return RecordedIdentification(**parts)


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
