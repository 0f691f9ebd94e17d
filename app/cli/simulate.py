"""pkmcal sim: serve a simulated cell."""

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Annotated

import typer

from app.console import Terminal
from app.interrupt import awaited_signal
from app.new_campaign import COMPLETED_ROBOT, COMPLETED_SCENARIO, cell_text, trust_typed
from app.options import Port, Seed
from campaigns.robots.robot import find_robot
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.scenarios.scenario import load_scenario, parse_scenario
from sim.servers.server import CellServer
from sim.sessions import controller_sessions, tracker_sessions

Name = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A shipped scenario's name, or a cell file.",
        autocompletion=COMPLETED_SCENARIO,
    ),
]
SpeedUp = Annotated[
    float | None,
    typer.Option(
        metavar="FACTOR",
        min=0.1,
        max=100_000.0,
        help="How many times faster than real the cell moves; 1 to practise.",
        show_default="the scenario's",
    ),
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
        help="A shipped robot or a robot file: the cell becomes one of its kind.",
        show_default="the scenario's",
        autocompletion=COMPLETED_ROBOT,
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class CellAnswer:
    """Answer of `sim`: addresses of the simulated cell."""

    controller: str
    tracker: str
    scenario: str
    seed: int
    speed_up: float


def command(
    scenario: Name,
    *,
    robot: Robot = None,
    seed: Seed = None,
    speed_up: SpeedUp = None,
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
        trust_typed(robot)
        loaded = parse_scenario(cell_text(find_robot(robot).robot, scenario), scenario)
    cell = Cell(loaded, seed=seed)
    factor = loaded.speed_up if speed_up is None else speed_up
    server = CellServer(ScaledClock(factor), cell.faults)  # sockets live by the wall clock
    with ExitStack() as ending:
        ending.callback(server.stop)  # also where one of its addresses is taken
        tracker = server.serve_tcp(tracker_sessions(cell, tracker_driver), "tracker", tracker_port)
        controller = controller_sessions(cell)
        answer = CellAnswer(
            controller=server.serve_pty(controller, "controller")
            if serial
            else server.serve_tcp(controller, "controller", controller_port),
            tracker=tracker,
            scenario=loaded.name,
            seed=cell.seed,
            speed_up=factor,
        )
        # signals are awaited before the addresses are printed: a reader may end the server at once
        with awaited_signal() as wait, server:
            Terminal(as_json=True, command="sim").conclude(answer)
            wait()
