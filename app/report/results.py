"""Sections of the page on results: limits, before and after, workspace, tests, the model.

A section's function adds what the evaluation has and leaves out the remaining blocks: the tables
drop themselves when they have no rows. Notes below tables say what U, n and each figure mean, so
that a page can be read without this software's documentation.
"""

from itertools import zip_longest

from app.report import figures, tables
from app.report.course import Course
from app.report.section import Section
from campaigns.assessment import Evaluation
from campaigns.evaluation.iso_figures import cube_frame, cube_poses, iso_rows
from campaigns.files.table import by_place
from campaigns.identification.determined import MOST_ASSUMED
from campaigns.identification.findings import UNSEEN_ROWS, WRONG_ROWS
from campaigns.identification.result import IdentificationResult


def limits_section(evaluation: Evaluation) -> Section:
    """Return the section on the decision."""
    section = Section("limits", "Decision, limit by limit")
    section.table(
        "Specified limits",
        tables.limits("after calibration"),
        evaluation.verdict.requirements,
        "U: as stated with the decision rule. Margin: limit − e; it must not be smaller than U. "
        "Limits: `acceptance` in campaign.yaml. The largest distance error may have a smaller U "
        "than the mean: its U is of one pair, that of the mean is of all pairs on average, since "
        "averaging does not reduce errors of the instrument that they have in common.",
    )
    return section


def gain_section(evaluation: Evaluation) -> Section:
    """Return the section on errors before and after calibration."""
    section = Section("gain", "Before and after")
    section.table(
        "Errors of distance and position",
        tables.ERRORS,
        tables.error_rows(evaluation),
        "Of absolute values, at the measured joint angles. Fitted positions: by the model, with "
        "the motions and changes found. Fitted and hold-out pairs: by the parameters alone. "
        "Commanded: as the controller moved with the parameters it held.",
    )
    section.table(
        "The commanded robot, test by test",
        tables.GAINS,
        evaluation.gains,
        "U: of the difference, with the tracker's uncertainty and the robot's own scatter in both "
        "stages: no two visits are the same. An unknown scatter counts as 0.5 mm per axis. A "
        "difference that is not larger than its U shows no change. Errors of the instrument that "
        "are common to both stages cancel in the difference of means, so its U may be smaller than "
        "that of either.",
    )
    for name, stage in (("Before", evaluation.before), ("After", evaluation.after)):
        if stage is not None and stage.series_in_words:
            section.note(f"{name}: {stage.series_in_words}.")
    identification = evaluation.evidence.identification
    if identification is not None and (test := identification.judgement.hold_out) is not None:
        section.text(f"hold-out test: {tables.hold_out_in_words(test)}")
    if pairs := tables.pair_groups(evaluation):
        section.figure(
            "pair-errors",
            "Errors of distance, pair by pair",
            figures.pair_errors(pairs),
            "Each mark is a pair: its distance by the parameters (fitted and hold-out pairs) or as "
            "commanded, minus its measured distance. Numbers name the largest.",
        )
    return section


def workspace_section(evaluation: Evaluation) -> Section:
    """Return the section on errors over the workspace."""
    section = Section("workspace", "Errors over the workspace")
    positions = evaluation.errors.positions if evaluation.errors else None
    if positions is None:
        return section
    course = Course.of(evaluation.evidence)
    left_out_mm = figures.NO_PLACES if course is None else course.left_out_mm
    crosses = " Crosses: places of shots that were left out." if len(left_out_mm) else ""
    section.figure(
        "arrows",
        "Errors of position in the workspace",
        figures.error_arrows(positions, left_out_mm),
        "From the point by the parameters to the measured one, in the base frame as fitted for "
        "each model: where neighbouring arrows agree, the parameters are wrong, or the robot or "
        f"its stand changed.{crosses}",
    )
    if positions.after_mm is not None:
        section.figure(
            "against-position",
            "Errors of position after, against place and angle",
            figures.errors_against_position(
                positions.poses,
                positions.after_mm,
                positions.fitted,
                evaluation.evidence.campaign.robot.mechanism.task,
            ),
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
            "Where the point goes while only the platform should turn.",
        )
    if any(stage.repeatability for stage in measured):
        section.figure(
            "repeatability",
            "Repeatability",
            figures.repeatability(results),
            "Visits of one pose from different directions, about their mean, with the smallest "
            "sphere about it that holds all.",
        )
    # both stages form the same figures in the same order; a stage that was not measured has none
    old, new = (iso_rows(stage) if stage else () for stage in results)
    section.table(
        "ISO 9283, before and after calibration",
        tables.ISO,
        [*zip_longest(old, new)],
        "AP and RP are tested as the standard has it, but for the base frame of AP, which is "
        "fitted. n: visits.",
    )
    frames = " ".join(f"{n.title()}: {cube_frame(s)}." for n, s in stages.items() if s and s.cube)
    section.table(
        "ISO 9283, five poses of the inclined plane in the cube",
        tables.CUBE,
        cube_poses(**stages),
        "Commanded places in the base frame. AP: from the commanded place to the mean of the "
        f"visits; RP: l̄ + 3 S of the visits' distances from their mean. {frames}",
    )
    return section


