"""The sections on the model: its parameters, how surely they are known, what it leaves over."""

from collections.abc import Iterator

from app.report.parts import (
    NOTHING,
    Column,
    Paragraph,
    Part,
    Row,
    Section,
    Table,
    number,
    words,
)
from app.report.pictures import correlation_picture
from app.report.results_sections import NO_IDENTIFICATION
from campaigns.evaluation.residual_budget import ResidualBudget
from campaigns.evidence import Evaluation
from campaigns.identification.result import (
    ComparedModel,
    IdentifiedParameter,
    RecordedIdentification,
)
from campaigns.mechanisms.mechanism import ParameterSpace

PARAMETER_DECIMALS = 4
STRONGEST = 8
INSTRUMENT_EXPLAINS = 1.5
"""Up to this ratio of residuals to stated uncertainty nothing else needs to be looked for."""
HORIZONTAL, NO_PLAY = "the motor axes are horizontal", "gears have no play"
ASSUMED = (
    "the plate stays parallel to the base",
    "the two rods of a forearm are alike",
    "parts do not bend and do not grow with heat",
)


def parameters_section(contents: Evaluation) -> Section:
    """Old, new, and how surely."""
    found = contents.evidence.identification
    if found is None:
        missing = Paragraph(NO_IDENTIFICATION, "missing")
        return Section("parameters", "Parameters", (missing,))
    return Section("parameters", "Parameters", tuple(_parameter_parts(contents, found)))


def remainder_section(contents: Evaluation) -> Section:
    """What is left when the model has said all it can."""
    parts: list[Part] = []
    if contents.budget is None:
        text = "Without an identification and shots to spare, nothing can be said of what is left."
        parts.append(Paragraph(text, "missing"))
    else:
        parts += _remainder_parts(contents.budget)
    evidence = contents.evidence
    space = evidence.campaign.robot.mechanism.parameters
    assumed = Paragraph(_assumed(evidence.identification, space))
    return Section("remainder", "What the model does not explain", (*parts, assumed))


def _assumed(found: RecordedIdentification | None, space: ParameterSpace) -> str:
    """What the model that was kept cannot express."""
    free = () if found is None else found.free
    unknown = [*ASSUMED]
    if not {*space.extensions} & {*free}:
        unknown.append(HORIZONTAL)
    if not {*space.backlashes} & {*free}:
        unknown.append(NO_PLAY)
    return (
        f"What the model assumes, and no parameter of it can express: {'; '.join(unknown)}. "
        "Parameters marked held are assumed to be as given."
    )


def _parameter_parts(contents: Evaluation, found: RecordedIdentification) -> Iterator[Part]:
    state = "converged" if found.converged else "did not converge"
    condition = "" if found.condition is None else f", condition {found.condition:.0f}"
    yield Paragraph(
        f"Estimator: {found.estimator.value}; it {state} after {found.iterations} evaluations with "
        f"rank {found.rank} of {len(found.free)}{condition} and {found.dof} degrees of freedom. "
        "σ is one standard deviation."
    )
    yield from _uncertainty_paragraphs(found)
    columns = (
        *words("parameter", "unit"),
        *(Column(title) for title in ("old", "new", "Δ", "σ", "Δ ÷ σ")),
    )
    rows = tuple(_parameter_row(name, each) for name, each in found.parameters.items())
    yield Table("Parameters old and new", columns, rows, "held: not identified, kept as it was.")
    if found.models:
        yield _models_table(found.models)
    for names in found.unobservable:
        text = f"Cannot be told by these shots, and was held: {', '.join(names)}."
        yield Paragraph(text, "missing")
    for names in found.known_by_priors_alone:
        text = f"Known by what was given beforehand alone: {', '.join(names)}."
        yield Paragraph(text)
    known = found.covariance
    if known is None or not known.names:
        text = "There are no correlations: the shots do not tell how surely parameters are known."
        yield Paragraph(text, "missing")
        return
    strongest = tuple(
        (each.a, each.b, number(each.value, 2, signed=True)) for each in known.strongest(STRONGEST)
    )
    yield Table("Strongest correlations", (*words("", ""), Column("ρ")), strongest)
    picture = correlation_picture(contents)
    if picture is not None:
        yield picture


