"""The figures with what is to be seen in them. None is drawn here."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from app.papers.corbel2006 import figures, printed
from app.papers.corbel2006.comparison import Comparison, Row, of_experiment
from app.papers.corbel2006.evidence import Evidence
from app.papers.corbel2006.experiments import EXPERIMENTS, PROTOTYPE, REPEATABILITY, SIMULATION
from app.papers.corbel2006.floors import Floor
from app.papers.corbel2006.summary import middle
from app.papers.corbel2006.trials import TrialResult
from app.report.figures.distances import PairGroup, pair_errors
from app.report.parts import Picture

Results = Sequence[TrialResult]


def fig_7(results: Results) -> Iterator[Picture]:
    """Of the simulation's middle seed."""
    yield from _pair_errors("fig-7", "Fig. 7", of_experiment(results, SIMULATION.name))


def fig_8(results: Results) -> Iterator[Picture]:
    """Of the prototype's middle seed."""
    yield from _pair_errors("fig-8", "Fig. 8", of_experiment(results, PROTOTYPE.name))


def overview(comparison: Comparison) -> Iterator[Picture]:
    """Every figure of the experiment in mm."""
    rows = tuple(_overview_rows(comparison))
    if rows:
        yield Picture(
            "every-seed",
            "The experiment, every seed",
            "A dot is a seed, light before and dark after calibration; the upright stroke is our "
            'median, the red diamond what the paper prints, an arrowhead where it says "above". '
            "The grey bar is what is asked of the median. The scale is logarithmic.",
            partial(figures.every_seed, rows),
        )


def parameters(results: Results) -> Iterator[Picture]:
    """By how much they are missed, in each experiment."""
    markers = dict(zip((SIMULATION, PROTOTYPE, REPEATABILITY), "osD", strict=True))
    series = [
        (experiment.name, markers[experiment], own)
        for experiment in EXPERIMENTS
        if (own := of_experiment(results, experiment.name))
    ]
    if series:
        yield Picture(
            "parameters-missed",
            "By how much parameters are missed",
            "Median of all seeds, and their 5 to 95 %. With the tracker's noise alone the "
            "parameters are found; with the robot's repeatability they are not the real ones any "
            "more, although the robot is better by them. Section IV.D says the same.",
            partial(figures.parameters_missed, series),
        )


def noise(comparison: Comparison, evidence: Evidence) -> Iterator[Picture]:
    """Three tests in which the robot's noise alone explains what is left."""
    found = {
        row.quantity.name: row.values
        for compared in comparison.groups
        if compared.group.experiment is PROTOTYPE
        for row in compared.rows
    }
    panels = [
        (_floor(evidence, start), found[name])
        for start, name in (
            ("rotation", "rotation, after"),
            ("straightness", "along x, after"),
            ("repeatability", "radius of the sphere"),
        )
        if name in found
    ]
    if panels:
        yield Picture(
            "noise-alone",
            "What noise alone leaves",
            "Grey: the test drawn 2000 times on a robot whose geometry is perfectly known, with "
            "the paper's repeatability of ± 0.4/√3 mm. No calibration gets below it. For "
            "straightness the three red lines are those of the paper, and our seeds are of the "
            "line along x.",
            partial(figures.noise_alone, panels),
        )


def lengths(evidence: Evidence) -> Iterator[Picture]:
    """Errors of distance against distance."""
    if evidence.pairs is not None:
        yield Picture(
            "errors-and-lengths",
            "Errors before calibration, and distances",
            "A mark is a validation pair of one of the seeds. Which pairs the paper took is not "
            "printed; shorter ones give its figures.",
            partial(
                figures.errors_and_lengths,
                evidence.pairs,
                printed.MEAN_BEFORE,
                printed.MAX_BEFORE,
            ),
        )


def reached(evidence: Evidence) -> Picture:
    """The robot as printed beside ours."""
    return Picture(
        "reached",
        "What the robots reach",
        "Points of a 25 mm grid that can be reached at θ = 0: on the left all of the robot as "
        "printed, on the right one in eight of our reading of it.",
        partial(figures.reached, evidence.reaches[0], evidence.reaches[-1]),
    )


def _pair_errors(name: str, title: str, own: Results) -> Iterator[Picture]:
    if not own:
        return
    shown = own[middle([max(map(abs, result.fitted.after_mm)) for result in own])]
    groups = [
        PairGroup(kind, marker, np.array(errors.before_mm), np.array(errors.after_mm))
        for kind, marker, errors in (
            ("fitted pairs", "o", shown.fitted),
            ("unseen pairs", "D", shown.unseen),
        )
    ]
    yield Picture(
        name,
        f"{title}: errors of distance, seed {shown.seed}",
        f"Modelled minus measured distance of each pair. Of {len(own)} seeds the one whose largest "
        "error after calibration is in the middle. The paper shows fitted pairs only; unseen ones "
        "took no part in the identification.",
        partial(pair_errors, groups),
    )


def _overview_rows(comparison: Comparison) -> Iterator[tuple[str, Row]]:
    """Rows in mm of the prototype's groups, each with the group's short name."""
    for compared in comparison.groups:
        short = compared.group.title.split(":")[0]
        for row in compared.rows:
            if compared.group.experiment is PROTOTYPE and row.quantity.unit == "mm":
                yield f"{short} · {row.quantity.name}", row


def _floor(evidence: Evidence, start: str) -> Floor:
    return next(floor for floor in evidence.floors if floor.name.startswith(start))
