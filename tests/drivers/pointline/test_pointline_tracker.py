"""An instrument over pointline: what counts as a point, refusals, what it does not have."""

import pytest
from scripted_pointline import CCR, POINT_MM, SEEN, ScriptedInstrument

from drivers import errors
from drivers.pointline import recorded_measurement
from drivers.values import Identity, Readiness, Reflector, Weather


@pytest.fixture
def instrument():
    return ScriptedInstrument().prepared()


@pytest.mark.parametrize("hello", ["NO VERSION 2 is spoken here", "OK 2 Example T 1 1"])
def test_other_version_is_the_wrong_device(hello):
    instrument = ScriptedInstrument()
    instrument.answers["HELLO"] = hello
    with pytest.raises(errors.WrongDevice):
        instrument.tracker.connect()
    assert instrument.pipes[0].is_closed


def test_point_comes_with_its_covariance_the_air_and_the_answer(instrument):
    who = Identity("Example Metrology", "T-1000", "4711", "2.1", "pointline 1")
    assert instrument.tracker.identity() == who
    measured = instrument.tracker.measure()
    assert measured.point_in_tracker_mm == POINT_MM
    assert measured.covariance_mm2 == ((1e-4, 0.0, 0.0), (0.0, 4e-4, 0.0), (0.0, 0.0, 4e-4))
    assert measured.weather == Weather(20.5, 1013.25, 45.0)
    assert recorded_measurement(measured.raw) == (POINT_MM, measured.covariance_mm2)


def test_instrument_may_state_no_covariance_know_no_air_and_no_direction(instrument):
    instrument.answers["MEASURE"] = f"OK 1 CCR-1.5in 2510.0 -35.5 -75.0{6 * ' 0.0'}"
    instrument.answers["AIR"] = instrument.answers["DIRECTION"] = "NO NONE"
    measured = instrument.tracker.measure()
    assert (measured.covariance_mm2, measured.weather) == (None, None)
    assert recorded_measurement(measured.raw) == (POINT_MM, None)
    assert instrument.tracker.direction() is None


def test_number_told_before_is_no_measurement_and_0_is_no_number(instrument):
    instrument.answers["MEASURE"] = f"OK 5 CCR-1.5in {SEEN}"
    assert instrument.tracker.measure()
    with pytest.raises(errors.NotAMeasurement, match="measurement before, number 5"):
        instrument.tracker.measure()
    instrument.tracker.reconnect()
    with pytest.raises(errors.NotAMeasurement):
        instrument.tracker.measure()
    instrument.answers["MEASURE"] = f"OK 0 CCR-1.5in {SEEN}"
    assert instrument.tracker.measure()
    assert instrument.tracker.measure()


def test_point_of_another_reflector_is_refused(instrument):
    instrument.answers["MEASURE"] = f"OK 5 CCR-75mm {SEEN}"
    with pytest.raises(errors.DeviceNotReady, match=r"'CCR-75mm', prepared was 'CCR-1.5in'"):
        instrument.tracker.measure()


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ("3.0e5 0.0 0.0 0.01 0.0 0.0 0.01 0.0 0.01", "possible is 0 to 200000 mm"),
        ("1.0 2.0 3.0 0.01 0.02 0.0 0.01 0.0 0.01", "not positive definite"),
        ("1.0 2.0 3.0 -0.01 0.0 0.0 0.01 0.0 0.01", "not positive definite"),
        ("1.0 2.0 3.0 1.0e6 0.0 0.0 0.01 0.0 0.01", "standard deviation"),
    ],
)
def test_point_that_cannot_be_is_refused(instrument, told, said):
    instrument.answers["MEASURE"] = f"OK 5 CCR-1.5in {told}"
    with pytest.raises(errors.ImplausibleAnswer, match=said):
        instrument.tracker.measure()


def test_answer_that_is_ok_but_empty_ends_the_attempt(instrument):
    instrument.answers["MEASURE"] = f"OK 0 - {' '.join(['0.0'] * 9)}"
    with pytest.raises(errors.NotAMeasurement, match="is empty"):
        instrument.tracker.measure()


@pytest.mark.parametrize(
    ("code", "error"),
    [
        ("NOBEAM", errors.NoReflector),
        ("BEAM", errors.BeamBroken),
        ("COLD", errors.DeviceNotReady),
        ("FAULT", errors.DeviceNotReady),
        ("TIRED", errors.DeviceRefused),
    ],
)
def test_refusal_is_the_error_of_its_code_and_leaves_the_wire_open(instrument, code, error):
    instrument.answers["MEASURE"] = f"NO {code} as it happens"
    with pytest.raises(errors.DeviceRefused, match=f"MEASURE refused, {code}: as it") as refused:
        instrument.tracker.measure()
    assert type(refused.value) is error
    assert refused.value.remedy
    assert instrument.tracker.state().beam_locked


def test_unknown_reflector_is_refused_and_nothing_is_measured_then():
    instrument = ScriptedInstrument()
    instrument.answers["PREPARE"] = "NO REFLECTOR there is no CCR-2in"
    instrument.tracker.connect()
    with pytest.raises(errors.DeviceNotReady, match="pkmcal devices"):
        instrument.tracker.prepare("CCR-2in", 2.0)
    with pytest.raises(errors.DeviceNotReady, match="not prepared"):
        instrument.tracker.measure()
    assert "MEASURE" not in instrument.verbs


@pytest.mark.parametrize(
    ("state", "readiness"),
    [
        ("0 1 1 1", Readiness.READY),
        ("1 1 1 1", Readiness.BUSY),
        ("0 0 1 1", Readiness.NOT_READY),
        ("0 1 0 1", Readiness.NOT_READY),
        ("0 1 1 0", Readiness.NOT_READY),
    ],
)
def test_light_is_green_when_nothing_is_missing(instrument, state, readiness):
    instrument.answers["STATE"] = f"OK {state} -"
    assert instrument.tracker.state().readiness is readiness


def test_reflectors_are_asked_for_one_by_one(instrument):
    assert instrument.tracker.reflectors() == (
        Reflector(CCR, 0, 19.05),
        Reflector("CCR-75mm", 1, 37.5),
    )
    del instrument.answers["REFLECTOR 0"], instrument.answers["REFLECTOR 1"]
    instrument.answers["REFLECTOR"] = "OK 999999999 more 1.0"
    assert len(instrument.tracker.reflectors()) == 100


def test_aims_are_sent_in_millimetres_and_a_direction_has_length_1(instrument):
    instrument.tracker.go_to(POINT_MM)
    instrument.tracker.find_reflector(2500.0)
    assert [question.split(" ", 1)[1] for question in instrument.questions] == [
        "GOTO 2510.0 -35.5 -75.0",
        "FIND 2500.0",
    ]
    assert instrument.tracker.direction() == (1.0, 0.0, 0.0)


def test_long_measurement_is_waited_for_as_long_as_it_takes_and_no_longer(instrument):
    instrument.delays_s["MEASURE"] = 16.0
    assert instrument.tracker.measure()
    instrument.delays_s["MEASURE"] = 18.0
    with pytest.raises(errors.LinkDown, match="no answer to MEASURE within 17 s"):
        instrument.tracker.measure()
    instrument.tracker.reconnect()
    assert [question.split()[1] for question in instrument.questions[-2:]] == ["HELLO", "PREPARE"]
