"""pkmcal plan: choose the poses to measure, and predict the uncertainty."""

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from app import plan_text
from app.console import WARNING, Terminal
from app.next import tell_next
from app.options import Excel, Plot, for_spreadsheets
from app.report.tables import DETERMINED
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid
from campaigns.identification.repeats import PlannedVisits
from campaigns.measuring.stopping_rule import read_goal
from campaigns.options import PlanOptions, ProgramOptions
from campaigns.planning.plans import pairs_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.outlook import Gain
from campaigns.workflow.observation_plan import PlannedObservations
from campaigns.workflow.planning import PlannedCampaign, plan, plan_without_shots
from campaigns.workflow.programs import WrittenProgram, write_programs


@dataclass(frozen=True, slots=True, kw_only=True)
class ObservationsAnswer:
    """Planned observations of other kinds, and what all that is planned will determine."""

    counts: Mapping[str, int]
    """Observations of each object, those held out included."""
    seconds_estimated: float
    determined: Sequence[Mapping[str, object]]
    quantity: str
    gains: Sequence[Gain]
    """What ten more of each object would gain in the quantity; the most per minute first."""
    path: Path | None
    """Where they are written; None: none is asked for."""
    older: Path | None
    """Where the file before is kept; None without one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanAnswer:
    """Answer of `plan`: contents of the plan, and the uncertainty predicted for it."""

    shots: int
    pairs: int
    placement: str
    seed: int | None
    until_mm: float | None
    position_std_mm: Mapping[str, float]
    rotation_std_deg: Mapping[str, float] | None
    """None for a robot whose platform does not turn."""
    predicted_std: Mapping[str, float]
    weakest: Sequence[Mapping[str, object]]
    """Parameter with the largest σ, of lengths and of angles."""
    from_below: Sequence[float]
    """Share of the shots that each joint approaches from a smaller value."""
    repeats: Sequence[PlannedVisits]
    """Visits of the drift pose and what they will show: the plan's, then twice as many."""
    fitting_lines_mm: Sequence[float] | None
    space: Mapping[str, object] | None
    """Candidates that the space refuses; None where nothing restricts it."""
    seconds_estimated: float
    path: Path
    older: Path | None
    """Where the plan before is kept; None without one."""
    reflector_moves: Sequence[int]
    """Shots before which the reflector is moved to another part of the platform."""
    observations: "ObservationsAnswer | None"
    """Observations of other kinds; None where campaign.yaml has no objects."""
    programs: Sequence[WrittenProgram] = ()


@dataclass(frozen=True, slots=True)
class ProgramsAnswer:
    """Answer of `plan --program` for a plan that is there already."""

    programs: Sequence[WrittenProgram]


def command(
    terminal: Terminal,
    campaign: Campaign,
    options: PlanOptions,
    programs: ProgramOptions,
    *,
    plot: Plot = None,
    excel: Excel = False,
) -> None:
    """Choose the poses to measure and write plan.csv.

    The plan has pairs for the identification; hold-out pairs all over the workspace, which the fit
    never uses; and one pose that is measured again about every 20 shots, which shows drift. Every
    pose and every path is checked.

    Predicts, before anything moves, the uncertainty of positions and parameters. Defaults: `plan`
    in campaign.yaml. You may edit plan.csv: every command checks it again. An older plan.csv is
    kept under another name; one by which anything was measured is replaced only with --force.

    --program csv writes the plan as a table of poses and joints, along safe paths, for a controller
    that is not connected.

    --observe plans what other instruments than a tracker measure: touches of a bed, widths of a
    part. What ten more of each object in campaign.yaml would gain, is compared in any case.

    pkmcal plan cell-3 --shots 60
    pkmcal plan cell-3 --shots 60 --reflector 'half 2'
    pkmcal plan printer --shots 0 --observe bed=30 --observe part=12 --for xy
    pkmcal plan cell-3 --until 0.02
    pkmcal plan cell-5 --program csv
    """
    # --program alone writes the existing plan in another form: it may be measured in part already
    if programs.program and campaign.plan_path.exists() and options == PlanOptions() and not plot:
        written = _write_programs(terminal, campaign, programs, excel=excel)
        terminal.conclude(ProgramsAnswer(written), tell_next(terminal, campaign))
        return
    if options.shots == 0:
        if programs.program or plot:
            raise OptionsInvalid(
                "--shots 0 plans no shots, which --program and --plot are for",
                remedy="leave them out",
            )
        observations = plan_without_shots(campaign, options)
        for_spreadsheets(observations.path, excel=excel)
        show_observations(terminal, observations)
        _tell_written(terminal, observations)
        terminal.conclude(observations_answer(observations), tell_next(terminal, campaign))
        return
    with terminal.telling("reading the campaign") as now_at:
        planned = plan(campaign, options, now_at)
    until_mm = None if options.until is None else read_goal(options.until)
    observed_at = planned.observations.path if planned.observations is not None else None
    for_spreadsheets(campaign.plan_path, observed_at, excel=excel)
    show(terminal, campaign, planned, until_mm)
    terminal.say(f"written: {campaign.plan_path}")
    if planned.older is not None:
        _tell_way_back(terminal, "plan", planned.older, campaign.plan_path)
    if planned.observations is not None:
        _tell_written(terminal, planned.observations)
    if plot is not None:
        from app.report.plots import plot_plan  # with matplotlib

        plot_plan(plot, planned.checked.shots, planned.forecast, campaign.space)
        terminal.say(f"drawn: {plot}")
    wanted = programs.program is not None
    of_stages = _write_programs(terminal, campaign, programs, excel=excel) if wanted else ()
    answer = plan_answer(campaign, planned, until_mm, of_stages)
    terminal.conclude(answer, tell_next(terminal, campaign))


