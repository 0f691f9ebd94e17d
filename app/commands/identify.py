"""pkmcal identify: the geometry from the measured shots."""

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Folder, Json, Plot

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pydantic import JsonValue

    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.identify import Identification
    from campaigns.journal import Journal
    from campaigns.journal_views import Series


class Estimator(Enum):
    """What the fit compares; the value is the word on the command line."""

    DISTANCES = "distances"


def command(
    context: typer.Context,
    folder: Folder,
    *,
    estimator: Annotated[
        Estimator, typer.Option(help="distances: of pairs, as in the paper; needs no common frame.")
    ] = Estimator.DISTANCES,
    free: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Find this parameter too, such as arm1.azimuth_deg; repeatable."
        ),
    ] = None,
    fix: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Hold this parameter at its nominal value; repeatable."),
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Find the parameters that explain what was measured.

    Takes the latest run or import. The fit sees the pairs of the set "identification" and is
    judged by those of the set "validation", which it never sees. Unless told otherwise it finds
    22 parameters; the first motor's place, which holds the frame, and the azimuths stay nominal.

    Exit code 1: it was computed, but must not be used; the reasons are given.
    """
    from app.console import terminal_of
    from app.folder import open_campaign

    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    found, document = identify(campaign, free_names(free or (), fix or ()))
    terminal.detail(f"estimator: {estimator.value}, {document['seconds']} s")
    show(terminal, found)
    if plot is not None:
        draw(campaign, found, plot)
        terminal.say(f"drawn: {plot}")
    terminal.document(document)
    if found.verdict != "pass":
        raise typer.Exit(Exit.NOT_GOOD)
    terminal.note(f"next: pkmcal export {folder}")


def free_names(freed: "Sequence[str]", fixed: "Sequence[str]") -> tuple[str, ...]:
    """The parameters to find, in their usual order; raises `UsageInvalid` for an unknown one."""
    from app.errors import UsageInvalid
    from campaigns.numerics.geometry import FREE_BY_DEFAULT, NAMES
    from campaigns.wording import suggestion

    for name in (*freed, *fixed):
        if name not in NAMES:
            raise UsageInvalid(f"{name} is not a parameter", remedy=suggestion(name, NAMES))
    if both := sorted(set(freed) & set(fixed)):
        raise UsageInvalid(f"--free and --fix both name {both[0]}", remedy="give one of the two")
    wanted = {*FREE_BY_DEFAULT, *freed} - set(fixed)
    if not wanted:
        raise UsageInvalid("--fix leaves no parameter to find", remedy="fix fewer")
    return tuple(name for name in NAMES if name in wanted)


def identify(
    campaign: "Campaign", free: tuple[str, ...]
) -> "tuple[Identification, dict[str, JsonValue]]":
    """Identify from the latest run or import and write the finding into the journal."""
    import time

    from app.folder import journal_of, measured_series, require_journal
    from campaigns.dataset import dataset_of_journal
    from campaigns.identification_document import identification_document
    from campaigns.identify import identify_distances
    from campaigns.planning import numeric_geometry
    from campaigns.records import Finding

    require_journal(campaign)
    with journal_of(campaign) as journal:
        series = measured_series(campaign, journal)
        data = dataset_of_journal(journal.shots(series.number))
        nominal = numeric_geometry(campaign.nominal.robot)
        started_s = time.perf_counter()
        found = identify_distances(nominal, data, free)
        document = identification_document(found, time.perf_counter() - started_s)
        provenance = _provenance(campaign, journal, series, len(data.numbers))
        journal.append(Finding("identification", document | provenance))
    return found, document


def draw(campaign: "Campaign", found: "Identification", path: Path) -> None:
    """Draw the distance errors before and after; raises `WriteFailed`."""
    from app.folder import measured_series, require_journal
    from app.report.plots import plot_residuals
    from campaigns.dataset import dataset_of_journal
    from campaigns.journal_reader import read_journal
    from campaigns.numerics.geometry import Geometry
    from campaigns.planning import numeric_geometry

    with read_journal(require_journal(campaign)) as journal:
        series = measured_series(campaign, journal)
        data = dataset_of_journal(journal.shots(series.number))
    nominal = numeric_geometry(campaign.nominal.robot)
    plot_residuals(
        path, nominal, Geometry.from_flat({p.name: p.value for p in found.parameters}), data
    )


def _provenance(
    campaign: "Campaign", journal: "Journal", series: "Series", shots: int
) -> "dict[str, JsonValue]":
    from app.folder import now_utc

    return {
        "series": series.number,
        "shots": shots,
        "robot_digest": campaign.nominal.robot.digest(),
        "plan_digest": series.started.plan_digest,
        "journal_digest": journal.digest(),
        "journal_records": journal.last_number(),
        "at_utc": now_utc(),
    }


def show(terminal: "Terminal", found: "Identification") -> None:
    """The result for people."""
    from app.console import BAD, GOOD, OPEN, WARNING

    terminal.table(
        "Parameters (mm, deg)", ("", "nominal", "identified", "Δ", "σ"), _parameter_rows(found)
    )
    terminal.table(
        "Errors of distances (mm)",
        ("", "mean before", "after", "max before", "after"),
        _error_rows(found),
    )
    terminal.say(
        f"{found.explanation}; rank {found.rank}, condition {found.condition:.0f}, "
        f"{found.dof} degrees of freedom"
    )
    for names in found.unobservable:
        terminal.say(f"cannot be told apart: {', '.join(names)} move together", WARNING)
    style = {"pass": GOOD, "fail": BAD}.get(found.verdict, OPEN)
    terminal.say(f"verdict: {found.verdict}", style)
    for reason in found.reasons:
        terminal.say(f"  {reason}")


def _parameter_rows(found: "Identification") -> list[tuple[str, ...]]:
    return [
        (
            parameter.name,
            f"{parameter.nominal:.4f}",
            f"{parameter.value:.4f}",
            f"{parameter.delta:+.4f}",
            "-" if parameter.std is None else f"{parameter.std:.4f}",
        )
        for parameter in found.parameters
        if parameter.free
    ]


def _error_rows(found: "Identification") -> list[tuple[str, ...]]:
    pairs = {"fitted pairs": found.residuals, "unseen pairs": found.unseen}
    return [
        (
            name,
            f"{errors.before.mean_abs:.3f}",
            f"{errors.after.mean_abs:.3f}",
            f"{errors.before.max_abs:.3f}",
            f"{errors.after.max_abs:.3f}",
        )
        for name, errors in pairs.items()
        if errors is not None
    ]
