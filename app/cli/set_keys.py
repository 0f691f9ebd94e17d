"""pkmcal set: change keys of campaign.yaml, its comments left as they are."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import typer

from app.console import Terminal
from app.next import tell_next
from campaigns.campaign import CampaignFolder, now_utc, open_campaign
from campaigns.errors import CampaignError, OptionsInvalid
from campaigns.files.lock import campaign_lock
from campaigns.files.text_file import replace_text
from campaigns.settings.config import FILE_NAME, changed_settings

Changes = Annotated[
    list[str],
    typer.Argument(metavar="KEY=VALUE...", help="Keys with new values, as in campaign.yaml."),
]


@dataclass(frozen=True, slots=True)
class SetAnswer:
    """Answer of `set`: the keys with their new values."""

    changed: Mapping[str, object]


def command(terminal: Terminal, campaign: CampaignFolder, changes: Changes) -> None:
    """Change keys of campaign.yaml; its comments stay.

    A key below another one is joined to it by a point. A value is written as in the file: a
    number, a text, a list in [ ]; without a value the key becomes empty. All keys:
    `pkmcal help files`. Refused while another process works on the campaign, and nothing is written
    unless all of it is right.

    pkmcal set cell-3 tracker.place_mm='[2400, 250, -150]'
    pkmcal set cell-3 plan.shots=60 acceptance.distance_mean_mm=0.1
    """
    pairs = dict(map(_split, changes))
    # All keys are checked before the file is replaced: half of a change may make no sense.
    with campaign_lock(campaign.folder, now_utc=now_utc):
        settings = changed_settings(campaign.folder, pairs)
        replace_text(campaign.folder / FILE_NAME, settings.text)
    for key, value in settings.values.items():
        terminal.say(f"{key}: {value}")
    try:
        following = tell_next(terminal, open_campaign(campaign.folder))
    except CampaignError:  # the robot or its program cannot be read: the change is made
        following = None
    terminal.conclude(SetAnswer(settings.values), following)


def _split(word: str) -> tuple[str, str]:
    """Return key and value of a typed word; raise `OptionsInvalid` without an equals sign."""
    key, sign, value = word.partition("=")
    if not (sign and key):
        raise OptionsInvalid(
            f"'{word}' is no KEY=VALUE", remedy="write for example plan.shots=60, without blanks"
        )
    return key, value
