"""Results of finished seeds, a JSON line each, so that what was broken off can go on."""

import os
from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from app.papers.corbel2006.experiments import Trial
from app.papers.corbel2006.trials import TrialResult
from campaigns.errors import CampaignError, WriteFailed
from campaigns.files.text_file import read_text, replace_text


class ResultsInvalid(CampaignError):
    """The file of kept results holds something else: take it away, or name another folder."""


class KeptResults:
    """A file of results; only ever appended to, save for a last line that a crash has torn."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def read(self) -> tuple[TrialResult, ...]:
        """All of them; raises `ResultsInvalid`, or `WriteFailed` when a torn line cannot go."""
        if not self._path.exists():
            return ()
        text = read_text(self._path, ResultsInvalid, if_missing="try again")
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            replace_text(self._path, whole)
        return tuple(
            self._result(number, line) for number, line in enumerate(whole.splitlines(), start=1)
        )

    def append(self, result: TrialResult) -> None:
        """Write it through to the disk; raises `WriteFailed`."""
        try:
            with self._path.open("a", encoding="utf-8", newline="") as file:
                file.write(result.model_dump_json() + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise WriteFailed(
                f"{self._path}: a result cannot be written ({error.strerror})",
                remedy="free space on the disk or check your rights, then give the command again",
            ) from error

    def _result(self, number: int, line: str) -> TrialResult:
        try:
            return TrialResult.model_validate_json(line)
        except ValidationError as error:
            raise ResultsInvalid(
                f"{self._path}:{number}: is no result of `pkmcal reproduce`",
                remedy="delete the line, or name another folder with --to",
            ) from error


def usable(kept: Sequence[TrialResult], trials: Sequence[Trial]) -> dict[Trial, TrialResult]:
    """Those of the trials that were made by the same recipe; the last one of each."""
    recipes = {trial.experiment.name: trial.experiment.recipe() for trial in trials}
    by_place = {(r.experiment, r.seed, r.recipe): r for r in kept}
    places = {t: (t.experiment.name, t.seed, recipes[t.experiment.name]) for t in trials}
    return {trial: by_place[place] for trial, place in places.items() if place in by_place}
