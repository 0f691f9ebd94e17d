/* The few HAL functions that pkmkins needs, so that a test can load the very module that LinuxCNC
 * loads and call its kinematics without LinuxCNC; and a clock for them. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static struct { char name[48]; int component; volatile double value; } pins[1024];
static int count, components;

int hal_init(const char *name) { (void)name; return ++components; }
int hal_exit(int component) { (void)component; return 0; }
int hal_ready(int component) { (void)component; return 0; }
void *hal_malloc(long size) { return malloc((size_t)size); }
void rtapi_print_msg(int level, const char *format, ...) { (void)level; (void)format; }

int hal_pin_float_newf(int direction, volatile double **pin, int component, const char *format, ...)
{
    va_list words;

    (void)direction;
    if (count == sizeof pins / sizeof pins[0])
        return -1;
    pins[count].component = component;
    va_start(words, format);
    vsnprintf(pins[count].name, sizeof pins[count].name, format, words);
    va_end(words);
    *pin = &pins[count++].value;
    return 0;
}

/* The component that was made last. */
int stub_component(void) { return components; }

int stub_set(int component, const char *name, double value)
{
    int i;

    for (i = 0; i < count; i++)
        if (pins[i].component == component && !strcmp(pins[i].name, name)) {
            pins[i].value = value;
            return 0;
        }
    return -1;
}

double stub_get(int component, const char *name)
{
    int i;

    for (i = 0; i < count; i++)
        if (pins[i].component == component && !strcmp(pins[i].name, name))
            return pins[i].value;
    return -1.0;
}

int stub_count(int component)
{
    int i, found = 0;

    for (i = 0; i < count; i++)
        found += pins[i].component == component;
    return found;
}

static double now_us(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e6 * now.tv_sec + 1e-3 * now.tv_nsec;
}

typedef int kinematics(const void *from, void *to, const void *flags, void *others);

/* Times in us of one call each, from rows of 9 doubles to as many that are thrown away. */
void stub_time(kinematics *solve, int rows, const double *from, double *times_us)
{
    int i;

    for (i = 0; i < rows; i++) {
        double to[9] = {0.0}, began_us = now_us();
        solve(from + 9 * i, to, 0, 0);
        times_us[i] = now_us() - began_us;
    }
}
