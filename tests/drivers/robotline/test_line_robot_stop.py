"""Stopping over robotline: whatever has happened before, and loud when it cannot be confirmed."""

import pytest
from scripted_controller import connected

from drivers.errors import Cancelled, LinkDown, RobotStateUnknown
from drivers.robotline import RobotlineDeadlines

MOVING = "OK 1 0 - 0.0 0.0 0.0 0.0"
STANDING = "OK 0 0 - 0.0 0.0 0.0 0.0"


def lose_the_wire(controller):
    """An answer fails to come, and the link closes itself."""
    usual = controller.answers["STATE"]
    controller.answers["STATE"] = None
    with pytest.raises(LinkDown):
        controller.robot.state()
    controller.answers["STATE"] = usual
    controller.questions.clear()


def test_stop_returns_when_the_robot_stands(controller):
    controller.answers["STATE"] = [MOVING, MOVING, STANDING]
    controller.robot.stop()
    assert controller.verbs == ["STOP", "STATE", "STATE", "STATE"]
    assert controller.robot.state().moving is False


def test_stop_opens_a_closed_wire_says_stop_first_and_the_rest_waits_for_a_reconnection(controller):
    lose_the_wire(controller)
    controller.robot.stop()
    assert controller.verbs == ["STOP", "STATE"]
    with pytest.raises(LinkDown, match="not connected"):
        controller.robot.move_joints([0.0] * 4, 0.5)
    assert all(pipe.is_closed for pipe in controller.pipes)


def wish_after(controller, seconds):
    """The wish to stop, from then on."""
    asked_s = controller.clock.now_s() + seconds
    return lambda: controller.clock.now_s() >= asked_s


@pytest.mark.parametrize("verb", ["STATE", "MOVEJ"])
def test_pending_question_is_abandoned_and_stop_goes_over_a_new_wire_at_once(verb):
    wishes = [lambda: False]
    controller = connected(cancelled=lambda: wishes[-1]())
    controller.answers[verb] = None
    wishes.append(wish_after(controller, 0.3))
    pressed_s = controller.clock.now_s() + 0.3
    with pytest.raises(Cancelled):
        controller.robot.state() if verb == "STATE" else controller.robot.move_joints([0.0] * 4, 1)
    controller.answers[verb] = STANDING
    sent_s = []
    usual = controller.respond
    controller.respond = lambda data: sent_s.append(controller.clock.now_s()) or usual(data)
    controller.robot.stop()
    assert sent_s[0] - pressed_s <= 0.03
    assert controller.verbs == [verb, "STOP", "STATE"]


@pytest.mark.parametrize("answer_s", [0.6, 1.0, 1.5, 1.99])
@pytest.mark.parametrize("lost", [True, False])
def test_slow_controller_can_confirm_a_stop(controller, answer_s, lost):
    if lost:
        lose_the_wire(controller)
    controller.delays_s = dict.fromkeys(("STOP", "STATE"), answer_s)
    controller.robot.stop()
    assert controller.clock.now_s() < 5.0 + 2.0


def test_slow_controller_that_brakes_for_long_is_watched_no_longer_than_is_allowed(controller):
    controller.delays_s = dict.fromkeys(("STOP", "STATE"), 1.5)
    controller.answers["STATE"] = MOVING
    begun_s = controller.clock.now_s()
    with pytest.raises(RobotStateUnknown):
        controller.robot.stop()
    assert controller.clock.now_s() - begun_s <= 5.0 + 0.02


def test_stop_comes_again_over_a_new_wire_when_it_is_not_answered(controller):
    controller.pipes[0].respond = lambda _: []
    controller.robot.stop()
    assert len(controller.pipes) == 2
    assert controller.verbs == ["STOP", "STATE"], "the first pipe has kept its own to itself"


def test_stop_comes_again_when_the_state_is_not_answered(controller):
    controller.answers["STATE"] = [None, STANDING]
    controller.robot.stop()
    assert controller.verbs == ["STOP", "STATE", "STOP", "STATE"]


def test_half_an_old_answer_in_the_line_does_not_prevent_a_stop(controller):
    lose_the_wire(controller)
    controller.waiting = b"0 0 - 12.5 0.0 0.0 0.0 *12AB\n"
    controller.robot.stop()
    assert controller.verbs[-2:] == ["STOP", "STATE"]


