"""pkmcal identify: the geometry from the measured shots."""

from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Folder, Json

if TYPE_CHECKING:
    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.identify import Identification
    from campaigns.journal import Journal
    from campaigns.journal_views import Series


def command(
    folder: Folder,
    *,
    estimator: Annotated[
        str, typer.Option(help="distances: of pairs, as in the paper (no common frame needed).")
    ] = "distances",
    json: Json = False,
) -> None:
    """Find the parameters that explain the measured distances, and prove them on unseen pairs.

    Exit code 1 means: computed, but not to be used (the reasons are given).
    """
    from app.console import Terminal
    from app.folder import open_campaign

    if estimator != "distances":
        raise typer.BadParameter(f"--estimator is '{estimator}', known: distances")
    terminal = Terminal(as_json=json)
    campaign = open_campaign(folder)
    found, document = identify(campaign)
    show(terminal, found)
    terminal.document(document)
    if found.verdict != "pass":
        raise typer.Exit(Exit.NOT_GOOD)
    terminal.note(f"next: pkmcal export {folder}")


def identify(campaign: "Campaign") -> "tuple[Identification, dict[str, object]]":
    """Identify from the latest run or import and write the finding into the journal."""
    import time

    from app.folder import journal_of, measured_series
    from campaigns.dataset import dataset_of_journal
    from campaigns.identification_document import identification_document
    from campaigns.identify import identify_distances
    from campaigns.planning import numeric_geometry
    from campaigns.records import Finding

    with journal_of(campaign) as journal:
        series = measured_series(journal)
        data = dataset_of_journal(journal.shots(series.number))
        started_s = time.perf_counter()
        found = identify_distances(numeric_geometry(campaign.nominal.robot), data)
        document = identification_document(found, time.perf_counter() - started_s)
        provenance = _provenance(campaign, journal, series, len(data.numbers))
        journal.append(Finding("identification", document | provenance))
    return found, dict(document)


def _provenance(
    campaign: "Campaign", journal: "Journal", series: "Series", shots: int
) -> dict[str, object]:
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
    from app.console import BAD, GOOD, OPEN

    rows = [
        (p.name, f"{p.nominal:.4f}", f"{p.value:.4f}", f"{p.delta:+.4f}", _std(p.std))
        for p in found.parameters
        if p.free
    ]
    terminal.table("Parameters (mm, deg)", ("", "nominal", "identified", "Δ", "σ"), rows)
    errors = [("fitted pairs", found.residuals)]
    if found.unseen is not None:
        errors.append(("unseen pairs", found.unseen))
    terminal.table(
        "Distance errors (mm)",
        ("", "mean before", "after", "max before", "after"),
        [
            (
                name,
                *(f"{v:.3f}" for v in (e.before.mean_abs, e.after.mean_abs)),
                *(f"{v:.3f}" for v in (e.before.max_abs, e.after.max_abs)),
            )
            for name, e in errors
        ],
    )
    terminal.say(
        f"{found.explanation}; rank {found.rank}, condition {found.condition:.0f}, "
        f"{found.dof} degrees of freedom"
    )
    for names in found.unobservable:
        terminal.say(f"cannot be told apart here: {', '.join(names)} move together", "yellow")
    style = {"pass": GOOD, "fail": BAD}.get(found.verdict, OPEN)
    terminal.say(f"verdict: {found.verdict}: {'; '.join(found.reasons)}", style)


def _std(std: float | None) -> str:
    return "-" if std is None else f"{std:.4f}"
