/* SPDX-License-Identifier: Apache-2.0
 *
 * What a compiled solver needs to calibrate Par4: Gauss-Newton on normal equations, the forward
 * model by Newton, its derivatives from the closures: gauss_newton distances|points REPEATS <problem
 *
 * On stdin numbers, mm and rad: shots N and free parameters F; the 29 parameters (x, y, z, azimuth,
 * joint offset, arm and forearm of each arm, then the plate's length); the F places of the free
 * ones; rotation and translation from base to tracker to begin with, row by row; and for
 * each shot four joints, the pose x, y, z, theta to begin with, and the measured point. Two shots
 * that follow each other are a pair. On stdout: processor time of a solve in us, its iterations,
 * and the F parameters.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { ARMS = 4, OF_ARM = 7, PARAMETERS = ARMS * OF_ARM + 1, FRAME = 6 };
enum { COLUMNS = PARAMETERS + FRAME, MOST_SHOTS = 1000, MOST_STEPS = 50 };

static const double POSE_MM = 1e-10, STEP = 1e-7; /* at which Newton and Gauss-Newton have ended */
typedef struct { double joints[ARMS], start[4], measured[3]; } Shot;
typedef struct { double row[3][4]; } Frame; /* a row of the rotation, then of the translation */

typedef struct {
    int shots, free, places[PARAMETERS];
    double nominal[PARAMETERS];
    Frame frame;
    Shot shot[MOST_SHOTS];
} Problem;
/* Position of a shot, and its derivatives by all parameters. */
typedef struct { double pose[4], by_parameter[3][PARAMETERS]; } Position;
/* Normal equations: upper triangle of J'J, and J'r. */
typedef struct { int size; double matrix[COLUMNS][COLUMNS], side[COLUMNS]; } Normal;

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void fail(const char *why) {
    fprintf(stderr, "gauss_newton: %s\n", why);
    exit(1);
}

/* Inverse of the rows (end less elbow, derivative by theta), of which the first two are 0 there. */
static void invert(double d[ARMS][3], const double *by_theta, double inverse[4][4]) {
    double c[3][3], w[4], schur;
    for (int j = 0; j < 3; j++) cross(d[(j + 1) % 3], d[(j + 2) % 3], c[j]);
    double determinant = dot(d[0], c[0]);
    for (int j = 0; j < 3; j++) w[j] = -dot(d[3], c[j]) / determinant;
    w[3] = 1.0, schur = by_theta[3] + by_theta[2] * w[2];
    if (determinant == 0.0 || schur == 0.0) fail("a pose is singular");
    for (int j = 0; j < 4; j++) {
        inverse[3][j] = w[j] / schur;
        for (int k = 0; k < 3; k++) {
            double alone = j < 3 ? c[j][k] : 0.0;
            inverse[k][j] = (alone - by_theta[2] * inverse[3][j] * c[2][k]) / determinant;
        }
    }
}

