"""A LinuxCNC on a hand-moved clock: enough of linuxcncrsh, and of what can go wrong behind it."""

from math import radians

from timed_pipe import FarEnd

from drivers.linuxcnc.robot import LinuxcncRobot
from drivers.linuxcnc.settings import Coordinates, LinuxcncSettings
from drivers.values import Pose

ANSWER_S = 0.0001
ORDER_S = 0.1
MOVE_S = 0.3
SPEED_DEG_S = 100.0
NEVER = object()
TARGET_RAD = tuple(map(radians, (10.0, -20.0, 30.0, 40.123456789)))


class Straight:
    """Kinematics for tests: a degree is ten millimetres, and a fourth joint the angle."""

    def __init__(self, geometry):
        self.plate_mm = geometry["plate_mm"]

    def joints(self, pose, here=None):
        return (
            radians(pose.x_mm / 10),
            radians(pose.y_mm / 10),
            radians(pose.z_mm / 10),
            pose.theta_rad,
        )

    def pose(self, joints):
        x, y, z, theta = joints
        return Pose(*(radians_to_mm(angle) for angle in (x, y, z)), theta)


def radians_to_mm(angle_rad):
    return angle_rad / radians(1) * 10


def told(**facts):
    """Settings of a Par4 that takes joints, unless a test says otherwise."""
    usual = {
        "coordinates": Coordinates.JOINTS,
        "lowest": radians(-45),
        "highest": radians(90),
        "full_speed_per_s": radians(SPEED_DEG_S),
        "store": None,
        "poses_of": Straight,
    }
    return LinuxcncSettings(**usual | facts)


class Memory:
    """A store of parameters in memory."""

    def __init__(self):
        self.geometry = {"plate_mm": 100.0}

    def read(self):
        return self.geometry

    def write(self, geometry):
        self.geometry = dict(geometry)


