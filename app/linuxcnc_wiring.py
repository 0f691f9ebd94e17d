"""A campaign on LinuxCNC: its settings, limits, parameters and kinematics put together."""

import shlex
from collections.abc import Callable

from app.folder import Campaign
from campaigns.controllers.active_kinematics import ActiveKinematics
from campaigns.controllers.linuxcnc_export import PIN_OF, CalibrationFile, Whose
from campaigns.settings.linuxcnc_section import LinuxcncConfig
from drivers.clock import SystemClock
from drivers.linuxcnc.conversation import Passwords
from drivers.linuxcnc.motion import JointLimits
from drivers.linuxcnc.parameters import FileParameters, HalParameters
from drivers.linuxcnc.pins import HalAccess, HalPins
from drivers.linuxcnc.robot import LinuxcncRobot
from drivers.linuxcnc.settings import LinuxcncSettings, ParameterStore
from drivers.linuxcnc.state import Coordinates
from drivers.transport import Transport

ACTIVE = "linuxcnc-active.hal"
"""The parameters in use where LinuxCNC has none itself; in the campaign's folder."""


def linuxcnc_robot(
    campaign: Campaign, section: LinuxcncConfig, opener: Callable[[], Transport]
) -> LinuxcncRobot:
    """The driver for this campaign's LinuxCNC; nothing is opened yet."""
    settings = LinuxcncSettings(
        Coordinates[section.coordinates.upper()],
        JointLimits(*campaign.nominal.robot.limits.joint_rad),
        section.full_speed_rad_s,
        passwords=Passwords(section.connect_password, section.enable_password),
    )
    return LinuxcncRobot(
        opener,
        clock=SystemClock(),
        settings=settings,
        store=_store(campaign, section),
        kinematics_of=ActiveKinematics,
    )


def _store(campaign: Campaign, section: LinuxcncConfig) -> ParameterStore:
    nominal = campaign.nominal.robot
    whose = Whose(campaign.robot_identity, nominal)
    path = campaign.folder / (section.hal_file or ACTIVE)
    if section.coordinates == "joints":
        return FileParameters(CalibrationFile(path, whose, otherwise=nominal))
    access = HalAccess(prefix=tuple(shlex.split(section.beside)))
    pins = HalPins(tuple(PIN_OF.values()), access)
    return HalParameters(CalibrationFile(path, whose), pins, PIN_OF)
