"""The emScon driver measures and moves: what it believes, and what a failure means."""

import math
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scripted_emscon import RESULT, Instrument, Station, system_status

from drivers import errors
from drivers.values import Weather
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon import Answer, encode
from drivers.wire.emscon_constants import WRONG_PARAMETERS, Command, ResultStatus
from drivers.wire.framing import Packet

START = Command.START_MEASUREMENT


def started(*messages):
    """What follows a StartMeasurement: its answer, then these."""
    return [(0.0, Answer(START)), *[(0.5, message) for message in messages]]


class TestMeasure:
    def test_result_is_a_point_with_covariance_air_and_the_packet_itself(self):
        measurement = Station().prepared().tracker.measure()
        assert measurement.point_in_tracker_mm == RESULT.point
        assert measurement.covariance_mm2 == (
            (pytest.approx(1e-4), 1e-5, 2e-5),
            (1e-5, pytest.approx(4e-4), -3e-5),
            (2e-5, -3e-5, pytest.approx(9e-4)),
        )
        assert measurement.weather == Weather(20.5, 1001.0, 45.0)
        assert bytes.fromhex(measurement.raw) == encode(RESULT)

    @pytest.mark.parametrize(
        "said",
        [[(0.5, RESULT), (0.6, Answer(START))], [(0.5, encode(Answer(START)) + encode(RESULT))]],
    )
    def test_result_may_overtake_the_answer_or_come_with_it(self, station, said):
        station.instrument.says[START] = said
        assert station.tracker.measure().point_in_tracker_mm == RESULT.point

    def test_stale_result_is_never_taken_for_the_new_one(self, station):
        station.comes(replace(RESULT, point=(9.0, 9.0, 9.0)))
        assert station.tracker.measure().point_in_tracker_mm == RESULT.point

    def test_late_result_closes_the_wire(self):
        station = Station().prepared(measuring_time_s=2.0)
        station.instrument.says[START] = [(0.0, Answer(START)), (22.1, RESULT)]
        with pytest.raises(errors.LinkDown, match="no answer to the measurement within 22 s"):
            station.tracker.measure()
        assert station.pipe.is_closed

    @pytest.mark.parametrize(
        "unasked",
        [
            Answer(Command.GET_TRACKER_STATUS, 0, bodies.Code(1)),
            Answer(Command.GET_SYSTEM_STATUS, 0, system_status()),
            bodies.ErrorResponse(START, ResultStatus.ALL_OK),
            bodies.ErrorResponse(Command.GET_ENVIRONMENT_PARAMS, 94),
            Packet(99, bytes(60_000)),
            bodies.ReflectorPosition(0, (1.0, 2.0, 3.0)),
            bodies.StatusChange(26),
            bodies.StatusChange(4711),
        ],
    )
    def test_state_or_packet_that_nobody_asked_for_does_not_end_a_measurement(
        self, station, unasked
    ):
        station.instrument.says[START] = [(0.0, unasked), *started(unasked, RESULT, unasked)]
        assert station.tracker.measure().point_in_tracker_mm == RESULT.point
        assert not station.pipe.is_closed

    def test_packets_that_are_passed_over_are_counted(self, station):
        before = station.tracker.state().ignored_packets
        station.comes(Packet(99, b""), Packet(3, b""), bodies.StatusChange(26))
        station.comes(Answer(Command.GET_TRACKER_STATUS, 0, bodies.Code(1)))
        assert station.tracker.state().ignored_packets - before == 2

    def test_locked_beam_lost_is_a_broken_beam(self, station):
        station.instrument.lose_the_beam()
        station.instrument.refuses[START] = ResultStatus.MEASUREMENT_STATUS_NOT_READY
        with pytest.raises(
            errors.NoReflector, match=r"10004 .measurement status not ready. → clear"
        ):
            station.tracker.measure()

    def test_beam_that_breaks_during_the_measurement_is_a_broken_beam(self, station):
        station.instrument.says[START] = started(
            bodies.StatusChange(25), bodies.ErrorResponse(START, 10009)
        )
        with pytest.raises(errors.BeamBroken) as caught:
            station.tracker.measure()
        assert caught.value.code == "10009"
        assert not isinstance(caught.value, errors.NoReflector), "it was there when it began"
        del station.instrument.says[START]
        assert station.tracker.measure().point_in_tracker_mm == RESULT.point

    def test_error_number_in_no_table_is_a_broken_beam_only_if_the_light_is_red(self, station):
        station.instrument.says[START] = started(replace(RESULT, status=24010))
        with pytest.raises(errors.DeviceRefused, match="emScon error 24010") as caught:
            station.tracker.measure()
        assert not isinstance(caught.value, errors.BeamBroken)
        station.instrument.lose_the_beam()
        with pytest.raises(errors.BeamBroken, match="emScon error 24010"):
            station.tracker.measure()

    @pytest.mark.parametrize(
        ("status", "said"),
        [(39, "prepare the tracker again"), (10012, "wait until"), (10010, "level the tracker")],
    )
    def test_tracker_that_is_not_ready_says_why(self, station, status, said):
        station.instrument.lose_the_beam()
        station.instrument.refuses[START] = status
        with pytest.raises(errors.DeviceNotReady, match=said):
            station.tracker.measure()

    @pytest.mark.parametrize(("processor", "laser"), [(3, 3), (5, 2)])
    def test_lost_beam_of_a_tracker_that_restarted_is_not_called_a_broken_beam(
        self, station, processor, laser
    ):
        station.instrument.lose_the_beam()
        station.instrument.state[Command.GET_SYSTEM_STATUS] = system_status(processor, laser)
        station.instrument.refuses[START] = ResultStatus.MEASUREMENT_STATUS_NOT_READY
        with pytest.raises(errors.DeviceNotReady):
            station.tracker.measure()


