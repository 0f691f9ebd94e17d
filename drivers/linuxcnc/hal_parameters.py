"""Parameters of LinuxCNC: the file that it reads when it starts, and its HAL pins from outside.

Pins are read and set as full doubles, by LinuxCNC's own Python module.
`halcmd getp` prints seven digits, too few to verify a parameter by. So a small program is handed to
the system's Python on LinuxCNC's computer: directly, or by a prefix such as `ssh controller`.
"""

import json
import math
import subprocess
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from drivers.errors import DeviceRefused, DriverError, LinkDown, WireError

POWER_PIN = "motion.motion-enabled"
WITHIN_S = 15.0
MOST_ANSWERED = 65536

PROGRAM = """
import sys
sys.path = [folder for folder in sys.path if folder]
import json, os
try:
    import hal
except ImportError as error:
    print(json.dumps({"missing": str(error)}))
    sys.exit()
component = None
try:
    component = hal.component("pkmcal-%d" % os.getpid())
    component.ready()
    try:
        powered = hal.get_value(ASKED["power"])
    except RuntimeError:
        print(json.dumps({"missing": "LinuxCNC does not run"}))
        sys.exit()
    if ASKED["must_be_off"] and powered:
        print(json.dumps({"powered": True}))
    else:
        for name, value in ASKED["set"].items():
            hal.set_p(name, value)
        pins = {}
        for name in ASKED["get"]:
            try:
                pins[name] = hal.get_value(name).hex()
            except RuntimeError:
                if name in ASKED["required"]:
                    raise
        print(json.dumps({"pins": pins}))
except Exception as error:
    print(json.dumps({"problem": "%s: %s" % (type(error).__name__, error)}))
finally:
    if component is not None:
        component.exit()
"""
"""Runs on LinuxCNC's computer: any Python 3, nothing of ours or of the folder it is started in."""


@dataclass(frozen=True, slots=True)
class HalPins:
    """Some float pins of a running LinuxCNC, by name; `prefix` runs a program on its computer."""

    names: tuple[str, ...]
    prefix: tuple[str, ...] = ()
    python: str = "/usr/bin/python3"
    within_s: float = WITHIN_S
    required: frozenset[str] | None = None
    """Those without which it is another kinematics; None: all."""

    @property
    def command(self) -> tuple[str, ...]:
        """A Python that takes its program from its input: the same through ssh, unquoted."""
        return (*self.prefix, self.python, "-")

    def read(self) -> dict[str, float]:
        """All of them that there are; raises `LinkDown` when LinuxCNC cannot be reached so."""
        return self._run({}, must_be_off=False)

    def write(self, values: Mapping[str, float]) -> dict[str, float]:
        """Set some or none with the machine off, and give what all of them hold then.

        Raises `DeviceRefused` while the machine is on: the joints would jump.
        """
        texts = {name: repr(float(value)) for name, value in values.items()}
        return self._run(texts, must_be_off=True)

    def _run(self, settings: Mapping[str, str], *, must_be_off: bool) -> dict[str, float]:
        asked = {
            "set": dict(settings),
            "get": self.names,
            "required": tuple(self.required_names),
            "power": POWER_PIN,
            "must_be_off": must_be_off,
        }
        program = f"ASKED = {asked!r}\n{PROGRAM}"
        try:
            done = subprocess.run(  # noqa: S603 - the prefix is the operator's own command
                self.command,
                input=program,
                capture_output=True,
                encoding="utf-8",
                errors="replace",
                timeout=self.within_s,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise self._unreachable(f"{error}") from error
        return self._pins_of(done.stdout, done.stderr)

    def _pins_of(self, said: str, complaint: str) -> dict[str, float]:
        answer = _answer_of(said)
        if answer is None:
            raise self._unreachable(_last_line(complaint) or "no answer")
        if "missing" in answer:
            raise self._unreachable(f"{answer['missing']}")
        if "powered" in answer:
            raise DeviceRefused(
                "LinuxCNC's machine is on: changed parameters would make the joints jump",
                remedy="switch the machine off, then load again",
                code="MACHINE ON",
            )
        if "problem" in answer:
            raise self._refused(f"{answer['problem']}")
        return _values(answer.get("pins"), self.names, self.required_names)

    @property
    def required_names(self) -> frozenset[str]:
        """Pins that there must be."""
        return frozenset(self.names) if self.required is None else self.required

    def _unreachable(self, why: str) -> LinkDown:
        return LinkDown(
            f"LinuxCNC's HAL cannot be reached by '{' '.join(self.command)}' ({why:.200})",
            remedy="check that LinuxCNC runs there, as this user, with its Python module installed",
        )

    def _refused(self, problem: str) -> DeviceRefused:
        return DeviceRefused(
            f"LinuxCNC runs, but without the pins of the expected kinematics ({problem:.200})",
            remedy="check [KINS]KINEMATICS in LinuxCNC's INI file, and what else sets these pins",
            code="PINS",
        )


def _answer_of(said: str) -> Mapping[str, object] | None:
    """The one line of JSON; None for anything else."""
    try:
        answer = json.loads(_last_line(said[:MOST_ANSWERED]))
    except (ValueError, RecursionError):  # brackets without an end nest too deeply
        return None
    return answer if isinstance(answer, dict) else None


def _values(pins: object, names: Sequence[str], required: frozenset[str]) -> dict[str, float]:
    if not isinstance(pins, dict) or not required <= set(pins) <= set(names):
        raise WireError("LinuxCNC's HAL answers other pins than were asked for")
    try:
        values = {name: float.fromhex(pins[name]) for name in names if name in pins}
    except (TypeError, ValueError, OverflowError) as error:
        raise WireError("LinuxCNC's HAL answers a pin that is no number") from error
    if not all(map(math.isfinite, values.values())):
        raise WireError("LinuxCNC's HAL answers a pin that is not finite")
    return values


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1] if lines else ""


