"""The GeoCOM driver: its sessions, and opening them anew."""

import pytest
from scripted_geocom import POINT_MM, Bench, Instrument

from drivers.errors import DeviceNotReady, LinkDown
from drivers.wire.geocom import GeocomReply, encode_reply, words_of
from drivers.wire.geocom_constants import Result, Rpc


class TestSession:
    def test_identity_is_name_serial_and_firmware_with_enough_digits(self):
        identity = Bench().connected().tracker.identity()
        assert str(identity) == "Leica TDRA6000 serial 361234 (GeoCOM, firmware 4.1.2)"
        bench = Bench()
        bench.instrument.answers[Rpc.COM_GET_DOUBLE_PRECISION] = (0, words_of(3))
        bench.connected()
        assert bench.instrument.words_of_last(Rpc.COM_SET_DOUBLE_PRECISION) == ("10",)

    def test_instrument_that_is_silent_or_sleeps_is_given_up(self):
        bench = Bench()
        bench.instrument.says[Rpc.COM_NULL_PROC] = []
        with pytest.raises(LinkDown, match="no answer to COM_NULL_PROC within 15 s"):
            bench.tracker.connect()
        assert bench.clock.now_s() == pytest.approx(15.0)
        assert bench.pipe.is_closed
        bench = Bench()
        bench.instrument.says[Rpc.COM_NULL_PROC] = lambda request: [
            (0.0, encode_reply(GeocomReply(Result.COM_SLEEPING, request.transaction, 0)))
        ]
        with pytest.raises(DeviceNotReady, match="switch the instrument on"):
            bench.tracker.connect()
        assert bench.pipe.is_closed


class TestReconnect:
    def test_state_is_established_anew(self, bench):
        bench.instrument.answers |= Instrument().answers
        bench.tracker.reconnect()
        assert bench.pipes[0].is_closed
        assert bench.instrument.answers[Rpc.TMC_GET_HEIGHT] == (0, ("0.0",))
        assert bench.tracker.measure().point_in_tracker_mm == POINT_MM

    def test_numbers_of_questions_go_on_over_connections(self, bench):
        bench.tracker.measure()
        last = bench.instrument.asked[-1].transaction
        bench.instrument.asked.clear()
        bench.tracker.reconnect()
        numbers = [request.transaction for request in bench.instrument.asked]
        assert last >= 1000
        assert all(number > last for number in numbers if number >= 1000)

    def test_late_answer_to_the_old_connection_is_never_read(self, bench):
        bench.instrument.says[Rpc.TMC_GET_COORDINATE] = []
        with pytest.raises(LinkDown, match="no answer to TMC_GET_COORDINATE within 15 s"):
            bench.tracker.measure()
        late = bench.instrument.reply(bench.instrument.asked[-1]).replace(b"2.5", b"9.9")
        del bench.instrument.says[Rpc.TMC_GET_COORDINATE]
        bench.tracker.reconnect()
        bench.pipe.arrives(0.0, late)
        assert bench.tracker.measure().point_in_tracker_mm == POINT_MM
