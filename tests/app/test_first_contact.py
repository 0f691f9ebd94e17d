"""`pkmcal devices --move`: what a server must not do is seen before anything is measured."""

import pytest
from command_line import change

from campaigns.campaign import open_campaign
from campaigns.journal.records import Rejected
from campaigns.measuring import first_contact

pytestmark = pytest.mark.slow


@pytest.fixture
def cell(pkmcal, tmp_path):
    """A campaign's folder, and a function that changes its simulated controller."""
    folder = tmp_path / "cell"
    assert pkmcal("new", folder).code == 0

    def made(**controller):
        change(folder / "cell.yaml", {f"controller.{key}": v for key, v in controller.items()})
        return folder

    return made


def test_an_honest_controller_with_a_watchdog_moves_a_joint_there_and_back(pkmcal, cell):
    folder = cell(watchdog_s=2.0)
    before = pkmcal("devices", folder, "--json").document
    answer = pkmcal("devices", folder, "--move", "--yes", "--json")
    assert answer.code == 0
    motion = answer.document["motion"]
    assert motion == {"joint": 0, "travel_deg": pytest.approx(6.75), "stops_unasked": True}
    after = pkmcal("devices", folder, "--json").document
    assert after["controller"]["joints_deg"] == pytest.approx(before["controller"]["joints_deg"])
    assert after["motion"] is None


def test_a_controller_without_a_watchdog_gets_a_warning_with_the_rule(pkmcal, cell):
    answer = pkmcal("devices", cell(), "--move", "--yes")
    assert answer.code == 0
    assert "its controller has no watchdog" in answer.out + answer.err
    assert "no valid line has come for 2 seconds" in answer.out + answer.err


@pytest.mark.parametrize(
    ("lies", "said"),
    [
        (["targets as encoders"], "sooner than any robot is there"),
        (["never moving"], "stands (moving 0) while its joints change"),
        (["targets as encoders", "never moving"], "sooner than any robot is there"),
    ],
)
def test_a_server_that_lies_is_refused_with_what_it_does(pkmcal, cell, lies, said):
    answer = pkmcal("devices", cell(lies=lies), "--move", "--yes")
    assert answer.code == 3
    assert said in answer.err
    assert "`pkmcal help robotline`" in answer.err


def test_a_run_sees_by_its_first_long_leg_what_a_server_must_not_do(pkmcal, cell):
    folder = cell(lies=["targets as encoders", "never moving"])
    assert pkmcal("plan", folder, "--shots", "20").code == 0
    answer = pkmcal("run", folder, "--yes")
    assert answer.code == 3
    assert "sooner than any robot is there" in answer.err
    with open_campaign(folder).journal_reader() as journal:
        assert [shot.outcome.shot for shot in journal.shots(1)] == [0], "where it stood before"


def test_a_tracker_sees_a_motion_that_its_controller_does_not_report(pkmcal, cell, monkeypatch):
    """Its legs are not watched here: the scatter of the readings is all that shows the motion."""
    monkeypatch.setattr("campaigns.measuring.motion.MotionWatch.see", lambda *_: None)
    folder = cell(lies=["targets as encoders", "never moving"])
    change(folder / "campaign.yaml", {"controller.speed_percent": 10})
    assert pkmcal("plan", folder, "--shots", "20").code == 0
    answer = pkmcal("run", folder, "--yes")
    assert answer.code != 0
    with open_campaign(folder).journal_reader() as journal:
        assert [shot.outcome.shot for shot in journal.shots(1)] == [0]
        reasons = [entry.record.reason for entry in journal.records_of(Rejected, 1)]
    assert any("the reflector moved while it was measured" in reason for reason in reasons)


def test_nothing_moves_without_consent_and_by_hand_not_at_all(pkmcal, cell):
    folder = cell()
    assert pkmcal("devices", folder, "--move").code == 2
    change(folder / "campaign.yaml", {"controller.url": "by-hand", "controller.driver": "by-hand"})
    answer = pkmcal("devices", folder, "--move", "--yes")
    assert answer.code == 2
    assert "nothing but its operator moves this robot" in answer.err


def test_a_wish_to_stop_stops_the_robot_also_while_nothing_is_asked(pkmcal, cell, monkeypatch):
    """Two seconds of the time without a question have passed."""
    folder, stops = cell(), []

    class Wished(first_contact.ContactTest):
        def __init__(self, robot, clock, model, settle, stop_requested):
            began_s = []

            def wish():
                if self.unasked:
                    began_s.append(clock.now_s())
                return bool(began_s) and clock.now_s() > began_s[0] + 2.0

            super().__init__(robot, clock, model, settle, wish)
            self.unasked = False
            stop = robot.stop
            monkeypatch.setattr(robot, "stop", lambda: (stop(), stops.append(robot.state()))[0])

        def _stops_unasked(self, target):
            self.unasked = True
            return super()._stops_unasked(target)

    monkeypatch.setattr("app.cli.devices.ContactTest", Wished)
    answer = pkmcal("devices", folder, "--move", "--yes")
    assert answer.code == 130
    (stood,) = stops
    assert not stood.moving
