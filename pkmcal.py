"""The Python API of pkmcal, and the way into its command line.

A name of the API is imported when it is used, because `pkmcal --help` needs none of them.
"""

# The packages have plain names, such as `app`. Python would take any folder of such a name that
# comes first on its path, and fail later with an error about something else. So before the first
# import `_find_obstacle` compares where each package would come from, and names what hides it.

import os
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from app.new_campaign import NewOptions, create_campaign, create_simulated
    from app.wiring import connected_cell, prepare
    from campaigns.api import (
        correct_targets,
        find_robot,
        identify,
        plan,
        read_observations,
        read_shots,
        sample_workspace,
        study,
    )
    from campaigns.assessment import evaluate
    from campaigns.campaign import open_campaign
    from campaigns.design.pose_sampling import WorkspaceTooSmall
    from campaigns.errors import (
        ConfigInvalid,
        OptionsInvalid,
        PlanInvalid,
        ShotsInvalid,
        ShotsMissing,
        TargetsInvalid,
    )
    from campaigns.fit.rigid_transforms import fit_transform
    from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
    from campaigns.identification.objects import Object
    from campaigns.identification.other_kinds import Measured
    from campaigns.kinematics.axes import PLANE, POSITION, TURN, TURNS, Axis
    from campaigns.kinematics.closed_chain import ClosedChain
    from campaigns.kinematics.feasibility import Limits
    from campaigns.kinematics.implicit import ImplicitMechanism, closures
    from campaigns.kinematics.limbs import Carriage, Crank, place_fields, transmission_fields
    from campaigns.kinematics.model import Kinematics
    from campaigns.kinematics.parameters import ParameterField, Role
    from campaigns.kinematics.platforms import HingedPlate, Platform, SlidingBars
    from campaigns.kinematics.rotations import matrices_of, turn_between, turned_by
    from campaigns.robots.robot import RobotFile
    from campaigns.shots.shots import Shots
    from campaigns.workflow import campaign_steps as workflow

# Read when NumPy is imported. Our matrices are small: threads that wait for each other make a
# decomposition of 0.1 ms take 10 ms, once for every shot.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

HERE = Path(__file__).resolve().parent
PACKAGES = ("app", "campaigns", "drivers", "sim")
BAD_INPUT = 2
"""Exit code, as `app.exits` has it."""

KINEMATICS = "campaigns.kinematics"
MECHANISMS = {
    "axes": ("PLANE", "POSITION", "TURN", "TURNS", "Axis"),
    "closed_chain": ("ClosedChain",),
    "feasibility": ("Limits",),
    "implicit": ("ImplicitMechanism", "closures"),
    "limbs": ("Carriage", "Crank", "place_fields", "transmission_fields"),
    "parameters": ("ParameterField", "Role"),
    "platforms": ("HingedPlate", "Platform", "SlidingBars"),
    "rotations": ("matrices_of", "turn_between", "turned_by"),
}
"""What an author of a mechanism needs, by module of `KINEMATICS`."""
ERRORS = (
    "ConfigInvalid",
    "OptionsInvalid",
    "PlanInvalid",
    "ShotsInvalid",
    "ShotsMissing",
    "TargetsInvalid",
)
"""Errors that these functions raise, each with `problem` and `remedy`."""
HOMES = {name: f"{KINEMATICS}.{home}" for home, names in MECHANISMS.items() for name in names}
HOMES |= dict.fromkeys(ERRORS, "campaigns.errors") | {
    "Kinematics": "campaigns.kinematics.model",
    "Measured": "campaigns.identification.other_kinds",
    "Object": "campaigns.identification.objects",
    "NewOptions": "app.new_campaign",
    "WorkspaceTooSmall": "campaigns.design.pose_sampling",
    "RobotFile": "campaigns.robots.robot",
    "Shots": "campaigns.shots.shots",
    "TrackerUncertainty": "campaigns.fit.tracker_noise",
    "connected_cell": "app.wiring",
    "create_campaign": "app.new_campaign",
    "create_simulated": "app.new_campaign",
    "evaluate": "campaigns.assessment",
    "fit_transform": "campaigns.fit.rigid_transforms",
    "open_campaign": "campaigns.campaign",
    "point_covariance_mm2": "campaigns.fit.tracker_noise",
    "prepare": "app.wiring",
}
"""Modules of the names that are not in `campaigns.api`."""

__all__ = [
    "PLANE",
    "POSITION",
    "TURN",
    "TURNS",
    "Axis",
    "Carriage",
    "ClosedChain",
    "ConfigInvalid",
    "Crank",
    "HingedPlate",
    "ImplicitMechanism",
    "Kinematics",
    "Limits",
    "Measured",
    "NewOptions",
    "Object",
    "OptionsInvalid",
    "ParameterField",
    "PlanInvalid",
    "Platform",
    "RobotFile",
    "Role",
    "Shots",
    "ShotsInvalid",
    "ShotsMissing",
    "SlidingBars",
    "TargetsInvalid",
    "TrackerUncertainty",
    "WorkspaceTooSmall",
    "closures",
    "connected_cell",
    "correct_targets",
    "create_campaign",
    "create_simulated",
    "evaluate",
    "find_robot",
    "fit_transform",
    "identify",
    "matrices_of",
    "open_campaign",
    "place_fields",
    "plan",
    "point_covariance_mm2",
    "prepare",
    "read_observations",
    "read_shots",
    "sample_workspace",
    "study",
    "transmission_fields",
    "turn_between",
    "turned_by",
    "workflow",
]


def __getattr__(name: str) -> object:
    """Import the class, function or module of that name."""
    if name not in __all__:
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}"
        )
    if obstacle := _find_obstacle():
        raise ImportError(obstacle)
    if name == "workflow":
        return import_module("campaigns.workflow.campaign_steps")
    return getattr(import_module(HOMES.get(name, "campaigns.api")), name)


def __dir__() -> list[str]:
    """Return the names that an interactive prompt completes."""
    return __all__


def main() -> None:
    """Run the command line, and leave with its exit code."""
    if obstacle := _find_obstacle():
        sys.stderr.write(f"pkmcal: {obstacle}\n")
        sys.exit(BAD_INPUT)
    from app.main import main as run

    run()


def _find_obstacle() -> str:
    """Return a line about the folder that hides one of our packages; "" if none does."""
    for package in PACKAGES:
        spec = find_spec(package)
        # a package has folders, a module that hides it has a file, a namespace perhaps neither
        places = (
            [*(spec.submodule_search_locations or [spec.origin or "?"])] if spec else ["nothing"]
        )
        if HERE / package not in {Path(place).resolve() for place in places}:
            return (
                f"{places[0]} stands in the way of pkmcal's own package {package} "
                "→ take its folder out of PYTHONPATH, or start elsewhere"
            )
    return ""


if __name__ == "__main__":
    main()