/* Position of a shot from the pose that is there; its derivatives are those at the end. */
static void locate(const double *p, const double *joints, Position *at) {
    double elbow[ARMS][3], out[ARMS][3], down[ARMS][3], reach[ARMS];
    for (int i = 0; i < ARMS; i++) {
        const double *arm = p + OF_ARM * i;
        double c = cos(arm[3]), s = sin(arm[3]);
        double along = cos(joints[i] + arm[4]), below = sin(joints[i] + arm[4]);
        reach[i] = arm[5] * along;
        out[i][0] = along * c, out[i][1] = along * s, out[i][2] = -below;
        down[i][0] = -below * c, down[i][1] = -below * s, down[i][2] = -along;
        for (int k = 0; k < 3; k++) elbow[i][k] = arm[k] + arm[5] * out[i][k];
    }
    double plate = p[PARAMETERS - 1], to_end[ARMS][3], inverse[4][4], turned[3], last = INFINITY;
    for (int step = 0;; step++) {
        double s = sin(at->pose[3]), c = cos(at->pose[3]), by_theta[4], closure[4], largest = 0.0;
        turned[0] = -s, turned[1] = c, turned[2] = 0.0;
        double by_turn[3] = {-plate * c, -plate * s, 0.0};
        for (int i = 0; i < ARMS; i++) {
            double forearm = p[OF_ARM * i + 6], second = i >= 2 ? 1.0 : 0.0;
            for (int k = 0; k < 3; k++)
                to_end[i][k] = at->pose[k] + second * plate * turned[k] - elbow[i][k];
            by_theta[i] = second * dot(to_end[i], by_turn);
            closure[i] = 0.5 * (dot(to_end[i], to_end[i]) - forearm * forearm);
        }
        invert(to_end, by_theta, inverse);
        if (last < POSE_MM) break;
        if (step == MOST_STEPS) fail("a shot cannot be reached");
        for (int k = 0; k < 4; k++) {
            double change = 0.0;
            for (int i = 0; i < ARMS; i++) change -= inverse[k][i] * closure[i];
            at->pose[k] += change;
            largest = fmax(largest, fabs(change));
        }
        last = largest * largest; /* what the next step would be: Newton doubles the digits */
    }
    for (int k = 0; k < 3; k++) {
        double by_plate = 0.0;
        for (int i = 0; i < ARMS; i++) {
            const double *arm = p + OF_ARM * i;
            double *by = at->by_parameter[k] + OF_ARM * i, a = inverse[k][i];
            double sideways[3] = {-reach[i] * sin(arm[3]), reach[i] * cos(arm[3]), 0.0};
            for (int j = 0; j < 3; j++) by[j] = a * to_end[i][j];
            by[3] = a * dot(to_end[i], sideways);
            by[4] = a * arm[5] * dot(to_end[i], down[i]);
            by[5] = a * dot(to_end[i], out[i]);
            by[6] = a * arm[6];
            if (i >= 2) by_plate -= a * dot(to_end[i], turned);
        }
        at->by_parameter[k][PARAMETERS - 1] = by_plate;
    }
}

static void add_row(Normal *n, const double *row, double residual) {
    for (int i = 0; i < n->size; i++) {
        for (int j = i; j < n->size; j++) n->matrix[i][j] += row[i] * row[j];
        n->side[i] += row[i] * residual;
    }
}

/* Step of Gauss-Newton by Cholesky of the scaled matrix; gives its largest part, scaled. */
static void solve(Normal *n, double *step) {
    int size = n->size;
    double scale[COLUMNS];
    for (int i = 0; i < size; i++) scale[i] = 1.0 / sqrt(n->matrix[i][i]);
    for (int i = 0; i < size; i++) {
        for (int j = i; j < size; j++) {
            double sum = n->matrix[i][j] * scale[i] * scale[j];
            for (int k = 0; k < i; k++) sum -= n->matrix[k][i] * n->matrix[k][j];
            if (i == j && sum <= 0.0) fail("the shots do not tell the parameters");
            n->matrix[i][j] = i == j ? sqrt(sum) : sum / n->matrix[i][i];
        }
        double sum = -n->side[i] * scale[i];
        for (int k = 0; k < i; k++) sum -= n->matrix[k][i] * step[k];
        step[i] = sum / n->matrix[i][i];
    }
    for (int i = size - 1; i >= 0; i--) {
        for (int j = i + 1; j < size; j++) step[i] -= n->matrix[i][j] * step[j];
        step[i] /= n->matrix[i][i];
    }
    for (int i = 0; i < size; i++) step[i] *= scale[i];
}

/* Turn a frame about its origin, by Rodrigues' formula, and shift it. */
static void move(Frame *f, const double *turn, const double *shift) {
    double angle = sqrt(dot(turn, turn)), s = 1.0, c = 0.5;
    if (angle > 1e-8) s = sin(angle) / angle, c = (1.0 - cos(angle)) / (angle * angle);
    for (int j = 0; j < 3; j++) {
        double column[3] = {f->row[0][j], f->row[1][j], f->row[2][j]}, once[3], twice[3];
        cross(turn, column, once);
        cross(turn, once, twice);
        for (int i = 0; i < 3; i++) f->row[i][j] += s * once[i] + c * twice[i];
        f->row[j][3] += shift[j];
    }
}

