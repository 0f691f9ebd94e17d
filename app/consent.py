"""Consent to commands that a campaign's files name: asked for once, kept out of their reach."""

import hashlib
import json
import os
from pathlib import Path

from app.console import Terminal
from app.exits import NotConfirmed
from app.interrupt import asking
from campaigns.errors import ConfigInvalid
from campaigns.files.text_file import make_folder, read_text, replace_text, resolved
from drivers.bounded_files import is_there
from drivers.wire.command_prefix import command_prefix

CONSENTS = "consents"


def require_consent(file: Path, command: str) -> None:
    """Go on only with this user's consent to what the file lets run, given before or now.

    It holds for the file at its place as it is now. Without a terminal nobody gives it, and no
    option does. Raises `NotConfirmed`, `AddressInvalid` for a command that may not be named at all.
    """
    words = command_prefix(command)
    if not words:
        return
    file = resolved(file)
    if resolved(Path(words[0])).is_relative_to(file.parent):
        raise NotConfirmed(
            f"{file}: {words[0]} is in the folder of the file that names it, and is not run",
            remedy="keep programs elsewhere: a consent does not see that they are exchanged",
        )
    note = consent_note(file, command)
    if is_there(note):
        return
    with asking():
        if not Terminal(as_json=True).asks(
            f"{file} lets '{command}' run on this computer. Do you want that, now and later?"
        ):
            raise NotConfirmed(
                f"{file}: nobody has agreed that '{command}' is run, nothing was done",
                remedy="read the file, then answer y once on a terminal; --yes is no consent",
            )
    make_folder(note.parent)
    replace_text(note, f"{file}\n{command}\n")


def consent_note(file: Path, command: str) -> Path:
    """File by whose existence a consent is remembered, in the user's state directory."""
    text = read_text(file, ConfigInvalid, if_missing="bring it back")
    bound_to = json.dumps([str(resolved(file)), text, command])
    return _state_folder() / CONSENTS / hashlib.sha256(bound_to.encode()).hexdigest()


def _state_folder() -> Path:
    """Where the XDG specification has it; a relative path, which is none, counts as not given."""
    told = Path(os.environ.get("XDG_STATE_HOME", ""))
    try:
        return (told if told.is_absolute() else Path.home() / ".local" / "state") / "pkmcal"
    except RuntimeError as error:
        raise NotConfirmed(
            "this user has no home folder in which a consent could be kept",
            remedy="set XDG_STATE_HOME to a folder of this user's",
        ) from error
