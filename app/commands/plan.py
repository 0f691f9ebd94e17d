"""pkmcal plan: where to measure."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from app.folder import Campaign
    from campaigns.numerics.prediction import Prediction
    from campaigns.plan_check import CheckedPlan

MINUTE_S = 60.0


def command(
    folder: Folder,
    *,
    shots: Annotated[
        int | None, typer.Option(min=2, help="Identification shots, two a pair; others on top.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of what is drawn.")] = None,
    json: Json = False,
) -> None:
    """Choose poses and write plan.csv: pairs near the workspace's boundary for identification,
    pairs all over it for validation, and a drift pose at start, middle and end.

    The plan is checked for reach, limits, swing, singularity, view and every way between poses.
    An older plan is kept beside it.
    """
    from app.console import Terminal
    from app.folder import open_campaign

    if shots is not None and shots % 2:
        raise typer.BadParameter(f"--shots is {shots}: two make a pair, give an even number")
    terminal = Terminal(as_json=json)
    campaign = open_campaign(folder)
    checked, predicted = make(campaign, shots, seed)
    document = plan_document(campaign, checked, predicted)
    terminal.table("What the plan will tell (1 σ)", ("parameter", "predicted σ"), _rows(predicted))
    terminal.say(
        f"{len(checked.shots)} shots, about {checked.seconds / MINUTE_S:.0f} min, "
        f"condition {predicted.condition:.0f}, {checked.detours} ways not straight"
    )
    terminal.say(f"written: {campaign.plan_path}")
    terminal.document(document)


def make(
    campaign: "Campaign", shots: int | None = None, seed: int | None = None
) -> "tuple[CheckedPlan, Prediction]":
    """Make, check and write a plan; raises `PlanInvalid` or `WriteFailed`."""
    import numpy as np

    from app.setup import checked_plan, plan_request_of, view_of
    from campaigns.plan_file import write_plan
    from campaigns.planning import make_plan

    rng = np.random.default_rng(campaign.config.plan.seed if seed is None else seed)
    request = plan_request_of(campaign, shots)
    planned = make_plan(campaign.nominal.robot, view_of(campaign), request, rng)
    checked = checked_plan(campaign, planned)
    _keep_older(campaign.plan_path)
    write_plan(campaign.plan_path, planned)
    return checked, predict(campaign, checked)


def predict(campaign: "Campaign", checked: "CheckedPlan") -> "Prediction":
    """What the plan's identification pairs will tell, at the tracker's uncertainty."""
    import numpy as np

    from app.setup import tracker_uncertainty_of
    from campaigns.numerics.geometry import FREE_BY_DEFAULT
    from campaigns.numerics.instrument import distance_variance_mm2, point_covariance_mm2
    from campaigns.numerics.prediction import predict_distances
    from campaigns.planning import joints_of, numeric_geometry, pairs_of, poses_of
    from campaigns.shot_sets import ShotSet

    poses = poses_of(checked.shots)
    pairs = pairs_of(checked.shots, ShotSet.IDENTIFICATION)
    from_tracker = poses[:, :3] - np.array(campaign.config.tracker.place_mm)
    covariance = point_covariance_mm2(from_tracker, tracker_uncertainty_of(campaign))
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
        "shots_in_all": len(checked.shots),
        "predicted_std": std_by_name(predicted),
        "observability": predicted.indices | {"condition": _finite(predicted.condition)},
        "seconds_estimated": checked.seconds,
        "path": str(campaign.plan_path),
    }


def std_by_name(predicted: "Prediction") -> dict[str, float | None]:
    """Predicted standard deviations in file units; None where nothing can be told."""
    from campaigns.numerics.geometry import FILE_UNIT, FREE_BY_DEFAULT, indices

    values = predicted.std / FILE_UNIT[indices(FREE_BY_DEFAULT)]
    return {n: _finite(s) for n, s in zip(FREE_BY_DEFAULT, values.tolist(), strict=True)}


def _finite(value: float) -> float | None:
    return value if value < float("inf") else None


def _rows(predicted: "Prediction") -> list[tuple[str, str]]:
    return [
        (name, "unknown" if std is None else f"{std:.4f} {name.rsplit('_', 1)[1]}")
        for name, std in std_by_name(predicted).items()
    ]


def _keep_older(path: Path) -> None:
    """Move an existing plan aside under the first free number."""
    if not path.exists():
        return
    number = 1
    while (older := path.with_name(f"plan-older-{number}.csv")).exists():
        number += 1
    path.rename(older)
