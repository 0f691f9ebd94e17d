"""The far end of robotline, answering word for word what a test wants it to."""

from binascii import crc_hqx

from robotline_layouts import PAR4_LAYOUT
from timed_pipe import FarEnd

from drivers.declaration import RobotSurroundings
from drivers.robotline import LineRobot, RobotlineDeadlines

ANSWER_S = 0.001
PATIENT = RobotlineDeadlines()
ANSWERS = {
    "HELLO": "OK 1 Example%20Robotics Par4 SN-0042 2.1 4",
    "STATE": "OK 0 0 - 0.0 -45.0 90.0 180.0",
    "MOVEJ": "OK 1.5",
    "MOVEP": "OK 1.5",
    "STOP": "OK",
    "STAGE": "OK",
    "COMMIT": "OK",
    "ABANDON": "OK",
}


def checked(body: str) -> bytes:
    data = body.encode()
    return b"%s *%04X\n" % (data, crc_hqx(data, 0xFFFF))


class ScriptedController(FarEnd):
    """A robot behind as many connections as it is asked for.

    `answers` maps a verb, or a verb with its words, to what follows the verb in the answer: a text,
    a list of texts (one a question, the last again and again), or None for silence. `waiting` lies
    in the line when it is opened next; `connections` is how often it can be opened, each time after
    `accepts_after_s`.
    """

    def __init__(self, layout=PAR4_LAYOUT, deadlines=PATIENT, **given):
        super().__init__()
        self.answers = dict(ANSWERS)
        self.delays_s = {}
        self.questions = []
        wire = {"open_transport": self.open, "clock": self.clock, "first_number": 7}
        self.robot = LineRobot(RobotSurroundings(layout=layout, **wire, **given), deadlines)

    @property
    def verbs(self):
        """The verbs of all questions so far."""
        return [question.split()[1] for question in self.questions]

    @property
    def numbers(self):
        """The numbers of all questions so far."""
        return [int(question.split()[0][1:]) for question in self.questions]

    def respond(self, data):
        lines = data.decode().splitlines()
        return [timed for line in lines if line for timed in self.respond_to(line)]

    def respond_to(self, line):
        question = line.rpartition(" *")[0]
        self.questions.append(question)
        head, verb, *words = question.split()
        answer = self.answer_to(verb, " ".join([verb, *words]))
        if answer is None:
            return []
        said = answer if answer.startswith("? ") else f"{verb} {answer}"
        return [(self.delays_s.get(verb, ANSWER_S), checked(f"<{head[1:]} {said}"))]

    def answer_to(self, verb, whole):
        key = whole if whole in self.answers else verb
        answer = self.answers[key]
        if not isinstance(answer, list):
            return answer
        return answer.pop(0) if len(answer) > 1 else answer[0]


def connected(**settings):
    """A controller, and its robot that has said HELLO."""
    controller = ScriptedController(**settings)
    controller.robot.connect()
    controller.questions.clear()
    return controller
