"""Live state of a campaign: its status and last journal records, as plain data for the page."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from campaigns.campaign import open_folder
from campaigns.errors import CampaignError
from campaigns.files.lock import lock_holder
from campaigns.journal import records
from campaigns.journal.views import Entry
from campaigns.workflow.status import folder_status
from drivers.texts import printable

EVENTS_SHOWN = 8
Entries = Sequence[Entry[records.Record]]
NOT_MEASURED = {"colour": "grey", "state": "nothing was measured yet", "detail": ""}
MEASURING = {"colour": "green", "state": "measuring", "detail": ""}
FINISHED = {"colour": "green", "state": "finished", "detail": ""}
GONE = {
    "colour": "red",
    "state": "ended without a stop record",
    "detail": "the measuring process is gone; `run` resumes",
}


def live_state(folder: Path) -> dict[str, object]:
    """Return the contents of the page of an absolute folder; one that cannot be read is grey."""
    try:
        return _state(folder)
    except (CampaignError, OSError) as error:
        return {
            "name": folder.name,
            "colour": "grey",
            "state": "cannot be read",
            "detail": printable(str(error)),
        }


def _state(folder: Path) -> dict[str, object]:
    campaign = open_folder(folder)
    status = folder_status(campaign, datetime.now(UTC))
    is_held = lock_holder(folder) is not None
    entries: Entries = ()
    if campaign.journal_path.exists():
        with campaign.journal_reader() as journal:
            entries = journal.records()
    latest = status.series[-1] if status.series else None
    number = latest.series if latest else None
    # records without a series, such as an operator's note, belong to whatever is measured
    of_series = [entry for entry in entries if entry.series in (None, number)]
    activity = _activity(of_series, is_held=is_held) if latest else NOT_MEASURED
    shots = [entry for entry in of_series if isinstance(entry.record, records.Outcome)]
    if activity == FINISHED and status.next:
        activity = FINISHED | {"state": f"finished: {status.next.text}"}
    last = shots[-1].record if shots else None
    intents = [entry.record for entry in of_series if isinstance(entry.record, records.Intent)]
    return {
        "name": f"{status.name} (simulated)" if campaign.is_simulated else status.name,
        **activity,
        "stage": latest.stage if latest else "",
        "done": latest.shots if latest else 0,
        "total": latest.planned if latest else None,
        "ends_utc": latest.ends_utc if latest and activity == MEASURING else None,
        "reflector": intents[-1].reflector if intents else "",
        "residual_mm": last.residual_mm if isinstance(last, records.Outcome) else None,
        "campaign": status.phase,
        "verdict": status.decision or "",
        "open": status.open,
        "doubtful": status.doubtful,
        "next": status.next.says if status.next else "",
        "events": [*_events(of_series)][-1 : -EVENTS_SHOWN - 1 : -1],
        "latest_utc": entries[-1].at_utc if entries else None,
    }


def _activity(entries: Entries, *, is_held: bool) -> dict[str, str]:
    """Return colour, state and detail by the last record of a series that shows its state."""
    # Backwards from the newest record to the first one that decides. A broken beam counts only
    # while the process lives, and until a record shows that work went on: then the loop ends, and
    # whether the process holds the campaign decides between "measuring" and "gone".
    for entry in reversed(entries):
        match entry.record:
            case records.SeriesFinished():
                return FINISHED
            case records.SessionStopped(how=how, reason=reason):
                colour = "green" if how == "finished" else "amber"
                return {"colour": colour, "state": "stopped", "detail": printable(reason)}
            case records.Event(kind="beam broken" | "suspended", text=text) if is_held:
                return {"colour": "red", "state": "the beam is broken", "detail": printable(text)}
            case (
                records.Intent()
                | records.Outcome()
                | records.SessionStarted()
                | records.Event(kind="resumed")
            ):
                break
            case _:
                pass
    return MEASURING if is_held else GONE


def _events(entries: Entries) -> list[dict[str, str]]:
    """Return the events and rejected shots of a series, in their order."""
    texts = []
    for entry in entries:
        match entry.record:
            case records.Event(text=text):
                texts.append((entry.at_utc, text))
            case records.Rejected(shot=shot, reason=reason):
                texts.append((entry.at_utc, f"shot {shot}: {reason}"))
            case _:
                pass
    return [{"at_utc": at_utc, "text": printable(text)} for at_utc, text in texts]
