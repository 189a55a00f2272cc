/* The imagined hand as Force Dimension would have it: in metres, z up; setting a force waits for the next cycle. */
#define _POSIX_C_SOURCE 199309L
#include <dhdc.h>

#include "imagined.h"

int dhdOpen(void)
{
    return 0;
}

int dhdClose(char id)
{
    (void)id;
    imagined_tell();
    return 0;
}

const char *dhdErrorGetLastStr(void)
{
    return "no error";
}

double dhdGetTime(void)
{
    return imagined_seconds();
}

int dhdEnableForce(unsigned char on, char id)
{
    (void)on;
    (void)id;
    return 0;
}

int dhdGetPosition(double *x, double *y, double *z, char id)
{
    (void)id;
    imagined_look();
    *x = *y = 0.0;
    *z = imagined.up;
    return 0;
}

int dhdGetLinearVelocity(double *x, double *y, double *z, char id)
{
    (void)id;
    *x = *y = 0.0;
    *z = imagined.speed;
    return 0;
}

int dhdGetButton(int index, char id)
{
    (void)id;
    return index == 0 && imagined.clutch;
}

int dhdSetForce(double x, double y, double z, char id)
{
    const struct timespec cycle = {0, 250000};
    (void)x;
    (void)y;
    (void)id;
    imagined_feel(z);
    nanosleep(&cycle, NULL);
    return 0;
}
