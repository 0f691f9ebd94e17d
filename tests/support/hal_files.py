"""HAL files as LinuxCNC reads them, for tests alone: the product writes them, the bridge reads."""

import re

from campaigns.controllers.linuxcnc_export import MODULE, drawing_pins, pin_of

SETTING = re.compile(rf"^setp ({MODULE}\.\S+) (\S+)$", re.MULTILINE)
BACKLASH = re.compile(
    r"^# (?:setp ini\.|\[JOINT_)(\d+)(?:\.backlash|\]BACKLASH =) (\S+)$", re.MULTILINE
)


def parameters_of(text, mechanism):
    """Parameters by name that a HAL file sets, backlashes from its comments."""
    table = mechanism.parameters
    names = {pin_of(name): name for name in (*table.of_robot, table.rate.name)}
    pins = {pin: float(value) for pin, value in SETTING.findall(text)}
    values = {names[pin]: value for pin, value in pins.items() if pin in names}
    backlashes = {table[name].arm: name for name in table.select(group="backlash")}
    values |= {backlashes[int(arm)]: float(value) for arm, value in BACKLASH.findall(text)}
    assert {pin: value for pin, value in pins.items() if pin not in names} == drawing_pins(
        mechanism
    )
    return values
