"""All figures of the paper's simulation and experiment, in its order."""

from app.papers.corbel2006 import printed
from app.papers.corbel2006.experiments import PROTOTYPE, REPEATABILITY, SIMULATION
from app.papers.corbel2006.printed import Printed
from app.papers.corbel2006.quantities import (
    Asked,
    Group,
    OfStage,
    Quantity,
    after,
    at_most,
    before,
    gain_percent,
    largest_of,
    middle_missed,
    straightness,
    worst_missed,
)
from app.papers.corbel2006.reasons import Reason

STRAIGHTNESS_ASKED = {"x": Asked(5.3, 6.6), "y": Asked(4.3, 5.6), "z": Asked(0.5, 1.4)}
STRAIGHTNESS_REASON = {
    "x": Reason.BELOW_REPEATABILITY,
    "y": Reason.REAL_ROBOT,
    "z": Reason.REAL_ROBOT,
}


def _largest_errors(
    printed_before: Printed, printed_after: Printed, reason: Reason, unseen: Asked | None = None
) -> tuple[Quantity, ...]:
    """Figs. 7 and 8: of pairs that were fitted, and of those that were not."""
    return (
        Quantity("fitted pairs, before", largest_of(lambda r: r.fitted.before_mm), printed_before),
        Quantity(
            "fitted pairs, after",
            largest_of(lambda r: r.fitted.after_mm),
            printed_after,
            reason,
            decimals=3,
        ),
        Quantity(
            "unseen pairs, after", largest_of(lambda r: r.unseen.after_mm), asked=unseen, decimals=3
        ),
    )


def _parameters(
    lengths: Printed,
    angles: Printed,
    lengths_asked: Asked | None = None,
    angles_asked: Asked | None = None,
) -> tuple[Quantity, ...]:
    """How far estimated parameters are from the true ones."""
    reason = Reason.ONE_DRAW
    return (
        Quantity(
            "worst of 18 lengths", worst_missed("mm"), lengths, reason, lengths_asked, decimals=3
        ),
        Quantity("middle one of 18 lengths", middle_missed("mm"), decimals=3),
        Quantity("worst of 4 angles", worst_missed("deg"), angles, reason, angles_asked, "deg", 4),
        Quantity("middle one of 4 angles", middle_missed("deg"), unit="deg", decimals=4),
    )


def _line(axis: str) -> tuple[Quantity, ...]:
    """Table III: before, after and gain along one axis."""
    of, reason = straightness(axis), STRAIGHTNESS_REASON[axis]
    was, became = printed.STRAIGHTNESS_BEFORE[axis], printed.STRAIGHTNESS_AFTER[axis]
    gain, asked = printed.STRAIGHTNESS_GAIN[axis], STRAIGHTNESS_ASKED[axis]
    gained = gain_percent(of)
    why = Reason.GAIN_ALONG_Z if axis == "z" else reason
    return (
        Quantity(f"along {axis}, before", before(of), was, Reason.READING, asked),
        Quantity(f"along {axis}, after", after(of), became, reason, at_most(0.7)),
        Quantity(f"along {axis}, gain", gained, gain, why, unit="%", decimals=0),
    )


def _distances(
    name: str, of: OfStage, paper: tuple[Printed, Printed, Printed], asked: Asked
) -> tuple[Quantity, ...]:
    """Table IV: before, after and gain of the mean or the largest error."""
    was, became, gain = paper
    reason = Reason.PAIRS
    return (
        Quantity(f"{name}, before", before(of), was, reason),
        Quantity(f"{name}, after", after(of), became, Reason.REAL_ROBOT, asked),
        Quantity(f"{name}, gain", gain_percent(of), gain, reason, unit="%", decimals=0),
    )


GROUPS = (
    Group(
        "Fig. 7: largest error of distance, Table I's errors",
        SIMULATION,
        _largest_errors(printed.LARGEST_BEFORE, printed.LARGEST_AFTER, Reason.NOISE, at_most(0.05)),
    ),
    Group(
        "Section IV.D: parameters missed by",
        SIMULATION,
        _parameters(printed.LENGTHS, printed.ANGLES, at_most(0.25), at_most(0.015)),
    ),
    Group(
        "Section IV.D: the same with ± 0.4/√3 mm of repeatability",
        REPEATABILITY,
        (
            *_largest_errors(
                printed.LARGEST_BEFORE, printed.LARGEST_WITH_REPEATABILITY, Reason.LARGEST_OF_A_DRAW
            )[1:],
            *_parameters(printed.LENGTHS_WITH_REPEATABILITY, printed.ANGLES_WITH_REPEATABILITY),
        ),
    ),
    Group(
        "Section IV.E.1: repeatability, 28 approaches",
        PROTOTYPE,
        (
            Quantity("radius of the sphere", before(lambda stage: stage.radius_mm), printed.RADIUS),
            Quantity("RP as ISO 9283 forms it", before(lambda stage: stage.rp_mm)),
        ),
    ),
    Group(
        "Fig. 8: largest error of distance, Table II's errors",
        PROTOTYPE,
        _largest_errors(printed.EXPERIMENT_BEFORE, printed.EXPERIMENT_AFTER, Reason.REAL_ROBOT),
    ),
    Group(
        "Section IV.E.3: motion while only θ turns",
        PROTOTYPE,
        (
            Quantity(
                "rotation, before",
                before(lambda stage: stage.rotation_mm),
                printed.ROTATION_BEFORE,
                Reason.READING,
                Asked(1.7, 3.0),
            ),
            Quantity(
                "rotation, after",
                after(lambda stage: stage.rotation_mm),
                printed.ROTATION_AFTER,
                Reason.BELOW_REPEATABILITY,
                at_most(0.6),
            ),
        ),
    ),
    Group(
        "Table III: straightness",
        PROTOTYPE,
        (*_line("x"), *_line("y"), *_line("z")),
    ),
    Group(
        "Table IV: errors of distances, validation points",
        PROTOTYPE,
        (
            *_distances(
                "mean",
                lambda stage: stage.distance_mean_mm,
                (printed.MEAN_BEFORE, printed.MEAN_AFTER, printed.MEAN_GAIN),
                at_most(0.4),
            ),
            *_distances(
                "max",
                lambda stage: stage.distance_max_mm,
                (printed.MAX_BEFORE, printed.MAX_AFTER, printed.MAX_GAIN),
                at_most(1.2),
            ),
        ),
    ),
    Group(
        "Eq. (22)–(25): errors in the tracker's frame",
        PROTOTYPE,
        (
            Quantity("mean, before", before(lambda stage: stage.frame_mean_mm)),
            Quantity("mean, after", after(lambda stage: stage.frame_mean_mm)),
            Quantity("max, before", before(lambda stage: stage.frame_max_mm)),
            Quantity("max, after", after(lambda stage: stage.frame_max_mm)),
        ),
    ),
)
