"""LinuxCNC as the robot's controller."""
