/* SPDX-License-Identifier: GPL-2.0-or-later
 *
 * pkmkins: kinematics of parallel robots for LinuxCNC: Par4, H4, I4R, I4L, Delta, linear Delta.
 *
 * This program is free software; you can redistribute it and/or modify it under the terms of the
 * GNU General Public License as published by the Free Software Foundation, version 2 or later. It
 * comes WITHOUT ANY WARRANTY. This licence holds for this folder only; see LICENSE.md beside it.
 *
 * In the INI file: KINEMATICS = pkmkins type=TYPE, with TYPE par4, h4, i4r, i4l, delta or linear-delta.
 *
 * The joints are the motors as the encoders read them, deg, or the carriages, mm. World: X, Y, Z of
 * the controlled point in mm and, of robots with four arms, C = the plate's natural angle in deg.
 *
 * HAL pins hold the geometry, mm and deg, named as pkmcal names parameters: pkmkins.arm0.x_mm and so
 * on, and pkmkins.plate_mm or pkmkins.pinion_mm. Those that all robots of a type have are 0 at first,
 * and with lengths of 0 nothing has a solution: nothing moves in world coordinates before a HAL file
 * has set them. Those of imperfect parts may stay 0, which means perfect ones:
 *     armN.axis_tilt_deg, armN.parallelogram_skew_deg, armN.bar_turn_deg, of rails
 *     armN.rail_tilt_deg, and sag_x_mm _y_mm _reach_mm _z_mm of the plate
 *     armN.encoder_gain_ppm, armN.eccentricity_sin_deg _cos_deg, armN.ripple_sin_deg _cos_deg
 *     (of rails without eccentricities and in mm), with ripples_per_turn of a crank, or with
 *     drive_period_mm, a carriage's travel in a turn of its drive
 *     armN.compliance_deg or _mm, by which the plate's weight turns a joint back at 300 mm of lever
 *     armN.plate_joint_x_mm _y_mm _z_mm and fitted.reflector_x_mm _y_mm _z_mm, which are added to
 *     the drawing below
 * From which side a joint comes no kinematics is told: backlash is LinuxCNC's own [JOINT_N]BACKLASH.
 * Where one of them is not 0, the plate tilts, and its drawing counts:
 *     armN.plate_x_mm _y_mm _z_mm    where the forearm's bar sits on its part of the plate
 *     armN.bar_azimuth_deg           of rails: the direction across which the bars lie
 *     reflector_x_mm _y_mm _z_mm     the point that is to be at X, Y, Z, seen from the controlled one
 * Set them only while the machine is off: with power, the joints would jump to where the new values
 * put them.
 *
 * Whoever moves the robot to joints in world coordinates asks for their pose: he sets ask.joint0 … and
 * then ask.number to a new number. Within a servo period ask.answered is that number, and ask.x, ask.y,
 * ask.z and ask.c are the pose; ask.found is 0 where no plate can be assembled.
 *
 * Build and install: halcompile --install pkmkins.c
 */
#include "rtapi.h"
#include "rtapi_app.h"
#include "rtapi_math.h"
#include "rtapi_string.h"
#include "hal.h"
#include "kinematics.h"
#include "pkm_model.h"

#define KINDS (int)(sizeof kinds / sizeof kinds[0])

#define TYPICAL_CRANK_MM 300.0 /* at which compliance_deg is stated */

MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("Kinematics of Par4, H4, I4R, I4L, Delta and linear Delta, parameters as HAL pins");

static char *type = "par4";
RTAPI_MP_STRING(type, "par4, h4, i4r, i4l, delta or linear-delta");

enum field {
    X, Y, Z, AZIMUTH, ELEVATION, OFFSET, ARM, FOREARM, RAIL_TILT, AXIS_TILT, SKEW, BAR_TURN,
    GAIN, ONCE_SIN, ONCE_COS, OFTEN_SIN, OFTEN_COS, GIVE, PLATE_X, PLATE_Y, PLATE_Z,
    BEYOND_X, BEYOND_Y, BEYOND_Z, BAR_AZIMUTH, FIELDS
};

