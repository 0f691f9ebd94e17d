"""The figures of the page, each with what is to be seen in it. None is drawn here."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from app.report.figures import distances, tests, time_and_parameters, workspace
from app.report.figures.distances import PairGroup
from app.report.parts import Picture
from campaigns.evaluation.model_errors import PairErrors, PositionErrors, ShotErrors
from campaigns.evaluation.validation import ValidationResult
from campaigns.evidence import Evaluation


def distance_pictures(contents: Evaluation) -> Iterator[Picture]:
    """Errors shot by shot if positions were fitted, pair by pair, and the latter's histogram."""
    if contents.errors is not None and contents.errors.shots is not None:
        yield _shot_picture(contents.errors.shots)
    groups = pair_groups(contents)
    if not groups:
        return
    yield Picture(
        "pair-errors",
        "Errors of distance, pair by pair",
        "Each mark is a pair: its distance by the model, or as commanded, minus its measured "
        "distance. Fitted pairs were used to identify; unseen pairs never were. For commanded "
        "pairs the controller's own parameters count. After calibration all should scatter about "
        "zero, and the unseen pairs hardly more than the fitted ones.",
        partial(distances.pair_errors, groups),
    )
    yield Picture(
        "histogram",
        "How the errors of distance are spread",
        "Before, the errors lean to one side: that is what a wrong geometry does. After, they "
        "should be centred on zero, with a single hump.",
        partial(distances.histogram, groups),
    )


def workspace_pictures(contents: Evaluation) -> Iterator[Picture]:
    """Errors of position where they are."""
    positions = contents.errors.positions if contents.errors else None
    if positions is None:
        return
    yield _arrows(positions)
    if positions.after_mm is not None:
        yield Picture(
            "against-position",
            "Errors of position after, against place and angle",
            "A line that rises or bends shows something that the model does not hold, such as a "
            "load, a bent part or heat. A level line shows that nothing depends on the place.",
            partial(
                workspace.errors_against_position,
                positions.poses,
                positions.after_mm,
                positions.fitted,
            ),
        )


def test_pictures(
    before: ValidationResult | None, after: ValidationResult | None
) -> Iterator[Picture]:
    """Straightness, rotation and repeatability, as far as they were measured."""
    if any(stage and stage.lines for stage in (before, after)):
        yield Picture(
            "straightness",
            "Straightness",
            "How far the point is from its own best straight line while the controller is told to "
            "follow one, in the two directions across it. The number is the largest distance.",
            partial(tests.straightness, before, after),
        )
    turns = [stage.rotation if stage else None for stage in (before, after)]
    if any(turns):
        yield Picture(
            "rotation",
            "Rotation",
            "Where the point goes while only θ should change. The number is the largest distance "
            "between any two of its places.",
            partial(tests.rotation, *turns),
        )
    clouds = [stage.repeatability if stage else None for stage in (before, after)]
    if any(clouds):
        yield Picture(
            "repeatability",
            "Repeatability",
            "One pose, visited again and again from different directions, seen from three sides "
            "about the mean, with the smallest sphere about it that holds all visits. Calibration "
            "does not change it: no robot becomes more accurate than this.",
            partial(tests.repeatability, *clouds),
        )


def time_picture(contents: Evaluation) -> Picture | None:
    """Air and drift."""
    if not contents.time_series:
        return None
    return Picture(
        "over-time",
        "Air and drift while measuring",
        "Above, the air's temperature at each shot; below, how far the drift pose has moved since "
        "it was first measured. A steady rise of either means that something warmed up or gave way "
        "during the measurement.",
        partial(time_and_parameters.over_time, contents.time_series),
    )


def correlation_picture(contents: Evaluation) -> Picture | None:
    """The parameters' correlations."""
    found = contents.evidence.identification
    if found is None or found.covariance is None or not found.covariance.names:
        return None
    return Picture(
        "correlations",
        "Correlations of the identified parameters",
        "The darker, the less two parameters can be told apart with these shots: an error in one "
        "is made good by an error in the other.",
        partial(time_and_parameters.correlation_map, found.covariance),
    )


def pair_groups(contents: Evaluation) -> tuple[PairGroup, ...]:
    """Fitted and unseen pairs by the models, and the pairs that the controller was told."""
    errors = contents.errors
    groups = [
        _group("fitted pairs", "o", errors.fitted if errors else None),
        _group("unseen pairs", "D", errors.unseen if errors else None),
    ]
    told = [
        stage.distances.errors_mm if stage and stage.distances else None
        for stage in (contents.before, contents.after)
    ]
    if any(values is not None for values in told):
        groups.append(PairGroup("commanded pairs", "s", *told))
    return tuple(group for group in groups if group is not None)


def _shot_picture(shots: ShotErrors) -> Picture:
    before, after = (np.linalg.norm(e, axis=1) for e in (shots.before_mm, shots.after_mm))
    return Picture(
        "shot-errors",
        "Errors of position, shot by shot",
        "Each mark is a shot that was identified from: the distance from its modelled place to its "
        "measured one, the tracker's place being fitted too. After, none should stand out from its "
        "neighbours.",
        partial(
            distances.pair_errors,
            [PairGroup("fitted shots", "o", before, after)],
            quantity="length of the error",
            what="shots",
        ),
    )


def _arrows(positions: PositionErrors) -> Picture:
    return Picture(
        "arrows",
        "Errors of position in the workspace",
        "From the point that the model gives to the point that was measured, in the base frame as "
        "fitted for each model. Arrows of neighbours that agree are errors of the model; arrows "
        "that point everywhere are the robot's repeatability and the tracker's noise.",
        partial(workspace.error_arrows, positions.poses, positions.before_mm, positions.after_mm),
    )


def _group(name: str, marker: str, errors: PairErrors | None) -> PairGroup | None:
    return None if errors is None else PairGroup(name, marker, errors.before_mm, errors.after_mm)