def _uncertainty_paragraphs(found: RecordedIdentification) -> Iterator[Paragraph]:
    if found.chi2 is not None:
        yield Paragraph(f"{found.chi2.says[0].upper()}{found.chi2.says[1:]}.")
    if found.position_std_mm is not None:
        mean, most = (number(v, 4) for v in (found.position_std_mm.mean, found.position_std_mm.max))
        yield Paragraph(
            f"Predicted uncertainty of position (1 σ, after a best fit of the frame): {mean} mm on "
            f"average over the workspace, {most} mm at most."
        )
    if found.priors:
        known = ", ".join(f"{name} ± {std:g}" for name, std in found.priors.items())
        yield Paragraph(f"Given beforehand, about the old values (1 σ, mm and deg): {known}.")


def _models_table(models: tuple[ComparedModel, ...]) -> Table:
    columns = (
        *words("model"),
        *(Column(title) for title in ("parameters", "BIC")),
        Column("unseen rms", "mm"),
        *words(""),
    )
    rows = tuple(
        (
            model.name,
            str(model.parameters),
            number(model.bic, 0),
            number(model.unseen_rms_mm, PARAMETER_DECIMALS),
            model.outcome,
        )
        for model in models
    )
    note = "A larger model is kept only if unseen pairs and Schwarz's criterion (BIC) speak for it."
    return Table("Models compared", columns, rows, note)


def _parameter_row(name: str, found: IdentifiedParameter) -> Row:
    stem, _, unit = name.rpartition("_")
    values = [number(value, PARAMETER_DECIMALS) for value in (found.nominal, found.value)]
    if not found.free:
        return stem, _unit(unit), *values, "held", NOTHING, NOTHING
    delta = number(found.delta, PARAMETER_DECIMALS, signed=True)
    std = number(found.std, PARAMETER_DECIMALS)
    ratio = number(found.delta / found.std, 1, signed=True) if found.std else NOTHING
    return stem, _unit(unit), *values, delta, std, ratio


def _unit(suffix: str) -> str:
    return {"deg": "°"}.get(suffix, suffix)


def _remainder_parts(left: ResidualBudget) -> Iterator[Part]:
    rows: list[Row] = [
        (f"residuals of the fitted {left.of}s, √(Σ r² / ν)", number(left.residual_mm)),
        ("the tracker's stated uncertainty alone", number(left.instrument_mm)),
    ]
    if left.repeatability_mm is None:
        rows.append(("the robot's repeatability alone", "not measured"))
    else:
        rows.append(("the robot's repeatability alone", number(left.repeatability_mm)))
    rows.append(("left beyond the larger of the two", number(left.unexplained_mm)))
    columns = (*words(f"one {left.of}, 1 σ"), Column("", "mm"))
    note = f"ν = {left.dof} degrees of freedom."
    yield Paragraph(_in_words(left))
    yield Table("Residuals and their known causes", columns, tuple(rows), note)


def _in_words(left: ResidualBudget) -> str:
    ratio = f"The residuals are {left.chi:.1f} times what the tracker's stated uncertainty explains"
    if left.chi <= INSTRUMENT_EXPLAINS:
        return f"{ratio}: the model leaves nothing that this tracker could see."
    if left.repeatability_mm is None:
        return f"{ratio}. Repeatability was not measured, so nothing is known of the rest."
    if left.unexplained_mm == 0.0:
        return (
            f"{ratio}; the robot's repeatability accounts for the rest. A better model would not "
            "make this robot more accurate."
        )
    return (
        f"{ratio}, and more than its repeatability accounts for. {left.unexplained_mm:.3f} mm "
        "(1 σ) remain that neither explains: look at the assumptions below."
    )
