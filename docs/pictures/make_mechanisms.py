"""Draws hexapod.svg, hexaglide.svg and five-bar.svg anew, from the shipped robots.

python docs/pictures/make_mechanisms.py
"""

from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.kinematics.rotations import matrices_of
from pkmcal import find_robot

HERE = Path(__file__).parent
WIDTH_PX, HEIGHT_PX, MARGIN_PX = 460, 330, 52
INK, FIXED, LEG, MOVED = "#22303c", "#66727d", "#1f4e79", "#c98a3d"
POSE = np.array([40.0, -30.0, 0.0, np.radians(8.0), np.radians(-6.0), np.radians(10.0)])
"""Beside the workspace's centre, so that nothing in the picture is symmetrical."""
LEGS = 6

Line = tuple[Array, str, float]
"""Points (N, 3), colour and width of a line."""
Word = tuple[Array, str]


def main() -> None:
    """Draw all three."""
    for name in ("hexapod", "hexaglide", "five-bar"):
        lines, words = five_bar() if name == "five-bar" else six_legs(name)
        (HERE / f"{name}.svg").write_text(svg(lines, words, name), encoding="utf-8")


def six_legs(name: str) -> tuple[list[Line], list[Word]]:
    """Legs between base or rails and a platform that is turned a little."""
    robot = find_robot(name)
    pose, values = robot.workspace_centre + POSE, robot.parameters
    base, ends = (
        np.array([[values[f"arm{leg}.{on}{c}_mm"] for c in "xyz"] for leg in range(LEGS)])
        for on in ("", "plate_")
    )
    ends = pose[:3] + ends @ matrices_of(pose[3:]).T
    lines: list[Line] = []
    if name == "hexaglide":
        low, high = robot.limits.joint_range
        rails = [base + np.array([0.0, 0.0, end]) for end in (low, high)]
        lines += [(np.array(rail), FIXED, 1.5) for rail in zip(*rails, strict=True)]
        base = base + robot.kinematics.inverse(pose).values_or_raise()[0][:, None] * [0, 0, 1.0]
    else:
        lines.append((np.vstack([base, base[:1]]), FIXED, 2.5))
    lines += [(np.array(leg), LEG, 2.5) for leg in zip(base, ends, strict=True)]
    lines.append((np.vstack([ends, ends[:1]]), MOVED, 3.0))
    words = [(base[3], "P₃ + q₃ e₃" if name == "hexaglide" else "a₃"), (ends[3], "b₃")]
    words += [(0.5 * (base[3] + ends[3]), "L₃" if name == "hexaglide" else "q₃"), (pose[:3], "X")]
    return [*lines, *frame(0.25 * np.ptp(base[:, 0]))], words


def five_bar() -> tuple[list[Line], list[Word]]:
    """Two cranks and two forearms in the plane of the page."""
    robot = find_robot("five-bar")
    pose, values = robot.workspace_centre + np.array([40.0, 10.0, 0.0]), robot.parameters
    turns = robot.kinematics.inverse(pose).values_or_raise()[0]
    lines: list[Line] = []
    words: list[Word] = [(pose, "X")]
    for arm, turn in enumerate(turns):
        motor = np.array([values[f"arm{arm}.x_mm"], values[f"arm{arm}.y_mm"], 0.0])
        angle = turn + np.radians(values[f"arm{arm}.joint_offset_deg"])
        elbow = motor + values[f"arm{arm}.arm_mm"] * np.array([np.cos(angle), np.sin(angle), 0.0])
        lines += [(np.array([motor, elbow]), LEG, 3.5), (np.array([elbow, pose]), MOVED, 2.5)]
        words += [(motor, f"P{'₀₁'[arm]}"), (elbow, f"elbow {arm}")]
    return [*lines, *frame(60.0)[:2]], words


def frame(size_mm: float) -> list[Line]:
    """Return the axes of the base frame."""
    return [(np.array([np.zeros(3), size_mm * axis]), INK, 1.0) for axis in np.eye(3)]


def svg(lines: list[Line], words: list[Word], name: str) -> str:
    """Return a picture: from above for a robot in a plane, else from the front and above."""
    seen = np.array([[0.9, 0.42, 0.0], [-0.16, 0.3, 0.94]])
    if name == "five-bar":
        seen = np.eye(3)[:2]
    flat = [points @ seen.T for points, _, _ in lines]
    low, high = np.vstack(flat).min(axis=0), np.vstack(flat).max(axis=0)
    scale = ((np.array([WIDTH_PX, HEIGHT_PX]) - 2 * MARGIN_PX) / (high - low)).min()
    aside = 0.5 * (WIDTH_PX - scale * (high - low)[0])

    def px(points: Array) -> list[str]:
        across, up = scale * (points @ seen.T - low).T
        return [f"{aside + x:.1f},{HEIGHT_PX - MARGIN_PX - y:.1f}" for x, y in np.c_[across, up]]

    size = f'viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}" width="{WIDTH_PX}"'
    text = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="13">',
        f'<rect width="{WIDTH_PX}" height="{HEIGHT_PX}" fill="#ffffff"/>',
    ]
    for points, colour, width in lines:
        text.append(
            f'<polyline points="{" ".join(px(points))}" fill="none" stroke="{colour}" '
            f'stroke-width="{width}" stroke-linejoin="round" stroke-linecap="round"/>'
        )
    axes = lines[-2 if name == "five-bar" else -3 :]
    labels = words + [(axis[0][1], word) for axis, word in zip(axes, "xyz", strict=False)]
    for place, word in labels:
        x, y = map(float, px(np.array([place]))[0].split(","))
        text.append(f'<text x="{x + 5:.1f}" y="{y - 5:.1f}" fill="{INK}">{word}</text>')
    return "\n".join([*text, "</svg>", ""])


if __name__ == "__main__":
    main()
