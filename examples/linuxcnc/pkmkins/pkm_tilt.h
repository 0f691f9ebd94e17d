/* SPDX-License-Identifier: GPL-2.0-or-later
 *
 * The tilt of the plate by unequal rods and tilted axes.
 *
 * A forearm is two rods between the ends of two bars of equal width: one above, along `axis`, one
 * on the plate, along R plate_bar with R the plate's rotation. With g from the middle of the upper
 * bar to that of the lower one, and rods that differ by `skew` times their distance, they close where
 *     |g| = L                                    the sum of their squares: the contracted forearm
 *     g . (R plate_bar - axis) = skew L          the difference of their squares
 * The second says how the plate tilts: with three arms exactly, with four, one too many, in the sense
 * of least squares, each weighted by how much a tilt of a level plate changes it.
 *
 * R is kept as its Gibbs vector: along the rotation's axis, as long as the tangent of half its angle.
 */
#ifndef PKM_TILT_H
#define PKM_TILT_H

#include "pkm_robot.h"

/* (R - 1) c without the difference of two like numbers: 2 (s x c + s x (s x c)) / (1 + s.s). */
static vector displaced(vector gibbs, vector c)
{
    vector once = cross(gibbs, c);

    return times(2.0 / (1.0 + dot(gibbs, gibbs)), plus(once, cross(gibbs, once)));
}

static vector turned_further(vector gibbs, vector turn)
{
    vector half = times(0.5, turn);
    vector sum = plus(plus(gibbs, half), cross(half, gibbs));

    return times(1.0 / (1.0 - dot(half, gibbs)), sum);
}

/* From the reflector to the middle of a plate bar: what a tilt turns. */
static vector lever(const robot_geometry *robot, double theta, int i)
{
    return plus(to_plate_joint(robot, theta, i), robot->arm[i].on_plate);
}

static void add_row(double system[3][UNKNOWNS_AT_MOST + 1], vector weight, double wanted)
{
    double w[3] = {weight.x, weight.y, weight.z};
    int i, k;

    for (i = 0; i < 3; i++) {
        for (k = 0; k < 3; k++)
            system[i][k] += w[i] * w[k];
        system[i][UNKNOWNS_AT_MOST] += w[i] * wanted;
    }
}

/* One step towards the tilt at a pose, for forearms whose upper ends are these; the error left is
 * some thousandth of what it was. Gives the step, rad. */
static double tilt_further(const robot_geometry *robot, const vector upper[], const plate_pose *pose,
                           vector *gibbs)
{
    double system[3][UNKNOWNS_AT_MOST + 1] = {{0.0}}, turn[3];
    vector step;
    int i;

    for (i = 0; i < robot->kind->arms; i++) {
        const arm_geometry *arm = &robot->arm[i];
        vector end = plus(pose->point, to_plate_joint(robot, pose->theta, i));
        vector moved = displaced(*gibbs, lever(robot, pose->theta, i));
        vector forearm = plus(minus(end, upper[i]), moved);
        vector across = plus(displaced(*gibbs, arm->plate_bar), minus(arm->plate_bar, arm->axis));
        vector weight = times(1.0 / arm->forearm, cross(arm->plate_bar, forearm));
        add_row(system, weight, arm->skew - dot(forearm, across) / arm->forearm);
    }
    solve(3, system, turn);
    step.x = turn[0];
    step.y = turn[1];
    step.z = turn[2];
    *gibbs = turned_further(*gibbs, step);
    return longest(step);
}

/* Upper ends that hold a level plate where these hold the tilted one. */
static void seen_from_level(const robot_geometry *robot, const vector upper[], double theta,
                            vector gibbs, vector moved[])
{
    int i;

    for (i = 0; i < robot->kind->arms; i++)
        moved[i] = minus(upper[i], displaced(gibbs, lever(robot, theta, i)));
}

#endif
