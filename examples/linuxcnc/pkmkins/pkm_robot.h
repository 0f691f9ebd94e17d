/* SPDX-License-Identifier: GPL-2.0-or-later
 *
 * What a robot is built of: its kind, the geometry of its arms and plate, and where these put the
 * two ends of each forearm.
 */
#ifndef PKM_ROBOT_H
#define PKM_ROBOT_H

#include "pkm_vectors.h"

#define ARMS_AT_MOST 4
#define SAGS 4
#define DEG (M_PI / 180.0)
#define UPRIGHT 1e-12 /* a rail that goes less aside than that has no azimuth */
#define READING_ROUNDS 60
#define READ 1e-14    /* last change of a reading, rad or mm */

enum turn { NO_TURN, HINGE, SLIDE };

typedef struct {
    const char *name;
    int arms;
    enum turn turn;
    int on_rails;
    double share[ARMS_AT_MOST]; /* of the way between the plate's parts, where each arm ends */
} robot_kind;

static const robot_kind kinds[] = {
    {"par4", 4, HINGE, 0, {0.0, 0.0, 1.0, 1.0}},
    {"h4", 4, HINGE, 0, {-0.5, -0.5, 0.5, 0.5}},
    {"i4r", 4, SLIDE, 0, {0.0, 0.0, 1.0, 1.0}},
    {"i4l", 4, SLIDE, 1, {0.0, 0.0, 1.0, 1.0}},
    {"delta", 3, NO_TURN, 0, {0.0, 0.0, 0.0, 0.0}},
    {"linear-delta", 3, NO_TURN, 1, {0.0, 0.0, 0.0, 0.0}},
};

typedef struct {
    vector place;       /* of the motor, or of the rail's zero */
    vector out, down;   /* where a crank points at 0 and at 90 deg */
    vector rail;        /* where a carriage goes */
    double offset;      /* rad or mm */
    double gain;        /* the joint's motion over its reading's, less 1 */
    double once[2], often[2]; /* sine and cosine of an eccentric encoder, and of a ripple */
    double rate;        /* the ripple's phase over the reading */
    double give;        /* rad or mm by which the joint yields for 1 mm of the plate's rise by it */
    double arm;         /* the crank's length, mm */
    double forearm;     /* mm */
    vector plate_bar;   /* the rods' lower ends lie along it on a level plate */
    vector axis;        /* the upper ends: the motor's axis, or the bar on the carriage */
    double skew;        /* the difference of the rods' lengths over their distance */
    vector on_plate;    /* the plate's bar, where perfect parts have it, seen from the reflector,
                           without what the plate's own turn adds */
} arm_geometry;

typedef struct {
    const robot_kind *kind;
    arm_geometry arm[ARMS_AT_MOST];
    double apart;       /* the plate's parts, mm, or mm per rad */
    double sag[SAGS];   /* mm by which the plate rises, by x, y, reach and z */
    int is_stiff;       /* no joint yields */
    int is_level;       /* perfect rods, axes and bars: the plate never tilts */
    double home_side;   /* the sign of the closures' determinant where the robot is assembled */
} robot_geometry;

typedef struct { vector point; double theta; } plate_pose; /* mm and rad */

/* Crank: u along the azimuth, its axis v turned about u by the tilt, w as it hangs. */
static void set_crank(arm_geometry *arm, double azimuth, double tilt)
{
    double c = cos(azimuth), s = sin(azimuth), level = cos(tilt), rise = sin(tilt);
    vector out = {c, s, 0.0}, down = {-s * rise, c * rise, -level};

    arm->out = out;
    arm->down = down;
}

/* Rail: by azimuth and elevation, and tilted out of the vertical plane of its azimuth. */
static void set_rail(arm_geometry *arm, double azimuth, double elevation, double tilt)
{
    double c = cos(azimuth), s = sin(azimuth), level = cos(elevation);
    vector rail;

    if (fabs(level) < UPRIGHT)
        level = 0.0;
    rail.x = cos(tilt) * level * c - sin(tilt) * s;
    rail.y = cos(tilt) * level * s + sin(tilt) * c;
    rail.z = cos(tilt) * sin(elevation);
    arm->rail = rail;
}

/* The two bars between which a forearm's rods hang: across `outward`, the upper one tilted, the one
 * on the plate turned. */
static void set_bars(arm_geometry *arm, double outward, double tilt, double turn)
{
    vector bar = {-sin(outward + turn), cos(outward + turn), 0.0};
    vector axis = {-sin(outward) * cos(tilt), cos(outward) * cos(tilt), 0.0};

    axis.z = sin(tilt);
    arm->plate_bar = bar;
    arm->axis = axis;
}