class ParameterFile(Protocol):
    """A file of parameters that is read when LinuxCNC starts. Errors are its own.

    By itself it is for a controller that only takes joints: for our own conversion of poses.
    """

    def read(self) -> Mapping[str, float]:
        """All parameters by flat name; refuses another robot's."""

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace the file whole, and keep the one before."""

    def take_back(self) -> None:
        """Put back the file that the last `write` replaced."""

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        """Those of the named parameters that cannot be put to work."""


@dataclass(frozen=True, slots=True)
class HalParameters:
    """For a controller that runs our kinematics: the file and the pins, always the same."""

    file: ParameterFile
    pins: HalPins
    """Those of `pin_of` and of `drawing`."""
    pin_of: Mapping[str, str]
    """The pin of each parameter."""
    extensions: frozenset[str] = frozenset()
    """Parameters of imperfect parts, which a set leaves out where they are 0."""
    drawing: Mapping[str, float] = field(default_factory=dict)
    """What other pins hold, by pin, wherever an extension is not 0."""

    def read(self) -> Mapping[str, float]:
        """The parameters at work in LinuxCNC; raises `DeviceRefused` when its file has others."""
        pins = self.pins.read()
        held, filed = self._parameters(pins), self.file.read()
        names = [name for name in self.pin_of if name in held or name in filed]
        different = [name for name in names if held.get(name, 0.0) != filed.get(name, 0.0)]
        if different:
            name = different[0]
            raise DeviceRefused(
                f"LinuxCNC works with {name} = {held.get(name, 0.0)!r}, its HAL file says "
                f"{filed.get(name)!r} ({len(different)} of {len(names)} differ)",
                remedy="restart LinuxCNC to take the file (BACKLASH in the INI file as there), "
                "or load again to replace both",
                code="FILE",
            )
        if not self.extensions.isdisjoint(held):
            self._check_drawing(pins)
        return held

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        """Those of the named parameters of which the kinematics has no pin."""
        held = self.pins.read() if names else {}
        return tuple(name for name in names if self.pin_of.get(name) not in held)

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace file and pins, read the pins back; what does not verify is taken back.

        Raises `DeviceRefused`, with the machine on before anything is written.
        """
        before = self.pins.write({})
        self.file.write(geometry)
        known = {name for name in self.extensions if self.pin_of[name] in before}
        drawing = {pin: value for pin, value in self.drawing.items() if pin in before}
        try:
            self._set(dict.fromkeys(known, 0.0) | dict(geometry), drawing)
        except DriverError as error:
            raise self._taken_back(before, error) from error

    def _set(self, whole: Mapping[str, float], drawing: Mapping[str, float]) -> None:
        settings = {self.pin_of[name]: value for name, value in whole.items()}
        held = self.pins.write(settings | dict(drawing))
        for name, value in whole.items():
            if held[self.pin_of[name]] != value:
                raise DeviceRefused(
                    f"{name} is {held[self.pin_of[name]]!r} in LinuxCNC after {value!r} was set",
                    remedy="check what else writes the pins of its kinematics",
                    code="PINS",
                )
        self._check_drawing(held)

    def _check_drawing(self, held: Mapping[str, float]) -> None:
        """Raise `DeviceRefused` where a plate that tilts, or a drive, is drawn otherwise.

        A pin that not every such kinematics has may hold 0, which says nothing.
        """
        for pin, value in self.drawing.items():
            now = held.get(pin, 0.0)
            if now != value and (now or pin in self.pins.required_names):
                raise DeviceRefused(
                    f"LinuxCNC works with {pin} = {now!r}, the robot file's plate has {value!r}",
                    remedy="bring the robot file's plate back, or load again",
                    code="PLATE",
                )

    def _taken_back(self, before: Mapping[str, float], error: DriverError) -> DeviceRefused:
        self.file.take_back()
        try:
            restored = self.pins.write(before) == before
        except DriverError:
            restored = False
        if restored:
            problem, remedy = "the old parameters are back", error.remedy
        else:
            problem = "its old HAL file is back, but its pins could not be set back"
            remedy = "restart LinuxCNC before anything moves: it then takes the old file"
        return DeviceRefused(f"{error.problem}; {problem}", remedy=remedy, code="NOT LOADED")

    def _parameters(self, held: Mapping[str, float]) -> dict[str, float]:
        named = {name: held[pin] for name, pin in self.pin_of.items() if pin in held}
        return {name: v for name, v in named.items() if v or name not in self.extensions}
