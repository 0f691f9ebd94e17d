"""Plan and its predicted uncertainty, for people and for programs."""

from collections import Counter
from collections.abc import Iterator

from app.console import WARNING, Terminal
from app.progress import interval
from campaigns.campaign import Campaign
from campaigns.design.restricted_space import Refusals, RestrictedSpace
from campaigns.fit.error_sources import SOURCES
from campaigns.fit.kinds import KINDS
from campaigns.identification.determined import UNITS
from campaigns.identification.repeats import PlannedVisits
from campaigns.kinematics.parameters import SIGNS, ParameterTable
from campaigns.planning.forecast import Forecast
from campaigns.planning.plan_check import REFLECTOR_MOVE_S, CheckedPlan
from campaigns.shots.observations_csv import default_in_words
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.outlook import Gain
from campaigns.workflow.observation_plan import PlannedObservations
from campaigns.workflow.planning import PlannedCampaign

ONE_SIDED = 0.85
"""Share of approaches from one side above which the plan is warned about.

With all approaches from one side, backlash moves a joint by a constant, as a joint offset does."""
LEAST_GAIN = 0.1
"""Part of σ that ten more of a kind must take away to be worth naming: forecasts are no better."""
PREDICTED = (
    "predicted 1 σ; prior: every source of error at its tolerance; noise: the tracker's, as "
    "campaign.yaml states it"
)


def show_forecast(
    terminal: Terminal, campaign: Campaign, planned: PlannedCampaign, until_mm: float | None
) -> None:
    """Show the predicted uncertainty and warnings; with --verbose also that of each group."""
    forecast, table = planned.forecast, campaign.robot.mechanism.parameters
    for line in forecast_lines(forecast, table, until_mm):
        terminal.say(line)
    terminal.say(visits_line(planned.visits))
    for line in warnings(forecast):
        terminal.say(line, WARNING)
    if terminal.is_verbose:
        columns = ("source of error", "weakest", "predicted σ")
        terminal.table("Predicted uncertainty", columns, group_rows(forecast, table))
        terminal.say(PREDICTED)


def group_rows(forecast: Forecast, table: ParameterTable) -> list[tuple[str, ...]]:
    """Return a row for each group and unit: its words, its weakest parameter, and 1 σ of that."""
    # by unit too, because σ in mm and in degrees cannot be compared
    weakest: dict[tuple[str, str], str] = {}
    for name, std in forecast.std.items():
        key = table[name].field.group, table[name].unit
        if key not in weakest or std > forecast.std[weakest[key]]:
            weakest[key] = name
    return [
        (SOURCES[group].words, name, _std_text(name, forecast.std[name], table))
        for (group, _), name in weakest.items()
    ]


def forecast_lines(
    forecast: Forecast, table: ParameterTable, until_mm: float | None = None
) -> Iterator[str]:
    """Yield lines on the uncertainty of positions, the goal, and the weakest length and angle."""
    std_mm = forecast.position_std_mm
    yield (
        f"positions in the workspace ±{std_mm.mean():.4f} mm on average, "
        f"±{std_mm.max():.4f} mm at most (1 σ, predicted)"
    )
    if (std_deg := forecast.rotation_std_deg) is not None:
        yield (
            f"rotation of the tool ±{std_deg.mean():.4f}° on average, ±{std_deg.max():.4f}° at "
            "most (1 σ, predicted)"
        )
    if until_mm is not None:
        yield f"--until {until_mm:g}: ±{std_mm.mean():.4f} mm by {forecast.shots} shots"
    weakest = [
        f"{name} ±{_std_text(name, std, table)} ({SOURCES[table[name].field.group].words})"
        for name, std in filter(None, (forecast.worst(unit) for unit in ("mm", "deg")))
    ]
    if weakest:
        yield f"weakest: {', '.join(weakest)}"


def observations_lines(planned: PlannedObservations) -> Iterator[str]:
    """Yield how many observations of each object are planned, and the time that they take."""
    counts = Counter((row.kind, row.object) for row in planned.rows)
    held_out = Counter(row.object for row in planned.rows if row.purpose is ShotSet.VALIDATION)
    for (kind, name), count in counts.items():
        yield f"{count} {_plural(kind, name)}, {held_out[name]} of them held out to test the result"
    if planned.rows:
        yield f"observations take about {interval((planned.seconds, planned.seconds))}"
    if by_default := default_in_words(planned.rows):
        yield by_default


def gain_rows(planned: PlannedObservations) -> list[tuple[str, ...]]:
    """Return a row for each object, and for shots: what ten more gain, and the time they take."""
    unit = UNITS[planned.quantity]
    return [
        (
            _more(gain),
            f"{gain.now:.4f} {unit}",
            f"{gain.then:.4f} {unit}",
            f"{gain.assumed:.0%}",
            interval((gain.seconds, gain.seconds)),
        )
        for gain in planned.gains
    ]