def parameters_section(evaluation: Evaluation) -> Section:
    """Return the section on the findings of the identification, parameters and correlations."""
    section = Section("parameters", "Findings and parameters")
    identification = evaluation.evidence.identification
    if identification is None:
        return section
    section.text(*tables.in_words(identification))
    if not identification.judgement.findings:
        section.note("The identification has no findings.")
    section.table(
        "Findings of the identification",
        tables.FINDINGS,
        identification.judgement.findings,
        "Accepted: somebody took the result with it (`--force`).",
    )
    table = evaluation.evidence.campaign.robot.mechanism.parameters
    section.table(
        "Parameters old and new",
        tables.parameters(table),
        identification.value.parameters.items(),
        "σ: one standard deviation. Within U: |Δ| is not larger than U = 2 σ, so no change is "
        "shown. Held: not fitted, kept at nominal.",
    )
    section.table(
        "Determined by no shot, and kept at nominal",
        by_place("", "parameters"),
        tables.undetermined_rows(identification),
    )
    if (covariance := identification.determined_covariance) is not None:
        section.table(
            "Strongest correlations", tables.CORRELATIONS, tables.correlations(identification)
        )
        section.figure(
            "correlations",
            "Correlations of the identified geometry",
            figures.correlation_map(covariance),
            "The darker, the less these shots separate two parameters. Without parameters of "
            "combinations determined by no shot: how these correlate follows from where the base "
            "frame is put, not from the shots.",
        )
    return section


def observations_section(evaluation: Evaluation) -> Section:
    """Return the section on observations of other kinds than points, and what they determine."""
    section = Section("observations", "Observations without a tracker, and what they determine")
    evidence = evaluation.evidence
    section.table(
        "Imported observations",
        tables.OBSERVED,
        tables.observed_rows(evidence.observations.rows),
        "Objects stand in campaign.yaml. `identify --hold-out` keeps a share of those out of the "
        "fit of which the file holds none out.",
    )
    identification = evidence.identification
    if identification is None:
        return section
    section.table(
        "What they determine",
        tables.DETERMINED,
        tables.determined_rows(identification),
        "σ: one standard deviation, of all coordinates together. flat: height above the touched "
        "plane, up to a plane. xy: in that plane, up to two shifts and a turn. Determined: at most "
        f"{100.0 * MOST_ASSUMED:.0f} % of the variance comes from tolerances. Tested: by "
        "observations that were never fitted.",
    )
    names = (UNSEEN_ROWS, WRONG_ROWS)
    section.text(*(f.says for f in identification.judgement.findings if f.name in names))
    return section


def course_section(evaluation: Evaluation) -> Section:
    """Return the section on wrong shots, changes and slow motions during the campaign."""
    section = Section("course", "Course of the campaign")
    course = Course.of(evaluation.evidence)
    if course is None:
        return section
    section.table(
        "Wrong shots and changes",
        tables.events(course.mechanism.joints),
        course.identification.judgement.events,
        "Wrong shot: by how far it is off where all others put it. Change: the component that is "
        "largest in its σ, of all parts that explain it nearly as well. U is 2 σ.",
    )
    if not course.identification.judgement.events:
        section.text("no shot contradicts the others, and no part changed")
    if not course.has_slow_stand:
        section.text(course.stand_in_words)
    title = "The campaign, shot by shot"
    section.figure("course-of-shots", title, course.panels(), course.caption())
    return section


def budget_section(evaluation: Evaluation) -> Section:
    """Return the section on the uncertainty of positions."""
    section = Section("budget", "Uncertainty of positions")
    identification: IdentificationResult | None = evaluation.evidence.identification
    if identification is None or not identification.uncertainty.budget:
        return section
    section.table(
        "Uncertainty budget of positions",
        tables.BUDGET,
        tables.budget_rows(identification),
        "1 σ of a position by the identified parameters, rms over the workspace. Type A: estimated "
        "from the scatter of these shots; B: stated or known before. The rows add up in squares to "
        "the combined σ.",
    )
    section.text(
        *tables.positions_in_words(identification),
        "U of a position is 2 σ of this table, of a point by the identified model; U in the table "
        "of limits is of what was measured there",
    )
    return section