class TestMotion:
    def test_motion_may_take_its_time_and_the_search_too(self):
        station = Station().prepared()
        station.instrument.says[Command.GO_POSITION] = [(39.0, Answer(Command.GO_POSITION))]
        station.tracker.go_to((1.0, 2.0, -3.0))
        sent = station.instrument.body_of(Command.GO_POSITION)
        assert sent == bodies.BeamTarget((1.0, 2.0, -3.0), use_adm=1)
        station.instrument.says[Command.GO_POSITION] = [(41.0, Answer(Command.GO_POSITION))]
        with pytest.raises(errors.LinkDown, match="within 40 s"):
            station.tracker.go_to((1.0, 2.0, 3.0))

    @pytest.mark.parametrize(
        ("status", "said"), [(36, "FindReflector"), (24010, "FindReflector"), (0, "no reflector")]
    )
    def test_search_that_ends_with_a_red_light_is_a_broken_beam(self, station, status, said):
        station.instrument.lose_the_beam()
        station.instrument.refuses[Command.FIND_REFLECTOR] = status
        with pytest.raises(errors.BeamBroken, match=said):
            station.tracker.find_reflector(3000.0)

    def test_wrong_parameter_is_not_blamed_on_the_beam(self, station):
        station.instrument.lose_the_beam()
        station.instrument.refuses[Command.GO_POSITION] = WRONG_PARAMETERS[0]
        with pytest.raises(errors.DeviceRefused) as caught:
            station.tracker.go_to((1.0, 2.0, 3.0))
        assert not isinstance(caught.value, errors.BeamBroken)


class TestUncertainty:
    def measured(self, **changes):
        instrument = Instrument()
        instrument.result = replace(RESULT, **changes)
        return Station(instrument).prepared().tracker.measure().covariance_mm2

    def test_a_priori_is_used_where_it_is_larger(self):
        matrix = self.measured(apriori_std=(0.1, 0.2, 0.3), apriori_covariance=(1e-3, 0.0, 2e-3))
        assert matrix == (
            (pytest.approx(0.01), 1e-3, 0.0),
            (1e-3, pytest.approx(0.04), 2e-3),
            (0.0, 2e-3, pytest.approx(0.09)),
        )

    @pytest.mark.parametrize("covariance", [(1.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (1e300,) * 3])
    def test_impossible_covariances_are_left_out(self, covariance):
        matrix = self.measured(covariance=covariance)
        assert matrix[0][1] == matrix[0][2] == matrix[1][2] == 0.0
        assert matrix[1][1] == pytest.approx(4e-4)

    @pytest.mark.parametrize("std", [(0.0,) * 3, (math.nan,) * 3, (math.inf,) * 3, (-1.0,) * 3])
    def test_deviations_that_are_none_give_way_to_the_a_priori_ones(self, std):
        assert self.measured(std=std)[0][0] == pytest.approx(25e-6)

    @pytest.mark.parametrize(
        "changes",
        [
            {"std": (0.0,) * 3, "apriori_std": (0.0,) * 3},
            {"point": (0.0,) * 3},
            {each.name: (0.0,) * 3 if each.type == bodies.Triple else 0 for each in fields(RESULT)},
        ],
    )
    def test_result_that_is_ok_but_empty_ends_the_attempt(self, changes):
        with pytest.raises(errors.NotAMeasurement, match=r"is empty|without uncertainty"):
            self.measured(**changes)

    @pytest.mark.parametrize(
        ("changes", "said"),
        [
            ({"point": (math.nan, 0.0, 0.0)}, "at a distance of nan mm, possible is 0 to 200000"),
            ({"temperature": math.inf}, "air temperature inf °C, possible is -40 to 70 °C"),
            ({"std": (0.01, 100.5, 0.01)}, "standard deviation of a coordinate 100.5 mm"),
            ({"apriori_std": (1e300, 1.0, 1.0)}, r"1e\+300 mm"),
        ],
    )
    def test_result_that_cannot_be_is_refused_with_its_value(self, changes, said):
        with pytest.raises(errors.ImplausibleAnswer, match=f"pipe://test: .*{said}"):
            self.measured(**changes)

    @pytest.mark.parametrize("changes", [{"mode": 1}, {"is_trial": 1}])
    def test_result_of_another_mode_is_refused(self, changes):
        with pytest.raises(errors.DeviceRefused, match="not the stationary measurement"):
            self.measured(**changes)

    @given(
        std=st.tuples(*[st.floats(max_value=0.1)] * 3),
        covariance=st.tuples(*[st.floats()] * 3),
        apriori_std=st.tuples(*[st.floats(1e-3, 1.0)] * 3),
    )
    def test_covariance_is_always_usable(self, std, covariance, apriori_std):
        matrix = self.measured(std=std, covariance=covariance, apriori_std=apriori_std)
        assert all(math.isfinite(value) for row in matrix for value in row)
        assert all(matrix[i][i] > 0.0 for i in range(3))
        assert all(
            matrix[i][j] ** 2 < matrix[i][i] * matrix[j][j] for i in range(3) for j in range(i)
        )
