"""Campaigns whose journals are written without a cell: the model itself stands for the robot.

A campaign takes a fraction of a second, and what it must show is known.
"""

import copy
import pickle
import shutil
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from par4_space import par4, with_values
from scipy.spatial.transform import Rotation

from campaigns.campaign import Campaign, open_campaign
from campaigns.controllers.export import compensated_robot, latest_identification
from campaigns.fit.rigid_transforms import Transform
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions, Model
from campaigns.identification.result import RecordedIdentification
from campaigns.journal import records
from campaigns.journal.journal import Journal, open_journal
from campaigns.kinematics.model import Kinematics
from campaigns.planning.plan_file import PlannedShot, plan_digest, write_plan
from campaigns.planning.validation_plan import ISO_POSES
from campaigns.robots.robot import find_robot, pose_of, write_new_robot
from campaigns.settings.config import CampaignConfig, new_settings_text, write_new_campaign
from campaigns.settings.sections import (
    AcceptanceConfig,
    ControllerConfig,
    TrackerCommonConfig,
    TrackerConfig,
)
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from campaigns.workflow.exporting import issuer_of
from campaigns.workflow.work import known_sets
from drivers.values import Identity, Weather

NOMINAL = find_robot("par4-prototype")
MECHANISM = NOMINAL.robot.mechanism
ERRORS = {"arm0.arm_mm": 1.0, "arm1.x_mm": -0.8, "arm2.joint_offset_deg": 0.4, "plate_mm": 0.5}
TRUE = par4(
    NOMINAL.robot.parameters
    | {name: NOMINAL.robot.parameters[name] + error for name, error in ERRORS.items()}
)
TRACKER_FROM_BASE = Transform(
    Rotation.from_euler("ZYX", [140.0, 4.0, -3.0], degrees=True).as_matrix(),
    np.array([2400.0, 250.0, -150.0]),
)
NOISE_MM = 0.005
CONTROLLER = Identity("Acme", "Par4", "R-1", "1.0", "robotline 1")
TRACKER = Identity("Leica", "AT403", "T-7", "2.3", "emScon")
CENTRE = np.array([0.0, 0.0, -575.0, 0.0])
LOAD_BEGUN = records.Finding(
    "load begun",
    {
        "source": "robot-compensated.yaml",
        "digest": "d",
        "kept": "k.yaml",
        "wanted": {"plate_mm": 1.0},
        "held": {"plate_mm": 2.0},
        "controller_serial": "R-1",
    },
)
"""Record of a load that has no end."""


@dataclass
class Clock:
    """A second later each time it is read."""

    now: datetime = datetime(2026, 3, 2, 8, 0, tzinfo=UTC)

    def __call__(self) -> str:
        self.now += timedelta(seconds=1)
        return self.now.isoformat(timespec="milliseconds")


