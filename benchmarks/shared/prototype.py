"""The robot of most yardsticks: par4-prototype, its reflector seen from everywhere."""

from math import pi

from campaigns.mechanisms.par4 import PAR4
from campaigns.planning.plans import View, region_of
from campaigns.robots.robot import find_robot
from drivers.values import Pose

ROBOT = find_robot("par4-prototype").robot
NOMINAL = ROBOT.kinematics
SPACE = PAR4.parameters
FREE = SPACE.free_by_default
FREE_PLACES = SPACE.places(FREE)
FREE_ANGLES = SPACE.is_angle[FREE_PLACES]
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
EVERYWHERE = View((2500.0, 0.0, -575.0), (1.0, 0.0, 0.0), pi)
REGION = region_of(NOMINAL, ROBOT.limits, EVERYWHERE, CENTRE)
"""All that the robot reaches."""
