"""Stopping over robotline: whatever has happened before, and loud when it cannot be confirmed."""

import pytest
from scripted_controller import connected

from drivers.errors import Cancelled, LinkDown, RobotStateUnknown

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


@pytest.mark.parametrize("verb", ["STATE", "MOVEJ"])
def test_pending_question_is_abandoned_and_stop_goes_over_a_new_wire_at_once(verb):
    pressed_s, sent_s = [1e9], []
    controller = connected(cancelled=lambda: controller.clock.now_s() >= pressed_s[0])
    controller.answers[verb] = None
    pressed_s[0] = controller.clock.now_s() + 0.3
    with pytest.raises(Cancelled):
        controller.robot.state() if verb == "STATE" else controller.robot.move_joints([0.0] * 4, 1)
    controller.answers[verb] = STANDING
    usual = controller.respond
    controller.respond = lambda data: sent_s.append(controller.clock.now_s()) or usual(data)
    controller.robot.stop()
    assert sent_s[0] - pressed_s[0] <= 0.03
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


def answers_no_stop(controller):
    controller.answers["STOP"] = None


def moves_on(controller):
    controller.answers["STATE"] = MOVING


def is_gone(controller):
    """Connecting hangs, and the wire was closed with the question that the wish abandoned."""
    controller.robot.close()
    controller.accepts_after_s = 1e6


def refuses_connections(controller):
    controller.robot.close()
    controller.connections = 1


@pytest.mark.parametrize(
    ("fault", "problem", "alarm_s"),
    [
        (answers_no_stop, "no answer to STOP", 0.5),
        (moves_on, "it still moves", 0.5),
        (is_gone, "timed out", 0.5),
        (refuses_connections, "nobody answers", 0.1),
    ],
)
def test_stop_that_is_not_confirmed_alarms_once_and_ends_loudly_in_time(fault, problem, alarm_s):
    alarms = []
    controller = connected(alarm=lambda text: alarms.append((text, controller.clock.now_s())))
    controller.robot.stop()
    assert not alarms
    fault(controller)
    for stops in (1, 2):
        begun_s = controller.clock.now_s()
        with pytest.raises(RobotStateUnknown, match=rf"within 5 s \(.*{problem}.*hardware stop"):
            controller.robot.stop()
        assert controller.clock.now_s() - begun_s < 5.5
        assert len(alarms) == stops, "each stop has its own"
        text, alarmed_s = alarms[-1]
        assert text.startswith("PRESS THE EMERGENCY STOP unless you see the robot stand: ")
        assert alarmed_s - begun_s == pytest.approx(alarm_s, abs=0.1)


def test_host_that_accepts_slowly_still_confirms_a_stop(controller):
    controller.robot.close()
    controller.accepts_after_s = 1.5
    controller.robot.stop()
    assert controller.verbs[-2:] == ["STOP", "STATE"]


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
