"""Course of a campaign: what the fit shows of each shot, in the order of time, as pictures.

A panel is drawn only where there is something to see: of a clean campaign these are the residuals
alone. Shots stand in the order in which they were measured; the axis names their numbers, by which
findings and options name them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from app.report.drawing import AFTER, BEFORE, INK, QUIET, legend_above, new_panel
from app.report.figures import DASHES, LINE_COLOURS, figures_of
from app.report.tables import part_of, size_of
from campaigns.arrays import AXES, Array
from campaigns.evidence import Evidence
from campaigns.fit.events import Event
from campaigns.identification.findings import NAMED_LOG_ODDS, PERIOD, STAND
from campaigns.identification.pictures import draw_arrows, magnification
from campaigns.identification.result import Diagnosis, RecordedIdentification
from campaigns.kinematics.mechanism import Mechanism
from campaigns.shots.shot_sets import ShotSet

SMALLEST_MM = 1e-3
"""Smallest residual that is drawn: the axis is logarithmic."""
ROW = 0.13
"""Height of a line with the name of a change, as a share of the axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Identification with the shots of its campaign in the order of time."""

    identification: RecordedIdentification
    diagnosis: Diagnosis
    numbers: tuple[int, ...]
    """Numbers of all shots, in the order of time."""
    mechanism: Mechanism

    @classmethod
    def of(cls, evidence: Evidence) -> "Course | None":
        """Return the course of the identified campaign; None without a diagnosis."""
        identification = evidence.identification
        if identification is None or identification.judgement.diagnosis is None:
            return None
        diagnosis = identification.judgement.diagnosis
        numbers = diagnosis.numbers
        # an update fitted the shots of a check, which have numbers of their own
        if evidence.run is not None and identification.provenance.pedigree is None:
            stops = evidence.run.stops
            rows = stops.rows_of(ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
            in_time = [row for row in stops.order_of_time().tolist() if row in set(rows.tolist())]
            measured = tuple(stops.numbers[row] for row in in_time)
            numbers = measured if {*numbers} <= {*measured} else numbers
        return cls(identification, diagnosis, numbers, evidence.campaign.robot.mechanism)

    @property
    def has_slow_stand(self) -> bool:
        """Whether the slow motion of the stand is more than noise."""
        return any(finding.name == STAND for finding in self.identification.judgement.findings)

    @property
    def has_period(self) -> bool:
        """Whether any period of the drives is likely enough to be named."""
        return max(self.diagnosis.rate_log_factors, default=0.0) > NAMED_LOG_ODDS

    @property
    def unexplained_mm(self) -> Array:
        """Errors without a known source at each fitted shot, in the base frame, (N, 3)."""
        in_tracker_mm = np.array(self.diagnosis.unexplained_mm).reshape(-1, 3)
        frame_of = self.identification.value.frame_of
        rotations = np.array([frame_of(number).rotation for number in self.diagnosis.numbers])
        return np.asarray(np.einsum("nji,nj->ni", rotations, in_tracker_mm))

    @property
    def left_out_mm(self) -> Array:
        """Places of the shots that were left out, (K, 3), by the nominal robot."""
        wrong = {event.first for event in self._events("wrong shot")}
        rows = [row for row, number in enumerate(self.diagnosis.numbers) if number in wrong]
        return np.array(self.diagnosis.places_mm)[rows].reshape(-1, 3)

    @property
    def stand_in_words(self) -> str:
        """Say by how much the stand moved slowly, where that is no more than noise."""
        moved_mm = [self._stand_mm(rows) for rows in self._sessions()]
        travel_mm = max(2.0 * float(np.linalg.norm(m, axis=1).max()) for m in moved_mm)
        return (
            "slow motion of the tracker's stand is no more than noise: "
            f"{max(travel_mm, 0.001):.1g} mm at most"
        )

    def panels(self) -> list[Figure]:
        """Return the panels in which there is something to see."""
        panels = [self._draw_residuals()]
        if self.has_slow_stand:
            panels.append(self._draw_stand())
        if self.has_period:
            panels.append(self._draw_periods())
        unexplained_mm = self.unexplained_mm
        if unexplained_mm.any():
            panels += self._draw_unexplained(unexplained_mm)
        return figures_of(panels)

    def caption(self) -> str:
        """Describe the panels that are drawn."""
        sentences = ["Shots in the order of time: errors by the identified model."]
        if self.has_slow_stand or self.identification.judgement.events:
            of_fitted = "of fitted shots without the motions and changes that were found"
            of_pairs = "of hold-out pairs by the parameters alone"
            sentences = [f"Shots in the order of time: errors {of_fitted}, {of_pairs}."]
        if any(self._events("wrong shot")):
            sentences.append("Crosses: wrong shots, by how far off they are.")
        if any(self._events("change")):
            sentences.append("Grey: shots that a change concerns, with its size ± U.")
        if any(self._events("no assembly")):
            sentences.append("Triangles: joints at which the robot cannot be assembled.")
        if self.has_slow_stand:
            sentences.append("Stand: in the tracker's axes, about the mean.")
        if self.has_period:
            sentences.append(
                "Periods: how much likelier a periodic error of the drives is than none, by its "
                "period. Above 0 it is added to the model if all periods together are likelier "
                "than none; above the dashed line, 100 times likelier, it is named."
            )
        if np.any(self.diagnosis.unexplained_mm):
            sentences.append("Arrows: errors that no source of the model explains, at the shots.")
        return " ".join(sentences)

    def _events(self, kind: str) -> Iterator[Event]:
        """Yield the events of a kind whose shots are on the axis of time."""
        for event in self.identification.judgement.events:
            if event.kind == kind and {event.first, event.last} <= {*self.numbers}:
                yield event

    def _places(self, numbers: Sequence[int]) -> Array:
        """Return the places of shots on the axis of time."""
        place_of = {number: place for place, number in enumerate(self.numbers)}
        return np.array([place_of[number] for number in numbers], dtype=np.float64)

    def _new_axes(self, title: str, y: str) -> Axes:
        axes = new_panel(title, "shot, in the order of time", y)
        ticks = np.linspace(0, len(self.numbers) - 1, min(7, len(self.numbers))).round().astype(int)
        axes.set_xticks(ticks, [str(self.numbers[tick]) for tick in ticks.tolist()])
        axes.set_xlim(-1.0, len(self.numbers))
        return axes

    def _draw_residuals(self) -> Axes:
        """Draw the residuals over time, with wrong shots and changes."""
        identification = self.identification
        axes = self._new_axes("errors of each shot", "error, mm")
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.labelpad = 1.0  # numbers such as 0.001 leave little room
        if (fitted := identification.residuals.fitted) is not None:
            sizes_mm = np.maximum(np.linalg.norm(fitted.after, axis=1), SMALLEST_MM)
            places = self._places(fitted.numbers)
            axes.plot(places, sizes_mm, "o", color=AFTER, markersize=2.4, label="fitted")
        if pairs := self._hold_out_pairs():
            places, errors_mm = np.transpose(pairs)
            look: Any = {"color": AFTER, "mfc": "white", "markersize": 2.8}
            sizes_mm = np.maximum(np.abs(errors_mm), SMALLEST_MM)
            axes.plot(places, sizes_mm, "D", **look, label="hold-out pairs")
        if wrong := [*self._events("wrong shot")]:
            places, sizes_mm = self._places([e.first for e in wrong]), [e.size for e in wrong]
            axes.plot(places, sizes_mm, "x", color=BEFORE, markersize=4.5, mew=1.4, label="wrong")
        if without := [*self._events("no assembly")]:
            places = self._places([event.first for event in without])
            axes.plot(
                places, np.full(len(places), 0.03), "^", color=INK, label="no assembly",
                transform=axes.get_xaxis_transform(),
            )  # fmt: skip
        self._draw_changes(axes)
        low, high = axes.get_ylim()
        steps = (1.0, 2.0, 5.0) if high < 300.0 * low else (1.0,)
        axes.yaxis.set_major_locator(LogLocator(subs=steps))
        legend_above(axes, 4)
        return axes

    def _hold_out_pairs(self) -> list[tuple[float, float]]:
        """Return place in time and error of distance of each hold-out pair, mm."""
        residuals = self.identification.residuals
        unseen, modelled = residuals.unseen, residuals.modelled
        if unseen is None or unseen.of != "pairs" or modelled is None:
            return []
        rows = zip(modelled.pairs, modelled.purposes, modelled.numbers, strict=True)
        last_shot = {p: n for p, purpose, n in rows if purpose is ShotSet.VALIDATION}
        errors_mm = dict(zip(unseen.numbers, unseen.after[:, 0].tolist(), strict=True))
        return [
            (float(self._places([last_shot[pair]])[0]), error_mm)
            for pair, error_mm in errors_mm.items()
            if last_shot.get(pair) in self.numbers
        ]

    def _draw_changes(self, axes: Axes) -> None:
        """Shade the shots that each change concerns, and write part and size above the marks."""
        changes = [*self._events("change")]
        if not changes:
            return
        # the names stand above all marks, a line for each, on the side with more room
        low, high = np.log10(axes.get_ylim())
        axes.set_ylim(top=10.0 ** (low + (high - low) / (1.0 - min(ROW * len(changes), 0.6))))
        for line, event in enumerate(changes):
            first, last = self._places([event.first, event.last]).tolist()
            axes.axvspan(first - 0.5, last + 0.5, color=QUIET, alpha=0.16, linewidth=0.0)
            axes.axvline(first - 0.5, color=INK, linewidth=0.8, linestyle="--")
            size = size_of(event, self.mechanism.joints)
            is_right = first > 0.5 * len(self.numbers)
            axes.text(
                first - 1.0 if is_right else first + 0.5, 0.99 - ROW * line,
                f"{part_of(event)} {size}", transform=axes.get_xaxis_transform(), size=6.0,
                ha="right" if is_right else "left", va="top",
            )  # fmt: skip

    def _sessions(self) -> Iterator[list[int]]:
        """Yield the rows of the diagnosis by session."""
        sessions = [{*session.shots} for session in self.identification.value.sessions]
        for shots in sessions or [{*self.diagnosis.numbers}]:
            rows = [row for row, number in enumerate(self.diagnosis.numbers) if number in shots]
            if rows:
                yield rows

    def _stand_mm(self, rows: Sequence[int]) -> Array:
        """Return the slow motion of the stand at these rows about its mean, (N, 3)."""
        moved_mm = np.array(self.diagnosis.stand_mm)[list(rows)]
        return np.asarray(moved_mm - moved_mm.mean(axis=0))

    def _draw_stand(self) -> Axes:
        axes = self._new_axes("slow motion of the stand", "moved, µm")
        for rows in self._sessions():
            moved_um = 1000.0 * self._stand_mm(rows)
            places = self._places([self.diagnosis.numbers[row] for row in rows])
            for axis, column in zip(AXES, moved_um.T, strict=True):
                axes.plot(places, column, DASHES[axis], color=LINE_COLOURS[axis], label=axis)
        axes.axhline(0.0, color=QUIET, linewidth=0.7)
        legend_above(axes, 3)
        return axes

    def _draw_periods(self) -> Axes:
        """Draw the log Bayes factor of a periodic error over its period."""
        rates = np.array(self.diagnosis.rates)
        x, places = "periods a turn", rates
        if not self.mechanism.rates_are_of_turns:
            x, places = "period, mm", 2.0 * np.pi / rates
        axes = new_panel("periodic errors of the drives", x, "log Bayes factor")
        axes.plot(places, self.diagnosis.rate_log_factors, color=AFTER, linewidth=0.8)
        axes.axhline(0.0, color=QUIET, linewidth=0.7, label="0: as likely as none")
        axes.axhline(
            NAMED_LOG_ODDS, color=INK, linewidth=0.8, linestyle="--", label="log 100: named"
        )
        for finding in self.identification.judgement.findings:
            if finding.name == PERIOD:
                rate = float(finding.numbers["rate"])
                place = rate if self.mechanism.rates_are_of_turns else 2.0 * np.pi / rate
                axes.text(
                    place, 0.99, f"{place:.4g}", transform=axes.get_xaxis_transform(), size=6.0,
                    va="top",
                )  # fmt: skip
        legend_above(axes, 2)
        return axes

    def _draw_unexplained(self, unexplained_mm: Array) -> Iterator[Axes]:
        """Yield the errors without a known source as arrows, from above and from the side."""
        places_mm = np.array(self.diagnosis.places_mm)
        factor = magnification(unexplained_mm, places_mm)
        for view, axis, side in (("above", 1, "y, mm"), ("the side", 2, "z, mm")):
            title = f"unexplained, from {view}: {factor:g} × error"
            axes = new_panel(title, "x, mm", side)
            draw_arrows(axes, places_mm[:, [0, axis]], factor * unexplained_mm[:, [0, axis]], AFTER)
            yield axes
