"""HAL files as LinuxCNC reads them, for tests alone: the product writes them, the bridge reads."""

import re

from campaigns.controllers.linuxcnc_export import drawing_flat

SETTING = re.compile(r"^setp pkmkins\.(\S+) (\S+)$", re.MULTILINE)
BACKLASH = re.compile(
    r"^# (?:setp ini\.|\[JOINT_)(\d+)(?:\.backlash|\]BACKLASH =) (\S+)$", re.MULTILINE
)


def parameters_of(text, mechanism):
    """Parameters by name that a HAL file sets, backlashes from its comments."""
    values = {name: float(value) for name, value in SETTING.findall(text)}
    table = mechanism.parameters
    backlashes = {table[name].arm: name for name in table.select(group="backlash")}
    values |= {backlashes[int(arm)]: float(value) for arm, value in BACKLASH.findall(text)}
    drawing = drawing_flat(mechanism)
    assert {name: values[name] for name in drawing} == drawing
    return {name: value for name, value in values.items() if name not in drawing}
