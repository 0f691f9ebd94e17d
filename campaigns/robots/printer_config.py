"""Configuration of a Delta printer: its nominal sizes, and what its firmware measured of it.

Klipper keeps all of it in one file, printer.cfg. People write the sections [printer], [stepper_a],
[stepper_b] and [stepper_c]; the command SAVE_CONFIG appends a block of lines that begin with `#*#`,
whose values take the place of those above. DELTA_CALIBRATE saves heights of the bed there, and
DELTA_ANALYZE distances on a part that was printed, each with the steps of the carriages.

A carriage that is s steps below its end stop stands at

    position_endstop + √(arm_length² − delta_radius²) − s · mm a step

above the bed, as Klipper's documentation of its keys has it. Readings of joints here are − s · mm a
step, 0 at the end stop, so that the end stop's height is the joint's offset.
"""

import configparser
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self, get_args

from campaigns.errors import ConfigInvalid
from campaigns.files.text_file import read_text
from drivers.values import DISTANCE

PRINTER = ".cfg"
"""Ending of the files of printers."""
SAVED = "#*#"
"""Beginning of the lines that SAVE_CONFIG writes."""
CALIBRATED = "delta_calibrate"
TOWERS = {"stepper_a": 210.0, "stepper_b": 330.0, "stepper_c": 90.0}
"""Sections of the towers, each with its usual direction, deg."""
STEPS_A_TURN = 200.0
"""Full steps of a motor that states none: 1.8° each."""
USUAL_SHARE = 0.6
"""Radius of a bed of unknown size, as a share of the towers'."""
JOINTS_OUT_MM = 30.0
"""Typical distance of the rods' joints from the nozzle: for the platform's tilt alone."""
SavedKind = Literal["height", "manual_height", "distance"]
KINDS: tuple[SavedKind, ...] = get_args(SavedKind)
NUMBERED = re.compile(r"(height|manual_height|distance)(\d{1,4})")
TEETH = re.compile(r"(0*[1-9]\d{0,5}(?:\.\d+)?):(0*[1-9]\d{0,5}(?:\.\d+)?)")
"""Pair of a gear's teeth; neither may be 0."""


@dataclass(frozen=True, slots=True)
class Tower:
    """Tower of a printer as the file states it."""

    angle_deg: float
    arm_mm: float
    endstop_mm: float
    """Height of the nozzle in the middle of the bed when the end stop triggers."""
    mm_per_step: float


@dataclass(frozen=True, slots=True)
class SavedValue:
    """Height or distance that the firmware saved."""

    kind: SavedKind
    number: int
    """Number in the file, from 0."""
    joints_mm: tuple[tuple[float, ...], ...]
    """Readings of the carriages at each of its one or two places, 0 at their end stops."""
    value_mm: float
    line: int
    """Line of its value in the file."""