def test_noise_on_the_line_does_not_keep_a_stop_from_being_sent(controller):
    noise = b"\xff" * 300
    controller.pipes[0].arrives(0.0, noise)
    controller.waiting = noise
    controller.connections = 2
    with pytest.raises(RobotStateUnknown):
        controller.robot.stop()
    assert controller.verbs == ["STOP"]


def test_stop_that_nobody_answers_is_loud_and_in_time():
    controller = connected(deadlines=RobotlineDeadlines(standstill_s=3.0))
    controller.connections = 1
    controller.robot.close()
    begun_s = controller.clock.now_s()
    with pytest.raises(RobotStateUnknown, match=r"robot state unknown.*use the hardware stop"):
        controller.robot.stop()
    assert controller.clock.now_s() - begun_s < 3.0 + 0.5


def test_operator_is_alarmed_once_as_soon_as_a_stop_is_not_confirmed():
    alarms = []
    controller = connected(alarm=lambda text: alarms.append((text, controller.clock.now_s())))
    controller.robot.stop()
    assert not alarms
    controller.answers["STOP"] = None
    begun_s = controller.clock.now_s()
    with pytest.raises(RobotStateUnknown):
        controller.robot.stop()
    ((text, told_s),) = alarms
    assert text.startswith("PRESS THE EMERGENCY STOP unless you see the robot stand: ")
    assert told_s - begun_s == pytest.approx(0.5, abs=0.1)
    assert all(pipe.is_closed for pipe in controller.pipes)


def test_operator_is_alarmed_as_soon_when_the_host_is_gone_and_connecting_hangs():
    """The wire was closed with the question that the operator's wish abandoned."""
    alarms = []
    controller = connected(alarm=lambda _: alarms.append(controller.clock.now_s()))
    controller.robot.close()
    controller.accepts_after_s = 1e6
    begun_s = controller.clock.now_s()
    with pytest.raises(RobotStateUnknown, match="within 5 s"):
        controller.robot.stop()
    (told_s,) = alarms
    assert told_s - begun_s == pytest.approx(0.5)
    assert controller.clock.now_s() - begun_s < 5.5


def test_host_that_accepts_slowly_still_confirms_a_stop(controller):
    controller.robot.close()
    controller.accepts_after_s = 1.5
    controller.robot.stop()
    assert controller.verbs[-2:] == ["STOP", "STATE"]


def test_robot_that_goes_on_moving_is_loud_and_the_operator_alarmed_at_once():
    alarms = []
    controller = connected(alarm=lambda text: alarms.append((text, controller.clock.now_s())))
    controller.answers["STATE"] = MOVING
    begun_s = controller.clock.now_s()
    with pytest.raises(RobotStateUnknown, match=r"within 5 s \(it still moves\)"):
        controller.robot.stop()
    ((text, told_s),) = alarms
    assert text.startswith("PRESS THE EMERGENCY STOP unless you see the robot stand: ")
    assert told_s - begun_s == pytest.approx(0.5, abs=0.1)
    with pytest.raises(RobotStateUnknown):
        controller.robot.stop()
    assert len(alarms) == 2, "each stop has its own"


def test_stop_that_is_refused_is_loud(controller):
    controller.answers["STOP"] = "NO VERB"
    with pytest.raises(RobotStateUnknown, match="STOP refused"):
        controller.robot.stop()
    assert "STATE" not in controller.verbs


def test_silence_of_half_a_second_breaks_the_wire_of_a_robot_that_moves(controller):
    controller.robot.move_joints([0.0] * 4, 0.5)
    controller.answers["STATE"] = [MOVING, None]
    assert controller.robot.state().moving
    asked_s = controller.clock.now_s()
    with pytest.raises(LinkDown, match=r"no answer to STATE within 0\.5 s"):
        controller.robot.state()
    assert controller.clock.now_s() - asked_s <= 0.5 + 0.02


def test_robot_that_stands_may_answer_late(controller):
    controller.robot.move_joints([0.0] * 4, 0.5)
    assert not controller.robot.state().moving
    controller.delays_s["STATE"] = 1.5
    assert not controller.robot.state().moving
