"""pkmcal plan: where to measure."""

from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json, Plot

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.random import Generator

    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.numerics.prediction import Prediction
    from campaigns.plan_check import CheckedPlan
    from campaigns.plan_file import PlannedShot
    from campaigns.planning import PlanRequest

MINUTE_S = 60.0


class Placement(Enum):
    """Where poses are placed; the value is the word on the command line and in campaign.yaml."""

    BOUNDARY = "boundary"
    OPTIMAL = "optimal"


def command(
    context: typer.Context,
    folder: Folder,
    *,
    shots: Annotated[
        int | None,
        typer.Option(min=2, metavar="N", help="Shots to identify from, two a pair; others on top."),
    ] = None,
    placement: Annotated[
        Placement | None,
        typer.Option(
            help="boundary: near the limits of the workspace, as in the paper; optimal: the pairs "
            "of thousands that tell most about positions all over it."
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="Another seed than campaign.yaml's.")
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Choose the poses and write plan.csv.

    Pairs near the workspace's boundary to identify from, pairs all over it that stay unseen by
    the fit, and one pose at start, middle and end that shows drift. Every pose and every way is
    checked: reach, joint limits, swing, singularity, the reflector's angle to the tracker.

    Says before anything moves how well each parameter will be known. Defaults stand under `plan`
    in campaign.yaml; plan.csv may be edited and is checked again; an older one is kept.
    """
    from app.console import terminal_of
    from app.errors import UsageInvalid
    from app.folder import open_campaign

    if shots is not None and shots % 2:
        raise UsageInvalid(f"--shots is {shots}, but two make a pair", remedy="give an even number")
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    checked, predicted = make(campaign, shots, seed, placement)
    show(terminal, checked, predicted)
    terminal.say(f"written: {campaign.plan_path}")
    if plot is not None:
        from app.report.plots import plot_plan

        plot_plan(plot, checked.shots)
        terminal.say(f"drawn: {plot}")
    terminal.note(f"next: pkmcal validate {folder} --stage before, pkmcal run {folder}")
    terminal.document(plan_document(campaign, checked, predicted))


def make(
    campaign: "Campaign",
    shots: int | None = None,
    seed: int | None = None,
    placement: Placement | None = None,
) -> "tuple[CheckedPlan, Prediction]":
    """Make, check and write a plan; raises `PlanInvalid` or `WriteFailed`."""
    import numpy as np

    from app.folder import held
    from app.setup import checked_plan, plan_request_of

    rng = np.random.default_rng(campaign.config.plan.seed if seed is None else seed)
    request = plan_request_of(campaign, shots)
    chosen = placement or Placement(campaign.config.plan.placement)
    planned = _placed(campaign, chosen, request, rng)
    checked = checked_plan(campaign, planned)
    predicted = predict(campaign, checked)
    with held(campaign):
        _write_beside_older(campaign.plan_path, checked.shots)
    return checked, predicted


def _placed(
    campaign: "Campaign", placement: Placement, request: "PlanRequest", rng: "Generator"
) -> "tuple[PlannedShot, ...]":
    from app.setup import view_of
    from campaigns.planning import make_plan

    robot, view = campaign.nominal.robot, view_of(campaign)
    if placement is Placement.BOUNDARY:
        return make_plan(robot, view, request, rng)
    from campaigns.numerics.instrument import TrackerUncertainty
    from campaigns.optimal_planning import OptimalRequest, make_optimal_plan

    wanted = OptimalRequest(request, TrackerUncertainty(), estimator="distances")
    return make_optimal_plan(robot, view, wanted, rng).shots


def predict(campaign: "Campaign", checked: "CheckedPlan") -> "Prediction":
    """What the plan's identification pairs will tell, at the tracker's uncertainty."""
    import numpy as np

    from campaigns.numerics.geometry import FREE_BY_DEFAULT
    from campaigns.numerics.instrument import (
        TrackerUncertainty,
        distance_variance_mm2,
        point_covariance_mm2,
    )
    from campaigns.numerics.prediction import predict_distances
    from campaigns.planning import joints_of, numeric_geometry, pairs_of, poses_of
    from campaigns.shot_sets import ShotSet

    poses = poses_of(checked.shots)
    pairs = pairs_of(checked.shots, ShotSet.IDENTIFICATION)
    from_tracker = poses[:, :3] - np.array(campaign.config.tracker.place_mm)
    covariance = point_covariance_mm2(from_tracker, TrackerUncertainty())
    variance = distance_variance_mm2(poses[:, :3], covariance, pairs[:, 0], pairs[:, 1])
    geometry = numeric_geometry(campaign.nominal.robot)
    joints = joints_of(checked.shots)
    return predict_distances(geometry, FREE_BY_DEFAULT, joints, poses, pairs, variance)


def plan_document(
    campaign: "Campaign", checked: "CheckedPlan", predicted: "Prediction"
) -> dict[str, object]:
    """The plan as `--json` prints it."""
    from campaigns.planning import pairs_of
    from campaigns.shot_sets import ShotSet

    pairs = len(pairs_of(checked.shots, ShotSet.IDENTIFICATION))
    return {
        "shots": 2 * pairs,
        "pairs": pairs,
        "predicted_std": std_by_name(predicted),
        "observability": predicted.indices | {"condition": _finite(predicted.condition)},
        "seconds_estimated": checked.seconds,
        "path": str(campaign.plan_path),
    }


def show(terminal: "Terminal", checked: "CheckedPlan", predicted: "Prediction") -> None:
    """The plan for people: picture, what it will tell, what it takes."""
    from app.picture import plan_picture

    for line in plan_picture(checked.shots):
        terminal.say(line)
    rows = [
        (name, "unknown" if std is None else f"{std:.4f} {name.rsplit('_', 1)[1]}")
        for name, std in std_by_name(predicted).items()
    ]
    terminal.table("What the plan will tell", ("parameter", "predicted σ"), rows)
    terminal.say(plan_line(checked))
    terminal.say(f"condition {predicted.condition:.0f}, {checked.detours} ways go round something")


def plan_line(checked: "CheckedPlan") -> str:
    """What a plan holds and takes, in one line."""
    from collections import Counter

    from app.progress_bar import interval

    counts = Counter(shot.purpose.value for shot in checked.shots)
    sets = ", ".join(f"{count} {purpose}" for purpose, count in counts.items())
    took = interval((checked.seconds, checked.seconds))
    return f"{len(checked.shots)} shots ({sets}), about {took}"


def std_by_name(predicted: "Prediction") -> dict[str, float | None]:
    """Predicted standard deviations in file units; None where nothing can be told."""
    from campaigns.numerics.geometry import FILE_UNIT, FREE_BY_DEFAULT, indices

    values = predicted.std / FILE_UNIT[indices(FREE_BY_DEFAULT)]
    return {n: _finite(s) for n, s in zip(FREE_BY_DEFAULT, values.tolist(), strict=True)}


def _finite(value: float) -> float | None:
    return value if value < float("inf") else None


def _write_beside_older(path: "Path", shots: "tuple[PlannedShot, ...]") -> None:
    """Write a plan; an older one is kept under the first free number, or stays if that fails."""
    from campaigns.errors import CampaignError
    from campaigns.plan_file import write_plan

    older = _moved_aside(path)
    try:
        write_plan(path, shots)
    except CampaignError:
        if older is not None:
            older.rename(path)
        raise


def _moved_aside(path: "Path") -> "Path | None":
    from campaigns.errors import WriteFailed

    if not path.exists():
        return None
    number = 1
    while (older := path.with_name(f"plan-older-{number}.csv")).exists():
        number += 1
    try:
        return path.rename(older)
    except OSError as error:
        raise WriteFailed(
            f"{path}: cannot be renamed to {older.name} ({error.strerror})",
            remedy="check that this user may write the folder",
        ) from error
