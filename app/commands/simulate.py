"""pkmcal sim: a simulated cell as servers."""

from typing import Annotated

import typer


def command(
    scenario: Annotated[str, typer.Argument(help="A shipped scenario's name, or a cell file.")],
    *,
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the scenario's.")] = None,
    controller_port: Annotated[int, typer.Option(min=0, max=65535, help="0: any free one.")] = 0,
    tracker_port: Annotated[int, typer.Option(min=0, max=65535, help="0: any free one.")] = 0,
    serial: Annotated[
        bool, typer.Option("--serial", help="Controller on a pseudo-terminal instead of TCP.")
    ] = False,
) -> None:
    """Serve a simulated cell on loopback: a controller that speaks robotline, a tracker that
    speaks emScon. Prints one JSON line with the addresses, then serves until Ctrl-C.
    """
    import json
    import signal
    import sys

    from app.interrupt import StopWish, stop_on_signals
    from sim.cell import Cell
    from sim.clock import ScaledClock
    from sim.embedded import EmbeddedCell
    from sim.scenario import load_scenario

    loaded = load_scenario(scenario)
    wish = StopWish()
    cell = EmbeddedCell(
        Cell(loaded, seed=seed),
        ScaledClock(loaded.speed_up),
        controller_on="pty" if serial else "tcp",
        controller_port=controller_port,
        tracker_port=tracker_port,
    )
    with stop_on_signals(wish), cell:
        addresses = {
            "scenario": loaded.name,
            "controller": cell.controller_url,
            "tracker": cell.tracker_url,
            "speed_up": loaded.speed_up,
        }
        sys.stdout.write(json.dumps(addresses) + "\n")
        sys.stdout.flush()
        while not wish():
            signal.pause()
