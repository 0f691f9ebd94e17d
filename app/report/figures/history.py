"""Parameters and errors over campaigns."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from app.report.figures import drawing
from app.report.figures.picture import AFTER, BEFORE
from campaigns.evaluation.decision import COVERAGE
from campaigns.evaluation.trend import Epoch, ParameterTrend

MOVERS = 6
"""Lines that a panel can hold apart."""
MARKERS = "os^Dv<"


@drawing.in_house_style
def over_campaigns(epochs: Sequence[Epoch], moved: Sequence[ParameterTrend]) -> Figure:
    """Largest movers in mm and in deg with U (k = 2), and mean errors of distances, over time."""
    figure = drawing.new_figure(150.0)
    lengths, angles, errors = figure.subplots(3, 1, sharex=True)
    for axes, unit in ((lengths, "mm"), (angles, "deg")):
        own = [each for each in moved if each.changes[0].unit == unit]
        own.sort(key=lambda each: -max(abs(change.ratio or 0.0) for change in each.changes))
        for place, (each, marker) in enumerate(zip(own[:MOVERS], MARKERS, strict=False)):
            at = [epochs[change.epoch - 1].at for change in each.changes]
            size = [change.delta for change in each.changes]
            u = [COVERAGE * change.std for change in each.changes]
            shade = str(0.65 * place / MOVERS)
            axes.errorbar(at, size, u, fmt=f"{marker}-", color=shade, capsize=2, label=each.name)
        if own:
            axes.legend(loc="upper left", ncols=3)
        else:
            drawing.say_instead(axes, "nothing changed by more than its σ")
        drawing.zero_line(axes)
        axes.set_ylabel(f"change since the first, {unit}")
    for stage, color in (("before", BEFORE), ("after", AFTER)):
        told = [(each.at, value) for each in epochs if (value := getattr(each, stage))]
        if told:
            mm = [value.value_mm for _, value in told]
            u = [value.expanded_uncertainty_mm for _, value in told]
            errors.errorbar([at for at, _ in told], mm, u, fmt="o-", color=color, label=stage)
            errors.legend(loc="upper left", ncols=2)
    errors.set_ylabel("mean distance error, mm")
    errors.set_ylim(bottom=0.0)
    figure.autofmt_xdate()
    return figure
