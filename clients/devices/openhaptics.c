/* A Touch, PHANTOM or any other device of OpenHaptics in the hand: forces in its own servo loop, a clutch on its second
 * button.
 *
 *     cc -std=c11 -IINCLUDE -I$OPENHAPTICS/include openhaptics.c libpalpate_sdk.so -L$OPENHAPTICS/lib -lHD -lm -o touch
 *     ./touch [FORCE_ENDPOINT SURFACE_ENDPOINT SESSION [X Y Z [SECONDS]]]
 *
 * X Y Z [m] is the place in the body that the middle of the device's workspace is registered to.
 */
#define _POSIX_C_SOURCE 199309L
#include <HD/hd.h>
#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "palpate.h"

/* Who may use the client: the servo loop, or, once it has found the tool gone, the main thread. */
enum owner { SERVO, MAIN };

struct hand {
    palpate_client *client;
    HHD device;
    atomic_int owner;
};

/* The quaternion of a rotation: `transform` is 4 by 4, column by column. */
static void quaternion(const double transform[16], double q[4])
{
    double m[3][3], trace;
    int i, j, k;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            m[i][j] = transform[4 * j + i];
    trace = m[0][0] + m[1][1] + m[2][2];
    if (trace > 0.0) {
        double s = sqrt(trace + 1.0);
        q[3] = 0.5 * s;
        q[0] = 0.5 / s * (m[2][1] - m[1][2]);
        q[1] = 0.5 / s * (m[0][2] - m[2][0]);
        q[2] = 0.5 / s * (m[1][0] - m[0][1]);
        return;
    }
    i = m[1][1] > m[0][0] ? 1 : 0;
    i = m[2][2] > m[i][i] ? 2 : i;
    j = (i + 1) % 3;
    k = (i + 2) % 3;
    {
        double s = sqrt(m[i][i] - m[j][j] - m[k][k] + 1.0);
        q[i] = 0.5 * s;
        q[3] = 0.5 / s * (m[k][j] - m[j][k]);
        q[j] = 0.5 / s * (m[j][i] + m[i][j]);
        q[k] = 0.5 / s * (m[k][i] + m[i][k]);
    }
}

/* The servo loop, 1 kHz: a pose out, a force in. Where the tool is gone there is no force. */
static HDCallbackCode HDCALLBACK servo(void *data)
{
    struct hand *hand = data;
    palpate_pose pose;
    double velocity[3], transform[16], force[3] = {0.0, 0.0, 0.0};
    HDint buttons;

    hdBeginFrame(hand->device);
    hdGetDoublev(HD_CURRENT_POSITION, pose.position); /* mm */
    hdGetDoublev(HD_CURRENT_VELOCITY, velocity);      /* mm/s */
    hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
    hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
    quaternion(transform, pose.orientation);
    pose.buttons = (uint32_t)buttons;
    pose.opening = 0.0f;
    if (atomic_load(&hand->owner) == SERVO) {
        int good = palpate_clutch(hand->client, (buttons & HD_DEVICE_BUTTON_2) != 0) == 0;
        good = good && palpate_send_pose(hand->client, &pose) == 0;
        good = good && palpate_force(hand->client, pose.position, velocity, force, NULL) == 0;
        if (!good) {
            memset(force, 0, sizeof force);
            atomic_store(&hand->owner, MAIN);
        }
    }
    hdSetDoublev(HD_CURRENT_FORCE, force);
    hdEndFrame(hand->device);
    return HD_CALLBACK_CONTINUE;
}

int main(int argc, char **argv)
{
    const double middle[3] = {0.0, 0.0, 0.0};
    const struct timespec pause = {0, 100000000};
    double place[3] = {0.0, 0.0, 0.0}, seconds = argc > 7 ? strtod(argv[7], NULL) : HUGE_VAL, passed;
    struct hand hand;
    palpate_attachment attachment;
    HDSchedulerHandle loop;
    HDErrorInfo error;
    int i;

    for (i = 0; i < 3 && argc > 6; i++)
        place[i] = strtod(argv[4 + i], NULL);
    hand.device = hdInitDevice(HD_DEFAULT_DEVICE);
    error = hdGetError();
    if (HD_DEVICE_ERROR(error)) {
        fprintf(stderr, "the device: %s\n", hdGetErrorString(error.errorCode));
        return EXIT_FAILURE;
    }
    hand.client = palpate_connect(argc > 1 ? argv[1] : NULL, argc > 2 ? argv[2] : NULL, argc > 3 ? argv[3] : NULL,
                                        getenv("PALPATE_IDENTITY"));
    palpate_attachment_defaults(&attachment);
    attachment.client = "openhaptics.c";
    attachment.device = (const char *)hdGetString(HD_DEVICE_MODEL_TYPE);
    attachment.frame = "phantom";
    if (hand.client == NULL || palpate_registration_place(&attachment.registration, middle, place) != 0
        || palpate_attach(hand.client, &attachment) != 0) {
        fprintf(stderr, "palpate: %s\n", palpate_last_error());
        hdDisableDevice(hand.device);
        return EXIT_FAILURE;
    }
    atomic_init(&hand.owner, SERVO);
    hdEnable(HD_FORCE_OUTPUT);
    loop = hdScheduleAsynchronous(servo, &hand, HD_MAX_SCHEDULER_PRIORITY);
    hdStartScheduler();

    for (passed = 0.0; passed < seconds; passed += 0.1) {
        nanosleep(&pause, NULL);
        if (atomic_load(&hand.owner) == MAIN) {
            /* Taken again where the hand is: the tool has to leave the body before it can touch. */
            palpate_detach(hand.client);
            if (palpate_attach(hand.client, &attachment) == 0)
                atomic_store(&hand.owner, SERVO);
            else
                fprintf(stderr, "no tool: %s\n", palpate_last_error());
        }
    }
    hdStopScheduler();
    hdUnschedule(loop);
    hdDisableDevice(hand.device);
    palpate_close(hand.client);
    return EXIT_SUCCESS;
}
