"""Observations of a campaign that are planned in observations.csv, measured one after the other."""

# What counts is the journal: each value is a record of its own before the robot moves again, and
# the file is written after it, with the value and the joints as they were read. So a process that
# is killed between both loses nothing: the next one finds the row measured, and writes the file.

from campaigns.campaign import Campaign, now_utc
from campaigns.errors import ObservationsInvalid
from campaigns.identification.observed import objects_of
from campaigns.identification.plausible_observations import check_observations
from campaigns.journal.journal import Journal
from campaigns.measuring.observing import ObservationWork
from campaigns.shots.observation_records import (
    PlannedRow,
    append_measured,
    measured_rows,
    planned_rows,
)
from campaigns.shots.observations_csv import (
    FILE_NAME,
    ObservationRow,
    read_observations,
    write_observations,
)
from drivers.bounded_files import is_there


def planned_observations(campaign: Campaign) -> tuple[PlannedRow, ...]:
    """Return the rows of observations.csv that no run has measured yet; () without the file.

    Raise `ShotsInvalid` with the line of a row that cannot be measured.
    """
    planned = planned_rows(_rows(campaign))
    if not planned or not campaign.journal_path.exists():
        return planned
    with campaign.journal_reader() as journal:
        measured = measured_rows(journal, FILE_NAME)
    return tuple(row for row in planned if row.key not in measured)


def observation_work(
    campaign: Campaign, journal: Journal, planned: tuple[PlannedRow, ...]
) -> ObservationWork:
    """Return the work of measuring planned observations, each kept in the journal and the file."""

    def keep(row: PlannedRow, measured: ObservationRow) -> None:
        append_measured(journal, FILE_NAME, row, measured)
        fill_in(campaign, journal)

    config = campaign.config
    return ObservationWork(
        planned=planned,
        robot=campaign.robot_model,
        speed_fraction=config.controller.speed_percent / 100.0,
        settle=config.settle,
        keep=keep,
        now_utc=now_utc,
    )


def fill_in(campaign: Campaign, journal: Journal) -> None:
    """Write into observations.csv the values that runs have measured of its planned rows."""
    rows, measured = list(_rows(campaign)), measured_rows(journal, FILE_NAME)
    by_line = {planned.row.line: planned.key for planned in planned_rows(rows)}
    filled = [measured.get(by_line.get(row.line, ()), row) for row in rows]
    if filled != rows:
        path = campaign.path(FILE_NAME)
        write_observations(path, filled, campaign.robot.mechanism, overwrite=True)


def doubt_of(campaign: Campaign) -> str:
    """Return why the values that runs have read cannot be this robot's, in words; "" if they can.

    Units and signs are those of the instrument's display, which people mistake all alike.
    """
    with campaign.journal_reader() as journal:
        rows = tuple(measured_rows(journal, FILE_NAME).values())
    if not rows:
        return ""
    objects, limit_mm = objects_of(campaign.config.objects), campaign.config.gate.distance_mm
    try:
        check_observations(campaign.robot.kinematics, rows, objects, limit_mm, FILE_NAME)
    except ObservationsInvalid as error:
        return error.problem
    return ""


def _rows(campaign: Campaign) -> tuple[ObservationRow, ...]:
    """Return the rows of observations.csv; () without the file."""
    path = campaign.path(FILE_NAME)
    if not is_there(path):
        return ()
    names = [item.name for item in campaign.config.objects]
    return read_observations(path, campaign.robot.mechanism, names)