@dataclass
class PaperCampaign:
    """A campaign in a folder that tests fill step by step."""

    folder: Path
    campaign: Campaign
    rng: np.random.Generator
    noise_mm: float = NOISE_MM
    clock: Clock = field(default_factory=Clock)
    controller: Kinematics = field(default_factory=lambda: NOMINAL.robot.kinematics)
    states_uncertainty: bool = True
    """Whether the tracker states an uncertainty of each point."""
    records_settings: bool = False
    """Whether the series have the settings of campaign.yaml, as those of the engine have."""

    def journal(self) -> Journal:
        path = self.campaign.journal_path
        return open_journal(path, now_utc=self.clock)

    def copy_to(self, folder: Path, **settings: object) -> "PaperCampaign":
        """Copy all that was done to another folder, where these settings are other ones."""
        shutil.copytree(self.folder, folder)
        text = new_settings_text(self.campaign.config.model_copy(update=settings))
        (folder / "campaign.yaml").write_text(text, encoding="utf-8")
        rng, clock = copy.deepcopy((self.rng, self.clock))
        return replace(self, folder=folder, campaign=open_campaign(folder), rng=rng, clock=clock)

    def run(self, pairs: int = 40, unseen: int = 8) -> None:
        """Plan and measure pairs for identification and validation, with drift shots around."""
        shots = self.plan(pairs, unseen)
        write_plan(self.campaign.plan_path, shots, MECHANISM)
        self.measure("run", shots)

    def plan(self, pairs: int, unseen: int) -> tuple[PlannedShot, ...]:
        """The same pairs always begin a longer plan."""
        rng = np.random.default_rng(5)
        shots = [planned(0, ShotSet.DRIFT, None, CENTRE)]
        for pair in range(pairs + unseen):
            purpose = ShotSet.IDENTIFICATION if pair < pairs else ShotSet.VALIDATION
            for _ in range(2):
                shots.append(planned(len(shots), purpose, pair, random_pose(rng)))
        return (*shots, planned(len(shots), ShotSet.DRIFT, None, CENTRE))

    def validate(self, stage: str, only: frozenset[ShotSet] = frozenset(ShotSet)) -> None:
        """Measure the tests of section IV.E."""
        shots = [s for s in validation_shots(np.random.default_rng(6)) if s.purpose in only]
        self.measure(stage, tuple(shots))

    def measure(
        self,
        stage: str,
        shots,
        *,
        finished: bool = True,
        stopped: bool = True,
        planned: int | None = None,
    ) -> int:
        """Write a series as the engine does; gives its number."""
        air = Weather(20.0, 1013.2, 45.0)
        digest = self.robot_digest()
        with self.journal() as journal:
            plan = plan_digest(shots, MECHANISM)
            config = self.campaign.config.model_dump(mode="json") if self.records_settings else {}
            started = records.SeriesStarted(
                stage, plan, config, "0.1.0", digest, CONTROLLER, TRACKER, air, planned=planned
            )
            series = journal.start_series(started)
            journal.append(records.SessionStarted("0.1.0", CONTROLLER, TRACKER, air), series=series)
            for shot in shots:
                self._take(journal, series, shot, as_joints=stage == "run")
            if finished:
                journal.append(records.SeriesFinished(), series=series)
            if stopped:
                journal.append(records.SessionStopped("finished", ""), series=series)
        return series

    def identify(self, model: Model = "full") -> None:
        """Identify and write the finding, as the command does."""
        with self.journal() as journal:
            series = journal.latest_series("run")
            shots = journal.shots(series.number)
            data = shots_of_journal(shots, MECHANISM)
            options = IdentificationOptions(model=model, workspace=WORKSPACE)
            found = RecordedIdentification.of(
                identify(NOMINAL.robot.kinematics, data, options),
                series=series.number,
                shots=len(shots),
                robot_digest=NOMINAL.robot.digest(),
                plan_digest=series.started.plan_digest,
                journal_digest=journal.digest(),
                journal_records=journal.last_number(),
                at_utc=self.clock(),
            )
            journal.append(records.Finding("identification", found.document()))

    def export_and_load(self) -> None:
        """Put the identified parameters into the controller."""
        with self.journal() as journal:
            finding = latest_identification(journal)
            issuer = issuer_of(self.campaign, journal).stated()
            robot = compensated_robot(issuer, NOMINAL, finding)
            write_new_robot(self.folder / "robot-compensated.yaml", robot)
            self.controller = robot.robot.kinematics
            body = {"source": "robot-compensated.yaml", "digest": robot.robot.digest(), "kept": "k"}
            journal.append(records.Finding("load", body))

    def robot_digest(self) -> str:
        held = known_sets(self.campaign).match(self.controller.parameters)
        return with_values(NOMINAL.robot, held).digest()

    def outcome(self, number: int, attempt: int, joints: np.ndarray) -> records.Outcome:
        """What controller and tracker say at these joints."""
        point = TRUE.forward(joints[None]).values_or_raise()[:, :3]
        seen = TRACKER_FROM_BASE.apply(point)[0] + self.rng.normal(0.0, self.noise_mm, 3)
        variance = NOISE_MM**2
        covariance = tuple(tuple(variance * (r == c) for c in range(3)) for r in range(3))
        air = Weather(20.0 + 0.01 * number, 1013.2, 45.0)
        return records.Outcome(
            number,
            attempt,
            tuple(joints.tolist()),
            tuple(seen.tolist()),
            covariance if self.states_uncertainty else None,
            air,
            "raw robot",
            "raw tracker",
            None,
        )

    def _take(self, journal: Journal, series: int, shot: PlannedShot, *, as_joints: bool) -> None:
        joints = np.array(shot.joints)
        if not as_joints:
            pose = np.array([[shot.pose.x_mm, shot.pose.y_mm, shot.pose.z_mm, shot.pose.theta_rad]])
            joints = self.controller.inverse(pose).values_or_raise()[0]
        command = "joints" if as_joints else "pose"
        purpose = shot.purpose.value
        intent = records.Intent(
            shot.shot, 1, purpose, shot.pose, tuple(joints.tolist()), command, shot.pair
        )
        journal.append(intent, series=series)
        journal.append(self.outcome(shot.shot, 1, joints), series=series)


