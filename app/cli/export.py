"""pkmcal export: write the compensated parameters, or the measured shots, as a file."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from app.console import Terminal
from app.next import tell_next
from app.options import Excel, Force, for_spreadsheets
from campaigns.campaign import Campaign
from campaigns.controllers.delta_firmware import FIRMWARE, has_firmware
from campaigns.errors import OptionsInvalid
from campaigns.workflow import exporting

Format = Literal["yaml", "linuxcnc", "plain", "klipper", "marlin", "reprap", "shots"]


@dataclass(frozen=True, slots=True)
class ExportAnswer:
    """Answer of `export`: the file that was written."""

    path: Path


@dataclass(frozen=True, slots=True)
class PlainExportAnswer(ExportAnswer):
    """Answer of `export` for fewer parameters: remaining error of position, by set of them."""

    left_mm: Mapping[str, Mapping[str, float]]


def command(
    terminal: Terminal,
    campaign: Campaign,
    *,
    to: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Default, in DIR: robot-compensated.yaml, calib.hal, shots.csv …"
        ),
    ] = None,
    format_: Annotated[
        Format,
        typer.Option(
            "--format",
            metavar="FORMAT",
            help="yaml: a robot file. linuxcnc: a HAL file for pkmkins. plain: a robot file "
            "without tilts, skews and gears, with the nearest values. klipper, marlin, reprap: for "
            "the firmware of a Delta printer. shots: the measured shots.",
        ),
    ] = "yaml",
    excel: Excel = False,
    force: Force = False,
) -> None:
    """Write the identified parameters as a robot file.

    The file contains the parameters, 1 σ of each identified one, their provenance, and the sha256
    of the geometry. Only an identification with the verdict "pass" is written. The file can be the
    nominal robot of a later campaign.

    For a controller with fewer parameters (plain, and the firmware of printers) it contains the
    values that minimise the mean square error of position over the workspace, and the remaining
    error is shown beside that of all parameters. z = 0 of a printer is its bed, if heights of it
    were imported. Marlin and RepRapFirmware (reprap) get M665 and M666, whose signs differ.
    """
    if excel and format_ != "shots":
        raise OptionsInvalid(
            f"--excel is for a CSV file, and --format {format_} writes none",
            remedy="add --format shots, or leave it out",
        )
    left_mm = None
    if format_ == "shots":  # what was measured, not what was identified
        path, halves = exporting.export_shots(campaign, to, overwrite=force)
        for_spreadsheets(path, excel=excel)
        if halves:
            terminal.note(f"left out because their pair is incomplete: shots {halves}")
    elif format_ == "plain":
        plain = exporting.export_plain(campaign, to, overwrite=force)
        path, left_mm = plain.path, _show_remaining_errors(terminal, plain)
    elif format_ in FIRMWARE:
        printer = exporting.export_firmware(campaign, format_, to, overwrite=force)
        path, left_mm = printer.path, _show_remaining_errors(terminal, printer)
        _show_bed(terminal, printer)
    elif format_ == "linuxcnc":
        path = exporting.export_hal(campaign, to, overwrite=force)
    else:
        path, robot = exporting.export(campaign, to, overwrite=force)
        if robot.remark:
            terminal.note(robot.remark)
        if has_firmware(robot.mechanism):
            terminal.note(f"for a printer's firmware: --format {', '.join(FIRMWARE)}")
    terminal.say(f"written: {path}")
    answer = ExportAnswer(path) if left_mm is None else PlainExportAnswer(path, left_mm)
    if format_ in FIRMWARE:  # people put it into the printer, and its file says how
        terminal.note("its first lines say where the values go; then measure again")
    terminal.conclude(answer, tell_next(terminal, campaign))


def _show_bed(terminal: Terminal, printer: exporting.FirmwareExport) -> None:
    """Say what z = 0 is, and how far the bed leans."""
    if printer.bed is None:
        terminal.note("z = 0 is that of the base frame: no heights of a bed were imported")
        return
    terminal.note(
        f"z = 0 is the bed, which leans by {printer.bed.tilt_mrad:.1f} mrad to the towers; prints "
        "are sheared by as much"
    )


def _show_remaining_errors(
    terminal: Terminal, plain: exporting.PlainExport
) -> dict[str, dict[str, float]]:
    """Show and return the mean and largest error of position that remains with each set."""
    remaining_mm = {
        "nominal parameters": (plain.nominal.lost_mean_mm, plain.nominal.lost_max_mm),
        "these values": (plain.form.lost_mean_mm, plain.form.lost_max_mm),
    }
    if plain.std is not None:
        remaining_mm["all identified parameters, 1 σ"] = (plain.std.mean, plain.std.max)
    rows = [(name, f"{mean:.4f}", f"{most:.4f}") for name, (mean, most) in remaining_mm.items()]
    terminal.table("Remaining error of position (mm)", ("with", "mean", "max"), rows)
    return {name: {"mean": mean, "max": most} for name, (mean, most) in remaining_mm.items()}
