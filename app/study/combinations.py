"""What a study compares: every plan with every scenario and every estimator."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from app.study.setup import Method, StudyOptions, robots_drawn, study_scenario, study_setup
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Model
from campaigns.studies.store import StudyTable
from campaigns.studies.study import StudySetup
from sim.scenarios.schema import Scenario

UNFIT_FOR_FILES = re.compile(r"[^\w.-]+")


@dataclass(frozen=True, slots=True)
class Combination:
    """One plan, scenario and estimator; its campaigns have a table of their own."""

    plan: str
    scenario: Scenario
    setup: StudySetup
    table: StudyTable
    method: Method
    """Estimator, weights and model of its fits."""

    def __str__(self) -> str:
        """As people are told; of the usual model nothing."""
        return " · ".join(told_words(self.words))

    @property
    def words(self) -> tuple[str, str, str, str]:
        """Plan, scenario, estimator and model."""
        return self.plan, self.scenario.name, str(self.method), self.method.model.value


def combinations(campaign: Campaign, asked: StudyOptions, folder: Path) -> tuple[Combination, ...]:
    """All of them, by scenario, then plan, then estimator; their tables lie in `folder`.

    Raises `PlanInvalid`, `ScenarioInvalid` and `OptionsInvalid`.
    """
    found = tuple(_combinations(campaign, asked, folder))
    seen: dict[Path, Combination] = {}
    for combination in found:
        other = seen.setdefault(combination.table.path, combination)
        if other is not combination:
            raise OptionsInvalid(
                f"two plans or scenarios are called alike: {combination}",
                remedy="give one of the files another name (a scenario: another `name:`)",
            )
    return found


def file_name(*words: str) -> str:
    """Name of a table, from what tells it from others; the model last."""
    return f"{UNFIT_FOR_FILES.sub('_', '-'.join(told_words(words)).replace(', ', '-'))}.csv"


def told_words(words: tuple[str, ...]) -> tuple[str, ...]:
    """Words of a combination without those of the usual model, which are last."""
    return words[:-1] if words[-1] == Model.STANDARD else words


def _combinations(campaign: Campaign, asked: StudyOptions, folder: Path) -> Iterator[Combination]:
    plans = dict.fromkeys(asked.plans or [campaign.plan_path])
    names: Iterable[str | None] = dict.fromkeys(asked.scenarios) or [None]
    scenarios = [study_scenario(campaign, name) for name in names]
    for scenario, plan, method in product(scenarios, plans, asked.methods):
        setup = study_setup(campaign, plan, scenario, method, asked)
        path = folder / file_name(plan.stem, scenario.name, str(method), method.model.value)
        table = StudyTable(path, setup.digest(robots_drawn(scenario)), setup.free)
        yield Combination(plan.stem, scenario, setup, table, method)
