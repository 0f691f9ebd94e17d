"""LinuxCNC's HAL file of a robot: one `setp` a parameter, for our kinematics module par4kins.

The parameters' 29 pins are named after them. The heading says whose they are: a file of another
robot, of another kinematics, with a parameter missing or changed by hand is refused.
"""

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path

from pydantic import JsonValue

from campaigns.decimals import number_text
from campaigns.errors import ConfigInvalid
from campaigns.parameters import PARAMETER_NAMES
from campaigns.robot import RobotFile, geometry_digest
from campaigns.textfile import read_text, replace_text, write_new_text
from campaigns.version import VERSION
from campaigns.wording import shown

FILE_NAME = "calib.hal"
LAST_GOOD = ".last-good"
MODULE = "par4kins"
SCHEMA = "pkmcal/linuxcnc/1"
PIN_OF: Mapping[str, str] = {name: f"{MODULE}.{name}" for name in PARAMETER_NAMES}
PARAMETER_OF: Mapping[str, str] = {pin: name for name, pin in PIN_OF.items()}
LONGEST_NOTE = 160
"""halcmd reads lines of some 255 characters."""

_HEADING = re.compile(r"#\s*(robot|sha256):\s*(\S.*?)\s*")
