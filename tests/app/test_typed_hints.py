"""Every hint is a command that can be typed, whatever options the commands before it had."""

import re
import shlex
from dataclasses import replace

import pytest
from command_line import SMALL_TESTS, change
from typer.main import get_command

from app.main import app, run_command
from campaigns.campaign import now_utc
from campaigns.files.lock import campaign_lock
from campaigns.next_step import ROWS, CampaignState, next_step

OPTIONS = {
    "plan": "--placement optimal --shots 40 --seed 3 --fix arm2.*",
    "run": "--until 5 --skip 3 --retry 1 --yes",
    "identify": "--prior arm*.arm_mm=0.05 --fix arm2.* --hold-out 20%",
}
"""Options that no hint after these commands may repeat."""
SMALL = {"plan.shots": 40, "plan.validation_pairs": 1, **SMALL_TESTS}


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.command)
def test_every_command_of_the_table_is_taken_by_the_command_line(row, monkeypatch):
    state = CampaignState(
        folder="a b",
        remedy="identify {folder} --only-shots 60-",
        overwrite=True,
        file="robot-plain.yaml",
    )
    monkeypatch.setattr("campaigns.next_step.ROWS", (replace(row, applies=lambda _: True),))
    step = next_step(state)
    command, *words = shlex.split(step.text)[1:]
    context = get_command(app).get_command(None, command).make_context(command, words)
    assert str(context.params["folder"]) == "a b"


def hint(ended):
    """The command that is next, of which its words, status and the document say the same."""
    (said,) = re.findall(r"^next: (pkmcal .*)$", ended.err + ended.out, re.M)
    return said


@pytest.mark.slow
def test_hints_after_options_of_all_commands_can_be_typed(pkmcal, tmp_path):
    folder = tmp_path / "c"
    run_command(["new", str(folder), "--robot", "delta", "--scenario", "drawn-robots"])
    change(folder / "campaign.yaml", SMALL)
    change(folder / "cell.yaml", {"speed_up": 10_000})
    step = f"pkmcal plan {folder}"
    for command, options in OPTIONS.items():
        if command == "run":  # which was planned, and is validated before
            assert step == f"pkmcal validate {folder} --stage before"
            before = pkmcal(*shlex.split(step)[1:], "--only", "distances", "--yes")
            assert before.code in {0, 1}, "the scenario's limits are for a calibrated robot"
            step = f"pkmcal run {folder}"
        assert step == f"pkmcal {command} {folder}"
        ended = pkmcal(command, folder, *options.split())
        assert ended.code in {0, 1}, ended.err
        step = hint(ended)
        assert hint(pkmcal("status", folder)) == step
        assert pkmcal("status", folder, "--json").document["next"] == step
    assert not {"--prior", "--fix", "--hold-out"} & {*step.split()}


def test_who_works_on_a_campaign_is_waited_for_or_watched(pkmcal, tmp_path):
    folder = tmp_path / "c"
    run_command(["new", str(folder)])
    with campaign_lock(folder, now_utc=now_utc):
        ended = pkmcal("status", folder)
        document = pkmcal("status", folder, "--json").document
    assert f"first: wait, or look on by `pkmcal watch {folder}`" in ended.out
    assert document["next"] == f"pkmcal status {folder}"
    assert hint(pkmcal("status", folder)) == f"pkmcal plan {folder}"
