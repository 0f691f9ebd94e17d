#!/usr/bin/python3
"""Make a LinuxCNC without a screen ready to move: e-stop released, switched on, homed.

What its operator does at the screen otherwise. Run it beside LinuxCNC, whenever `pkmcal` says that
the machine is off or not homed; homing may move the robot.
"""

import sys
import time

import linuxcnc

status, command, errors = linuxcnc.stat(), linuxcnc.command(), linuxcnc.error_channel()


def fail(what):
    """End with LinuxCNC's own words."""
    command.abort()
    said = errors.poll()
    sys.exit(f"no {what}: {said[1] if said else 'LinuxCNC says no reason'}")


def step(what, is_done, within_s, order, *values):
    """Give an order and wait until it is done, or end."""
    getattr(command, order)(*values)
    give_up_s = time.monotonic() + within_s
    while not is_done():
        if time.monotonic() > give_up_s:
            fail(what)
        time.sleep(0.01)
        status.poll()


def is_homed():
    """Tell whether all joints are."""
    return all(status.homed[: status.joints])


def is_on():
    """Tell whether the machine is on."""
    return status.task_state == linuxcnc.STATE_ON


status.poll()
while errors.poll():
    pass
if not is_on():
    step("released e-stop", lambda: not status.estop, 1.0, "state", linuxcnc.STATE_ESTOP_RESET)
    step("machine on", is_on, 1.0, "state", linuxcnc.STATE_ON)
time.sleep(0.5)  # with a faulty drive it is on for a moment
status.poll()
if not is_on():
    fail("machine that stays on")
if not is_homed():
    step("manual mode", lambda: True, 1.0, "mode", linuxcnc.MODE_MANUAL)
    step("joint mode", lambda: True, 1.0, "teleop_enable", 0)
    step("homing", is_homed, 120.0, "home", -1)
# Homed joints may still settle, and an order that comes meanwhile is refused.
step("rest", lambda: status.inpos, 10.0, "wait_complete", 10.0)
