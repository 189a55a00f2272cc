/* The imagined hand as OpenHaptics would have it: in millimetres, y up, a servo loop on a thread of its own. */
#define _POSIX_C_SOURCE 199309L
#include <HD/hd.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "imagined.h"

static HDSchedulerCallback callback;
static void *callback_data;
static atomic_int running;
static pthread_t scheduler;

HHD hdInitDevice(const char *name)
{
    (void)name;
    return 1;
}

void hdDisableDevice(HHD device)
{
    (void)device;
    imagined_tell();
}

HDErrorInfo hdGetError(void)
{
    HDErrorInfo none = {0, 0, 0};
    return none;
}

const char *hdGetErrorString(unsigned int code)
{
    (void)code;
    return "no error";
}

const char *hdGetString(HDenum what)
{
    return what == HD_DEVICE_MODEL_TYPE ? "Touch" : "";
}

void hdEnable(HDenum what)
{
    (void)what;
}

void hdBeginFrame(HHD device)
{
    (void)device;
    imagined_look();
}

void hdEndFrame(HHD device)
{
    (void)device;
}

void hdGetDoublev(HDenum what, double *values)
{
    static const double unturned[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    if (what == HD_CURRENT_TRANSFORM) {
        memcpy(values, unturned, sizeof unturned);
        return;
    }
    values[0] = values[2] = 0.0;
    values[1] = 1000.0 * (what == HD_CURRENT_POSITION ? imagined.up : imagined.speed);
}

void hdGetIntegerv(HDenum what, HDint *values)
{
    *values = what == HD_CURRENT_BUTTONS && imagined.clutch ? HD_DEVICE_BUTTON_2 : 0;
}

void hdSetDoublev(HDenum what, const double *values)
{
    if (what == HD_CURRENT_FORCE)
        imagined_feel(values[1]);
}

static void *schedule(void *data)
{
    const struct timespec period = {0, 1000000};
    (void)data;
    while (atomic_load(&running)) {
        callback(callback_data);
        nanosleep(&period, NULL);
    }
    return NULL;
}

HDSchedulerHandle hdScheduleAsynchronous(HDSchedulerCallback given, void *data, unsigned short priority)
{
    (void)priority;
    callback = given;
    callback_data = data;
    return 1;
}

void hdUnschedule(HDSchedulerHandle handle)
{
    (void)handle;
}

void hdStartScheduler(void)
{
    atomic_store(&running, 1);
    if (pthread_create(&scheduler, NULL, schedule, NULL) != 0)
        abort();
}

void hdStopScheduler(void)
{
    atomic_store(&running, 0);
    pthread_join(scheduler, NULL);
}
