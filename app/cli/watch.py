"""pkmcal watch: a live page of a campaign."""

import os
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated

import typer

from app.console import Terminal
from app.interrupt import awaited_signal
from app.monitor.server import LiveServer
from app.options import Port
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid

POLITE = 10
"""Added to the process's niceness: a run on the same machine comes first."""
Host = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Address to serve at: this machine only, or, for other machines, 0.0.0.0 or its own "
        "address; the page's address then has a token.",
    ),
]


@dataclass(frozen=True, slots=True)
class WatchAnswer:
    """Answer of `watch`: address of the live page."""

    url: str


def command(
    terminal: Terminal, campaign: Campaign, *, host: Host = "127.0.0.1", port: Port = 0
) -> None:
    """Serve a live page of the campaign, for a tablet or a wall screen.

    What is measured, what is left and when it ends, the last events, what `status` says, and the
    next command. It only reads the campaign's folder and changes nothing: it may start before a
    run, and it goes on when the measuring process has ended, for whatever reason. Prints the page's
    address, then serves until Ctrl-C or SIGTERM.
    """
    try:
        server = LiveServer(host, port, campaign.folder)
    except (OSError, OverflowError) as error:
        raise OptionsInvalid(
            f"--host {host} --port {port}: cannot serve there: {error}",
            remedy="name an address of this machine and a free port, or leave --port out",
        ) from error
    with suppress(OSError, AttributeError):
        os.nice(POLITE)
    serving = threading.Thread(target=server.serve_forever, name="server", daemon=True)
    with awaited_signal() as wait, server:
        serving.start()
        terminal.say(f"live page: {server.url}")
        terminal.conclude(WatchAnswer(server.url))
        wait()
        server.shutdown()
        serving.join()
