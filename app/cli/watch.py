"""pkmcal watch: serve a live page of a campaign."""

import io
import os
import sys
import threading
from contextlib import suppress
from typing import Annotated, NoReturn

import typer

from app.console import Terminal
from app.exits import Exit
from app.interrupt import awaited_signal
from app.monitor.server import LiveServer
from app.options import Port
from campaigns.campaign import CampaignFolder
from campaigns.errors import OptionsInvalid

LOOK_FOR_END_S = 0.1
"""Longest time until the server has noticed that it is to end."""
Host = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Address to serve at. 127.0.0.1: this machine only. 0.0.0.0 or this machine's own "
        "address: other machines, too; the page's address then has a token.",
    ),
]


def command(
    terminal: Terminal, campaign: CampaignFolder, *, host: Host = "127.0.0.1", port: Port = 0
) -> None:
    """Serve a live page of the campaign, for a tablet or a wall screen.

    What is measured, what is left and when it ends, the last events, what `status` says, and the
    next command. It only reads the campaign's folder and changes nothing: it may start before a
    run, and it goes on when the measuring process has ended, for whatever reason. Prints the page's
    address, for other machines also as a QR code, then serves until Ctrl-C or SIGTERM.
    """
    try:
        server = LiveServer(host, port, campaign.folder)
    except (OSError, OverflowError) as error:
        raise OptionsInvalid(
            f"--host {host} --port {port}: cannot serve there: {error}",
            remedy="name an address of this machine and a free port, or leave --port out",
        ) from error
    serving = threading.Thread(target=_serve, args=(server,), name="server", daemon=True)
    with awaited_signal() as wait, server:
        serving.start()
        terminal.say(f"live page: {server.url}")
        if server.token:
            for line in qr_code(server.url):
                terminal.note(line, "")
        terminal.conclude({"url": server.url})  # before serving: a program waits for the address
        wait()
        server.shutdown()
        serving.join()
    _leave()


def _leave() -> NoReturn:
    """End the process at once, with exit code 0: nothing is open any more but the streams."""
    # Python would take all modules apart first: 0.3 s, and several on a machine that is busy.
    for stream in filter(None, (sys.stdout, sys.stderr)):
        with suppress(OSError, ValueError):  # its reader may have left
            stream.flush()
    os._exit(Exit.DONE)


def _serve(server: LiveServer) -> None:
    """Serve until the server is shut down; a run on the same machine comes first."""
    # Linux gives each thread its own priority, which the threads that it starts inherit: the one
    # that waits for the signal to end keeps its own.
    with suppress(OSError, AttributeError):
        os.nice(10)
    server.serve_forever(poll_interval=LOOK_FOR_END_S)


def qr_code(text: str) -> list[str]:
    """Return the lines of a QR code in block characters."""
    # Half blocks, so that the code stays square and fits beside the address on a small terminal.
    # No other command draws one: none waits for its import.
    import segno

    drawing = io.StringIO()
    segno.make(text).terminal(drawing, compact=True)
    return drawing.getvalue().splitlines()