/* Where the joint stands, but for its offset, when its encoder reads that, rad or mm. */
static double stands_at(const arm_geometry *arm, double reading)
{
    double turned = arm->rate * reading;

    return reading * (1.0 + arm->gain) + arm->once[0] * sin(reading) + arm->once[1] * cos(reading)
           + arm->often[0] * sin(turned) + arm->often[1] * cos(turned);
}

/* What the encoder reads where the joint stands there. The errors of a gear are small: each round
 * leaves a small part of what the one before has left. */
static double reading_at(const arm_geometry *arm, double joint)
{
    double reading = joint, off = HUGE_VAL;
    int i;

    for (i = 0; i < READING_ROUNDS && fabs(off) > READ * (1.0 + fabs(joint)); i++) {
        off = stands_at(arm, reading) - joint;
        reading -= off;
    }
    return reading;
}

/* The forearm's upper end, its joint in rad or mm but for the offset. */
static vector upper_end(const robot_geometry *robot, int i, double joint)
{
    const arm_geometry *arm = &robot->arm[i];
    double moved = joint + arm->offset;
    vector way;

    if (robot->kind->on_rails)
        way = times(moved, arm->rail);
    else
        way = plus(times(arm->arm * cos(moved), arm->out), times(arm->arm * sin(moved), arm->down));
    return plus(arm->place, way);
}

/* The way of that end for 1 rad or mm of its joint. */
static vector end_by_joint(const robot_geometry *robot, int i, double joint)
{
    const arm_geometry *arm = &robot->arm[i];
    double moved = joint + arm->offset;

    if (robot->kind->on_rails)
        return arm->rail;
    return plus(times(-arm->arm * sin(moved), arm->out), times(arm->arm * cos(moved), arm->down));
}

/* By how much frame and limbs that bend lift the plate: over 400 mm aside, by the square of the
 * distance from the z axis, over 200 mm of height. */
static double rise(const robot_geometry *robot, vector point)
{
    double x = point.x / 400.0, y = point.y / 400.0;

    return robot->sag[0] * x + robot->sag[1] * y + robot->sag[2] * (x * x + y * y)
           + robot->sag[3] * point.z / 200.0;
}

/* The height from which the plate rises to where `point` is. */
static double height_without_sag(const robot_geometry *robot, vector point)
{
    vector aside = {point.x, point.y, 0.0};

    return (point.z - rise(robot, aside)) / (1.0 + robot->sag[3] / 200.0);
}

/* From the controlled point to a level plate's joint. */
static vector to_plate_joint(const robot_geometry *robot, double theta, int i)
{
    double way = robot->kind->share[i] * robot->apart;
    vector to = {0.0, 0.0, 0.0};

    if (robot->kind->turn == HINGE) {
        to.x = -way * sin(theta);
        to.y = way * cos(theta);
    } else if (robot->kind->turn == SLIDE) {
        to.x = -way * theta;
    }
    return to;
}

/* How a forearm lengthens, times its length, when the plate turns. */
static double by_turn(const robot_geometry *robot, double theta, int i, vector forearm)
{
    double way = robot->kind->share[i] * robot->apart;

    if (robot->kind->turn == HINGE)
        return -way * (cos(theta) * forearm.x + sin(theta) * forearm.y);
    return -way * forearm.x;
}

static int joint_of_crank(const arm_geometry *arm, vector reach, double *joint)
{
    double sine = -2.0 * arm->arm * dot(reach, arm->down);
    double cosine = -2.0 * arm->arm * dot(reach, arm->out);
    double constant = dot(reach, reach) + arm->arm * arm->arm - arm->forearm * arm->forearm;
    double discriminant = sine * sine + cosine * cosine - constant * constant;
    double angle;

    if (!(discriminant >= 0.0))
        return 0;
    angle = atan2(sine, cosine) + atan2(sqrt(discriminant), -constant) - arm->offset;
    *joint = remainder(angle, 2.0 * M_PI);
    return 1;
}

static int joint_of_carriage(const arm_geometry *arm, vector reach, double *joint)
{
    double along = dot(reach, arm->rail);
    double square = along * along - dot(reach, reach) + arm->forearm * arm->forearm;

    if (!(square >= 0.0))
        return 0;
    *joint = along + sqrt(square) - arm->offset;
    return 1;
}

/* The joint but for its offset, rad or mm, with the elbow outward or the carriage above; 0 when the
 * forearm does not reach `end`. */
static int joint_to(const robot_geometry *robot, int i, vector end, double *joint)
{
    const arm_geometry *arm = &robot->arm[i];
    vector reach = minus(end, arm->place);

    return robot->kind->on_rails ? joint_of_carriage(arm, reach, joint)
                                 : joint_of_crank(arm, reach, joint);
}

#endif
