"""`pkmcal check`: what it says of shots that contradict all others, by lines and exit codes."""

import pytest

from campaigns.identification.checking import RecordedCheck

IN_WORDS = "(χ² 9.0 of 18, p = 0.5)"


def judged(parts=(), wrong=(), decision="fail", says="", p=0.5):
    return RecordedCheck(
        decision=decision, says=f"{says} {IN_WORDS}", shots=8, chi2=9.0, dof=18, p=p,
        parts=parts, wrong=wrong, log_factors={}, series=9, of="", at_utc="",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("check", "lines"),
    [
        (
            judged(wrong=(5,), decision="not decided", says="shot 5 contradicts all others"),
            [f"shot 5 contradicts all others {IN_WORDS}"],
        ),
        (
            judged(wrong=(3, 5), says="shots 3 and 5 contradict all others"),
            [f"shots 3 and 5 contradict all others {IN_WORDS}"],
        ),
        (
            judged(("encoder 2",), (3, 5), says="the robot has changed"),
            [
                f"the robot has changed {IN_WORDS}",
                "left out: shot 3: it contradicts all others",
                "left out: shot 5: it contradicts all others",
            ],
        ),
        (
            judged((), (3,), p=1e-9, says="the shots contradict the last result"),
            [
                f"the shots contradict the last result {IN_WORDS}",
                "left out: shot 3: it contradicts all others",
            ],
        ),
    ],
)
def test_wrong_shots_of_a_check_are_named_once(pkmcal, whole, monkeypatch, check, lines):
    monkeypatch.setattr("app.cli.check.measure", lambda *_, **__: check)
    answer = pkmcal("check", whole.folder)
    assert answer.code == 1
    starts = ("first: ", "because: ", "next: ")
    assert [line for line in answer.out.splitlines() if not line.startswith(starts)] == lines
    assert pkmcal("check", whole.folder, "--json").document["wrong"] == [*check.wrong]
