"""pkmcal sim: a simulated cell as servers."""

from typing import Annotated

import typer

from app.console import terminal_of
from app.interrupt import awaited_signal
from app.new_campaign import cell_text
from app.options import Port, Seed
from campaigns.robots.robot import find_robot
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import EmbeddedCell
from sim.scenarios.scenario import load_scenario, parse_scenario

Name = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A shipped scenario's name, or a cell file.")
]
Serial = Annotated[
    bool, typer.Option("--serial", help="The controller on a pseudo-terminal instead of TCP.")
]

Speaks = Annotated[
    str, typer.Option(metavar="NAME", help="The tracker's protocol: emscon or pointline.")
]
Robot = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="A shipped robot or a robot file, of which the cell becomes one.",
        show_default="the scenario's",
    ),
]


def command(
    context: typer.Context,
    scenario: Name,
    *,
    robot: Robot = None,
    seed: Seed = None,
    controller_port: Port = 0,
    tracker_port: Port = 0,
    tracker_driver: Speaks = "emscon",
    serial: Serial = False,
) -> None:
    """Serve a simulated cell on loopback.

    A controller that speaks robotline and a tracker that speaks emScon or --tracker-driver, for
    `pkmcal new --controller URL --tracker URL` or for your own software. Prints one JSON line with
    the addresses, then serves until Ctrl-C or SIGTERM.
    """
    loaded = load_scenario(scenario)
    if robot is not None:
        loaded = parse_scenario(cell_text(find_robot(robot).robot, scenario), scenario)
    cell = EmbeddedCell(
        Cell(loaded, seed=seed),
        ScaledClock(loaded.speed_up),
        tracker_speaks=tracker_driver,
        controller_on="pty" if serial else "tcp",
        controller_port=controller_port,
        tracker_port=tracker_port,
    )
    addresses = {
        "controller": cell.controller_url,
        "tracker": cell.tracker_url,
        "scenario": loaded.name,
        "seed": cell.cell.seed,
        "speed_up": loaded.speed_up,
    }
    with awaited_signal() as wait, cell:
        terminal_of(context, as_json=True).document(addresses)
        wait()
