"""Robots of every mechanism whose controllers keep nominal parameters, and poses for them."""

from functools import cached_property

import numpy as np
from family_cases import MEMBERS, Member

from campaigns.mechanisms.mechanism import Kinematics
from campaigns.robots.robot import find_robot


class Target(Member):
    """A mechanism with poses that its nominal and its perturbed robot can take."""

    def poses(self, count, seed=1):
        return self.reachable_poses(self.nominal, count, seed, self.well_inside)


class Par4Target(Target):
    """Par4, of which the reference model of the family says nothing."""

    @cached_property
    def shipped(self):
        return find_robot("par4-prototype").robot

    @property
    def perturbed(self):
        names = self.space.free_by_default
        shift = np.random.default_rng(8).uniform(-1.0, 1.0, len(names))
        p = self.nominal.p.copy()
        angles = self.space.is_angle[self.space.places(names)]
        p[self.space.places(names)] += shift * np.where(angles, np.radians(0.3), 1.0)
        return Kinematics(self.mechanism, p)


TARGETS = (*(Target(member.name) for member in MEMBERS), Par4Target("par4"))
