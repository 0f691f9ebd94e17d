/* SPDX-License-Identifier: GPL-2.0-or-later
 *
 * The two ways through the kinematics of a parallel robot: joints of a pose, pose of joints.
 *
 * Each forearm is as long as from its upper end, where its joint holds it, to its joint on the
 * plate. For given joints the plate can be at several places. The wanted one hangs below the upper
 * ends, has |theta| < 90 deg where the plate is hinged, and the determinant of the closures, here
 * called `side`, has the sign that it has with all joints at 0.
 *
 * Unequal rods and tilted axes tilt the plate by milliradians, which moves its joints. Seen from the
 * plate that is a level one held by upper ends that are moved the other way: a few rounds of tilt and
 * pose, or tilt and joints, agree. Every loop here ends after a fixed number of rounds.
 */
#ifndef PKM_MODEL_H
#define PKM_MODEL_H

#include "pkm_tilt.h"

#define ITERATIONS 40
#define STEP_MM 120.0      /* the longest step of one iteration */
#define HINGE_STEP 0.35    /* rad */
#define HINGE_LEVER_MM 100.0 /* compares a step in theta with one in position */
#define CONVERGED_MM 1e-7  /* the error left is of the order of its square */
#define RESIDUAL_MM 1e-6
#define WELL_BELOW_MM 100.0
#define ROUNDS 30          /* of tilt and the rest in turn; each leaves some thousandth */
#define SETTLED 1e-9       /* last change, mm or thousandths of a rad */
#define NEARBY_MM 20.0
#define CLOSED 1e-6        /* a change above that after all rounds is no solution */

/* theta in rad and height above the guessed one in mm, tried in turn */
static const double starts[][2] = {
    {0.0, 0.0}, {0.6, -40.0}, {-0.6, -40.0}, {0.0, -150.0},
    {0.9, 60.0}, {-0.9, 60.0}, {0.0, 150.0}
};
#define STARTS (int)(sizeof starts / sizeof starts[0])

static double turn_lever(const robot_geometry *robot)
{
    return robot->kind->turn == SLIDE ? robot->apart : HINGE_LEVER_MM;
}

static double turn_step(const robot_geometry *robot)
{
    return robot->kind->turn == SLIDE ? STEP_MM / robot->apart : HINGE_STEP;
}

static double change(const robot_geometry *robot, const plate_pose *step)
{
    return longest(step->point) + turn_lever(robot) * fabs(step->theta);
}

static plate_pose moved_by(const plate_pose *pose, double part, const plate_pose *step)
{
    plate_pose moved = {plus(pose->point, times(part, step->point)),
                        pose->theta + part * step->theta};
    return moved;
}

/* One Newton step for a level plate; `misfit` says by how many mm a forearm is too long or short. */
static plate_pose newton_step(const robot_geometry *robot, const vector upper[],
                              const plate_pose *pose, double *side, double *misfit)
{
    double system[ARMS_AT_MOST][UNKNOWNS_AT_MOST + 1] = {{0.0}};
    double solution[UNKNOWNS_AT_MOST] = {0.0};
    plate_pose step;
    int i;

    *misfit = 0.0;
    for (i = 0; i < robot->kind->arms; i++) {
        double length = robot->arm[i].forearm, f;
        vector joint = plus(pose->point, to_plate_joint(robot, pose->theta, i));
        vector forearm = minus(joint, upper[i]);
        f = 0.5 * (dot(forearm, forearm) - length * length);
        *misfit = fmax(*misfit, fabs(f) / length);
        system[i][0] = forearm.x;
        system[i][1] = forearm.y;
        system[i][2] = forearm.z;
        if (robot->kind->turn != NO_TURN)
            system[i][3] = by_turn(robot, pose->theta, i, forearm);
        system[i][UNKNOWNS_AT_MOST] = -f;
    }
    *side = solve(robot->kind->arms, system, solution);
    step.point.x = solution[0];
    step.point.y = solution[1];
    step.point.z = solution[2];
    step.theta = robot->kind->turn == NO_TURN ? 0.0 : solution[3];
    return step;
}

static double mean_height(const robot_geometry *robot, const vector upper[])
{
    double sum = 0.0;
    int i;

    for (i = 0; i < robot->kind->arms; i++)
        sum += upper[i].z;
    return sum / robot->kind->arms;
}

static int has_not_turned_over(const robot_geometry *robot, const plate_pose *pose)
{
    return robot->kind->turn != HINGE || fabs(pose->theta) < 0.5 * M_PI;
}

static int is_wanted(const robot_geometry *robot, const vector upper[], const plate_pose *pose,
                     double side)
{
    return side * robot->home_side > 0.0 && has_not_turned_over(robot, pose)
           && pose->point.z < mean_height(robot, upper);
}

/* From a start to the pose at which all forearms hold a level plate, on the wanted assembly; 0 when
 * there is none. */
