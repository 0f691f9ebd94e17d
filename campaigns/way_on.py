"""Next step after an identification that did not pass, by the first finding against it. Pure."""

from collections.abc import Sequence

from campaigns.identification import findings
from campaigns.identification.result import RecordedIdentification
from campaigns.next_step import NextStep

ENOUGH_SHOTS = 240
"""Number of shots to identify from, beyond which more tell nothing new."""
FEWEST_SHOTS = 40
"""Number of shots from which a part can be identified alone, or some pairs be kept unseen."""
BUILT_SO = "look at units, joints and robot.yaml; if the robot is built so"
MEND = "mend what the findings name"


def way_on(
    found: RecordedIdentification, shots: Sequence[int], folder: str, *, imported: bool
) -> NextStep:
    """Return the step after an identification from shots of these numbers.

    `imported` says whether shots are imported. A remedy by an option is named only where the
    identification had none: two remedies would have to be typed together.
    """
    name = next(iter(found.obstacles), "")
    numbers = next((own.numbers for own in found.findings if own.name == name), {})
    again = NextStep(
        ("import", folder, "FILE") if imported else ("run", folder, "--anew"),
        f"{MEND}, measure again" if imported else MEND,
    )
    if found.asked or found.pedigree is not None:
        return again
    match name:
        case findings.BEYOND_TOLERANCE:
            return NextStep(("identify", folder, "--accept-large-change"), BUILT_SO)
        case findings.CHANGE:
            first = int(float(numbers["before_shot"]))
            later = [number for number in shots if number >= first]
            earlier = [number for number in shots if number < first]
            if max(len(later), len(earlier)) < FEWEST_SHOTS or "last_shot" in numbers:
                return again
            part = f"{first}-" if len(later) >= len(earlier) else f"-{max(earlier)}"
            return NextStep(("identify", folder, "--shots", part))
        case findings.NOTHING_UNSEEN if len(shots) >= FEWEST_SHOTS:
            return NextStep(("identify", folder, "--hold-out", "20%"))
        case findings.NOTHING_UNSEEN | findings.EXTRAPOLATION if len(shots) < ENOUGH_SHOTS:
            if imported:
                return NextStep(again.command, "measure pairs of the set validation as well")
            return NextStep(("plan", folder, "--shots", str(2 * len(shots))))
    return again
