"""The kinematics from the shots: what is known before, what is fitted, what came of it."""
