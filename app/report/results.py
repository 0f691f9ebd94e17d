"""Sections of the page on results: limits, before and after, workspace, tests, the model."""

from itertools import zip_longest

from app.report import figures, tables
from app.report.section import Section
from campaigns.evaluation.iso_figures import cube_frame, cube_poses, iso_rows
from campaigns.evidence import Evaluation
from campaigns.files.table import words
from campaigns.identification.result import IdentificationResult, ParameterCovariance
from campaigns.kinematics.parameters import ParameterTable


def limits_section(evaluation: Evaluation) -> Section:
    """Return the section on the decision."""
    section = Section("limits", "Decision, limit by limit")
    section.table(
        "Specified limits",
        tables.limits("after calibration"),
        evaluation.verdict.requirements,
        "U includes the tracker's stated uncertainty of each shot; the robot's own scatter is part "
        "of the error e. Margin: limit − e; it must be larger than U. Limits: `acceptance` in "
        "campaign.yaml.",
    )
    return section


def gain_section(evaluation: Evaluation) -> Section:
    """Return the section on errors before and after calibration."""
    section = Section("gain", "Before and after")
    section.table(
        "Errors of distance and position",
        tables.ERRORS,
        tables.error_rows(evaluation),
        "Of absolute values. Fitted positions, fitted and hold-out pairs: by the model at the "
        "measured joint angles. Commanded: as the controller moved with the parameters it held.",
    )
    section.table(
        "The commanded robot, test by test",
        tables.GAINS,
        evaluation.gains,
        "U: of the difference (k = 2), with the tracker's uncertainty in both stages and, where "
        "repeated visits show it, the robot's own scatter: no two visits are the same. A "
        "difference that is not larger than its U shows no change.",
    )
    for name, stage in (("Before", evaluation.before), ("After", evaluation.after)):
        if stage is not None and stage.series_in_words:
            section.note(f"{name}: {stage.series_in_words}.")
    found = evaluation.evidence.identification
    if found is not None and found.hold_out is not None:
        section.text(f"hold-out test: {tables.hold_out_in_words(found.hold_out)}")
    if pairs := tables.pair_groups(evaluation):
        section.figure(
            "pair-errors",
            "Errors of distance, pair by pair",
            figures.pair_errors(pairs),
            "Each mark is a pair: its distance by the model (fitted and hold-out pairs) or as "
            "commanded, minus its measured distance. Numbers name the largest.",
        )
    return section


def workspace_section(evaluation: Evaluation) -> Section:
    """Return the section on errors over the workspace."""
    section = Section("workspace", "Errors over the workspace")
    positions = evaluation.errors.positions if evaluation.errors else None
    if positions is None:
        return section
    section.figure(
        "arrows",
        "Errors of position in the workspace",
        figures.error_arrows(positions),
        "From the modelled to the measured point, in the base frame as fitted for each model: "
        "where neighbouring arrows agree, the model is wrong.",
    )
    if positions.after_mm is not None:
        section.figure(
            "against-position",
            "Errors of position after, against place and angle",
            figures.errors_against_position(positions.poses, positions.after_mm, positions.fitted),
            "A line that rises or bends shows something that the model lacks, such as a load, a "
            "bent part or heat.",
        )
    return section


def motion_tests_section(evaluation: Evaluation) -> Section:
    """Return the section on straightness, rotation, repeatability, and AP and RP of ISO 9283."""
    section = Section("tests", "Straightness, rotation, repeatability")
    results = before, after = evaluation.before, evaluation.after
    stages = {"before": before, "after": after}
    measured = [stage for stage in results if stage is not None]
    if any(stage.lines for stage in measured):
        section.figure(
            "straightness",
            "Straightness",
            figures.straightness(results),
            "Distance of the point from its own best straight line, in the two directions across "
            "the commanded line.",
        )
    if any(stage.rotation for stage in measured):
        section.figure(
            "rotation",
            "Rotation",
            figures.rotation(results),
            "Where the point goes while only θ should change.",
        )
    if any(stage.repeatability for stage in measured):
        section.figure(
            "repeatability",
            "Repeatability",
            figures.repeatability(results),
            "Visits of one pose from different directions, about their mean, with the smallest "
            "sphere about it that holds all.",
        )
    old, new = (iso_rows(stage) if stage else () for stage in results)
    section.table(
        "ISO 9283, before and after calibration",
        tables.ISO,
        [*zip_longest(old, new)],
        "AP and RP are tested as the standard has it, but for the base frame of AP, which is "
        "fitted. n: visits; U: k = 2.",
    )
    frames = " ".join(f"{n.title()}: {cube_frame(s)}." for n, s in stages.items() if s and s.cube)
    section.table(
        "ISO 9283, five poses of the inclined plane in the cube",
        tables.CUBE,
        cube_poses(**stages),
        "Commanded places in the base frame. AP: from the commanded place to the mean of the "
        f"visits; RP: l̄ + 3 S of the visits' distances from their mean. U: k = 2. {frames}",
    )
    return section


def parameters_section(evaluation: Evaluation) -> Section:
    """Return the section on the findings of the identification, parameters and correlations."""
    section = Section("parameters", "Findings and parameters")
    found = evaluation.evidence.identification
    if found is None:
        return section
    section.text(*tables.in_words(found))
    if not found.findings:
        section.note("The identification has no findings.")
    section.table(
        "Findings of the identification",
        tables.FINDINGS,
        found.findings,
        "Accepted: somebody took the result with it (`--force`).",
    )
    table = evaluation.evidence.campaign.robot.mechanism.parameters
    section.table(
        "Parameters old and new",
        tables.parameters(table),
        found.parameters.items(),
        "σ: one standard deviation. Within U: |Δ| is not larger than U = 2 σ, so no change is "
        "shown. Held: not fitted, kept at nominal.",
    )
    section.table(
        "Determined by no shot, and kept at nominal",
        [words("parameter, or combination of parameters", ", ".join)],
        found.undetermined,
    )
    if found.covariance is not None:
        geometry = _of_geometry(found.covariance, table)
        section.table("Strongest correlations", tables.CORRELATIONS, geometry.strongest(8))
        section.figure(
            "correlations",
            "Correlations of the identified parameters",
            figures.correlation_map(geometry),
            "The darker, the less these shots separate two parameters.",
        )
    return section


def _of_geometry(known: ParameterCovariance, table: ParameterTable) -> ParameterCovariance:
    """Return the covariance of the parameters that every robot file has."""
    places = [place for place, name in enumerate(known.names) if name in table.names]
    names = tuple(known.names[place] for place in places)
    rows = tuple(tuple(known.matrix[row][column] for column in places) for row in places)
    return ParameterCovariance(names, rows)


def budget_section(evaluation: Evaluation) -> Section:
    """Return the section on the uncertainty of positions."""
    section = Section("budget", "Uncertainty of positions")
    found: IdentificationResult | None = evaluation.evidence.identification
    if found is None or not found.budget:
        return section
    section.table(
        "Uncertainty budget of positions",
        tables.BUDGET,
        tables.budget_rows(found),
        "1 σ of a position by the identified parameters, rms over the workspace. Type A: estimated "
        "from the scatter of these shots; B: stated or known before. The rows add up in squares to "
        "the combined σ.",
    )
    section.text(
        *tables.positions_in_words(found),
        "U of a position is 2 σ of this table, of a point by the identified model; U of a distance "
        "in the tables of limits is that of the tracker between two measured points",
    )
    return section
