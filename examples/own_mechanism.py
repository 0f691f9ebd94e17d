# %% [markdown]
# # A mechanism of one's own
# A Par4 whose tool sits a quarter of the way along the plate. Limbs and platforms combine freely;
# kinematics, Jacobians, plan and identification follow.

# %%
import numpy as np

from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.limbs import Crank
from campaigns.kinematics.platforms import HingedPlate
from pkmcal import find_robot, plan, study

OWN = ClosedChain("quarter-par4", Crank(), HingedPlate(shares=(-0.25, -0.25, 0.75, 0.75)))

# %% [markdown]
# A package that offers it by an entry point has it in robot files and commands, by its word
# `mechanism: quarter-par4`:
#
#     [project.entry-points."pkmcal.mechanisms"]
#     quarter-par4 = "my_package:OWN"

# %%
par4 = find_robot("par4-prototype")
robot = par4.of(OWN, par4.parameters, name="own", limits=par4.limits)
pose = [30.0, -40.0, -600.0, np.radians(15.0)]
print(np.degrees(robot.kinematics.inverse(pose).values_or_raise()))

# %%
tracker_mm = (2400.0, -300.0, -450.0)
made = plan(robot, tracker_mm, shots=24, validation_pairs=4, seed=3)
print(made)
print(study(robot, made.shots, tracker_mm, campaigns=8, seed=1))
made.plot().savefig("plan.svg")
