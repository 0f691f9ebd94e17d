# %% [markdown]
# # An estimator of one's own
# pkmcal gives the whitened residuals with their analytic Jacobian; which solver and which loss take
# them is up to you. Here SciPy's with a soft L1 loss, against three shots with the beam broken.

# %%
import numpy as np
from scipy.optimize import least_squares

from pkmcal import Shots, find_robot, point_residuals, sample_workspace

rng = np.random.default_rng(3)
robot = find_robot("delta")
longer = {name: v + 0.5 * name.endswith("forearm_mm") for name, v in robot.parameters.items()}
true = robot.of(robot.mechanism, longer, name="true", limits=robot.limits)
poses = sample_workspace(true, 60, seed=5)
joints = true.kinematics.inverse(poses).values_or_raise()
points_mm = poses[:, :3] - [1800.0, 500.0, -600.0] + rng.normal(0.0, 0.01, (60, 3))
points_mm[[4, 17, 40]] += [3.0, -2.0, 1.0]

# %%
noise_mm2 = 0.01**2 * np.eye(3)
residuals = point_residuals(Shots.of(joints, points_mm, robot, covariance_mm2=noise_mm2), robot)
solved = least_squares(
    residuals.residual,
    residuals.start(),
    residuals.jacobian,
    x_scale="jac",  # mm beside rad
    loss="soft_l1",
)
identified = residuals.model.kinematics(residuals.parameters(solved.x)).parameters
for name in ("arm0.forearm_mm", "arm1.forearm_mm", "arm2.forearm_mm"):
    print(name, f"{identified[name] - robot.parameters[name]:+.4f} mm of 0.5 mm")

# %% [markdown]
# How poses follow the encoders: the last row's d(pose)/d(joints), mm/rad.

# %%
print(robot.kinematics.joint_jacobian(joints[-1], poses[-1])[0].round(1))
