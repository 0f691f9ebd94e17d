"""Settings that one driver alone knows, of what a campaign says."""

from functools import partial

from campaigns.campaign import Campaign
from campaigns.controllers import linuxcnc_export as export
from campaigns.controllers.active_kinematics import ActiveKinematics
from campaigns.settings.sections import BY_HAND, FILE, WATCH_FILE, LinuxcncConfig
from campaigns.shots import ascii_points
from drivers.by_hand import HandSettings
from drivers.linuxcnc.hal_parameters import HalParameters, HalPins, ParameterFile
from drivers.linuxcnc.settings import Coordinates, LinuxcncSettings
from drivers.watch_file import WatchSettings
from drivers.wire.command_prefix import command_prefix

ACTIVE = "linuxcnc-active.hal"
"""The parameters in use where LinuxCNC has none itself; in the campaign's folder."""
HELD = "by-hand-active.hal"
"""The parameters that were typed into a controller by hand; in the campaign's folder."""


def controller_settings(campaign: Campaign) -> LinuxcncSettings | HandSettings | None:
    """What the campaign says to one controller's driver alone."""
    if campaign.config.controller.driver == BY_HAND:
        return _hand_settings(campaign)
    section = campaign.config.controller.linuxcnc
    return None if section is None else _linuxcnc_settings(campaign, section)


def tracker_settings(campaign: Campaign) -> WatchSettings | str:
    """What the campaign says to one tracker's driver alone: the file, or a serial number."""
    tracker = campaign.config.tracker
    if tracker.driver != WATCH_FILE:
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
    whose = export.RobotIdentity(campaign.robot_identity, campaign.robot)
    held = export.CalibrationFile(campaign.folder / HELD, whose, otherwise=campaign.robot)
    return HandSettings(
        serial=campaign.config.controller.serial or BY_HAND,
        in_place=tuple(campaign.config.settle.in_place_rad * a.scale for a in mechanism.joints),
        read=held.read,
        write=held.write,
        lacks=held.lacks,
        joints_of=lambda held, pose: ActiveKinematics(mechanism, held).joints(pose),
    )


def _linuxcnc_settings(campaign: Campaign, section: LinuxcncConfig) -> LinuxcncSettings:
    """What the driver has to know of this campaign's LinuxCNC and its robot."""
    mechanism = campaign.robot.mechanism
    are_rotary = mechanism.joints[0].is_revolute
    lowest, highest = campaign.robot.limits.joint
    return LinuxcncSettings(
        coordinates=Coordinates[section.coordinates.upper()],
        lowest=lowest,
        highest=highest,
        full_speed_per_s=section.full_speed_rad_s if are_rotary else section.full_speed_mm_per_s,
        store=_store(campaign, section),
        poses_of=partial(ActiveKinematics, mechanism),
        robot=mechanism.name.capitalize(),
        joints=len(mechanism.joints),
        are_rotary=are_rotary,
        has_turn=any(axis.is_revolute for axis in mechanism.task),
        connect_password=section.connect_password,
        enable_password=section.enable_password,
    )


def _store(campaign: Campaign, section: LinuxcncConfig) -> ParameterFile | HalParameters:
    nominal = campaign.robot
    whose = export.RobotIdentity(campaign.robot_identity, nominal)
    path = campaign.folder / (section.hal_file or ACTIVE)
    if section.coordinates == "joints":
        return export.CalibrationFile(path, whose, otherwise=nominal)
    space, pins = nominal.mechanism.parameters, export.parameter_pins(nominal.mechanism)
    drawn = export.drawing_flat(nominal.mechanism)
    drawing = {export.pin_of(name): value for name, value in drawn.items()}
    required = frozenset((*drawing, *(pins[name] for name in space.names)))
    return HalParameters(
        export.CalibrationFile(path, whose),
        HalPins((*pins.values(), *drawing), command_prefix(section.beside), required=required),
        pins,
        frozenset(space.optional),
        drawing,
    )