/* no name: the field does not exist, and counts as 0 */
static const char *const crank_fields[FIELDS] = {
    "x_mm", "y_mm", "z_mm", "azimuth_deg", 0, "joint_offset_deg", "arm_mm", "forearm_mm",
    0, "axis_tilt_deg", "parallelogram_skew_deg", "bar_turn_deg", "encoder_gain_ppm",
    "eccentricity_sin_deg", "eccentricity_cos_deg", "ripple_sin_deg", "ripple_cos_deg",
    "compliance_deg",
    "plate_x_mm", "plate_y_mm", "plate_z_mm", "plate_joint_x_mm", "plate_joint_y_mm",
    "plate_joint_z_mm", 0
};
static const char *const rail_fields[FIELDS] = {
    "x_mm", "y_mm", "z_mm", "azimuth_deg", "elevation_deg", "joint_offset_mm", 0, "forearm_mm",
    "rail_tilt_deg", "axis_tilt_deg", "parallelogram_skew_deg", "bar_turn_deg",
    "encoder_gain_ppm", 0, 0, "ripple_sin_mm", "ripple_cos_mm", "compliance_mm",
    "plate_x_mm", "plate_y_mm", "plate_z_mm", "plate_joint_x_mm", "plate_joint_y_mm",
    "plate_joint_z_mm", "bar_azimuth_deg"
};
static const char *const rate_fields[] = {"ripples_per_turn", "drive_period_mm"}; /* of rails */
static const char *const sag_fields[SAGS] = {"sag_x_mm", "sag_y_mm", "sag_reach_mm", "sag_z_mm"};
static const char *const apart_fields[] = {[HINGE] = "plate_mm", [SLIDE] = "pinion_mm"};

static struct pins {
    hal_float_t *arm[ARMS_AT_MOST][FIELDS];
    hal_float_t *apart, *rate;
    hal_float_t *reflector[3], *fitted[3]; /* as drawn, and what a fit adds to it */
    hal_float_t *sag[SAGS];
    hal_float_t *asked[ARMS_AT_MOST], *number, *answer[4], *found, *answered;
} *pins;

static const robot_kind *kind;

static double value_of(hal_float_t *pin) { return pin ? *pin : 0.0; }

static double unit(void) { return kind->on_rails ? 1.0 : DEG; }

/* The phase of a ripple over its joint's reading; 0 where the pin says nothing. */
static double ripple_rate(void)
{
    double told = *pins->rate;

    return kind->on_rails && told > 0.0 ? 2.0 * M_PI / told : told;
}

static vector reflector(void)
{
    vector drawn = {*pins->reflector[0], *pins->reflector[1], *pins->reflector[2]};
    vector fitted = {*pins->fitted[0], *pins->fitted[1], *pins->fitted[2]};
    return plus(drawn, fitted);
}

/* An arm as its values say; 0 when they cannot be an arm's. */
static int read_arm(arm_geometry *arm, const double value[FIELDS])
{
    double azimuth = value[AZIMUTH] * DEG, axis_tilt = value[AXIS_TILT] * DEG;
    vector place = {value[X], value[Y], value[Z]};
    vector drawn = {value[PLATE_X], value[PLATE_Y], value[PLATE_Z]};
    vector fitted = {value[BEYOND_X], value[BEYOND_Y], value[BEYOND_Z]};

    arm->place = place;
    arm->on_plate = minus(plus(drawn, fitted), reflector());
    arm->forearm = value[FOREARM];
    arm->skew = value[SKEW] * DEG;
    arm->arm = value[ARM];
    arm->gain = 1e-6 * value[GAIN];
    arm->once[0] = value[ONCE_SIN] * unit();
    arm->once[1] = value[ONCE_COS] * unit();
    arm->rate = ripple_rate();
    arm->give = value[GIVE] * unit() / (kind->on_rails ? 1.0 : TYPICAL_CRANK_MM);
    arm->often[0] = arm->rate ? value[OFTEN_SIN] * unit() : 0.0;
    arm->often[1] = arm->rate ? value[OFTEN_COS] * unit() : 0.0;
    if (kind->on_rails) {
        arm->offset = value[OFFSET];
        set_rail(arm, azimuth, value[ELEVATION] * DEG, value[RAIL_TILT] * DEG);
        set_bars(arm, value[BAR_AZIMUTH] * DEG, axis_tilt, value[BAR_TURN] * DEG);
    } else {
        arm->offset = value[OFFSET] * DEG;
        set_crank(arm, azimuth, axis_tilt);
        set_bars(arm, azimuth, axis_tilt, value[BAR_TURN] * DEG);
    }
    return arm->forearm > 0.0 && (kind->on_rails || arm->arm > 0.0);
}