@dataclass(frozen=True, slots=True)
class PrinterConfig:
    """Delta printer of a configuration file."""

    name: str
    radius_mm: float
    """Radius of the towers' circle less the platform's: `delta_radius`."""
    bed_mm: float
    """Radius of the bed."""
    towers: tuple[Tower, ...]
    saved: tuple[SavedValue, ...]

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a printer.cfg; raise `ConfigInvalid` for one that is no Delta's."""
        text = read_text(path, ConfigInvalid, if_missing="give the printer's printer.cfg")
        return cls.of_text(text, str(path))

    @classmethod
    def of_text(cls, text: str, where: str) -> Self:
        """Read the text of a printer.cfg named `where`; raise `ConfigInvalid`."""
        keys = _Keys.of(text, where)
        kinematics = keys.word("printer", "kinematics")
        if kinematics != "delta":
            raise ConfigInvalid(
                f"{where}: [printer] kinematics is {kinematics}, must be delta",
                remedy="give the configuration of a Delta on three towers",
            )
        radius_mm = keys.length("printer", "delta_radius")
        bed_mm = USUAL_SHARE * radius_mm
        for section, key in ((CALIBRATED, "radius"), ("printer", "print_radius")):
            if keys.has(section, key):
                bed_mm = min(keys.length(section, key), radius_mm)
        towers = tuple(_tower(keys, section) for section in TOWERS)
        for section, tower in zip(TOWERS, towers, strict=True):
            if tower.arm_mm <= radius_mm:
                raise ConfigInvalid(
                    f"{where}: [{section}] arm_length is {tower.arm_mm:g} mm, must be above "
                    f"delta_radius, {radius_mm:g} mm",
                    remedy="correct the file: with these the nozzle does not reach the middle",
                )
        steps = [tower.mm_per_step for tower in towers]
        name = re.sub(r"[^\w-]+", "-", Path(where).stem) or "printer"
        return cls(name, radius_mm, bed_mm, towers, tuple(_saved(keys, steps)))

    @property
    def offsets_mm(self) -> tuple[float, ...]:
        """Heights of the carriages above the bed at their end stops."""
        return tuple(
            tower.endstop_mm + math.sqrt(tower.arm_mm**2 - self.radius_mm**2)
            for tower in self.towers
        )

    # The rods swing as far as they have to for the nozzle at the bed's edge, opposite a tower. That
    # also bounds the workspace, for a tower is reached by the same swing from all sides.
    @property
    def robot_text(self) -> str:
        """Text of the robot file of this printer: its frame's z = 0 is the bed."""
        outward = [
            (math.cos(math.radians(tower.angle_deg)), math.sin(math.radians(tower.angle_deg)))
            for tower in self.towers
        ]
        arms = "".join(
            f"    - {{x_mm: {self.radius_mm * x:.9f}, y_mm: {self.radius_mm * y:.9f}, z_mm: 0.0, "
            f"azimuth_deg: 0.0, elevation_deg: 90.0, joint_offset_mm: {offset_mm:.9f}, "
            f"forearm_mm: {tower.arm_mm!r}}}\n"
            for (x, y), offset_mm, tower in zip(outward, self.offsets_mm, self.towers, strict=True)
        )
        joints = [[round(JOINTS_OUT_MM * c, 6) for c in (x, y)] + [0.0] for x, y in outward]
        far_mm = self.radius_mm + self.bed_mm
        rods = [max(tower.arm_mm, 1.02 * far_mm) for tower in self.towers]
        swing_deg = max(math.degrees(math.asin(far_mm / rod)) for rod in rods)
        lowest_mm = max(
            offset - math.sqrt(rod**2 - far_mm**2)
            for offset, rod in zip(self.offsets_mm, rods, strict=True)
        )
        middle_mm = 0.3 * min(tower.endstop_mm for tower in self.towers)
        return f"""\
# Delta printer of {self.name}.cfg, made by pkmcal. The base frame is that of the file: x and y as
# its towers stand, z = 0 on the bed. A joint's reading is its carriage's height less that at its
# end stop: 0 there, negative below.
schema: pkmcal/robot/1
mechanism: linear-delta
name: {self.name}
geometry:
  arms:
    # x and y by delta_radius and angle; joint_offset: height of the carriage at its end stop,
    # position_endstop + √(arm_length² − delta_radius²); forearm: arm_length
{arms}limits:
  joint_mm: [{-math.ceil(lowest_mm)}.0, 0.0]
  # rods away from their towers: as far as the edge of a bed of {self.bed_mm:g} mm radius needs
  forearm_swing_deg: {round(swing_deg + 0.5, 3)}
# 1 σ of what the file states. Narrow those that you measured: rods measured by a calliper to
# 0.1 mm are lengths_mm: 0.1, and scale what heights of the bed cannot.
tolerances: {{places_mm: 1.0, lengths_mm: 0.2, offsets_mm: 1.0}}
workspace_centre_mm: [0.0, 0.0, {round(middle_mm, 3)}]
# typical places of the rods' joints on the platform, which matter for its tilt alone
plate_joints_mm: {joints}
"""


