"""Sound requests with odd contents, to a whole cell: it answers, refuses or hangs up."""

import math
from contextlib import suppress
from random import Random

import pytest
from robotline_layouts import PAR4_LINES

from drivers.errors import WireError
from drivers.wire import robotline as messages
from drivers.wire.emscon import REQUESTS as BODIES
from drivers.wire.emscon import EmsconRequest, encode
from drivers.wire.emscon_constants import Command
from drivers.wire.emscon_messages import Nothing, Triple, annotations_of
from drivers.wire.lines import Question
from sim.cell import Cell
from sim.geometry import PAR4
from sim.scenarios.scenario import load_scenario
from sim.servers.emscon_server import EmsconSession
from sim.servers.robotline_server import RobotlineSession, layout_of

WHOLES = (0, 1, -1, 2, 5, 500, 2**31 - 1, -(2**31))
FINITE = (0.0, 1.0, -1.0, 1.0002, 2500.0, 1e9, 1e-300, -1e155, 1e300)
FLOATS = (*FINITE, math.nan, math.inf)
REQUESTS = 60
PART = "ARM 0"


def emscon_request(draw, _number):
    command = draw.choice(list(Command))
    kind = BODIES.get(command, Nothing)
    one = {
        int: lambda: draw.choice(WHOLES),
        float: lambda: draw.choice(FLOATS),
        Triple: lambda: tuple(draw.choice(FLOATS) for _ in range(3)),
    }
    return encode(EmsconRequest(command, kind(*(one[form]() for form in annotations_of(kind)))))


def robotline_request(draw, number):
    def some(count):
        return tuple(draw.choice(FINITE) for _ in range(count))

    parameters = len(layout_of(PAR4).parts[PART])
    questions = (
        ("STATE",),
        ("STOP",),
        ("MOVEJ", messages.MoveJoints(some(4), 50.0)),
        ("MOVEP", messages.MovePose(some(4), 100.0)),
        ("STAGE", messages.Part(PART, some(parameters))),
        ("COMMIT",),
        ("GEOM", messages.ReadPart(PART)),
    )
    return PAR4_LINES.encode_question(Question(number, *draw.choice(questions)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_odd_request_is_answered_refused_or_hung_up_on(seed):
    draw, said, now_s = Random(seed), [], 0.0
    cell = Cell(load_scenario("realistic"))
    sessions = (
        (EmsconSession(cell.tracker, said.append), emscon_request),
        (RobotlineSession(cell.controller, said.append), robotline_request),
    )
    for number in range(1, REQUESTS + 1):
        session, request = draw.choice(sessions)
        now_s += draw.choice((0.0, 0.01, 1.0, 30.0))
        with suppress(WireError):
            session.received(request(draw, number), now_s)
            session.advance(now_s)
    assert len(said) > REQUESTS // 3