static int newton(const robot_geometry *robot, const vector upper[], plate_pose *pose)
{
    int i;

    for (i = 0; i < ITERATIONS; i++) {
        double side, misfit, too_long, size;
        plate_pose step = newton_step(robot, upper, pose, &side, &misfit);

        size = change(robot, &step);
        if (!isfinite(size))
            return 0;
        too_long = fmax(longest(step.point) / STEP_MM, fabs(step.theta) / turn_step(robot));
        *pose = moved_by(pose, 1.0 / fmax(too_long, 1.0), &step);
        if (size < CONVERGED_MM)
            return misfit < RESIDUAL_MM && is_wanted(robot, upper, pose, side);
    }
    return 0;
}

/* A plate that hangs under the middle of its forearms' upper ends. */
static plate_pose guess(const robot_geometry *robot, const vector upper[], const double start[2])
{
    vector middle = {0.0, 0.0, 0.0}, aside = {0.0, 0.0, 0.0};
    double drop = 0.0, part = 1.0 / robot->kind->arms;
    plate_pose pose;
    int i;

    pose.theta = robot->kind->turn == NO_TURN ? 0.0 : start[0];
    for (i = 0; i < robot->kind->arms; i++) {
        middle = plus(middle, times(part, upper[i]));
        aside = plus(aside, times(part, to_plate_joint(robot, pose.theta, i)));
    }
    for (i = 0; i < robot->kind->arms; i++) {
        double dx = upper[i].x - middle.x, dy = upper[i].y - middle.y;
        double length = robot->arm[i].forearm;
        drop += part * fmax(length * length - dx * dx - dy * dy, 0.0);
    }
    pose.point.x = middle.x - aside.x;
    pose.point.y = middle.y - aside.y;
    pose.point.z = middle.z - sqrt(drop) + start[1];
    return pose;
}

static void all_upper_ends(const robot_geometry *robot, const double joints[], vector upper[])
{
    int i;

    for (i = 0; i < robot->kind->arms; i++)
        upper[i] = upper_end(robot, i, joints[i]);
}

/* The sign of the determinant with all joints at 0 and the plate well below. */
static double side_at_home(const robot_geometry *robot)
{
    static const double below[2] = {0.0, -WELL_BELOW_MM};
    const double joints[ARMS_AT_MOST] = {0.0};
    vector upper[ARMS_AT_MOST];
    double side, misfit;
    plate_pose pose;

    all_upper_ends(robot, joints, upper);
    pose = guess(robot, upper, below);
    newton_step(robot, upper, &pose, &side, &misfit);
    return side;
}

/* From a pose nearby, such as that of a level plate, to that of the tilted one. */
static int settle(const robot_geometry *robot, const vector upper[], plate_pose *pose)
{
    vector gibbs = {0.0, 0.0, 0.0}, moved[ARMS_AT_MOST];
    double side = 0.0, misfit, left = HUGE_VAL;
    int i;

    for (i = 0; i < ROUNDS && !(left < SETTLED); i++) {
        plate_pose step;
        tilt_further(robot, upper, pose, &gibbs);
        seen_from_level(robot, upper, pose->theta, gibbs, moved);
        step = newton_step(robot, moved, pose, &side, &misfit);
        left = change(robot, &step);
        if (!(left < NEARBY_MM))
            return 0;
        *pose = moved_by(pose, 1.0, &step);
    }
    return left < CLOSED && is_wanted(robot, upper, pose, side);
}

/* Where joints rest under the plate's weight, a level one at `pose`: each yields by the plate's rise
 * for its own motion, which is its torque by virtual work. */
static void yield_at(const robot_geometry *robot, const double joints[], const plate_pose *pose,
                     double rest[])
{
    double system[ARMS_AT_MOST][UNKNOWNS_AT_MOST + 1] = {{0.0}};
    double rise_by[UNKNOWNS_AT_MOST] = {0.0};
    vector forearm[ARMS_AT_MOST];
    int i;

    for (i = 0; i < robot->kind->arms; i++) {
        vector end = plus(pose->point, to_plate_joint(robot, pose->theta, i));
        forearm[i] = minus(end, upper_end(robot, i, joints[i]));
        system[0][i] = forearm[i].x;
        system[1][i] = forearm[i].y;
        system[2][i] = forearm[i].z;
        if (robot->kind->turn != NO_TURN)
            system[3][i] = by_turn(robot, pose->theta, i, forearm[i]);
    }
    system[2][UNKNOWNS_AT_MOST] = 1.0;
    solve(robot->kind->arms, system, rise_by);
    for (i = 0; i < robot->kind->arms; i++)
        rest[i] = joints[i] - robot->arm[i].give * rise_by[i]
                  * dot(forearm[i], end_by_joint(robot, i, joints[i]));
}