@dataclass(frozen=True, slots=True, eq=False)
class _Keys:
    """Keys of a configuration file, with the messages about them."""

    parser: configparser.RawConfigParser
    where: str
    lines: tuple[str, ...]

    # Klipper's files: `key: value` or `key = value`, comments by #, texts of macros indented.
    @classmethod
    def of(cls, text: str, where: str) -> Self:
        """Parse a file with the block that SAVE_CONFIG appended; raise `ConfigInvalid`."""
        parser = configparser.RawConfigParser(
            strict=False, inline_comment_prefixes=("#", ";"), default_section=""
        )
        lines = text.splitlines()
        saved = [line[len(SAVED) :].removeprefix(" ") for line in lines if line.startswith(SAVED)]
        while saved and not saved[0].startswith("["):  # its heading is for people
            saved = saved[1:]
        written = [line for line in lines if not line.startswith(SAVED)]
        try:
            parser.read_string("\n".join([*written, *saved, ""]), where)
        except configparser.Error as error:
            first = str(error).splitlines()[0]
            raise ConfigInvalid(
                f"{where}: no configuration of Klipper: {first}",
                remedy="give the printer's printer.cfg",
            ) from error
        return cls(parser, where, tuple(lines))

    def line_of(self, key: str) -> int:
        """Return the last line that states a key, from 1."""
        stated = re.compile(rf"(?:{re.escape(SAVED)})?\s*{key}\s*[:=]", re.IGNORECASE)
        return max(n for n, line in enumerate(self.lines, start=1) if stated.match(line))

    def has(self, section: str, key: str) -> bool:
        """Return whether the file states a key."""
        return self.parser.has_option(section, key)

    def word(self, section: str, key: str) -> str:
        """Return a value's text; raise `ConfigInvalid` if the file lacks it."""
        value = self.parser.get(section, key, fallback=None)
        if not value:
            elsewhere = any(name.startswith("include ") for name in self.parser.sections())
            raise ConfigInvalid(
                f"{self.where}: [{section}] {key} is missing",
                remedy="copy it in from the file that [include …] names"
                if elsewhere
                else "give the printer.cfg of a Delta, with all of its sections",
            )
        return value.strip()

    def numbers(self, section: str, key: str, separator: str = ",") -> list[float]:
        """Return the numbers of a value; raise `ConfigInvalid` for what is none."""
        text = self.word(section, key)
        try:
            values = [float(part) for part in text.split(separator)]
        except ValueError:
            values = [math.nan]
        if not all(map(math.isfinite, values)):
            raise ConfigInvalid(
                f"{self.where}: [{section}] {key} is '{text[:80]}', must be numbers",
                remedy="correct it",
            )
        return values

    def number(self, section: str, key: str) -> float:
        """Return a number; raise `ConfigInvalid`."""
        values = self.numbers(section, key)
        if len(values) != 1:
            raise ConfigInvalid(
                f"{self.where}: [{section}] {key} holds {len(values)} numbers, must hold one",
                remedy="correct it",
            )
        return values[0]

    def ratio(self, section: str, key: str) -> float:
        """Return the product of pairs `80:16, 60:16`, 1 for a key that is not there."""
        ratio = 1.0
        for pair in self.word(section, key).split(",") if self.has(section, key) else ():
            match = TEETH.fullmatch(pair.strip())
            if match is None:
                raise ConfigInvalid(
                    f"{self.where}: [{section}] {key} has '{pair.strip()[:40]}', must be two "
                    "numbers above 0 with a colon",
                    remedy="correct it, such as 80:16",
                )
            ratio *= float(match[1]) / float(match[2])
        return ratio

    def length(self, section: str, key: str) -> float:
        """Return a number above 0 that is no absurd length; raise `ConfigInvalid`."""
        value = self.number(section, key)
        if not 0.0 < value <= DISTANCE.most:
            raise ConfigInvalid(
                f"{self.where}: [{section}] {key} is {value:g}, must be above 0 and at most "
                f"{DISTANCE.most:g}",
                remedy="correct it",
            )
        return value


def _tower(keys: _Keys, section: str) -> Tower:
    """Return a tower; what its section leaves out is that of [stepper_a], as in the firmware."""

    def stating(*names: str) -> str:
        return section if any(keys.has(section, key) for key in names) else next(iter(TOWERS))

    return Tower(
        keys.number(section, "angle") if keys.has(section, "angle") else TOWERS[section],
        keys.length(stating("arm_length"), "arm_length"),
        keys.number(stating("position_endstop"), "position_endstop"),
        _mm_per_step(keys, stating("rotation_distance", "step_distance")),
    )


def _mm_per_step(keys: _Keys, section: str) -> float:
    """Return the travel for a step, mm, by the drive of a section; raise `ConfigInvalid`."""
    if keys.has(section, "step_distance"):  # files of before 2021
        return keys.length(section, "step_distance")
    full = STEPS_A_TURN
    if keys.has(section, "full_steps_per_rotation"):
        full = keys.length(section, "full_steps_per_rotation")
    turn_mm = keys.length(section, "rotation_distance")
    steps = full * keys.length(section, "microsteps") * keys.ratio(section, "gear_ratio")
    return turn_mm / steps


# DELTA_CALIBRATE numbers heights from 0, and DELTA_ANALYZE distances.
def _saved(keys: _Keys, mm_per_step: Sequence[float]) -> Iterator[SavedValue]:
    """Yield what was saved, in the order of its numbers; raise `ConfigInvalid`."""

    def readings(key: str) -> tuple[float, ...]:
        steps = keys.numbers(CALIBRATED, key)
        if len(steps) != len(mm_per_step):
            raise ConfigInvalid(
                f"{keys.where}: [{CALIBRATED}] {key} holds {len(steps)} numbers, must hold the "
                f"steps of {len(mm_per_step)} carriages",
                remedy="run DELTA_CALIBRATE and SAVE_CONFIG again",
            )
        return tuple(-count * mm for count, mm in zip(steps, mm_per_step, strict=True))

    if not keys.parser.has_section(CALIBRATED):
        return
    numbered = [NUMBERED.fullmatch(key) for key in keys.parser.options(CALIBRATED)]
    names = [match for match in numbered if match is not None]
    for match in sorted(names, key=lambda match: (KINDS.index(match[1]), int(match[2]))):
        kind, number = KINDS[KINDS.index(match[1])], int(match[2])
        ends = ("_pos1", "_pos2") if kind == "distance" else ("_pos",)
        places = tuple(readings(f"{match[0]}{end}") for end in ends)
        value_mm = keys.number(CALIBRATED, match[0])
        yield SavedValue(kind, number, places, value_mm, keys.line_of(match[0]))
