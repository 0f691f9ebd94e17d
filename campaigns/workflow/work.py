"""Work for the engine: steps with the rules of a campaign's settings, and its parameter sets."""

# The engine (campaigns/measuring) reads no files. Everything that it needs of a campaign is copied
# into a `Work`: settle and gate limits, speed, the tracker's place, the plan's digest, and
# campaign.yaml as it stands, which the journal keeps with each series.

from collections.abc import Iterable
from math import dist

import numpy as np

from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import KnownSets
from campaigns.errors import ConfigInvalid, PlanInvalid
from campaigns.identification.objects import Object
from campaigns.identification.observed import objects_of
from campaigns.identification.options import IdentificationOptions
from campaigns.journal.records import Finding, Stage
from campaigns.journal.views import Series
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.monitors import Station
from campaigns.measuring.reflector_places import place_of, seen_at
from campaigns.measuring.work import Rules, Work
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import plan_digest
from campaigns.planning.steps import Step


def known_sets(campaign: Campaign) -> KnownSets:
    """Return the parameter sets that the campaign's controller may hold, by its journal."""
    if not campaign.journal_path.exists():
        return KnownSets.of(campaign.robot, ())
    with campaign.journal_reader() as journal:
        return KnownSets.of(campaign.robot, (each.record for each in journal.records_of(Finding)))


def all_series(campaign: Campaign) -> tuple[Series, ...]:
    """Return all series of the campaign's journal; () without a journal."""
    if not campaign.journal_path.exists():
        return ()
    with campaign.journal_reader() as journal:
        return journal.series()


def engine_work(
    campaign: Campaign,
    stage: Stage,
    steps: tuple[Step, ...],
    kinematics: Kinematics,
    digest: str,
    options: IdentificationOptions,
) -> Work:
    """Return the work of a stage's steps; `digest` is that of the parameters of `kinematics`.

    Raise `ConfigInvalid` for a parking place that the robot cannot take.
    """
    robot, config = campaign.robot, campaign.config
    rules = Rules(
        speed_fraction=config.controller.speed_percent / 100.0,
        settle=config.settle,
        gate=config.gate,
        search_mm=dist(config.tracker.place_mm, config.validation.centre_mm),
        look_back_s=config.run.look_back_s,
        park=_park_joints(campaign, kinematics),
        options=options,
        nests=config.nests,
        reflector=config.tracker.reflector,
        carriers=_carriers(campaign, steps, kinematics),
        measuring_time_s=config.tracker.measuring_time_s,
        station=Station(
            config.tracker.place_mm,
            config.tracker.reflector_facing,
            config.tracker.acceptance_rad,
            config.validation.centre_mm,
        ),
    )
    return Work(
        stage=stage,
        steps=steps,
        plan_digest=plan_digest([step.planned for step in steps], robot.mechanism),
        robot_file_digest=digest,
        configuration=config.model_dump(mode="json"),
        robot=RobotModel(kinematics, robot.limits, campaign.centre, campaign.space),
        rules=rules,
    )


def _carriers(
    campaign: Campaign, steps: Iterable[Step], kinematics: Kinematics
) -> dict[str, Object]:
    """Return the objects that carry the reflectors that the steps name, by name.

    Raise `PlanInvalid` for a name that is no object, or an object on no part of this platform, and
    `OptionsInvalid` for a place without its σ.
    """
    objects = {thing.name: thing for thing in objects_of(campaign.config.objects)}
    carriers: dict[str, Object] = {}
    for step in steps:
        name = step.planned.reflector
        if not name or name in carriers:
            continue
        if name not in objects:
            raise PlanInvalid(
                f"shot {step.planned.shot}: reflector '{name}' is not among the objects of "
                "campaign.yaml",
                remedy=f"write `- {{name: {name}, body: half 2}}` under objects there, or correct "
                "plan.csv",
            )
        carriers[name] = objects[name]
        place_of(carriers[name])
        try:
            seen_at(kinematics, carriers[name])
        except ValueError as error:
            raise PlanInvalid(
                f"shot {step.planned.shot}: reflector '{name}': {error}",
                remedy="correct `body` of this object in campaign.yaml",
            ) from error
    return carriers


def _park_joints(campaign: Campaign, kinematics: Kinematics) -> tuple[float, ...]:
    """Return the joints of `run.park_mm`, the plate unturned; () without that setting.

    Raise `ConfigInvalid` for a place that the robot cannot take.
    """
    park_mm = campaign.config.run.park_mm
    if park_mm is None:
        return ()
    pose = np.zeros((1, len(campaign.robot.mechanism.task)))
    pose[0, :3] = park_mm
    feasibility = kinematics.feasibility(campaign.robot.limits, pose)
    if not feasibility.feasible[0]:
        raise ConfigInvalid(
            f"run.park_mm in campaign.yaml: {feasibility.describe(0)[0]}",
            remedy="name a place that the robot can take, or leave it out",
        )
    return tuple(feasibility.joints[0].tolist())
