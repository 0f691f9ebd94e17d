"""Studies of effects: which campaigns with something wrong pass all the same."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from app.progress import CountedWork
from app.study.combinations import Combination, combinations, file_name
from app.study.results import Workers
from app.study.rods import RodRobots
from app.study.running import Job, run_jobs
from app.study.setup import StudyOptions, robots_drawn, study_tasks
from app.study.tables import labels_of
from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.design.pose_sampling import workspace_poses
from campaigns.errors import OptionsInvalid
from campaigns.files.csv_file import csv_text, number_text
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.effect_table import EffectTable, effect_digest
from campaigns.studies.effects import EFFECTS
from campaigns.studies.judged import EffectOutcome, EffectSetup, EffectTask, run_effects
from campaigns.studies.wrong_passes import WrongPasses, wrong_passes

ALL = "all"
SCHEMA = "pkmcal/study-effects/1"
WORKSPACE_POSES, WORKSPACE_SEED = 300, 1
PERCENT = 100.0
COLUMNS = (
    *("effect", "plan", "scenario", "estimator", "campaigns", "failed", "passed"),
    *("passed_parameter_off", "passed_position_worse", "wrong", "named", "false_alarms"),
    *("errors_over_sigma", "covered_95"),
)
TABLE = ("", "of", "pass", "wrong", "named", "alarms", "errors/σ", "95 %")
EXPLAINED = (
    "wrong: passed with a parameter more than 4 σ off, or positions worse than twice what is "
    "stated; named: the cause, of a step its arm and place too (± 5 shots), %; alarms: a change, a "
    "scale or a wrong shot named that is none; 95 %: share of intervals that hold the truth"
)


@dataclass(frozen=True, slots=True)
class EffectCombination:
    """Effect with plan, scenario and estimator; its campaigns have a table of their own."""

    effect: str
    base: Combination
    setup: EffectSetup
    table: EffectTable

    @property
    def words(self) -> tuple[str, str, str, str]:
        """Effect, plan, scenario and estimator."""
        return (self.effect, *self.base.words)


@dataclass(frozen=True, slots=True, eq=False)
class StudiedEffect:
    """All outcomes of an effect, what they show, and how many were lost on the way."""

    combination: EffectCombination
    outcomes: tuple[EffectOutcome, ...]
    found: WrongPasses
    computed: int
    lost: int
    reasons: tuple[str, ...]


def effect_names(asked: Sequence[str]) -> tuple[str, ...]:
    """Effects asked for, each once; raises `OptionsInvalid` for one that there is not."""
    if unknown := [name for name in asked if name not in (ALL, *EFFECTS)]:
        raise OptionsInvalid(
            f"there is no effect {unknown[0]}", remedy=f"choose from {ALL}, {', '.join(EFFECTS)}"
        )
    return tuple(EFFECTS) if ALL in asked else tuple(dict.fromkeys(asked))


def effect_combinations(
    campaign: Campaign, asked: StudyOptions, effects: Sequence[str], folder: Path
) -> tuple[EffectCombination, ...]:
    """All of them, by effect, then as `combinations` has them; raises as that does.

    Raises `OptionsInvalid` for a plan without the unseen pairs by which a verdict is formed.
    """
    bases = combinations(campaign, asked, folder)
    for base in bases:
        if not len(base.setup.shots.whole_pairs(ShotSet.VALIDATION).rows):
            raise OptionsInvalid(
                f"{campaign.plan_path}: no validation pairs, without which nothing passes",
                remedy="plan with some, as `pkmcal plan` does unless told otherwise",
            )
    workspace = _workspace(campaign)
    return tuple(
        _combination(effect, base, workspace, folder) for effect in effects for base in bases
    )


def _combination(
    effect: str, base: Combination, workspace: Array, folder: Path
) -> EffectCombination:
    setup = EffectSetup(base.setup, workspace, RodRobots(base.scenario.robot))
    digest = effect_digest(setup, effect, robots_drawn(base.scenario))
    path = folder / file_name("effect", effect, *base.words)
    return EffectCombination(effect, base, setup, EffectTable(path, digest))


def _workspace(campaign: Campaign) -> Array:
    """Poses at which positions are judged, (N, t)."""
    robot, rng = campaign.robot, np.random.default_rng(WORKSPACE_SEED)
    centre = robot.workspace_centre
    return workspace_poses(robot.kinematics, robot.limits, centre, WORKSPACE_POSES, rng)


def run_effect_study(
    found: Sequence[EffectCombination],
    wanted: range,
    workers: Workers,
    counting: Callable[[int, int], CountedWork],
) -> tuple[StudiedEffect, ...]:
    """Results of the wanted campaigns; what the tables lack of them is computed.

    Raises `OptionsInvalid`, `OutputExists` and `WriteFailed`; what had come back until then is
    kept.
    """
    tables = [each.table for each in found]
    known = [table.read() for table in tables]
    begun = [len(each) for each in known]
    jobs = [job for place, each in enumerate(found) for job in _jobs(place, each, known, wanted)]
    total = len(found) * len(wanted)
    counted = counting(total, total - sum(job.count for job in jobs))
    lost = run_jobs(jobs, run_effects, workers, tables, known, counted)
    studied = []
    for place, each in enumerate(found):
        outcomes = tuple(known[place][number] for number in wanted if number in known[place])
        own = [(job.count, reason) for job, reason in lost if job.table == place]
        reasons = tuple(dict.fromkeys(reason for _, reason in own))
        computed, missing = len(known[place]) - begun[place], sum(count for count, _ in own)
        passes = wrong_passes(outcomes)
        studied.append(StudiedEffect(each, outcomes, passes, computed, missing, reasons))
    return tuple(studied)


def _jobs(
    place: int,
    one: EffectCombination,
    known: Sequence[dict[int, EffectOutcome]],
    wanted: range,
) -> Iterator[Job[EffectTask]]:
    missing = (number for number in wanted if number not in known[place])
    for task in study_tasks(one.base.setup, one.base.scenario, missing):
        own = EffectTask(one.setup, one.effect, task.numbers, task.truths)
        yield Job(place, own, len(task.numbers))


def wrong_by_method(studied: Sequence[StudiedEffect]) -> dict[str, tuple[int, int]]:
    """Wrong passes, and campaigns, over all effects by estimator."""
    counts: dict[str, tuple[int, int]] = {}
    for one in studied:
        method = str(one.combination.base.method)
        wrong, campaigns = counts.get(method, (0, 0))
        counts[method] = wrong + one.found.wrong, campaigns + one.found.campaigns
    return counts


def effect_rows(studied: Sequence[StudiedEffect]) -> list[tuple[str, ...]]:
    """Lines for people, one a combination, by the words in which they differ."""
    words = [(*one.combination.words[:3], one.combination.base.method.short) for one in studied]
    labels = labels_of(words)
    return [(label, *_cells(one)) for label, one in zip(labels, studied, strict=True)]


def _cells(one: StudiedEffect) -> tuple[str, ...]:
    found = one.found
    return (
        *map(str, (found.campaigns, found.passed, found.wrong)),
        f"{PERCENT * found.named / max(found.campaigns, 1):.0f}",
        str(found.false_alarms),
        "-" if found.errors_over_sigma is None else f"{found.errors_over_sigma:.2f}",
        "-" if found.covered is None else f"{PERCENT * found.covered:.1f}",
    )


def effects_csv(studied: Sequence[StudiedEffect]) -> str:
    """Table for programs, a row a combination; what there is not is empty."""
    return csv_text(COLUMNS, map(_csv_row, studied))


def _csv_row(one: StudiedEffect) -> list[str]:
    found = one.found
    counts = (found.campaigns, found.failed, found.passed, found.off, found.worse)
    values = (found.errors_over_sigma, found.covered)
    return [
        *one.combination.words,
        *map(str, (*counts, found.wrong, found.named, found.false_alarms)),
        *("" if value is None else number_text(value) for value in values),
    ]


def effects_document(
    studied: Sequence[StudiedEffect], seed: int, seconds: float
) -> dict[str, object]:
    """Document `pkmcal/study-effects/1`; what there is not is null."""
    return {
        "schema": SCHEMA,
        "seed": seed,
        "effects": [_document(one) for one in studied],
        "wrong_passes": {
            method: {"wrong": wrong, "campaigns": campaigns}
            for method, (wrong, campaigns) in wrong_by_method(studied).items()
        },
        "computed": sum(one.computed for one in studied),
        "lost": sum(one.lost for one in studied),
        "seconds": seconds,
    }


def _document(one: StudiedEffect) -> dict[str, object]:
    effect, plan, scenario, estimator = one.combination.words
    return {
        "effect": effect,
        "kinds": [str(each) for each in EFFECTS[effect]],
        "plan": plan,
        "scenario": scenario,
        "estimator": estimator,
        "study": one.combination.table.study,
        **asdict(one.found),
        "lost": one.lost,
        "computed": one.computed,
        "path": str(one.combination.table.path),
    }