def _tell_written(terminal: Terminal, observations: PlannedObservations) -> None:
    """Print where planned observations are written, and how to go back to those before."""
    if observations.path is None:
        return
    terminal.say(f"written: {observations.path}")
    if observations.older is not None:
        _tell_way_back(terminal, "file", observations.older, observations.path)


def _tell_way_back(terminal: Terminal, what: str, older: Path, path: Path) -> None:
    back = shlex.join(["mv", str(older), str(path)])
    terminal.say(f"the {what} before is kept; to go back to it: {back}")


def _write_programs(
    terminal: Terminal, campaign: Campaign, options: ProgramOptions, *, excel: bool
) -> Sequence[WrittenProgram]:
    """Write the tables of poses and joints, and print their names."""
    written = write_programs(campaign, options)
    paths = [path for program in written for path in (program.path, program.joints_path)]
    for_spreadsheets(*paths, excel=excel)
    for program in written:
        for note in program.notes:
            terminal.note(note)
        terminal.say(
            f"written: {program.path}, {program.shots} shots, about {program.seconds / 60.0:.0f} "
            f"min; the joints that it commands: {program.joints_path}"
        )
    return written


def observations_answer(planned: PlannedObservations) -> ObservationsAnswer:
    """Return planned observations for programs."""
    return ObservationsAnswer(
        counts=Counter(row.object for row in planned.rows),
        seconds_estimated=planned.seconds,
        determined=[
            {**asdict(quantity), "unit": quantity.unit, "is_determined": quantity.is_determined}
            for quantity in planned.determined
        ],
        quantity=planned.quantity,
        gains=planned.gains,
        path=planned.path,
        older=planned.older,
    )


def plan_answer(
    campaign: Campaign,
    planned: PlannedCampaign,
    until_mm: float | None,
    programs: Sequence[WrittenProgram],
) -> PlanAnswer:
    """Return the plan for programs."""
    table, forecast = campaign.robot.mechanism.parameters, planned.forecast
    pairs = len(pairs_of(planned.checked.shots, ShotSet.IDENTIFICATION))
    std_mm, std_deg = forecast.position_std_mm, forecast.rotation_std_deg
    worst = {unit: forecast.worst(unit) for unit in ("mm", "deg")}
    space = None
    if planned.refusals is not None:
        space = {**asdict(planned.refusals), "by_zone": dict(planned.refusals.by_zone)}
    return PlanAnswer(
        shots=2 * pairs,
        pairs=pairs,
        placement=planned.placement,
        seed=planned.seed,
        until_mm=until_mm,
        position_std_mm={"mean": float(std_mm.mean()), "max": float(std_mm.max())},
        rotation_std_deg=None
        if std_deg is None
        else {"mean": float(std_deg.mean()), "max": float(std_deg.max())},
        predicted_std=forecast.std,
        weakest=[
            {"name": row[0], "std": row[1], "unit": unit, "group": table[row[0]].field.group}
            for unit, row in worst.items()
            if row is not None  # a mechanism of linear axes may have no angle
        ],
        from_below=forecast.from_below,
        repeats=planned.visits,
        fitting_lines_mm=planned.lines_mm,
        space=space,
        seconds_estimated=planned.checked.seconds,
        path=campaign.plan_path,
        older=planned.older,
        reflector_moves=planned.checked.reflector_moves,
        observations=None
        if planned.observations is None
        else observations_answer(planned.observations),
        programs=programs,
    )


def show(
    terminal: Terminal, campaign: Campaign, planned: PlannedCampaign, until_mm: float | None = None
) -> None:
    """Show the plan: number of shots, duration, refusals, predicted uncertainty."""
    detours = planned.checked.detours
    by_detours = f"; {detours} moves take a detour" if detours else ""
    terminal.say(f"{plan_text.plan_line(planned.checked)}{by_detours}")
    if moves := plan_text.moves_line(planned.checked):
        terminal.say(moves)
    if planned.refusals is not None:
        for line in plan_text.refusals_lines(campaign.space, planned.refusals):
            terminal.say(line)
    if warning := plan_text.plate_warning(campaign.space):
        terminal.say(warning, WARNING)
    if planned.lines_mm is not None:
        fitting = ", ".join(f"{mm:g}" for mm in planned.lines_mm)
        terminal.say(
            "validation.line_lengths_mm: the lines are too long for robot and space by more than a "
            f"third; [{fitting}] fit about validation.centre_mm",
            WARNING,
        )
    plan_text.show_forecast(terminal, campaign, planned, until_mm)
    if planned.observations is not None:
        show_observations(terminal, planned.observations)


def show_observations(terminal: Terminal, planned: PlannedObservations) -> None:
    """Show planned observations, what all of it determines, and what further ones would gain."""
    for line in plan_text.observations_lines(planned):
        terminal.say(line)
    terminal.rows("What this will determine, 1 σ", DETERMINED, planned.determined)
    words = f"σ of {planned.quantity}"
    columns = ("more of", words, "with these", "from tolerances", "time")
    terminal.table("What further observations would gain", columns, plan_text.gain_rows(planned))
    for line in plan_text.advice(planned):
        terminal.say(line)
