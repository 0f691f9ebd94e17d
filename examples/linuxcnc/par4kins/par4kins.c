/* SPDX-License-Identifier: GPL-2.0-or-later
 *
 * par4kins: kinematics of a Par4 robot for LinuxCNC.
 *
 * This program is free software; you can redistribute it and/or modify it under the terms of the
 * GNU General Public License as published by the Free Software Foundation, version 2 or later. It
 * comes WITHOUT ANY WARRANTY. This licence holds for this folder only; see LICENSE.md beside it.
 *
 * Joints 0 to 3 are the four motors, deg as the encoders read them. World: X, Y, Z of the
 * controlled point in mm, C = the plate's natural angle theta in deg. 29 HAL pins hold the
 * geometry: par4kins.arm0.x_mm ... par4kins.arm3.forearm_mm and par4kins.plate_mm, mm and deg.
 * They are 0 at first, and with lengths of 0 nothing has a solution: nothing moves in world
 * coordinates before a HAL file has set them. Set them only while the machine is off: with power,
 * the joints would jump to where the new values put them.
 *
 * Build and install: halcompile --install par4kins.c
 */
#include "rtapi.h"
#include "rtapi_app.h"
#include "rtapi_math.h"
#include "hal.h"
#include "kinematics.h"
#include "par4_model.h"

#define FIELDS 7

MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("Par4 kinematics, 29 parameters as HAL pins");

static const char *const field_name[FIELDS] = {
    "x_mm", "y_mm", "z_mm", "azimuth_deg", "joint_offset_deg", "arm_mm", "forearm_mm"
};

static struct pins {
    hal_float_t *arm[ARMS][FIELDS];
    hal_float_t *plate;
} *pins;

/* The geometry as the pins say now; 0 when it cannot be a robot's. */
static int read_geometry(robot_geometry *robot)
{
    int i, k;

    if (!pins)
        return 0;
    robot->plate = *pins->plate;
    if (!(robot->plate > 0.0) || !isfinite(robot->plate))
        return 0;
    for (i = 0; i < ARMS; i++) {
        arm_geometry *arm = &robot->arm[i];
        double value[FIELDS];
        for (k = 0; k < FIELDS; k++) {
            value[k] = *pins->arm[i][k];
            if (!isfinite(value[k]))
                return 0;
        }
        arm->motor.x = value[0];
        arm->motor.y = value[1];
        arm->motor.z = value[2];
        arm->cos_azimuth = cos(value[3] * DEG);
        arm->sin_azimuth = sin(value[3] * DEG);
        arm->offset = value[4] * DEG;
        arm->arm = value[5];
        arm->forearm = value[6];
        if (!(arm->arm > 0.0) || !(arm->forearm > 0.0))
            return 0;
    }
    return 1;
}

/* World coordinates of joints: from where the plate was last, else from safe starts.
 * Without an assembly the world is left as it was. */
int kinematicsForward(const double *joint, EmcPose *world, const KINEMATICS_FORWARD_FLAGS *fflags,
                      KINEMATICS_INVERSE_FLAGS *iflags)
{
    robot_geometry robot;
    plate_pose pose = {world->tran.x, world->tran.y, world->tran.z, world->c * DEG};
    (void)fflags;
    (void)iflags;

    if (!read_geometry(&robot) || !pose_of(&robot, joint, &pose))
        return -1;
    world->tran.x = pose.x;
    world->tran.y = pose.y;
    world->tran.z = pose.z;
    world->c = pose.theta / DEG;
    world->a = world->b = world->u = world->v = world->w = 0.0;
    return 0;
}

/* Joints of world coordinates; without a solution the joints are left as they were. */
int kinematicsInverse(const EmcPose *world, double *joint, const KINEMATICS_INVERSE_FLAGS *iflags,
                      KINEMATICS_FORWARD_FLAGS *fflags)
{
    robot_geometry robot;
    double wanted[ARMS];
    plate_pose pose = {world->tran.x, world->tran.y, world->tran.z, world->c * DEG};
    int i;
    (void)iflags;
    (void)fflags;

    if (!read_geometry(&robot) || !joints_of(&robot, &pose, wanted))
        return -1;
    for (i = 0; i < ARMS; i++)
        joint[i] = wanted[i];
    return 0;
}

KINEMATICS_TYPE kinematicsType(void) { return KINEMATICS_BOTH; }

KINS_NOT_SWITCHABLE
EXPORT_SYMBOL(kinematicsType);
EXPORT_SYMBOL(kinematicsForward);
EXPORT_SYMBOL(kinematicsInverse);

static int component;

static int make_pins(void)
{
    int i, k, error = 0;

    for (i = 0; i < ARMS; i++)
        for (k = 0; k < FIELDS; k++)
            error |= hal_pin_float_newf(HAL_IN, &pins->arm[i][k], component, "par4kins.arm%d.%s",
                                        i, field_name[k]);
    return error | hal_pin_float_newf(HAL_IN, &pins->plate, component, "par4kins.plate_mm");
}

int rtapi_app_main(void)
{
    component = hal_init("par4kins");
    if (component < 0)
        return component;
    pins = hal_malloc(sizeof *pins);
    if (!pins || make_pins()) {
        hal_exit(component);
        return -1;
    }
    hal_ready(component);
    return 0;
}

void rtapi_app_exit(void) { hal_exit(component); }
