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
 * coordinates before a HAL file has set them. Set them only while the machine is off.
 *
 * The model, in the words of pkmcal's docs:
 *   u = (cos azimuth, sin azimuth, 0), angle = joint + joint_offset, positive downwards
 *   elbow_i = motor_i + arm_i (cos(angle) u - sin(angle) z)
 *   plate joints 0 and 1 are at (X, Y, Z), 2 and 3 at (X - plate sin C, Y + plate cos C, Z)
 *   each forearm_i is as long as from elbow_i to plate joint_i
 *
 * Build and install: halcompile --install par4kins.c
 */
#include "rtapi.h"
#include "rtapi_app.h"
#include "rtapi_math.h"
#include "rtapi_string.h"
#include "hal.h"
#include "kinematics.h"

#define ARMS 4
#define FIELDS 7
#define DEG (M_PI / 180.0)

#define ITERATIONS 40
#define STEP_MM 120.0      /* the longest step of one iteration */
#define STEP_RAD 0.35
#define CONVERGED_MM 1e-7  /* the error left is of the order of its square */
#define RESIDUAL_MM 1e-6
#define LEVER_MM 100.0     /* compares a step in theta with one in position */

MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("Par4 kinematics, 29 parameters as HAL pins");

static const char *const field_name[FIELDS] = {
    "x_mm", "y_mm", "z_mm", "azimuth_deg", "joint_offset_deg", "arm_mm", "forearm_mm"
};

/* theta in rad and height above the guessed one in mm, tried in turn */
static const double starts[][2] = {
    {0.0, 0.0}, {0.6, -40.0}, {-0.6, -40.0}, {0.0, -150.0},
    {0.9, 60.0}, {-0.9, 60.0}, {0.0, 150.0}
};

static struct pins {
    hal_float_t *arm[ARMS][FIELDS];
    hal_float_t *plate;
} *pins;

typedef struct { double x, y, z; } vector;

typedef struct {
    vector motor;
    double cos_azimuth, sin_azimuth;
    double offset; /* rad */
    double arm, forearm;
} arm_geometry;

typedef struct {
    arm_geometry arm[ARMS];
    double plate;
} robot_geometry;

typedef struct { double x, y, z, theta; } plate_pose; /* mm and rad */

