"""Every hint is a command that can be typed."""

import re
import shlex
from dataclasses import replace

import pytest
from typer.main import get_command

from app.main import app, run_command
from campaigns.campaign import now_utc
from campaigns.files.lock import campaign_lock
from campaigns.next_step import ROWS, CampaignState, next_step


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


def test_who_works_on_a_campaign_is_waited_for_or_watched(pkmcal, tmp_path):
    folder = tmp_path / "c"
    run_command(["new", str(folder)])
    with campaign_lock(folder, now_utc=now_utc):
        ended = pkmcal("status", folder)
        document = pkmcal("status", folder, "--json").document
    assert f"first: wait, or look on by `pkmcal watch {folder}`" in ended.out
    assert document["next"] == f"pkmcal status {folder}"
    assert hint(pkmcal("status", folder)) == f"pkmcal plan {folder}"
