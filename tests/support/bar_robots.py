"""Robots of bars: parameters by name of a hexapod, a hexaglide and a five-bar, and their poses."""

import json

import numpy as np

CORNERS_DEG = (
    (5.0, 55.0),
    (115.0, 65.0),
    (125.0, 175.0),
    (235.0, 185.0),
    (245.0, 295.0),
    (355.0, 305.0),
)
"""Directions of each leg's joint on the base and on the platform."""


def _on_circle(radius_mm, angle_deg):
    return radius_mm * np.cos(np.radians(angle_deg)), radius_mm * np.sin(np.radians(angle_deg))


def _legs(base_mm, plate_mm, more):
    flat = {}
    for arm, (below, above) in enumerate(CORNERS_DEG):
        x, y = _on_circle(base_mm, below)
        plate_x, plate_y = _on_circle(plate_mm, above)
        row = {"x_mm": x, "y_mm": y, "z_mm": 0.0, "plate_x_mm": plate_x, "plate_y_mm": plate_y}
        row |= {"plate_z_mm": 0.0, **more(below)}
        flat |= {f"arm{arm}.{key}": float(value) for key, value in row.items()}
    return flat


HEXAPOD = _legs(400.0, 150.0, lambda _: {"joint_offset_mm": 450.0})
HEXAGLIDE = _legs(
    400.0,
    150.0,
    lambda around: {
        "azimuth_deg": around,
        "elevation_deg": 60.0,
        "joint_offset_mm": 30.0,
        "forearm_mm": 600.0,
    },
)
FIVE_BAR = {
    f"arm{arm}.{key}": value
    for arm, x_mm in enumerate((-100.0, 100.0))
    for key, value in (
        ("x_mm", x_mm), ("y_mm", 0.0), ("joint_offset_deg", 90.0), ("arm_mm", 200.0),
        ("forearm_mm", 250.0),
    )
}  # fmt: skip
HOMES = {
    "hexapod": (0.0, 0.0, -550.0),
    "hexaglide": (0.0, 0.0, -450.0),
    "five-bar": (0.0, 280.0, 0.0),
}
ROBOTS = {"hexapod": HEXAPOD, "hexaglide": HEXAGLIDE, "five-bar": FIVE_BAR}


def poses_of(name, count, seed):
    """Poses (count, 6) around the middle: x, y, z in mm and a rotation vector in rad."""
    draw = np.random.default_rng(seed)
    poses = np.zeros((count, 6))
    poses[:, :3] = HOMES[name] + draw.uniform(-70.0, 70.0, (count, 3))
    poses[:, 3:] = draw.uniform(-0.25, 0.25, (count, 3))
    if name == "five-bar":
        poses[:, 2:] = 0.0
    return poses


LIMITS = {
    "hexapod": {
        "joint_mm": [0.0, 300.0],
        "x_mm": [-150.0, 150.0],
        "y_mm": [-150.0, 150.0],
        "z_mm": [-650.0, -450.0],
        "rx_deg": [-15.0, 15.0],
        "ry_deg": [-15.0, 15.0],
        "rz_deg": [-20.0, 20.0],
    },
    "hexaglide": {
        "joint_mm": [-250.0, 350.0],
        "x_mm": [-100.0, 100.0],
        "y_mm": [-100.0, 100.0],
        "z_mm": [-520.0, -380.0],
        "rx_deg": [-15.0, 15.0],
        "ry_deg": [-15.0, 15.0],
        "rz_deg": [-15.0, 15.0],
    },
    "five-bar": {"joint_deg": [-120.0, 120.0], "x_mm": [-150.0, 150.0], "y_mm": [150.0, 400.0]},
}


def robot_file(folder, name):
    """Path of a new robot file."""
    arms = {}
    for key, value in ROBOTS[name].items():
        arm, _, field = key.partition(".")
        arms.setdefault(arm, {})[field] = round(value, 6)
    document = {
        "schema": "pkmcal/robot/1",
        "mechanism": name,
        "name": f"a {name}",
        "geometry": {"arms": list(arms.values())},
        "limits": LIMITS[name],
    }
    path = folder / f"{name}.yaml"
    path.write_text(json.dumps(document), encoding="utf-8")  # every JSON is a YAML
    return path
