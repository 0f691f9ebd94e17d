"""The figures of the page, each with what is to be seen in it."""

from collections.abc import Iterator

from app.report.contents import Contents
from app.report.figures import distances, tests, time_and_parameters, workspace
from app.report.figures.distances import PairGroup
from app.report.figures.drawing import svg_text
from app.report.model_errors import PairErrors
from app.report.parts import Picture
from app.report.stages import StageView


def distance_pictures(contents: Contents) -> Iterator[Picture]:
    """Errors pair by pair, and their histogram."""
    groups = pair_groups(contents)
    if not groups:
        return
    title = "Errors of distance, pair by pair"
    yield Picture(
        "pair-errors",
        title,
        "Each mark is a pair: its distance by the model, or as commanded, minus its measured "
        "distance. Fitted pairs were used to identify; unseen pairs never were. For commanded "
        "pairs the controller's own parameters count. After calibration all should scatter about "
        "zero, and the unseen pairs no more than the fitted ones.",
        svg_text(distances.pair_errors(groups), "pair-errors", title),
    )
    title = "How the errors of distance are spread"
    yield Picture(
        "histogram",
        title,
        "Before, the errors lean to one side: that is what a wrong geometry does. After, they "
        "should be centred on zero, with a single hump.",
        svg_text(distances.histogram(groups), "histogram", title),
    )


def workspace_pictures(contents: Contents) -> Iterator[Picture]:
    """Errors of position where they are."""
    positions = contents.errors.positions if contents.errors else None
    if positions is None:
        return
    title = "Errors of position in the workspace"
    arrows = workspace.error_arrows(positions.poses, positions.before_mm, positions.after_mm)
    yield Picture(
        "arrows",
        title,
        "From the point that the model gives to the point that was measured, in the base frame as "
        "fitted for each model. Arrows of neighbours that agree are errors of the model; arrows "
        "that point everywhere are the robot's repeatability and the tracker's noise.",
        svg_text(arrows, "arrows", title),
    )
    if positions.after_mm is None:
        return
    title = "Errors of position after, against place and angle"
    against = workspace.errors_against_position(
        positions.poses, positions.after_mm, positions.fitted
    )
    yield Picture(
        "against-position",
        title,
        "A line that rises or bends shows something that the model does not hold, such as a load, "
        "a bent part or heat. A level line shows that nothing depends on the place.",
        svg_text(against, "against-position", title),
    )


def test_pictures(before: StageView | None, after: StageView | None) -> Iterator[Picture]:
    """Straightness, rotation and repeatability, as far as they were measured."""
    if any(stage and stage.lines for stage in (before, after)):
        title = "Straightness"
        yield Picture(
            "straightness",
            title,
            "How far the point is from its own best straight line while the controller is told to "
            "follow one, in the two directions across it. The number is the largest distance.",
            svg_text(tests.straightness(before, after), "straightness", title),
        )
    turns = [stage.turn if stage else None for stage in (before, after)]
    if any(turns):
        title = "Rotation"
        yield Picture(
            "rotation",
            title,
            "Where the point goes while only θ should change. The number is the largest distance "
            "between any two of its places.",
            svg_text(tests.rotation(*turns), "rotation", title),
        )
    clouds = [stage.cloud if stage else None for stage in (before, after)]
    if any(clouds):
        title = "Repeatability"
        yield Picture(
            "repeatability",
            title,
            "One pose, visited again and again from different directions, seen from three sides "
            "about the mean, with the smallest sphere about it that holds all visits. Calibration "
            "does not change it: no robot becomes more accurate than this.",
            svg_text(tests.repeatability(*clouds), "repeatability", title),
        )


def time_picture(contents: Contents) -> Picture | None:
    """Air and drift."""
    if not contents.courses:
        return None
    title = "Air and drift while measuring"
    return Picture(
        "over-time",
        title,
        "Above, the air's temperature at each shot; below, how far the drift pose has moved since "
        "it was first measured. A steady rise of either means that something warmed up or gave way "
        "during the measurement.",
        svg_text(time_and_parameters.over_time(contents.courses), "over-time", title),
    )


def correlation_picture(contents: Contents) -> Picture | None:
    """The parameters' correlations."""
    if contents.correlations is None:
        return None
    title = "Correlations of the identified parameters"
    return Picture(
        "correlations",
        title,
        "The darker, the less two parameters can be told apart with these shots: an error in one "
        "is made good by an error in the other.",
        svg_text(time_and_parameters.correlation_map(contents.correlations), "correlations", title),
    )


def pair_groups(contents: Contents) -> tuple[PairGroup, ...]:
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


def _group(name: str, marker: str, errors: PairErrors | None) -> PairGroup | None:
    return None if errors is None else PairGroup(name, marker, errors.before_mm, errors.after_mm)
