"""pkmcal new: make a campaign's folder."""

from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

from app.console import Terminal
from app.new_campaign import NO_FACTS, NewOptions, create_campaign, read_limits, trust_typed
from app.next import tell_next, tell_step
from app.options import NewFolder, ask_reflector
from campaigns.campaign import open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.files.text_file import refuse_existing
from campaigns.next_step import NextStep
from campaigns.robots.printer_config import PRINTER
from campaigns.robots.robot import find_robot, states_reflector
from campaigns.settings.sections import OFFLINE
from drivers.texts import as_word

LIMITS = {
    "distance_mean_mm": "mean error of distances",
    "distance_max_mm": "largest error of distances",
}
"""Limits that `new` asks for; the others are rare."""


@dataclass(frozen=True, slots=True)
class NewAnswer:
    """Answer of `new`: the folder, and the addresses of its devices."""

    folder: Path
    controller: str
    tracker: str


def command(terminal: Terminal, folder: NewFolder, options: NewOptions) -> None:
    """Make a campaign's folder: settings and nominal robot.

    campaign.yaml explains each of its keys. With --controller and --tracker the campaign is for a
    real cell, otherwise for a simulated one, whose errors are listed in cell.yaml.

    One of the two addresses may be sim://SCENARIO, to rehearse with the other device: a simulated
    tracker then measures a robot that stands at the real controller's joints. An address may also
    be by-hand, for a device that the operator works, and that of the tracker file:NAME, a file to
    which its software writes each point.

    A mechanism of one's own that is named as --robot my.py:OWN is trusted from then on: its program
    may run (`pkmcal trust`).

    With --offline no device is ever connected: the robot's own controller and the tracker's own
    software measure, and `pkmcal import` reads their files.

    The robot may be a Delta printer's printer.cfg: `pkmcal import` then reads what its firmware
    measured.

    pkmcal new first-try
    pkmcal new cell-3 --controller tcp://10.0.0.5:5020 --tracker tcp://10.0.0.6:700
    pkmcal new cell-5 --offline
    pkmcal new kossel --offline --robot printer.cfg
    """
    trust_typed(options.robot)
    limits: dict[str, float] = {}
    if not options.is_simulated:
        limits = ask_limits(terminal, folder)
        if options.tracker_facts == NO_FACTS:
            options = ask_tracker(terminal, options)
        if options.reflector is None and not states_reflector(find_robot(options.robot)):
            options = replace(options, reflector=ask_reflector(terminal))
    config = create_campaign(folder, options, limits)
    answer = NewAnswer(folder, config.controller.url, config.tracker.url)
    devices = OFFLINE if options.offline else f"with {answer.controller} and {answer.tracker}"
    terminal.say(f"made: {folder}, {devices}")
    terminal.conclude(answer, _next(terminal, folder, options))


def _next(terminal: Terminal, folder: Path, options: NewOptions) -> NextStep | None:
    """Print and return what is next: of a printer without devices, what its file holds."""
    if not (options.offline and options.robot.endswith(PRINTER)):
        return tell_next(terminal, open_campaign(folder))
    words = ("import", as_word(str(folder)), as_word(options.robot))
    return tell_step(terminal, NextStep(words, why="the file holds what DELTA_CALIBRATE measured"))


def ask_limits(terminal: Terminal, folder: Path) -> dict[str, float]:
    """Ask for limits that the robot must meet; return those typed, none without a terminal."""
    # first, because answers to questions would be lost if the folder were refused afterwards
    refuse_existing(folder / "campaign.yaml")
    prompt, limits = terminal.prompt(), dict[str, float]()
    if prompt is None:
        return limits
    terminal.note("Limits that the calibrated robot must meet; Enter: none. More: `acceptance`")
    for name, words in LIMITS.items():
        while typed := prompt(f"{words}, mm: ").removesuffix("mm").strip():
            value = _number(typed)
            if 0.0 < value < inf:
                limits[name] = value
                break
            terminal.note("give a number above 0, such as 0.1, or nothing")
    return limits


def ask_tracker(terminal: Terminal, options: NewOptions) -> NewOptions:
    """Ask for the tracker's name and the limits of its data sheet; return options with the answers.

    Without a terminal, or with Enter, the options stay as they are.
    """
    prompt = terminal.prompt()
    name = (
        prompt("the tracker's maker and model (Enter: later, in campaign.yaml): ") if prompt else ""
    )
    if prompt is None or not name.strip():
        return options
    options = replace(options, tracker_name=name.strip())
    terminal.note(
        "Limits (MPE) of its data sheet decide about U: along the beam ±(A µm + B µm/m), across it "
        "±(C + D). Enter: none; then no certificate by points without an uncertainty of their own"
    )
    while typed := prompt("A,B,C,D: ").strip():
        try:
            limits = read_limits(typed)
        except OptionsInvalid as error:
            terminal.note(f"{error.problem}: {error.remedy}, or nothing")
            continue
        data_sheet = prompt("data sheet (number, date): ").strip()
        typed_by = prompt("your name: ").strip()
        if data_sheet and typed_by:
            return replace(options, tracker_limits=limits, data_sheet=data_sheet, typed_by=typed_by)
        terminal.note("limits need their source: give the data sheet and your name, or nothing")
    return options


def _number(text: str) -> float:
    """Return the number that was typed, 0 for other text."""
    try:
        return float(text.replace(",", "."))  # many keyboards have a decimal comma
    except ValueError:
        return 0.0