/* Three rows of a point as the tracker sees it; the frame's six columns are the last ones. */
static void add_point(const Problem *q, const Position *at, const Shot *s, const Frame *frame,
                      Normal *n) {
    double turned[3], row[COLUMNS];
    for (int i = 0; i < 3; i++) turned[i] = dot(frame->row[i], at->pose);
    for (int i = 0; i < 3; i++) {
        double unit[3] = {i == 0, i == 1, i == 2};
        for (int f = 0; f < q->free; f++) {
            row[f] = 0.0;
            for (int k = 0; k < 3; k++)
                row[f] += frame->row[i][k] * at->by_parameter[k][q->places[f]];
        }
        cross(turned, unit, row + q->free);
        memcpy(row + q->free + 3, unit, sizeof unit);
        add_row(n, row, turned[i] + frame->row[i][3] - s->measured[i]);
    }
}

/* Row of the distance of two shots. */
static void add_distance(const Problem *q, const Position *at, const Shot *s, Normal *n) {
    double between[3], measured[3], row[COLUMNS];
    for (int k = 0; k < 3; k++) {
        between[k] = at[1].pose[k] - at[0].pose[k];
        measured[k] = s[1].measured[k] - s[0].measured[k];
    }
    double distance = sqrt(dot(between, between));
    for (int f = 0; f < q->free; f++) {
        row[f] = 0.0;
        for (int k = 0; k < 3; k++) {
            const double *one = at[0].by_parameter[k], *other = at[1].by_parameter[k];
            row[f] += between[k] / distance * (other[q->places[f]] - one[q->places[f]]);
        }
    }
    add_row(n, row, distance - sqrt(dot(measured, measured)));
}

/* Parameters p that fit best; gives the number of iterations. */
static int identify(const Problem *q, int by_points, Position *at, double *p) {
    double step[COLUMNS];
    Frame frame = q->frame;
    memcpy(p, q->nominal, sizeof q->nominal);
    for (int i = 0; i < q->shots; i++) memcpy(at[i].pose, q->shot[i].start, sizeof at[i].pose);
    for (int iteration = 1; iteration <= MOST_STEPS; iteration++) {
        Normal n = {.size = q->free + (by_points ? FRAME : 0)};
        for (int i = 0; i < q->shots; i++) locate(p, q->shot[i].joints, at + i);
        for (int i = 0; i < q->shots; i += by_points ? 1 : 2) {
            if (by_points) add_point(q, at + i, q->shot + i, &frame, &n);
            else add_distance(q, at + i, q->shot + i, &n);
        }
        solve(&n, step);
        double largest = 0.0;
        for (int f = 0; f < q->free; f++)
            p[q->places[f]] += step[f], largest = fmax(largest, fabs(step[f]));
        if (by_points) move(&frame, step + q->free, step + q->free + 3);
        if (largest < STEP) return iteration;
    }
    fail("no minimum was found");
    return 0;
}
static void read(int count, double *values) {
    for (int i = 0; i < count; i++)
        if (scanf("%lf", values + i) != 1) fail("stdin ends too early");
}

int main(int count, char **words) {
    static Problem q;
    static Position at[MOST_SHOTS];
    int repeats = count == 3 ? atoi(words[2]) : 0, iterations = 0;
    if (repeats < 1) fail("usage: gauss_newton distances|points REPEATS < problem");
    double sizes[2], place, p[PARAMETERS];
    read(2, sizes);
    q.shots = (int)sizes[0], q.free = (int)sizes[1];
    if (q.shots < 3 || q.shots % 2 || q.shots > MOST_SHOTS || q.free < 1 || q.free > PARAMETERS)
        fail("shots are odd or too many, or so many parameters there are not");
    read(PARAMETERS, q.nominal);
    for (int f = 0; f < q.free; f++) {
        read(1, &place), q.places[f] = (int)place;
        if (q.places[f] < 0 || q.places[f] >= PARAMETERS) fail("there is no such parameter");
    }
    for (int i = 0; i < 3; i++) read(4, q.frame.row[i]);
    for (int i = 0; i < q.shots; i++)
        read(ARMS, q.shot[i].joints), read(4, q.shot[i].start), read(3, q.shot[i].measured);
    clock_t began = clock();
    for (int i = 0; i < repeats; i++) iterations = identify(&q, words[1][0] == 'p', at, p);
    printf("%.4f\n%d\n", 1e6 * (double)(clock() - began) / CLOCKS_PER_SEC / repeats, iterations);
    for (int f = 0; f < q.free; f++) printf("%.17g\n", p[q.places[f]]);
    return 0;
}