/* The geometry as the pins say now; 0 when it cannot be a robot's. */
static int read_geometry(robot_geometry *robot)
{
    int i, k;

    if (!pins)
        return 0;
    robot->kind = kind;
    robot->is_level = robot->is_stiff = 1;
    robot->apart = value_of(pins->apart);
    if (kind->turn != NO_TURN && (!(robot->apart > 0.0) || !isfinite(robot->apart)))
        return 0;
    if (!isfinite(dot(reflector(), reflector())) || !isfinite(ripple_rate()))
        return 0;
    for (i = 0; i < kind->arms; i++) {
        double value[FIELDS];
        for (k = 0; k < FIELDS; k++) {
            value[k] = value_of(pins->arm[i][k]);
            if (!isfinite(value[k]))
                return 0;
        }
        if (!read_arm(&robot->arm[i], value))
            return 0;
        robot->is_stiff &= value[GIVE] == 0.0;
        robot->is_level &= value[SKEW] == 0.0 && value[AXIS_TILT] == 0.0 && value[BAR_TURN] == 0.0;
    }
    for (i = 0; i < SAGS; i++) {
        robot->sag[i] = *pins->sag[i];
        if (!isfinite(robot->sag[i]))
            return 0;
    }
    robot->home_side = side_at_home(robot);
    return 1;
}

/* World coordinates of joints: from where the plate was last, else from safe starts.
 * Without an assembly the world is left as it was. */
static int world_of(const robot_geometry *robot, const double *joint, EmcPose *world)
{
    plate_pose pose = {{world->tran.x, world->tran.y, world->tran.z}, world->c * DEG};
    double inner[ARMS_AT_MOST];
    int i;

    for (i = 0; i < kind->arms; i++)
        inner[i] = stands_at(&robot->arm[i], joint[i] * unit());
    if (kind->turn == NO_TURN)
        pose.theta = 0.0;
    if (!pose_of(robot, inner, &pose))
        return 0;
    world->tran.x = pose.point.x;
    world->tran.y = pose.point.y;
    world->tran.z = pose.point.z + rise(robot, pose.point);
    world->c = pose.theta / DEG;
    world->a = world->b = world->u = world->v = world->w = 0.0;
    return 1;
}

/* The pose of the joints that are asked for, once for each number. */
static void answer(const robot_geometry *robot, EmcPose world)
{
    double joint[ARMS_AT_MOST], number = *pins->number;
    int i;

    if (number == *pins->answered)
        return;
    for (i = 0; i < kind->arms; i++)
        joint[i] = *pins->asked[i];
    *pins->found = world_of(robot, joint, &world);
    *pins->answer[0] = world.tran.x;
    *pins->answer[1] = world.tran.y;
    *pins->answer[2] = world.tran.z;
    *pins->answer[3] = world.c;
    *pins->answered = number;
}

int kinematicsForward(const double *joint, EmcPose *world, const KINEMATICS_FORWARD_FLAGS *fflags,
                      KINEMATICS_INVERSE_FLAGS *iflags)
{
    robot_geometry robot;
    (void)fflags;
    (void)iflags;

    if (!read_geometry(&robot) || !world_of(&robot, joint, world))
        return -1;
    answer(&robot, *world);
    return 0;
}

