"""Settings that one driver alone knows, of what a campaign says."""

from campaigns.campaign import Campaign
from campaigns.controllers.active_kinematics import ActiveKinematics, HeldParameters
from campaigns.settings.sections import BY_HAND
from campaigns.shots import ascii_points
from drivers.by_hand import HandSettings
from drivers.catalog import FILE
from drivers.watch_file import WatchSettings


def controller_settings(campaign: Campaign) -> HandSettings | None:
    """What the campaign says to one controller's driver alone."""
    is_by_hand = campaign.config.controller.driver == BY_HAND
    return _hand_settings(campaign) if is_by_hand else None


def tracker_settings(campaign: Campaign) -> WatchSettings | str:
    """What the campaign says to one tracker's driver alone: the file, or a serial number."""
    tracker = campaign.config.tracker
    if not tracker.url.startswith(FILE):
        return tracker.serial or BY_HAND
    path, told = campaign.folder / tracker.url.removeprefix(FILE), tracker.watch
    columns = told.columns.split(",") if told.columns else None
    return WatchSettings(
        serial=tracker.serial or path.name,
        path=path,
        wait_s=told.wait_s,
        rows_of=ascii_points.data_rows,
        point_of=lambda row, text: ascii_points.point_of_row(
            row, text, path.name, unit=told.unit, columns=columns
        ),
    )


def _hand_settings(campaign: Campaign) -> HandSettings:
    """What the driver has to know of a robot that somebody moves."""
    mechanism = campaign.robot.mechanism
    held = HeldParameters(campaign.folder, campaign.nominal)
    return HandSettings(
        serial=campaign.config.controller.serial or BY_HAND,
        in_place=tuple(campaign.config.settle.in_place_rad * a.scale for a in mechanism.joints),
        read=held.read,
        write=held.write,
        lacks=held.lacks,
        joints_of=lambda held, pose: ActiveKinematics(mechanism, held).joints(pose),
    )
