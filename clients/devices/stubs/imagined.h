/* An imagined hand: it goes down for a second, from 25 mm above the middle of the workspace to 1 mm above it, and holds still;
 * from 2 s to 2.6 s it presses the clutch, and lifts by 10 mm meanwhile; then it holds still there. What it feels is told at
 * the end. Included by one file of a program. */
#ifndef IMAGINED_H
#define IMAGINED_H

#include <stdio.h>
#include <time.h>

struct imagined {
    double begun; /* [s] */
    double now;   /* [s] since then, of the last look */
    double up;    /* height above the middle [m] */
    double speed; /* upwards [m/s] */
    int clutch;
    double most[3]; /* felt while it pressed, in the clutch and after it [N] upwards */
};

static struct imagined imagined;

static double imagined_seconds(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static void imagined_look(void)
{
    double t;
    if (imagined.begun == 0.0)
        imagined.begun = imagined_seconds();
    t = imagined.now = imagined_seconds() - imagined.begun;
    imagined.up = t < 1.0 ? 0.025 - 0.024 * t : t < 2.1 ? 0.001 : t < 2.4 ? 0.001 + 0.010 / 0.3 * (t - 2.1) : 0.011;
    imagined.speed = t < 1.0 ? -0.024 : t > 2.1 && t < 2.4 ? 0.010 / 0.3 : 0.0;
    imagined.clutch = t > 2.0 && t < 2.6;
}

static void imagined_feel(double up)
{
    double t = imagined.now;
    int part = t > 1.2 && t < 2.0 ? 0 : t > 2.2 && t < 2.6 ? 1 : t > 3.0 ? 2 : -1;
    if (part >= 0 && up > imagined.most[part])
        imagined.most[part] = up;
}

static void imagined_tell(void)
{
    printf("pressed %.3f N, clutched %.3f N, after %.3f N\n", imagined.most[0], imagined.most[1], imagined.most[2]);
}

#endif