static double dot(vector a, vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static vector minus(vector a, vector b)
{
    vector difference = {a.x - b.x, a.y - b.y, a.z - b.z};
    return difference;
}

static vector cross(vector a, vector b)
{
    vector product = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return product;
}

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

static vector elbow(const arm_geometry *arm, double joint_deg)
{
    double angle = joint_deg * DEG + arm->offset;
    double outward = arm->arm * cos(angle);
    vector place = arm->motor;

    place.x += outward * arm->cos_azimuth;
    place.y += outward * arm->sin_azimuth;
    place.z -= arm->arm * sin(angle);
    return place;
}

static vector plate_joint(double plate, const plate_pose *pose, int arm)
{
    vector place = {pose->x, pose->y, pose->z};

    if (arm >= 2) {
        place.x -= plate * sin(pose->theta);
        place.y += plate * cos(pose->theta);
    }
    return place;
}

/* The encoder's angle of one arm, elbow outward; 0 when it cannot reach. */
static int joint_of(const robot_geometry *robot, const plate_pose *pose, int i, double *joint_deg)
{
    const arm_geometry *arm = &robot->arm[i];
    vector reach = minus(plate_joint(robot->plate, pose, i), arm->motor);
    double along = reach.x * arm->cos_azimuth + reach.y * arm->sin_azimuth;
    double sine = 2.0 * arm->arm * reach.z;
    double cosine = -2.0 * arm->arm * along;
    double constant = dot(reach, reach) + arm->arm * arm->arm - arm->forearm * arm->forearm;
    double discriminant = sine * sine + cosine * cosine - constant * constant;
    double angle;

    if (!(discriminant >= 0.0))
        return 0;
    angle = atan2(sine, cosine) + atan2(sqrt(discriminant), -constant) - arm->offset;
    *joint_deg = remainder(angle, 2.0 * M_PI) / DEG;
    return 1;
}

/* One Newton step. The first two closures don't know theta: they leave one free direction, their
 * forearms' normal, along which the other two are solved. `side` is positive on the assembly that
 * is wanted, and `misfit` says by how many mm a forearm is too long or too short. */
static plate_pose newton_step(const robot_geometry *robot, const vector elbows[ARMS],
                              const plate_pose *pose, double *side, double *misfit)
{
    double f[ARMS], by_theta[2], by_free[2], wanted[2], area, free_part, determinant;
    double cos_theta = cos(pose->theta), sin_theta = sin(pose->theta);
    vector forearm[ARMS], normal, fixed;
    plate_pose step;
    double product, part0, part1;
    int i;

    *misfit = 0.0;
    for (i = 0; i < ARMS; i++) {
        double length = robot->arm[i].forearm;
        forearm[i] = minus(plate_joint(robot->plate, pose, i), elbows[i]);
        f[i] = 0.5 * (dot(forearm[i], forearm[i]) - length * length);
        *misfit = fmax(*misfit, fabs(f[i]) / length);
    }
    normal = cross(forearm[0], forearm[1]);
    area = dot(normal, normal);
    product = dot(forearm[0], forearm[1]);
    part0 = (f[1] * product - f[0] * dot(forearm[1], forearm[1])) / area;
    part1 = (f[0] * product - f[1] * dot(forearm[0], forearm[0])) / area;
    fixed.x = part0 * forearm[0].x + part1 * forearm[1].x;
    fixed.y = part0 * forearm[0].y + part1 * forearm[1].y;
    fixed.z = part0 * forearm[0].z + part1 * forearm[1].z;
    for (i = 0; i < 2; i++) {
        vector last = forearm[i + 2];
        by_theta[i] = -robot->plate * (cos_theta * last.x + sin_theta * last.y);
        by_free[i] = dot(last, normal);
        wanted[i] = -f[i + 2] - dot(last, fixed);
    }
    determinant = by_free[0] * by_theta[1] - by_free[1] * by_theta[0];
    free_part = (wanted[0] * by_theta[1] - wanted[1] * by_theta[0]) / determinant;
    step.x = fixed.x + free_part * normal.x;
    step.y = fixed.y + free_part * normal.y;
    step.z = fixed.z + free_part * normal.z;
    step.theta = (by_free[0] * wanted[1] - by_free[1] * wanted[0]) / determinant;
    *side = determinant;
    return step;
}

static double longest(const plate_pose *step)
{
    return fmax(fmax(fabs(step->x), fabs(step->y)), fabs(step->z));
}

/* From a start to the pose at which all forearms fit, on the wanted assembly; 0 when there is none. */
static int newton(const robot_geometry *robot, const vector elbows[ARMS], plate_pose *pose)
{
    int i;

    for (i = 0; i < ITERATIONS; i++) {
        double side, misfit, too_long, size;
        plate_pose step = newton_step(robot, elbows, pose, &side, &misfit);

        size = longest(&step) + LEVER_MM * fabs(step.theta);
        if (!isfinite(size))
            return 0;
        too_long = fmax(longest(&step) / STEP_MM, fabs(step.theta) / STEP_RAD);
        too_long = fmax(too_long, 1.0);
        pose->x += step.x / too_long;
        pose->y += step.y / too_long;
        pose->z += step.z / too_long;
        pose->theta += step.theta / too_long;
        if (size < CONVERGED_MM)
            return misfit < RESIDUAL_MM && side > 0.0 && fabs(pose->theta) < 0.5 * M_PI;
    }
    return 0;
}

/* A plate that hangs under the middle of its elbows. */
static plate_pose guess(const robot_geometry *robot, const vector elbows[ARMS], const double start[2])
{
    double theta = start[0], x = 0.0, y = 0.0, z = 0.0, drop = 0.0;
    plate_pose pose;
    int i;

    for (i = 0; i < ARMS; i++) {
        x += 0.25 * elbows[i].x;
        y += 0.25 * elbows[i].y;
        z += 0.25 * elbows[i].z;
    }
    for (i = 0; i < ARMS; i++) {
        double dx = elbows[i].x - x, dy = elbows[i].y - y, length = robot->arm[i].forearm;
        drop += 0.25 * fmax(length * length - dx * dx - dy * dy, 0.0);
    }
    pose.x = x + 0.5 * robot->plate * sin(theta);
    pose.y = y - 0.5 * robot->plate * cos(theta);
    pose.z = z - sqrt(drop) + start[1];
    pose.theta = theta;
    return pose;
}

/* World coordinates of joints: from where the plate was last, else from safe starts.
 * Without an assembly the world is left as it was. */
int kinematicsForward(const double *joint, EmcPose *world, const KINEMATICS_FORWARD_FLAGS *fflags,
                      KINEMATICS_INVERSE_FLAGS *iflags)
{
    robot_geometry robot;
    vector elbows[ARMS];
    plate_pose pose;
    int i, found;
    (void)fflags;
    (void)iflags;

    if (!read_geometry(&robot))
        return -1;
    for (i = 0; i < ARMS; i++)
        elbows[i] = elbow(&robot.arm[i], joint[i]);
    pose.x = world->tran.x;
    pose.y = world->tran.y;
    pose.z = world->tran.z;
    pose.theta = world->c * DEG;
    found = newton(&robot, elbows, &pose);
    for (i = 0; !found && i < (int)(sizeof starts / sizeof starts[0]); i++) {
        pose = guess(&robot, elbows, starts[i]);
        found = newton(&robot, elbows, &pose);
    }
    if (!found)
        return -1;
    world->tran.x = pose.x;
    world->tran.y = pose.y;
    world->tran.z = pose.z;
    world->c = pose.theta / DEG;
    world->a = world->b = world->u = world->v = world->w = 0.0;
    return 0;
}

/* Joints of world coordinates. Refuses what is out of reach, and what lies beyond a singularity:
 * there the same joints would also carry the plate at another place. */
int kinematicsInverse(const EmcPose *world, double *joint, const KINEMATICS_INVERSE_FLAGS *iflags,
                      KINEMATICS_FORWARD_FLAGS *fflags)
{
    robot_geometry robot;
    vector elbows[ARMS];
    double wanted[ARMS], side, misfit;
    plate_pose pose;
    int i;
    (void)iflags;
    (void)fflags;

    if (!read_geometry(&robot))
        return -1;
    pose.x = world->tran.x;
    pose.y = world->tran.y;
    pose.z = world->tran.z;
    pose.theta = world->c * DEG;
    if (!(fabs(pose.theta) < 0.5 * M_PI))
        return -1;
    for (i = 0; i < ARMS; i++) {
        if (!joint_of(&robot, &pose, i, &wanted[i]))
            return -1;
        elbows[i] = elbow(&robot.arm[i], wanted[i]);
    }
    newton_step(&robot, elbows, &pose, &side, &misfit);
    if (!(side > 0.0))
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
