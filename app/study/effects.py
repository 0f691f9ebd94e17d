"""Studies of effects: which campaigns with something wrong pass all the same."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from app.progress import CountedWork
from app.study.combinations import Combination, combinations, file_name
from app.study.results import Workers
from app.study.rods import RodRobots
from app.study.running import Job, run_jobs
from app.study.setup import CHOICES, StudyOptions, robots_drawn, study_tasks
from app.study.tables import labels_of
from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.design.pose_sampling import workspace_poses
from campaigns.errors import OptionsInvalid
from campaigns.files.csv_file import csv_text, number_text
from campaigns.identification.model_selection import candidate_models
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.effect_table import EffectTable, effect_digest
from campaigns.studies.effects import EFFECTS, KINDS, PARTS
from campaigns.studies.judged import EffectOutcome, EffectSetup, EffectTask, run_effects
from campaigns.studies.wrong_passes import WrongPasses, by_kind, wrong_passes

ALL = "all"
SCHEMA = "pkmcal/study-effects/1"
WORKSPACE_POSES, WORKSPACE_SEED = 300, 1
PERCENT, UM_PER_MM = 100.0, 1e3
COLUMNS = (
    *("effect", "plan", "scenario", "estimator", "model", "kind", "campaigns", "failed", "passed"),
    *("passed_parameter_off", "passed_position_worse", "wrong", "named", "false_alarms"),
    *("errors_over_sigma", "covered_95", "position_rms_median_mm", "kept"),
)
TABLE = ("", "of", "pass", "wrong", "named", "alarms", "errors/σ", "95 %", "left µm")
KEPT = "kept"
EXPLAINED = (
    "wrong: passed with a parameter more than 4 σ off, or positions worse than twice what is "
    "stated; named: the cause, of a step its arm and place too (± 5 shots), %; alarms: a change, a "
    "scale or a wrong shot named that is none; 95 %: share of intervals that hold the truth; left: "
    "real error of unseen positions, rms, in half of the campaigns; kept: models, %"
)


@dataclass(frozen=True, slots=True)
class EffectCombination:
    """Effect with plan, scenario and estimator; its campaigns have a table of their own."""

    effect: str
    base: Combination
    setup: EffectSetup
    table: EffectTable

    @property
    def words(self) -> tuple[str, str, str, str, str]:
        """Effect, plan, scenario, estimator and model."""
        return (self.effect, *self.base.words)


@dataclass(frozen=True, slots=True, eq=False)
class StudiedEffect:
    """All outcomes of an effect, what they show, and how many were lost on the way."""

    combination: EffectCombination
    outcomes: tuple[EffectOutcome, ...]
    found: WrongPasses
    kinds: dict[str, WrongPasses]
    """Of each size of the effect."""
    computed: int
    lost: int
    reasons: tuple[str, ...]


def effect_names(asked: Sequence[str]) -> tuple[str, ...]:
    """Effects asked for, each once; all of them are those that go wrong.

    Raises `OptionsInvalid` for one that there is not.
    """
    if unknown := [name for name in asked if name not in (ALL, *KINDS)]:
        raise OptionsInvalid(
            f"there is no effect {unknown[0]}", remedy=f"choose from {ALL}, {', '.join(KINDS)}"
        )
    names = [(*EFFECTS,) if name == ALL else (name,) for name in asked]
    return tuple(dict.fromkeys(chain.from_iterable(names)))


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
        _combination(effect, base, asked, workspace, folder) for effect in effects for base in bases
    )


def _combination(
    effect: str, base: Combination, asked: StudyOptions, workspace: Array, folder: Path
) -> EffectCombination:
    model, models = base.method.model, None
    if model in CHOICES:
        space = base.setup.nominal.mechanism.parameters
        models = candidate_models(space, model, asked.freed, asked.fixed)
    robots = RodRobots(base.scenario.robot)
    setup = EffectSetup(base.setup, workspace, robots, models, model)
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
        kinds = by_kind(outcomes)
        studied.append(StudiedEffect(each, outcomes, passes, kinds, computed, missing, reasons))
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


def effect_table(
    studied: Sequence[StudiedEffect],
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and lines for people, one a combination, by the words in which they differ.

    Of imperfect parts one a size; where models were chosen, which ones.
    """
    shown = [each for one in studied for each in _shown(one)]
    labels = labels_of([words for words, _ in shown])
    rows = [(label, *_cells(found)) for label, (_, found) in zip(labels, shown, strict=True)]
    if not any(one.combination.base.method.model in CHOICES for one in studied):
        return TABLE, rows
    kept = [_kept_words(found) for _, found in shown]
    return (*TABLE, KEPT), [(*row, each) for row, each in zip(rows, kept, strict=True)]


def _shown(one: StudiedEffect) -> list[tuple[tuple[str, ...], WrongPasses]]:
    *first, _, model = one.combination.words
    words = (*first, one.combination.base.method.short, model)
    if one.combination.effect not in PARTS:
        return [((*words, ""), one.found)]
    return [((*words, kind), found) for kind, found in one.kinds.items()]


def _cells(found: WrongPasses) -> tuple[str, ...]:
    return (
        *map(str, (found.campaigns, found.passed, found.wrong)),
        f"{PERCENT * found.named / max(found.campaigns, 1):.0f}",
        str(found.false_alarms),
        "-" if found.errors_over_sigma is None else f"{found.errors_over_sigma:.2f}",
        "-" if found.covered is None else f"{PERCENT * found.covered:.1f}",
        "-" if found.position_mm is None else f"{UM_PER_MM * found.position_mm:.1f}",
    )


def _kept_words(found: WrongPasses) -> str:
    """Models with the share that kept them, where there was a choice."""
    if len(found.kept) == 1:
        return next(iter(found.kept))
    return ", ".join(
        f"{name} {PERCENT * count / found.campaigns:.0f}" for name, count in found.kept.items()
    )


def effects_csv(studied: Sequence[StudiedEffect]) -> str:
    """Table for programs, a row a combination and one a size; what there is not is empty."""
    rows = [
        _csv_row((*one.combination.words, kind), found)
        for one in studied
        for kind, found in (("", one.found), *one.kinds.items())
    ]
    return csv_text(COLUMNS, rows)


def _csv_row(words: tuple[str, ...], found: WrongPasses) -> list[str]:
    counts = (found.campaigns, found.failed, found.passed, found.off, found.worse)
    values = (found.errors_over_sigma, found.covered, found.position_mm)
    kept = " ".join(f"{name}:{count}" for name, count in found.kept.items())
    return [
        *words,
        *map(str, (*counts, found.wrong, found.named, found.false_alarms)),
        *("" if value is None else number_text(value) for value in values),
        kept,
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
    effect, plan, scenario, estimator, model = one.combination.words
    return {
        "effect": effect,
        "kinds": [str(each) for each in KINDS[effect]],
        "plan": plan,
        "scenario": scenario,
        "estimator": estimator,
        "model": model,
        "study": one.combination.table.study,
        **asdict(one.found),
        "by_kind": [{"kind": kind, **asdict(found)} for kind, found in one.kinds.items()],
        "lost": one.lost,
        "computed": one.computed,
        "path": str(one.combination.table.path),
    }