def advice(planned: PlannedObservations) -> Iterator[str]:
    """Yield what to measure next, what not, and whether a length is missing."""
    useful = [gain for gain in planned.gains if gain.share >= LEAST_GAIN]
    if useful:
        best = useful[0]
        yield (
            f"gains most per minute: {_more(best)}, σ of {planned.quantity} "
            f"{best.now:.2g} → {best.then:.2g} {UNITS[planned.quantity]}"
        )
    for gain in planned.gains:
        if gain.share < LEAST_GAIN:
            yield f"{_more(gain)} gain next to nothing in {planned.quantity}"
    sized = next((q for q in planned.determined if q.name == planned.quantity), None)
    is_open = sized is not None and not sized.is_determined
    if planned.quantity in ("xy", "position") and is_open and not planned.has_lengths:
        yield "a length is missing: nothing that is planned has one, as distances on a part do"


def _more(gain: Gain) -> str:
    """Return further observations in words."""
    return f"{gain.count} {_plural(gain.kind, gain.name)}"


def _plural(kind: str, name: str) -> str:
    """Return observations of an object in words; a shot is of none."""
    kinds = KINDS[kind].plural if kind in KINDS else f"{kind}s"
    return kinds if name in (kind, kinds) else f"{kinds} of {name}"


def visits_line(visits: tuple[PlannedVisits, PlannedVisits]) -> str:
    """Return what visits of the drift pose will show, and what twice as many would and cost."""
    now, doubled = visits
    return (
        f"{now.visits} visits of the drift pose: scatter known to ±{now.scatter_std:.0%}, an error "
        f"that repeats shown from {now.shown_share:.0%} of its variance on; "
        f"{doubled.visits - now.visits} more (+ {interval((doubled.seconds, doubled.seconds))}): "
        f"±{doubled.scatter_std:.0%}, from {doubled.shown_share:.0%} on"
    )


def warnings(forecast: Forecast) -> Iterator[str]:
    """Yield a warning for each joint whose backlash the plan cannot separate from its offset."""
    for joint, share in enumerate(forecast.from_below):
        if max(share, 1.0 - share) > ONE_SIDED:
            side = "smaller" if share > ONE_SIDED else "larger"
            yield (
                f"joint {joint} comes from {side} values to {max(share, 1.0 - share):.0%} of the "
                "shots: its backlash would pass for a joint offset; try another --seed"
            )


def _std_text(name: str, std: float, table: ParameterTable) -> str:
    unit = table[name].unit
    return f"{std:.{1 if unit == 'ppm' else 4}f}{SIGNS[unit]}"


def refusals_lines(space: RestrictedSpace, refusals: Refusals) -> Iterator[str]:
    """Yield how far walls are kept off, and how many candidates the space and each zone refuse."""
    yield (
        f"space: walls are kept off the measured point by the plate's radius of "
        f"{space.plate_radius_mm:g} mm and a margin of {space.margin_mm:g} mm"
    )
    by_zone = [f"{count} by {name}" for name, count in refusals.by_zone if count]
    zones = f": {', '.join(by_zone)}" if by_zone else ""
    yield (
        f"{refusals.refused} of {refusals.tried} candidates that could be measured "
        f"are refused ({refusals.refused / refusals.tried:.0%}){zones}"
    )


def plate_warning(space: RestrictedSpace) -> str:
    """Return a warning if walls are kept off a plate of unknown radius; else an empty text."""
    if not space.is_restricted or space.plate_radius_mm > 0.0:
        return ""
    return (
        "the robot file does not say how far the plate reaches from the measured point: walls are "
        "kept off that point only; give space.plate_radius_mm in campaign.yaml"
    )


def plan_line(checked: CheckedPlan) -> str:
    """Return the shots of a plan and the time it takes, in one line."""
    counts = Counter(shot.purpose.value for shot in checked.shots)
    sets = ", ".join(f"{count} {purpose}" for purpose, count in counts.items())
    duration = interval((checked.seconds, checked.seconds))
    return f"{len(checked.shots)} shots ({sets}), about {duration}"


def moves_line(checked: CheckedPlan) -> str:
    """Return where the reflector is moved on the platform and the time of it; "" if nowhere."""
    if not (moves := checked.reflector_moves):
        return ""
    names = {shot.shot: shot.reflector or "where robot.yaml says" for shot in checked.shots}
    where = ", ".join(f"before shot {shot} ({names[shot]})" for shot in moves)
    seconds = REFLECTOR_MOVE_S * len(moves)
    return f"the reflector is moved {where}: {interval((seconds, seconds))} of this"