/* From a start to the pose of the plate: level, under its load, tilted. */
static int assembled(const robot_geometry *robot, const double joints[], const vector upper[],
                     plate_pose *pose)
{
    vector loaded[ARMS_AT_MOST];
    double rest[ARMS_AT_MOST];

    if (!newton(robot, upper, pose))
        return 0;
    if (robot->is_stiff)
        return robot->is_level || settle(robot, upper, pose);
    yield_at(robot, joints, pose, rest);
    all_upper_ends(robot, rest, loaded);
    return robot->is_level ? newton(robot, loaded, pose) : settle(robot, loaded, pose);
}

/* The plate's pose for these joints (rad or mm), looked for from where `pose` says, then from safe
 * starts. 0 when it cannot be assembled; then `pose` is of no use. */
static int pose_of(const robot_geometry *robot, const double joints[], plate_pose *pose)
{
    vector upper[ARMS_AT_MOST];
    plate_pose nearby = *pose;
    int i, found;

    all_upper_ends(robot, joints, upper);
    if (robot->is_stiff && !robot->is_level && settle(robot, upper, &nearby)) {
        *pose = nearby;
        return 1;
    }
    found = assembled(robot, joints, upper, pose);
    for (i = 0; !found && i < STARTS; i++) {
        *pose = guess(robot, upper, starts[i]);
        found = assembled(robot, joints, upper, pose);
    }
    return found;
}

/* From joints at rest under the plate's weight near `pose` to those without it: `joints` in place. 0
 * where the way back does not lead to a pose. */
static int unloaded(const robot_geometry *robot, const plate_pose *pose, double joints[])
{
    double scale = robot->kind->on_rails ? 1.0 : 1e3, left = HUGE_VAL;
    double rest[ARMS_AT_MOST], there[ARMS_AT_MOST];
    vector upper[ARMS_AT_MOST];
    plate_pose nearby;
    int i, k;

    for (k = 0; k < robot->kind->arms; k++)
        rest[k] = joints[k];
    for (i = 0; i < ROUNDS && !(left < SETTLED); i++) {
        plate_pose level = *pose;
        all_upper_ends(robot, joints, upper);
        if (!newton(robot, upper, &level))
            return 0;
        yield_at(robot, joints, &level, there);
        left = 0.0;
        for (k = 0; k < robot->kind->arms; k++) {
            left = fmax(left, scale * fabs(there[k] - rest[k]));
            joints[k] -= there[k] - rest[k];
        }
    }
    nearby = *pose;
    all_upper_ends(robot, joints, upper);
    return left < CLOSED && assembled(robot, joints, upper, &nearby);
}

/* All joints whose forearms end at a plate that is tilted so. */
static int joints_at(const robot_geometry *robot, const plate_pose *pose, vector gibbs,
                     double joints[])
{
    int i;

    for (i = 0; i < robot->kind->arms; i++) {
        vector end = plus(pose->point, to_plate_joint(robot, pose->theta, i));
        vector moved = displaced(gibbs, lever(robot, pose->theta, i));
        if (!joint_to(robot, i, plus(end, moved), &joints[i]))
            return 0;
    }
    return 1;
}

/* All joints of a pose whose plate tilts, from those of a level one. */
static int tilted_joints_of(const robot_geometry *robot, const plate_pose *pose, double joints[])
{
    double left = HUGE_VAL, scale = robot->kind->on_rails ? 1.0 : 1e3;
    vector gibbs = {0.0, 0.0, 0.0}, upper[ARMS_AT_MOST];
    int i, k;

    for (i = 0; i < ROUNDS && !(left < SETTLED); i++) {
        double before[ARMS_AT_MOST];
        all_upper_ends(robot, joints, upper);
        left = 1e3 * tilt_further(robot, upper, pose, &gibbs);
        for (k = 0; k < robot->kind->arms; k++)
            before[k] = joints[k];
        if (!joints_at(robot, pose, gibbs, joints))
            return 0;
        for (k = 0; k < robot->kind->arms; k++)
            left = fmax(left, scale * fabs(joints[k] - before[k]));
    }
    return left < CLOSED;
}

/* All joints of a pose (rad or mm). 0 for one out of reach, and for one beyond a singularity: there
 * the same joints would also carry the plate at another place. */
static int joints_of(const robot_geometry *robot, const plate_pose *pose, double joints[])
{
    static const vector level = {0.0, 0.0, 0.0};
    vector upper[ARMS_AT_MOST];
    plate_pose again = *pose;
    double side, misfit;

    if (!has_not_turned_over(robot, pose) || !joints_at(robot, pose, level, joints))
        return 0;
    if (!robot->is_level && !tilted_joints_of(robot, pose, joints))
        return 0;
    all_upper_ends(robot, joints, upper);
    if (!robot->is_level) { /* its step from here is not 0 where the tilt has a part in the closures */
        if (!settle(robot, upper, &again))
            return 0;
    } else {
        newton_step(robot, upper, pose, &side, &misfit);
        if (!is_wanted(robot, upper, pose, side))
            return 0;
    }
    return robot->is_stiff || unloaded(robot, pose, joints);
}

#endif
