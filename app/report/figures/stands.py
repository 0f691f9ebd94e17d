"""Map of the tracker's stands, seen from above in the base frame."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from app.report.figures.drawing import in_house_style, new_figure
from app.report.figures.picture import INK, QUIET
from campaigns.planning.stands import Stand, best_stand

HEIGHT_MM = 155.0
CELL_PT2 = 190.0
"""Area of a stand: they hardly touch where they are nearest."""
SMALL_PT = 4.5
M_PER_MM = 1e-3
UM_PER_MM = 1e3


@in_house_style
def stands_map(stands: Sequence[Stand]) -> Figure:
    """Largest σ of a position from each stand, µm; hollow, how many shots are unseen."""
    figure = new_figure(HEIGHT_MM)
    axes = figure.subplots()
    x_m, y_m = M_PER_MM * np.array([stand.place_mm[:2] for stand in stands]).T
    std_um = UM_PER_MM * np.array([stand.position_std_mm for stand in stands])
    told = np.array([not stand.unseen for stand in stands]) & np.isfinite(std_um)
    if told.any():
        seen = axes.scatter(
            x_m[told], y_m[told], CELL_PT2, std_um[told], cmap="viridis_r", linewidths=0.0
        )
        figure.colorbar(seen, ax=axes, label="largest σ of a position, µm", shrink=0.6)
    hollow = partial(axes.scatter, facecolors="none", edgecolors=QUIET)
    hollow(x_m[~told], y_m[~told], CELL_PT2, linewidths=0.6)
    middle = 0.5 * (std_um[told].min() + std_um[told].max()) if told.any() else np.inf
    for x, y, stand, is_told, um in zip(x_m, y_m, stands, told, std_um, strict=True):
        lost = f"({stand.unseen})" if stand.unseen else "–"
        colour = "white" if is_told and um > middle else INK
        words = f"{um:.0f}" if is_told else lost
        axes.text(x, y, words, size=SMALL_PT, ha="center", va="center", color=colour)
    best = stands.index(best_stand(stands))
    hollow(x_m[best], y_m[best], 1.6 * CELL_PT2, edgecolors=INK)
    axes.plot(0.0, 0.0, "+", color=INK)
    axes.annotate("base", (0.0, 0.0), (3, 3), textcoords="offset points")
    axes.set(
        aspect="equal",
        xlabel="x of the base, m",
        ylabel="y, m",
        title="Stands of the tracker: the best is ringed; in brackets: shots it would not see",
    )
    return figure
