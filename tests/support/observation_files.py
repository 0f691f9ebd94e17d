"""Files of observations: what a drawn printer measures, as rows of observations.csv."""

import numpy as np

from campaigns.shots.observations_csv import ObservationRow
from campaigns.shots.shot_sets import ShotSet


def rows_of(measured, *, first_pair=1, **changed):
    """Rows of a block; the pairs of observations of two poses are numbered from one on."""
    joints = np.asarray(measured.joints)
    joints = joints.reshape(len(joints), -1, joints.shape[-1])
    values = np.asarray(measured.values).reshape(len(joints), -1)
    std = np.broadcast_to(np.asarray(measured.std_mm, dtype=float).reshape(-1), len(joints))
    purpose = ShotSet.VALIDATION if measured.held_out else ShotSet.IDENTIFICATION
    return [
        ObservationRow(
            kind=measured.kind,
            object=measured.object.name,
            joints=tuple(map(tuple, poses.tolist())),
            values=tuple(value.tolist()),
            std_mm=float(sigma),
            purpose=purpose,
            pair=str(first_pair + place) if len(poses) > 1 else "",
            **changed,
        )
        for place, (poses, value, sigma) in enumerate(zip(joints, values, std, strict=True))
    ]
