"""Verdicts on a study's perturbed campaigns: which of them pass all the same."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

from app.console import WARNING, Terminal
from app.study.running import Studied
from app.study.setup import CHOICES
from app.study.summary_texts import PERCENT, common_document, labels_of, shortcomings
from campaigns.files.table import Column, csv_table
from campaigns.studies.perturbations import PERTURBATIONS, perturbation_of, sizes_of
from campaigns.studies.summary import VerdictStatistics, verdict_statistics

UM_PER_MM = 1e3
EXPLAINED = (
    "wrong: passed with a parameter more than 4 σ off, or positions worse than twice what is "
    "stated; named: the cause, of a step its arm and place too (± 5 shots), %; alarms: a change, a "
    "scale or a wrong shot named that is none; 95 %: share of intervals that hold the truth; left: "
    "real error of hold-out positions, rms, in half of the campaigns; kept: models, %"
)


@dataclass(frozen=True, slots=True, eq=False)
class SizedVerdicts:
    """Verdicts of a combination: of one size of what goes wrong, or of all (size empty)."""

    studied: Studied
    size: str
    found: VerdictStatistics
    label: str = ""

    @property
    def words(self) -> tuple[str, ...]:
        """What tells it from others, as people are told."""
        one = self.studied.combination
        return (*(one.words | {"estimator": one.method.short}).values(), self.size)

    @property
    def shown(self) -> bool:
        """Whether people get a line: of those that are told by size, one a size."""
        return bool(self.size) != (self.studied.combination.setup.perturbation in PERTURBATIONS)


def _word(name: str) -> Column[SizedVerdicts]:
    return Column(name, lambda one: one.studied.combination.words[name], kind="words")


def _figure(
    name: str, of: Callable[[VerdictStatistics], float | None], times: float = 1, decimals: int = 0
) -> Column[SizedVerdicts]:
    def cell(one: SizedVerdicts) -> float | None:
        value = of(one.found)
        return None if value is None else value * times

    return Column(name, cell, decimals=decimals)


TABLE: tuple[Column[SizedVerdicts], ...] = (
    *map(_word, ("effect", "plan", "scenario", "estimator", "model")),
    Column("kind", lambda one: one.size, kind="words"),
    _figure("campaigns", lambda found: found.campaigns),
    _figure("failed", lambda found: found.failed),
    _figure("passed", lambda found: found.passed),
    _figure("passed_parameter_off", lambda found: found.off),
    _figure("passed_position_worse", lambda found: found.worse),
    _figure("wrong", lambda found: found.wrong),
    _figure("named", lambda found: found.named),
    _figure("false_alarms", lambda found: found.false_alarms),
    _figure("errors_over_sigma", lambda found: found.errors_over_sigma),
    _figure("covered_95", lambda found: found.covered),
    _figure("position_rms_median_mm", lambda found: found.position_mm),
    Column("kept", lambda one: " ".join(f"{name}:{n}" for name, n in one.found.kept.items())),
)
"""effects.csv, a row a combination and one a size."""

SHOWN: tuple[Column[SizedVerdicts], ...] = (
    Column("", lambda one: one.label, kind="words"),
    _figure("of", lambda found: found.campaigns),
    _figure("pass", lambda found: found.passed),
    _figure("wrong", lambda found: found.wrong),
    _figure("named", lambda found: found.named / max(found.campaigns, 1), PERCENT),
    _figure("alarms", lambda found: found.false_alarms),
    _figure("errors/σ", lambda found: found.errors_over_sigma, 1.0, 2),
    _figure("95 %", lambda found: found.covered, PERCENT, 1),
    _figure("left µm", lambda found: found.position_mm, UM_PER_MM, 1),
)


@dataclass(frozen=True, slots=True, eq=False)
class Verdicts:
    """Summary of campaigns in which something goes wrong: how often "pass" is wrong."""

    sized: tuple[SizedVerdicts, ...]
    """Of every combination, first of all its campaigns, then of each size."""

    table_name, document_name = "effects.csv", "effects.json"
    """Files for programs."""

    def csv(self) -> str:
        """Table for programs."""
        return csv_table(TABLE, self.sized)

    def document(self) -> dict[str, object]:
        """What is in `pkmcal/study-effects/1` of the combinations."""
        effects = [
            {
                **common_document(every.studied),
                "kinds": [str(each) for each in sizes_of(every.words[0])],
                **asdict(every.found),
                "by_kind": [
                    {"kind": one.size, **asdict(one.found)}
                    for one in self.sized
                    if one.studied is every.studied and one.size
                ],
            }
            for every in self._of_all_sizes()
        ]
        return {
            "schema": "pkmcal/study-effects/1",
            "effects": effects,
            "wrong_passes": self.wrong_passes(),
        }

    def wrong_passes(self) -> dict[str, dict[str, int]]:
        """Falsely accepted campaigns, and all campaigns, over all perturbations by estimator."""
        counts: dict[str, dict[str, int]] = {}
        for one in self._of_all_sizes():
            method = str(one.studied.combination.method)
            own = counts.setdefault(method, {"wrong": 0, "campaigns": 0})
            own["wrong"] += one.found.wrong
            own["campaigns"] += one.found.campaigns
        return counts

    def show(self, terminal: Terminal) -> None:
        """The table for people, and the sum over all perturbations."""
        shown = [one for one in self.sized if one.shown]
        labels = labels_of([one.words for one in shown])
        rows = [replace(one, label=label) for label, one in zip(labels, shown, strict=True)]
        terminal.rows('How often is "pass" wrong?', SHOWN, rows)
        terminal.note(EXPLAINED)
        for one in rows:
            if one.studied.combination.method.model in CHOICES:  # as a column it leaves no place
                terminal.say(f"{one.label}: kept {_kept_words(one.found)}")
        for method, counts in self.wrong_passes().items():
            terminal.say(f"{method}: {counts['wrong']} wrong of {counts['campaigns']} campaigns")
        for one in self._of_all_sizes():
            for line in shortcomings(one.studied):
                terminal.say(f"{one.studied.combination}: {line}", WARNING)

    def _of_all_sizes(self) -> list[SizedVerdicts]:
        return [one for one in self.sized if not one.size]


def _kept_words(found: VerdictStatistics) -> str:
    """Models with the share that kept them, where there was a choice."""
    if len(found.kept) == 1:
        return next(iter(found.kept))
    return ", ".join(
        f"{name} {PERCENT * count / found.campaigns:.0f}" for name, count in found.kept.items()
    )


def sized_verdicts(studied: Sequence[Studied]) -> Iterator[SizedVerdicts]:
    """Verdicts of each combination: of all its campaigns, then of each size."""
    for one in studied:
        yield SizedVerdicts(one, "", verdict_statistics(one.rows))
        name = one.combination.setup.perturbation
        for size in dict.fromkeys(map(str, sizes_of(name))):
            own = (n for n in one.wanted if str(perturbation_of(name, n)) == size)
            found = verdict_statistics(one.rows_of(own))
            if found.campaigns or found.failed:
                yield SizedVerdicts(one, size, found)
