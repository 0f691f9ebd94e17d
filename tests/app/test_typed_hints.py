"""Every hint is a command that can be typed."""

import shlex
from dataclasses import replace

import pytest
from typer.main import get_command

from app.main import app
from campaigns.next_step import ROWS, CampaignState, next_step


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.command)
def test_every_command_of_the_table_is_taken_by_the_command_line(row, monkeypatch):
    state = CampaignState(
        folder="a b", remedy="identify {folder} --only-shots 60-", file="robot-plain.yaml"
    )
    monkeypatch.setattr("campaigns.next_step.ROWS", (replace(row, applies=lambda _: True),))
    step = next_step(state)
    command, *words = shlex.split(step.text)[1:]
    assert [command, *words] == [*step.words]
    context = get_command(app).get_command(None, command).make_context(command, words)
    assert str(context.params["folder"]) == "a b"