def new_campaign(
    folder: Path,
    *,
    acceptance: AcceptanceConfig | None = None,
    common: TrackerCommonConfig | None = None,
    **settings: object,
) -> PaperCampaign:
    """A campaign on real devices, as its settings say."""
    config = CampaignConfig(
        name="paper",
        controller=ControllerConfig(url="tcp://127.0.0.1:1"),
        tracker=TrackerConfig(
            url="tcp://127.0.0.1:2", reflector="CCR-1.5in", common=common or TrackerCommonConfig()
        ),
        acceptance=acceptance or AcceptanceConfig(),
        **settings,
    )
    write_new_campaign(folder, config, NOMINAL)
    return PaperCampaign(folder, open_campaign(folder), np.random.default_rng(4))


def make_loaded(folder: Path) -> None:
    """Do everything up to the load, and keep the campaign itself beside its folder."""
    paper = new_campaign(folder)
    paper.validate("before")
    paper.run()
    paper.identify()
    paper.export_and_load()
    folder.with_name("paper").write_bytes(pickle.dumps(paper))


def random_pose(rng: np.random.Generator) -> np.ndarray:
    low, high = np.array([-350.0, -350.0, -800.0, -0.6]), np.array([350.0, 300.0, -400.0, 0.6])
    return rng.uniform(low, high)


WORKSPACE = np.array([random_pose(np.random.default_rng(seed)) for seed in range(50)])


def planned(number: int, purpose: ShotSet, pair: int | None, pose: np.ndarray) -> PlannedShot:
    joints = NOMINAL.robot.kinematics.inverse(pose[None]).values_or_raise()[0]
    return PlannedShot(number, purpose, pair, pose_of(pose), tuple(joints.tolist()))


def validation_shots(rng: np.random.Generator) -> tuple[PlannedShot, ...]:
    """Rotation, three lines, pairs, repeated visits, two cycles through a cube."""
    poses: list[tuple[ShotSet, int | None, np.ndarray]] = []
    for theta in np.linspace(-0.7, 0.7, 7):
        poses.append((ShotSet.ROTATION, None, CENTRE + theta * np.eye(4)[3]))
    for axis in range(3):
        for place in np.linspace(-200.0, 200.0, 7):
            poses.append((ShotSet.STRAIGHTNESS, None, CENTRE + place * np.eye(4)[axis]))
    for pair in range(8):
        poses += [(ShotSet.VALIDATION, pair, random_pose(rng)) for _ in range(2)]
    poses += [(ShotSet.REPEATABILITY, None, CENTRE)] * 10
    for away in (*ISO_POSES, *ISO_POSES):
        poses.append((ShotSet.ISO_CUBE, None, CENTRE + 80.0 * np.append(away, 0.0)))
    return tuple(planned(number, *pose) for number, pose in enumerate(poses))
