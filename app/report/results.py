"""Sections of the page on results: limits, before and after, workspace, tests, ISO 9283."""

from itertools import zip_longest

from app.report import figures
from app.report.model_tables import hold_out_in_words
from app.report.result_tables import (
    CUBE,
    ERRORS,
    GAINS,
    ISO,
    error_group,
    errors,
    limits,
    pair_groups,
)
from app.report.section import NO_IDENTIFICATION, NO_RUN, Section
from campaigns.evaluation.iso_figures import cube_frame, cube_poses, iso_rows
from campaigns.evidence import Evaluation


def limits_section(evaluation: Evaluation) -> Section:
    """Return the section on the decision."""
    section = Section("limits", "Decision, limit by limit")
    section.table(
        "Limits asked for",
        limits("after calibration"),
        evaluation.verdict.requirements,
        "U includes the tracker's stated uncertainty of each shot; the robot's own scatter is part "
        "of the error e. Margin: limit − e; it must be larger than U. Limits: `acceptance` in "
        "campaign.yaml.",
    )
    section.lack_validation(evaluation, "after")
    return section


def gain_section(evaluation: Evaluation) -> Section:
    """Return the section on errors before and after calibration."""
    section = Section("gain", "Before and after")
    found = evaluation.evidence.identification
    if rows := errors(evaluation):
        section.table(
            "Errors of distance and position",
            ERRORS,
            rows,
            "Of absolute values. Fitted positions, fitted and hold-out pairs: by the model at the "
            "measured joint angles. Commanded: as the controller moved with the parameters it "
            "held.",
        )
    if evaluation.gains:
        section.table(
            "The commanded robot, test by test",
            GAINS,
            evaluation.gains,
            "U: k = 2, with the tracker's uncertainty in both stages and, where repeated visits "
            "show it, the robot's own scatter: no two visits are the same. A difference that is "
            "not larger than its U shows no change.",
        )
        for name, stage in (("Before", evaluation.before), ("After", evaluation.after)):
            if stage is not None and stage.series_in_words:
                section.note(f"{name}: {stage.series_in_words}.")
    if found is not None and found.hold_out is not None:
        section.text(f"hold-out test: {hold_out_in_words(found.hold_out)}")
    if evaluation.evidence.run is None:
        section.lack(NO_RUN)
    elif found is None:
        section.lack(NO_IDENTIFICATION)
    section.lack_validation(evaluation, "before", "after")
    shots = evaluation.errors.shots if evaluation.errors else None
    if shots is not None and shots.after_mm is not None:
        group = error_group("fitted shots", "o", shots.before_mm, shots.after_mm, shots.numbers)
        section.figure(
            "shot-errors",
            "Errors of position, shot by shot",
            figures.pair_errors([group], "length of the error", "shots"),
            "Each mark is a fitted shot: the distance from its modelled place to its measured one. "
            "Numbers name the largest.",
        )
    if pairs := pair_groups(evaluation):
        section.figure(
            "pair-errors",
            "Errors of distance, pair by pair",
            figures.pair_errors(pairs, "error of distance", "pairs"),
            "Each mark is a pair: its distance by the model (fitted and hold-out pairs) or as "
            "commanded, minus its measured distance. Numbers name the largest.",
        )
        section.figure(
            "histogram",
            "How the errors of distance are spread",
            figures.histogram(pairs),
            "After calibration they should be centred on zero, with a single peak.",
        )
    return section


def workspace_section(evaluation: Evaluation) -> Section:
    """Return the section on errors over the workspace."""
    section = Section("workspace", "Errors over the workspace")
    errors = evaluation.errors
    if errors is None:
        section.lack(NO_RUN)
        return section
    positions = errors.positions
    if positions is None:
        section.lack("Too few shots of pairs to fit a frame: errors of position cannot be shown.")
        return section
    section.figure(
        "arrows",
        "Errors of position in the workspace",
        figures.error_arrows(positions.poses, positions.before_mm, positions.after_mm),
        "From the modelled to the measured point, in the base frame as fitted for each model: "
        "where neighbouring arrows agree, the model is wrong.",
    )
    if positions.after_mm is None:
        section.lack(NO_IDENTIFICATION)
        return section
    section.figure(
        "against-position",
        "Errors of position after, against place and angle",
        figures.errors_against_position(positions.poses, positions.after_mm, positions.fitted),
        "A line that rises or bends shows something that the model lacks, such as a load, a bent "
        "part or heat.",
    )
    if positions.plate_tilt_rad.any():
        section.figure(
            "plate-tilt",
            "Tilt of the plate, by the identified model",
            figures.plate_tilt(positions.poses, positions.plate_tilt_rad),
            "Computed from the identified parameters, not measured: 1 mrad moves the tip of a tool "
            "of 100 mm by 0.1 mm.",
        )
    return section


def tests_section(evaluation: Evaluation) -> Section:
    """Return the section on straightness, rotation and repeatability."""
    section = Section("tests", "Straightness, rotation, repeatability")
    before, after = evaluation.before, evaluation.after
    stages = [stage for stage in (before, after) if stage is not None]
    if any(stage.lines for stage in stages):
        section.figure(
            "straightness",
            "Straightness",
            figures.straightness(before, after),
            "Distance of the point from its own best straight line, in the two directions across "
            "the commanded line.",
        )
    if any(stage.rotation for stage in stages):
        section.figure(
            "rotation",
            "Rotation",
            figures.rotation(before, after),
            "Where the point goes while only θ should change.",
        )
    if any(stage.repeatability for stage in stages):
        section.figure(
            "repeatability",
            "Repeatability",
            figures.repeatability(before, after),
            "Visits of one pose from different directions, about their mean, with the smallest "
            "sphere about it that holds all.",
        )
    section.lack_validation(evaluation, "before", "after")
    return section


def iso_section(evaluation: Evaluation) -> Section:
    """Return the section on AP and RP of ISO 9283."""
    section = Section("iso9283", "ISO 9283")
    before, after = evaluation.before, evaluation.after
    figures_of = [iso_rows(stage) if stage else () for stage in (before, after)]
    if rows := [*zip_longest(figures_of[0], figures_of[1])]:
        section.table(
            "Before and after calibration",
            ISO,
            rows,
            "AP and RP are tested as the standard has it, but for the base frame of AP, which is "
            "fitted. n: visits; U: k = 2.",
        )
    if poses := cube_poses(before=before, after=after):
        frames = (
            f" {name}: {cube_frame(stage)}."
            for name, stage in (("Before", before), ("After", after))
            if stage is not None and stage.cube
        )
        section.table(
            "Five poses of the inclined plane in the cube",
            CUBE,
            poses,
            "Commanded places in the base frame. AP: from the commanded place to the mean of the "
            "visits, and its components; RP: l̄ + 3 S of the visits' distances from their mean. "
            f"U: k = 2.{''.join(frames)}",
        )
    section.lack_validation(evaluation, "before", "after")
    return section
