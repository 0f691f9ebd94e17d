/* SPDX-License-Identifier: GPL-2.0-or-later
 *
 * Vectors, and linear systems of at most four unknowns.
 */
#ifndef PKM_VECTORS_H
#define PKM_VECTORS_H

#define UNKNOWNS_AT_MOST 4

typedef struct { double x, y, z; } vector;

static double dot(vector a, vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

static vector plus(vector a, vector b)
{
    vector sum = {a.x + b.x, a.y + b.y, a.z + b.z};
    return sum;
}

static vector minus(vector a, vector b)
{
    vector difference = {a.x - b.x, a.y - b.y, a.z - b.z};
    return difference;
}

static vector times(double factor, vector a)
{
    vector product = {factor * a.x, factor * a.y, factor * a.z};
    return product;
}

static vector cross(vector a, vector b)
{
    vector product = {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
    return product;
}

static double longest(vector a) { return fmax(fmax(fabs(a.x), fabs(a.y)), fabs(a.z)); }

static void swap_rows(double a[UNKNOWNS_AT_MOST + 1], double b[UNKNOWNS_AT_MOST + 1])
{
    int i;

    for (i = 0; i <= UNKNOWNS_AT_MOST; i++) {
        double kept = a[i];
        a[i] = b[i];
        b[i] = kept;
    }
}

/* Solves `size` rows, the right sides in their last column, and gives the determinant. With one of
 * 0 the solution is not finite. */
static double solve(int size, double system[][UNKNOWNS_AT_MOST + 1], double solution[])
{
    double determinant = 1.0;
    int place, row, i;

    for (place = 0; place < size; place++) {
        int best = place;
        for (row = place + 1; row < size; row++)
            if (fabs(system[row][place]) > fabs(system[best][place]))
                best = row;
        if (best != place) {
            swap_rows(system[place], system[best]);
            determinant = -determinant;
        }
        determinant *= system[place][place];
        for (row = place + 1; row < size; row++) {
            double factor = system[row][place] / system[place][place];
            for (i = place; i < UNKNOWNS_AT_MOST + 1; i++)
                system[row][i] -= factor * system[place][i];
        }
    }
    for (place = size - 1; place >= 0; place--) {
        solution[place] = system[place][UNKNOWNS_AT_MOST];
        for (i = place + 1; i < size; i++)
            solution[place] -= system[place][i] * solution[i];
        solution[place] /= system[place][place];
    }
    return determinant;
}

#endif
