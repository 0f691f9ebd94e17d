# %% [markdown]
# # Identify a robot from a table of shots
# Each shot is the robot's joint values and the reflector's place in the tracker's frame. Here a
# drawn robot is measured by a tracker whose noise is drawn too; put your own arrays in their place.

# %%
import numpy as np

from pkmcal import (
    Shots,
    TrackerUncertainty,
    find_robot,
    identify,
    point_covariance_mm2,
    sample_workspace,
)

rng = np.random.default_rng(7)
robot = find_robot("par4-prototype")
tracker_mm = np.array([2400.0, -300.0, -450.0])

# %% [markdown]
# A true robot: every length 1 mm and every joint offset 0.1° off, at random.

# %%
errors = {name: rng.normal(0.0, 0.1 if name.endswith("_deg") else 1.0) for name in robot.parameters}
true = robot.of(
    robot.mechanism,
    {name: v + errors[name] * ("azimuth" not in name) for name, v in robot.parameters.items()},
    name="true",
    limits=robot.limits,
)
poses = sample_workspace(true, 80, seed=2)
joints = true.kinematics.inverse(poses).values_or_raise()
points_mm = poses[:, :3] - tracker_mm
covariance_mm2 = point_covariance_mm2(points_mm, TrackerUncertainty())
points_mm = points_mm + np.array([rng.multivariate_normal(np.zeros(3), c) for c in covariance_mm2])

# %% [markdown]
# Every fourth pair is kept for validation: the fit never sees it.

# %%
pairs = [row // 2 for row in range(len(joints))]
sets = ["validation" if pair % 4 == 0 else "identification" for pair in pairs]
shots = Shots.of(joints, points_mm, robot, sets=sets, pairs=pairs, covariance_mm2=covariance_mm2)
found = identify(shots, robot)
print(shots)
print(found)

# %% [markdown]
# Parameters with their σ, the budget of the uncertainty of positions, and findings. No shot shows
# where the base frame is, so single places have a meaning only beside the others; joint offsets and
# lengths do not depend on it.

# %%
print(found.report())
for name in found.value.free:
    if name.endswith(("arm_mm", "plate_mm")):
        parameter = found.value.parameters[name]
        wrong = (parameter.value - true.parameters[name]) / parameter.std
        print(f"{name:24} {parameter.value:10.4f} ± {parameter.std:.4f}  ({wrong:+.1f} σ off)")
found.plot().savefig("identify.svg")