class ScriptedLinuxcnc(FarEnd):
    """The far end. Its attributes are what a test says of the machine; `asked` is what it heard."""

    def __init__(
        self, coordinates=Coordinates.JOINTS, *, newer=False, store=None, facts=None, **settings
    ):
        super().__init__()
        self.newer = newer
        self.name, self.version = "PAR4", "1.1"
        self.passwords = ("EMC", "EMCTOO")
        self.letters = coordinates.value
        self.types = ["ANGULAR"] * 4 + ["LINEAR"] * 2
        self.units = {"USER_LINEAR_UNITS": "MM", "USER_ANGULAR_UNITS": "DEG"}
        self.estop, self.machine, self.mode = True, False, "MANUAL"
        self.chain_closed = self.drives_fine = True
        self.homed = False
        self.task_lives = True
        self.in_control = None
        self.errors = []
        self.refuses_move = []
        self.overrides = {}
        self.start_deg = self.target_deg = (0.0, 0.0, 0.0, 0.0)
        self.started_s = -MOVE_S
        self.frozen_at = None
        self.asked, self.writes = [], []
        self.verbose = set()
        self.store = store or Memory()
        self.robot = LinuxcncRobot(
            self.open,
            clock=self.clock,
            settings=told(coordinates=coordinates, store=self.store, **facts or {}),
            **settings,
        )

    @property
    def orders(self):
        """What was ordered, without the questions."""
        return [line for line in self.asked if line.startswith("set")]

    @property
    def moves(self):
        return [line.removeprefix("set mdi ") for line in self.orders if "G53" in line]

    def open(self, **limit):
        pipe = super().open(**limit)
        pipe.respond = lambda data: self.respond(data, pipe)
        return pipe

    def respond(self, data, pipe):
        self.writes.append((self.clock.now_s(), data.decode()))
        return [
            timed for line in data.decode().splitlines() for timed in self.respond_to(pipe, line)
        ]

    def respond_to(self, pipe, line):
        self.asked.append(line)
        words = line.split()
        answer, after_s = self.answer(pipe, words), ANSWER_S
        if isinstance(answer, tuple):
            answer, after_s = answer
        unsaid = words[0] == "set" and pipe not in self.verbose
        if answer is NEVER or (unsaid and "ACK" in answer):
            return []
        return [(after_s, answer.encode())]

    def answer(self, pipe, words):
        key = " ".join(words[:2])
        if key in self.overrides:
            told = self.overrides[key]
            return told.pop(0) if isinstance(told, list) and len(told) > 1 else first(told)
        if words[0] == "hello":
            accepted = words[1] == self.passwords[0]
            return f"HELLO ACK {self.name} {self.version}\r\n" if accepted else "HELLO NAK\r\n"
        if words[0] == "get":
            return self.get(pipe, words[1]) + "\r\n"
        if key == "set echo":
            return " ".join(words) + "\r\n"
        return self.order(pipe, words[1], words[2:])

    def get(self, pipe, word):
        if word == "error":
            return f"ERROR {self.errors.pop(0) if self.errors else 'OK'}"
        joints = " ".join(f"{angle:.6f}" for angle in self.joints_deg())
        answers = {
            "joint_pos": f"{joints}" if self.newer else f"{joints} 0.000000 0.000000",
            "abs_cmd_pos": self.world(),
            "abs_act_pos": self.world(),
            "program_status": "RUNNING" if self.is_moving() else "IDLE",
            "machine": "ON" if self.machine else "OFF",
            "estop": "ON" if self.estop else "OFF",
            "enable": "ON" if self.in_control is pipe else "OFF",
            "mode": self.mode,
            "joint_homed": " ".join(["YES" if self.homed else "NO"] * 4 + ["NO"] * 2),
            "joint_type": " ".join(self.types[:4] if self.newer else self.types),
        }
        answers |= {key.lower(): value for key, value in self.units.items()}
        return f"{word.upper()} {answers[word]}"

    def order(self, pipe, word, arguments):
        if word == "enable":
            return self.enable(pipe, arguments[0])
        if word == "verbose":
            self.verbose.add(pipe)
            return verdict(word)
        if pipe is not self.in_control:
            return self.refused(word, "Connection must be enabled")
        if word in {"timeout", "set_wait", "wait_mode"}:
            unknown = word == ("set_wait" if self.newer else "wait_mode")
            return (
                self.refused("" if self.newer else word, "not found") if unknown else verdict(word)
            )
        if not self.task_lives:
            blind = word in {"estop", "machine"}
            return (verdict(word) if blind else verdict(word, "NAK")), 2.0
        if not self.machine and word not in {"estop", "machine"}:
            return self.refused(word, "Machine must be 'ON'")
        self.obey(word, arguments)
        return verdict(word), ORDER_S

    def enable(self, pipe, password):
        if password == "off":
            self.in_control = None
        elif password == self.passwords[1]:
            self.in_control = pipe
        else:
            return verdict("enable", "NAK")
        return verdict("enable")

    def refused(self, word, why):
        remark = f"error: {why}\r\n" if self.newer else ""
        return remark + verdict(word, "NAK")

    def obey(self, word, arguments):
        if word == "estop":
            self.estop = arguments == ["on"] or not self.chain_closed
            self.machine = self.machine and not self.estop
        elif word == "machine":
            self.machine = arguments == ["on"] and not self.estop and self.drives_fine
        elif word == "mode":
            self.mode = arguments[0].upper()
        elif word == "home":
            self.homed = True
        elif word == "abort":
            self.start_deg = self.target_deg = self.joints_deg()
        elif word == "mdi" and "G53" in arguments:
            self.start_move(arguments)

    def start_move(self, words):
        if self.refuses_move:
            self.errors += self.refuses_move
            return
        numbers = {word[0]: float(word[1:]) for word in words if word[0] in self.letters}
        values = tuple(numbers[letter] for letter in self.letters)
        if self.letters == "XYZC":
            values = (*(value / 10 for value in values[:3]), values[3])
        self.start_deg, self.target_deg = self.joints_deg(), values
        self.started_s = self.clock.now_s()

    def part(self):
        now_s = self.clock.now_s() if self.frozen_at is None else self.frozen_at
        return min(1.0, max(0.0, (now_s - self.started_s) / MOVE_S))

    def joints_deg(self):
        pairs = zip(self.start_deg, self.target_deg, strict=True)
        return tuple(a + self.part() * (b - a) for a, b in pairs)

    def is_moving(self):
        return self.part() < 1.0 and self.start_deg != self.target_deg

    def world(self):
        """X Y Z A B C of the joints."""
        a, b, c, d = self.joints_deg()
        numbers = (
            (a, b, c, d, 0, 0) if self.letters == "XYZA" else (10 * a, 10 * b, 10 * c, 0, 0, d)
        )
        return " ".join(f"{number:.6f}" for number in numbers)

    def fail(self, message, *, estop=False):
        """Stop by itself, as at a fault."""
        self.start_deg = self.target_deg = self.joints_deg()
        self.machine, self.estop = False, estop
        self.errors += [message] if message else []


def verdict(word, said="ACK"):
    return f"SET {word.upper()} {said}\n\r" if word else f"SET {said}\n\r"


def first(told):
    return told[0] if isinstance(told, list) else told


def connected(*arguments, **settings):
    """A LinuxCNC, and its robot that has connected to it."""
    linuxcnc = ScriptedLinuxcnc(*arguments, **settings)
    linuxcnc.robot.connect()
    return linuxcnc


def ready(*arguments, **settings):
    """The same, brought up."""
    linuxcnc = connected(*arguments, **settings)
    linuxcnc.robot.prepare()
    linuxcnc.asked.clear()
    return linuxcnc


def arrive(linuxcnc):
    """Poll until it says that it stands."""
    while (state := linuxcnc.robot.state()).moving:
        linuxcnc.clock.sleep_s(0.02)
    return state
