/* What a kinematics module of LinuxCNC asks of HAL, without HAL: pins by name, in this process.

   genhexkins.so as its package ships it is loaded after this library. Flags, directions and
   identifiers are ignored; a pin is eight bytes, zero until somebody sets it. */

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 256, LONGEST = 64 };

static struct {
    char name[LONGEST];
    void *value;
} pins[MOST];
static int count;

void *pin(const char *name)
{
    for (int k = 0; k < count; k++)
        if (strcmp(pins[k].name, name) == 0)
            return pins[k].value;
    return NULL;
}

static int add(void **place, const char *format, va_list values)
{
    if (count == MOST)
        return -1;
    vsnprintf(pins[count].name, LONGEST, format, values);
    *place = pins[count++].value = calloc(1, 8);
    return 0;
}

#define NAMED_BY_FORMAT(function)                                            \
    int function(int direction, void **place, int component, const char *format, ...) \
    {                                                                        \
        va_list values;                                                      \
        va_start(values, format);                                            \
        int failed = add(place, format, values);                             \
        va_end(values);                                                      \
        return failed;                                                       \
    }

NAMED_BY_FORMAT(hal_pin_float_newf)
NAMED_BY_FORMAT(hal_pin_bit_newf)
NAMED_BY_FORMAT(hal_pin_u32_newf)
NAMED_BY_FORMAT(hal_pin_s32_newf)

static int add_named(void **place, const char *format, ...)
{
    va_list values;
    va_start(values, format);
    int failed = add(place, format, values);
    va_end(values);
    return failed;
}

int hal_pin_bit_new(const char *name, int direction, void **place, int component)
{
    return add_named(place, "%s", name);
}

int hal_pin_s32_new(const char *name, int direction, void **place, int component)
{
    return add_named(place, "%s", name);
}

void *hal_malloc(long size) { return calloc(1, size); }
int hal_init(const char *name) { return 1; }
int hal_ready(int component) { return 0; }
int hal_exit(int component) { return 0; }
void rtapi_print(const char *format, ...) {}
void rtapi_print_msg(int level, const char *format, ...) {}
