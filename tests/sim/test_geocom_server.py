"""The simulated total station's GeoCOM: its answers, its telescope, its distance meter, garbage."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.wire.geocom import Reply, ReplyFramer, Request, encode_request
from drivers.wire.geocom_constants import Result, Rpc
from drivers.wire.geocom_words import parse_number, parse_string, words_of
from sim.cell import Cell
from sim.faults import Counted, Fault, FaultScript
from sim.geocom_server import GeocomSession
from sim.geocom_station import GeocomStation
from sim.scenario import load_scenario

MEASURE = words_of(1, 1)
CLEAR = words_of(3, 1)
WAIT = words_of(5000, 1)
WINDOW = words_of(0.1, 0.1, 0)


class Client:
    """Sends to a session at a time of its own and keeps what comes back."""

    def __init__(self, *faults, **tracker):
        scenario = load_scenario("realistic")
        changed = scenario.tracker.model_copy(update=tracker)
        self.cell = Cell(scenario.model_copy(update={"tracker": changed}))
        self.cell.tracker._faults = FaultScript(faults, {})
        self.station = GeocomStation(self.cell.tracker)
        self.now_s = 0.0
        self._bytes = []
        self._framer = ReplyFramer()
        self._number = 0
        self.session = GeocomSession(self.station, self._bytes.append)

    def sends(self, data):
        self.session.received(data, self.now_s)
        return self.taken()

    def taken(self):
        data = b"".join(self._bytes)
        self._bytes.clear()
        return self._framer.feed(data)

    def later(self, seconds):
        self.now_s += seconds
        self.session.advance(self.now_s)
        return self.taken()

    def begin(self, rpc, *words, checked=False):
        self._number += 1
        return self.sends(encode_request(Request(rpc, self._number, words, checked)))

    def ask(self, rpc, *words):
        """The answer, however long it takes."""
        replies = self.begin(rpc, *words)
        while not replies:
            due_s = self.session.next_due_s()
            assert due_s is not None, "no answer will ever come"
            replies = self.later(max(due_s - self.now_s, 0.0))
        (reply,) = replies
        assert reply.communication == Result.OK
        assert reply.transaction == self._number
        return reply

    def values(self, rpc, *words):
        reply = self.ask(rpc, *words)
        assert reply.result == Result.OK
        return [parse_number(word) for word in reply.parameters]

    def robotic(self):
        """With target recognition and lock mode on, in its own frame."""
        self.ask(Rpc.AUS_SET_USER_ATR_STATE, "1")
        self.ask(Rpc.AUS_SET_USER_LOCK_STATE, "1")
        self.ask(Rpc.TMC_SET_STATION, *words_of(0.0, 0.0, 0.0, 0.0))
        self.ask(Rpc.TMC_SET_HEIGHT, *words_of(0.0))
        return self

    def place_mm(self):
        reflector_mm = self.cell.true_reflector_mm(self.now_s)
        return tuple(self.cell.station.to_tracker_mm(reflector_mm))

    def polar(self):
        """Hz, V and distance of the reflector, as the tests know them."""
        x, y, z = self.place_mm()
        distance_mm = math.hypot(x, y, z)
        return math.atan2(x, y) % math.tau, math.acos(z / distance_mm), distance_mm

    def follow(self):
        assert self.ask(Rpc.AUT_FINE_ADJUST, *WINDOW).result == Result.OK
        assert self.ask(Rpc.AUT_LOCK_IN).result == Result.OK
        return self


class TestAnswers:
    def test_instrument_says_who_it_is(self):
        client = Client()
        assert parse_string(client.ask(Rpc.CSV_GET_INSTRUMENT_NAME).parameters[0]) == "SIM-TS"
        assert client.values(Rpc.CSV_GET_INSTRUMENT_NO) == [390001]
        assert client.values(Rpc.CSV_GET_DEVICE_CONFIG) == [350, 12]

    def test_number_of_the_question_comes_back(self):
        assert Client().sends(b"%R1Q,0,4711:\r\n") == [Reply(0, 4711, 0)]
        assert Client().sends(b"%R1Q,0:\r\n") == [Reply(0, 0, 0)]

    def test_checksum_is_answered_by_a_checksum(self):
        (reply,) = Client().begin(Rpc.COM_NULL_PROC, checked=True)
        assert reply.checked

    def test_damaged_question_is_refused_by_its_number(self):
        (reply,) = Client().sends(b"%R1Q,0,5,1:\r\n")
        assert (reply.communication, reply.transaction) == (Result.COM_SERVER_CHECKSUM, 5)

    @pytest.mark.parametrize(
        ("line", "communication"),
        [
            (b"hello\r\n", Result.COM_WRONG_FORMAT),
            (b"%R1Q,4711,1:\r\n", Result.COM_UNKNOWN_PROCEDURE),
            (b"%R1Q,2012,1:\r\n", Result.COM_CANNOT_DECODE_REQUEST),
            (b"%R1Q,2012,1:1.0,2.0\r\n", Result.COM_CANNOT_DECODE_REQUEST),
            (b'%R1Q,2012,1:"x"\r\n', Result.COM_CANNOT_DECODE_REQUEST),
        ],
    )
    def test_question_that_cannot_be_read_is_refused(self, line, communication):
        (reply,) = Client().sends(line)
        assert reply.communication == communication

    def test_empty_line_that_wakes_it_is_not_answered(self):
        assert Client().sends(b"\n\r\n") == []

    @pytest.mark.parametrize(("digits", "word"), [(3, "0.034"), (15, "0.0344"), (0, "0.0")])
    def test_numbers_have_the_digits_that_were_asked_for(self, digits, word):
        client = Client()
        client.ask(Rpc.BAP_SET_PRISM_TYPE_2, *words_of(9, "CCR-1.5in"))
        client.ask(Rpc.COM_SET_DOUBLE_PRECISION, str(digits))
        assert client.ask(Rpc.TMC_GET_PRISM_CORR).parameters == (word,)

    def test_settings_stay_when_the_client_goes(self):
        client = Client()
        client.ask(Rpc.TMC_SET_HEIGHT, *words_of(0.25))
        client.session.closed(client.now_s)
        again = []
        session = GeocomSession(client.station, again.append)
        session.received(b"%R1Q,2011,9:\r\n", client.now_s)
        assert again == [b"%R1P,0,9:0,0.25\r\n"]

    def test_prisms_of_the_operator_are_the_trackers_reflectors(self):
        client = Client()
        assert client.ask(Rpc.BAP_GET_USER_PRISM_DEF, '"CCR-75mm"').result == Result.OK
        assert client.ask(Rpc.BAP_GET_USER_PRISM_DEF, '"other"').result == Result.INVALID_PARAMETER
        client.ask(Rpc.BAP_SET_PRISM_TYPE_2, *words_of(9, "CCR-75mm"))
        assert client.cell.tracker.selected == 3
        assert client.ask(Rpc.BAP_GET_PRISM_TYPE_2).parameters == ("9", '"CCR-75mm"')

    def test_air_is_that_of_the_cell_until_somebody_sets_it(self):
        client = Client()
        _, pressure_hPa, dry_degC, wet_degC = client.values(Rpc.TMC_GET_ATM_CORR)
        assert (pressure_hPa, dry_degC) == (1008.0, 21.5)
        assert 5.0 < wet_degC < dry_degC
        client.ask(Rpc.TMC_SET_ATM_CORR, *words_of(6.58e-7, 1000.0, 25.0, 20.0))
        assert client.values(Rpc.TMC_GET_ATM_CORR)[1:] == [1000.0, 25.0, 20.0]


class TestMeasuring:
    def test_point_is_the_reflectors(self):
        client = Client().robotic().follow()
        assert client.ask(Rpc.TMC_DO_MEASURE, *MEASURE).result == Result.OK
        values = client.values(Rpc.TMC_GET_COORDINATE, *WAIT)
        assert [1000.0 * value for value in values[:3]] == pytest.approx(client.place_mm(), abs=0.1)
        assert values[4:7] == values[:3]

    def test_distance_takes_its_time(self):
        client = Client().robotic().follow()
        client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
        started_s = client.now_s
        assert client.begin(Rpc.TMC_GET_COORDINATE, *WAIT) == []
        assert client.later(1.4) == []
        assert client.later(0.2)[0].result == Result.OK
        assert client.now_s - started_s == pytest.approx(1.6)

    def test_nobody_waits_longer_than_was_asked_for(self):
        client = Client().robotic().follow()
        client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
        reply = client.ask(Rpc.TMC_GET_COORDINATE, *words_of(100, 1))
        assert reply.result == Result.ANGLES_ONLY
        assert [parse_number(word) for word in reply.parameters] == [0.0] * 8

    def test_polar_and_cartesian_are_one_point(self):
        client = Client().robotic().follow()
        client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
        east, north, up, *_ = client.values(Rpc.TMC_GET_COORDINATE, *WAIT)
        assert client.values(Rpc.TMC_GET_SIMPLE_COORD, *WAIT) == [east, north, up]
        hz, v, distance = client.values(Rpc.TMC_GET_SIMPLE_MEA, *WAIT)
        assert distance == pytest.approx(math.hypot(east, north, up))
        assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([hz, v])
        assert distance * math.sin(v) * math.sin(hz) == pytest.approx(east, abs=1e-4)
        assert distance * math.sin(v) * math.cos(hz) == pytest.approx(north, abs=1e-4)

    def test_one_call_measures_and_answers(self):
        client = Client().robotic().follow()
        hz, v, distance, mode = client.values(Rpc.BAP_MEAS_DISTANCE_ANGLE, "2")
        assert (hz, v, 1000.0 * distance) == pytest.approx(client.polar(), abs=0.1)
        assert mode == 2

    def test_cleared_distance_is_gone(self):
        client = Client().robotic().follow()
        client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
        client.ask(Rpc.TMC_GET_COORDINATE, *WAIT)
        client.ask(Rpc.TMC_DO_MEASURE, *CLEAR)
        assert client.ask(Rpc.TMC_GET_COORDINATE, *WAIT).result == Result.ANGLES_ONLY

    def test_station_heights_and_orientation_move_the_coordinates(self):
        client = Client().robotic().follow()
        client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
        east, north, up, *_ = client.values(Rpc.TMC_GET_COORDINATE, *WAIT)
        hz, v = client.values(Rpc.TMC_GET_ANGLE_5, "1")
        client.ask(Rpc.TMC_SET_STATION, *words_of(100.0, 200.0, 10.0, 1.5))
        client.ask(Rpc.TMC_SET_HEIGHT, *words_of(0.5))
        client.ask(Rpc.TMC_SET_ORIENTATION, *words_of(hz + 0.5 * math.pi))
        moved = client.values(Rpc.TMC_GET_COORDINATE, *WAIT)[:3]
        assert moved == pytest.approx([100.0 + north, 200.0 - east, 11.0 + up], abs=1e-6)
        turned = client.values(Rpc.TMC_GET_ANGLE_5, "1")
        assert turned == pytest.approx([(hz + 0.5 * math.pi) % math.tau, v], abs=1e-9)

    def test_prism_lost_meanwhile_gives_no_distance(self):
        client = Client(Fault(Counted.MEASUREMENT, 1, "beam_break", 3.0)).robotic().follow()
        client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
        assert client.ask(Rpc.TMC_GET_COORDINATE, *WAIT).result == Result.DISTANCE_ERROR
        assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [0]

    def test_no_prism_gives_no_distance(self):
        client = Client(beam_locked=False).robotic()
        client.ask(Rpc.TMC_DO_MEASURE, *MEASURE)
        assert client.ask(Rpc.TMC_GET_COORDINATE, *WAIT).result == Result.DISTANCE_ERROR


class TestTelescope:
    def test_it_follows_only_when_told_to(self):
        client = Client().robotic()
        assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [0]
        assert client.follow().values(Rpc.MOT_READ_LOCK_STATUS) == [1]

    def test_it_follows_while_the_robot_moves(self):
        client = Client().robotic().follow()
        before_mm = client.place_mm()
        client.cell.controller.move_joints([0.3, 0.4, 0.5, 0.4], 0.5, client.now_s)
        client.later(10.0)
        assert math.dist(client.place_mm(), before_mm) > 10.0
        assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [1]
        assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx(client.polar()[:2])

    def test_it_turns_onto_the_prism_near_a_direction(self):
        client = Client(beam_locked=False).robotic()
        hz, v, _ = client.polar()
        words = words_of(hz + 0.005, v - 0.005, 0, 1, 0)
        assert client.ask(Rpc.AUT_MAKE_POSITIONING, *words).result == Result.OK
        assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([hz, v])

    def test_it_does_not_see_a_prism_beside_its_field(self):
        client = Client(beam_locked=False).robotic()
        hz, v, _ = client.polar()
        words = words_of(hz + 0.05, v, 0, 1, 0)
        assert client.ask(Rpc.AUT_MAKE_POSITIONING, *words).result == Result.AUT_NO_TARGET
        assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([hz + 0.05, v])
        assert client.ask(Rpc.AUT_SEARCH, *words_of(0.2, 0.2, 0)).result == Result.OK
        assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([hz, v])

    def test_it_turns_to_angles_without_looking_for_a_prism(self):
        client = Client().robotic().follow()
        assert client.ask(Rpc.AUT_MAKE_POSITIONING, *words_of(1.0, 1.5, 0, 0, 0)).result == 0
        assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([1.0, 1.5])
        assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [0]

    @pytest.mark.parametrize(
        ("rpc", "words"),
        [
            (Rpc.AUT_SEARCH, WINDOW),
            (Rpc.AUT_FINE_ADJUST, WINDOW),
            (Rpc.AUT_LOCK_IN, ()),
            (Rpc.AUT_MAKE_POSITIONING, words_of(1.0, 1.5, 0, 1, 0)),
        ],
    )
    def test_what_is_not_switched_on_is_refused(self, rpc, words):
        assert Client().ask(rpc, *words).result == Result.AUT_NOT_ENABLED

    def test_question_behind_a_motion_waits_for_its_end(self):
        client = Client(beam_locked=False).robotic()
        assert client.begin(Rpc.AUT_SEARCH, *WINDOW) == []
        assert client.begin(Rpc.COM_NULL_PROC) == []
        first, second = client.later(60.0)
        assert second.transaction == first.transaction + 1

    def test_single_c_ends_a_motion(self):
        client = Client(beam_locked=False).robotic()
        client.begin(Rpc.AUT_MAKE_POSITIONING, *words_of(3.0, 1.0, 0, 0, 0))
        client.session.received(b"c\r\n", client.now_s)
        assert client._bytes[-1] == b"?\r\n"
        assert client.taken()[0].result == Result.ABORTED
        assert client.later(60.0) == []

    def test_direction_that_is_none_is_refused(self):
        client = Client().robotic()
        reply = client.ask(Rpc.AUT_MAKE_POSITIONING, *words_of(1e9, 1.0, 0, 0, 0))
        assert reply.result == Result.INVALID_PARAMETER


@pytest.fixture(scope="module")
def anybody():
    return Client().robotic()


any_words = st.lists(
    st.integers(-10, 10).map(str)
    | st.floats(-10, 10).map(lambda value: f"{value:.3f}")
    | st.sampled_from(['"CCR-1.5in"', '"', "x", "9" * 30, ""]),
    max_size=8,
)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(list(Rpc)) | st.integers(0, 30000), any_words)
def test_every_question_of_whatever_words_gets_one_answer(anybody, rpc, words):
    line = f"%R1Q,{int(rpc)},77:{','.join(words)}\r\n".encode()
    replies = anybody.sends(line)
    for _ in range(5):
        replies = replies or anybody.later(20.0)
    assert len(replies) == 1


@settings(deadline=None)
@given(st.lists(st.binary(max_size=40), max_size=10))
def test_garbage_never_breaks_the_instrument(pieces):
    client = Client()
    for piece in pieces:
        client.sends(piece)
    client.sends(b"\r\n")
    client.later(1000.0)
    assert client.sends(b"%R1Q,0,123456:\r\n") == [Reply(0, 123456, 0)]


def test_babbling_client_is_bounded():
    client = Client(beam_locked=False).robotic()
    client.begin(Rpc.AUT_SEARCH, *WINDOW)
    client.sends(b"%R1Q,0,1:\r\n" * 5000)
    assert len(client.session._waiting) <= 100