/* Joints of world coordinates; without a solution the joints are left as they were. */
int kinematicsInverse(const EmcPose *world, double *joint, const KINEMATICS_INVERSE_FLAGS *iflags,
                      KINEMATICS_FORWARD_FLAGS *fflags)
{
    robot_geometry robot;
    double inner[ARMS_AT_MOST];
    plate_pose pose = {{world->tran.x, world->tran.y, world->tran.z}, world->c * DEG};
    int i;
    (void)iflags;
    (void)fflags;

    if (!read_geometry(&robot))
        return -1;
    pose.point.z = height_without_sag(&robot, pose.point);
    if (!joints_of(&robot, &pose, inner))
        return -1;
    for (i = 0; i < kind->arms; i++)
        joint[i] = reading_at(&robot.arm[i], inner[i]) / unit();
    return 0;
}

KINEMATICS_TYPE kinematicsType(void) { return KINEMATICS_BOTH; }

KINS_NOT_SWITCHABLE
EXPORT_SYMBOL(kinematicsType);
EXPORT_SYMBOL(kinematicsForward);
EXPORT_SYMBOL(kinematicsInverse);

static int component;

static int make_arm_pins(int i)
{
    const char *const *names = kind->on_rails ? rail_fields : crank_fields;
    int k, error = 0;

    for (k = 0; k < FIELDS; k++)
        if (names[k])
            error |= hal_pin_float_newf(HAL_IN, &pins->arm[i][k], component, "pkmkins.arm%d.%s",
                                        i, names[k]);
    return error;
}

static int make_pins(void)
{
    int i, error = 0;

    for (i = 0; i < kind->arms; i++)
        error |= make_arm_pins(i);
    for (i = 0; i < 3; i++)
        error |= hal_pin_float_newf(HAL_IN, &pins->reflector[i], component,
                                    "pkmkins.reflector_%c_mm", "xyz"[i]);
    for (i = 0; i < 3; i++)
        error |= hal_pin_float_newf(HAL_IN, &pins->fitted[i], component,
                                    "pkmkins.fitted.reflector_%c_mm", "xyz"[i]);
    for (i = 0; i < SAGS; i++)
        error |= hal_pin_float_newf(HAL_IN, &pins->sag[i], component, "pkmkins.%s", sag_fields[i]);
    error |= hal_pin_float_newf(HAL_IN, &pins->rate, component, "pkmkins.%s",
                                rate_fields[kind->on_rails]);
    for (i = 0; i < kind->arms; i++)
        error |= hal_pin_float_newf(HAL_IN, &pins->asked[i], component, "pkmkins.ask.joint%d", i);
    error |= hal_pin_float_newf(HAL_IN, &pins->number, component, "pkmkins.ask.number");
    for (i = 0; i < 4; i++)
        error |= hal_pin_float_newf(HAL_OUT, &pins->answer[i], component, "pkmkins.ask.%c",
                                    "xyzc"[i]);
    error |= hal_pin_float_newf(HAL_OUT, &pins->found, component, "pkmkins.ask.found");
    error |= hal_pin_float_newf(HAL_OUT, &pins->answered, component, "pkmkins.ask.answered");
    if (kind->turn != NO_TURN)
        error |= hal_pin_float_newf(HAL_IN, &pins->apart, component, "pkmkins.%s",
                                    apart_fields[kind->turn]);
    return error;
}

static const robot_kind *find_kind(const char *name)
{
    int i;

    for (i = 0; i < KINDS; i++)
        if (!strcmp(kinds[i].name, name))
            return &kinds[i];
    return 0;
}

int rtapi_app_main(void)
{
    kind = find_kind(type);
    if (!kind) {
        rtapi_print_msg(RTAPI_MSG_ERR, "pkmkins: type=%s is none of par4, h4, i4r, i4l, delta, "
                        "linear-delta\n", type);
        return -1;
    }
    component = hal_init("pkmkins");
    if (component < 0)
        return component;
    pins = hal_malloc(sizeof *pins);
    if (pins)
        memset(pins, 0, sizeof *pins);
    if (!pins || make_pins()) {
        hal_exit(component);
        return -1;
    }
    hal_ready(component);
    return 0;
}

void rtapi_app_exit(void) { hal_exit(component); }
