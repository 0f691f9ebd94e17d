"""A client of the simulated total station, on a hand-moved clock."""

import math

from drivers.wire.geocom import GeocomRequest, encode_request, parse_number, replies, words_of
from drivers.wire.geocom_constants import Result, Rpc
from sim.cell import Cell
from sim.faults import FaultScript
from sim.scenarios.scenario import load_scenario
from sim.servers.geocom_server import GeocomSession
from sim.servers.geocom_station import GeocomStation

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
        self._read = replies()
        self._number = 0
        self.session = GeocomSession(self.station, self._bytes.append)

    def sends(self, data):
        self.session.received(data, self.now_s)
        return self.taken()

    def taken(self):
        data = b"".join(self._bytes)
        self._bytes.clear()
        return self._read(data)

    def later(self, seconds):
        self.now_s += seconds
        self.session.advance(self.now_s)
        return self.taken()

    def begin(self, rpc, *words, checked=False):
        self._number += 1
        return self.sends(encode_request(GeocomRequest(rpc, self._number, words, checked)))

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
