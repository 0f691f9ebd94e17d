/* The few HAL functions that par4kins needs, so that a test can load the very module that LinuxCNC
 * loads and call its kinematics without LinuxCNC. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct { char name[48]; volatile double value; } pins[64];
static int count;

int hal_init(const char *name) { (void)name; return 1; }
int hal_exit(int component) { (void)component; return 0; }
int hal_ready(int component) { (void)component; return 0; }
void *hal_malloc(long size) { return calloc(1, (size_t)size); }

int hal_pin_float_newf(int direction, volatile double **pin, int component, const char *format, ...)
{
    va_list words;

    (void)direction;
    (void)component;
    va_start(words, format);
    vsnprintf(pins[count].name, sizeof pins[count].name, format, words);
    va_end(words);
    *pin = &pins[count++].value;
    return 0;
}

int stub_set(const char *name, double value)
{
    int i;

    for (i = 0; i < count; i++)
        if (!strcmp(pins[i].name, name)) {
            pins[i].value = value;
            return 0;
        }
    return -1;
}

int stub_count(void) { return count; }
