/* Of OpenHaptics' <HD/hd.h> what openhaptics.c uses, with an imagined device behind it (../openhaptics.c): to compile and run
 * the example where there is no OpenHaptics. */
#ifndef STUB_HD_H
#define STUB_HD_H

#define HDCALLBACK
#define HD_DEFAULT_DEVICE NULL
#define HD_CALLBACK_CONTINUE 1
#define HD_MAX_SCHEDULER_PRIORITY 0xffff
#define HD_DEVICE_BUTTON_2 2
#define HD_DEVICE_ERROR(info) ((info).errorCode != 0)
enum {
    HD_CURRENT_BUTTONS,
    HD_CURRENT_POSITION,
    HD_CURRENT_VELOCITY,
    HD_CURRENT_TRANSFORM,
    HD_CURRENT_FORCE,
    HD_FORCE_OUTPUT,
    HD_DEVICE_MODEL_TYPE
};

typedef unsigned int HHD;
typedef int HDint;
typedef unsigned int HDenum;
typedef unsigned int HDCallbackCode;
typedef unsigned long HDSchedulerHandle;
typedef struct {
    unsigned int errorCode;
    int internalErrorCode;
    HHD hHD;
} HDErrorInfo;
typedef HDCallbackCode(HDCALLBACK *HDSchedulerCallback)(void *);

HHD hdInitDevice(const char *name);
void hdDisableDevice(HHD device);
HDErrorInfo hdGetError(void);
const char *hdGetErrorString(unsigned int code);
const char *hdGetString(HDenum what);
void hdEnable(HDenum what);
void hdBeginFrame(HHD device);
void hdEndFrame(HHD device);
void hdGetDoublev(HDenum what, double *values);
void hdGetIntegerv(HDenum what, HDint *values);
void hdSetDoublev(HDenum what, const double *values);
HDSchedulerHandle hdScheduleAsynchronous(HDSchedulerCallback callback, void *data, unsigned short priority);
void hdUnschedule(HDSchedulerHandle handle);
void hdStartScheduler(void);
void hdStopScheduler(void);

#endif
