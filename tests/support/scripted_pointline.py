"""The far end of pointline, answering word for word what a test wants it to."""

from scripted_controller import ScriptedController

from drivers.declaration import Surroundings
from drivers.pointline import PointlineDeadlines, PointlineTracker

PATIENT = PointlineDeadlines()
CCR = "CCR-1.5in"
POINT_MM = (2510.0, -35.5, -75.0)
SEEN = "2510.0 -35.5 -75.0 0.0001 0.0 0.0 0.0004 0.0 0.0004"
ANSWERS = {
    "HELLO": "OK 1 Example%20Metrology T-1000 4711 2.1",
    "STATE": "OK 0 1 1 1 CCR-1.5in",
    "AIR": "OK 20.5 1013.25 45.0",
    "REFLECTOR 0": "OK 2 CCR-1.5in 19.05",
    "REFLECTOR 1": "OK 2 CCR-75mm 37.5",
    "PREPARE": "OK",
    "MEASURE": [f"OK {count} CCR-1.5in {SEEN}" for count in range(1, 100)],
    "DIRECTION": "OK 2.0 0.0 0.0",
    "GOTO": "OK",
    "FIND": "OK",
}


class ScriptedInstrument(ScriptedController):
    """A tracker behind as many connections as it is asked for; answers as a controller's."""

    def __init__(self, deadlines=PATIENT, **given):
        super().__init__()
        self.answers = {verb: [*a] if isinstance(a, list) else a for verb, a in ANSWERS.items()}
        wire = {"open_transport": self.open, "clock": self.clock, "first_number": 7}
        self.tracker = PointlineTracker(Surroundings(**wire, **given), deadlines)

    def prepared(self):
        self.tracker.connect()
        self.tracker.prepare(CCR, 2.0)
        self.questions.clear()
        return self
