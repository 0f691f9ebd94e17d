/* SPDX-License-Identifier: GPL-2.0-or-later
 *
 * The geometry of a Par4 and its two ways through it: joints of a pose, pose of joints.
 *
 * In the words of pkmcal's docs:
 *   u = (cos azimuth, sin azimuth, 0), angle = joint + joint_offset, positive downwards
 *   elbow_i = motor_i + arm_i (cos(angle) u - sin(angle) z)
 *   plate joints 0 and 1 are at (X, Y, Z), 2 and 3 at (X - plate sin C, Y + plate cos C, Z)
 *   each forearm_i is as long as from elbow_i to plate joint_i
 *
 * For given joints the plate can be at two places of the workspace. The wanted one has |C| < 90 deg
 * and is the lower; on it the determinant that is called `side` here is positive.
 */
#ifndef PAR4_MODEL_H
#define PAR4_MODEL_H

#define ARMS 4
#define DEG (M_PI / 180.0)

#define ITERATIONS 40
#define STEP_MM 120.0      /* the longest step of one iteration */
#define STEP_RAD 0.35
#define CONVERGED_MM 1e-7  /* the error left is of the order of its square */
#define RESIDUAL_MM 1e-6
#define LEVER_MM 100.0     /* compares a step in theta with one in position */

/* theta in rad and height above the guessed one in mm, tried in turn */
static const double starts[][2] = {
    {0.0, 0.0}, {0.6, -40.0}, {-0.6, -40.0}, {0.0, -150.0},
    {0.9, 60.0}, {-0.9, 60.0}, {0.0, 150.0}
};

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

static void all_elbows(const robot_geometry *robot, const double joints_deg[ARMS],
                       vector elbows[ARMS])
{
    int i;

    for (i = 0; i < ARMS; i++)
        elbows[i] = elbow(&robot->arm[i], joints_deg[i]);
}

/* The plate's pose for these joints, looked for from where `pose` says, then from safe starts.
 * 0 when it cannot be assembled; then `pose` is of no use. */
static int pose_of(const robot_geometry *robot, const double joints_deg[ARMS], plate_pose *pose)
{
    vector elbows[ARMS];
    int i, found;

    all_elbows(robot, joints_deg, elbows);
    found = newton(robot, elbows, pose);
    for (i = 0; !found && i < (int)(sizeof starts / sizeof starts[0]); i++) {
        *pose = guess(robot, elbows, starts[i]);
        found = newton(robot, elbows, pose);
    }
    return found;
}

/* All joints of a pose. 0 for one out of reach, and for one beyond a singularity: there the same
 * joints would also carry the plate at another place. */
static int joints_of(const robot_geometry *robot, const plate_pose *pose, double joints_deg[ARMS])
{
    vector elbows[ARMS];
    double side, misfit;
    int i;

    if (!(fabs(pose->theta) < 0.5 * M_PI))
        return 0;
    for (i = 0; i < ARMS; i++)
        if (!joint_of(robot, pose, i, &joints_deg[i]))
            return 0;
    all_elbows(robot, joints_deg, elbows);
    newton_step(robot, elbows, pose, &side, &misfit);
    return side > 0.0;
}

#endif
