/* Palpate: touch soft bodies in real time. The client library for C and C++.
 *
 * `cargo build --profile library -p palpate-sdk` leaves it in target/library: shared (libpalpate_sdk.so, palpate_sdk.dll,
 * libpalpate_sdk.dylib) and static (libpalpate_sdk.a; palpate_sdk.lib with MSVC). On Linux clients/package makes an archive
 * of both, in which the static one is a quarter as long. That needs of the system beside: -lpthread -ldl -lm on Linux.
 * `--no-default-features` leaves out certificates, where no server asks for them, and makes both smaller.
 * examples/touch.c and examples/watch.c are whole clients.
 *
 * Every pose and force here is in the frame of the device that palpate_attachment.frame names; forces are in newtons and
 * torques in newton metres in every frame. Bodies are touched in "body space": right-handed, metres, +x to the right,
 * +y away from the user, +z up. palpate_attachment.registration says where the device lies in it.
 *
 * Functions that return int return 0, or -1 where they failed; palpate_last_error() then says why, in plain words. NULL
 * where something is needed is such a failure. No pointer is kept after the call it was passed to.
 *
 * A palpate_client may be used by any thread, but by one at a time, and so may a palpate_watch: connect and attach where
 * the program starts, send poses and ask for forces in the device's own loop, stop that loop, then detach and close.
 * Functions without a client may be called by any thread at any time.
 */
#ifndef PALPATE_H
#define PALPATE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The version of this library, such as "0.1.0". */
const char *palpate_version(void);

/* Why the last call of this thread that failed did so. Valid until the next call of this thread; never NULL. */
const char *palpate_last_error(void);

/* ---- where the device lies in the body ---- */

/* x_body = scale * R * x_device + translation. Forces come back with the same scale, so that power is the same on both
 * sides. With scale 1 the hand feels true newtons. */
typedef struct palpate_registration {
    double scale;          /* metres of the body per metre of the device */
    double rotation[4];    /* R, a quaternion x, y, z, w */
    double translation[3]; /* [m] */
} palpate_registration;

/* The registration that fits best to `pairs` points, three or more and not on one line: device_points holds 3 * pairs
 * numbers [m] in Palpate's axes (see palpate_frame_position), body_points as many in body space [m]. `scale` is taken as
 * given, or fitted too where it is 0. `residual`, unless NULL, is the root mean square of the distances left [m]. */
int palpate_registration_fit(const double *device_points, const double *body_points, size_t pairs, double scale,
                             palpate_registration *registration, double *residual);

/* Shifts a registration so that this point of the device is that point of the body [m]; both in Palpate's axes. */
int palpate_registration_place(palpate_registration *registration, const double device[3], const double body[3]);

/* A position from the axes and unit of a frame to Palpate's axes and metres. Frames: "palpate", "openxr", "unity",
 * "unreal", "ros", "phantom" (OpenHaptics: mm), "haply". */
int palpate_frame_position(const char *frame, const double position[3], double palpate_position[3]);

/* ---- a connection, and a tool in the hand ---- */

typedef struct palpate_client palpate_client;

/* Connects to a server; NULL for an endpoint or the session means that of a server on this machine, started without
 * arguments. `identity` is the folder of this client's certificate, from `palpate certificates`; NULL where the server asks
 * for none. Takes up to 5 s for each endpoint. Returns NULL where it failed.
 *
 * The network's threads start here, and inherit the scheduling class of the calling thread: raise that first. */
palpate_client *palpate_connect(const char *force_endpoint, const char *surface_endpoint, const char *session,
                                const char *identity);

/* As palpate_connect, but only to the surface endpoint: enough for palpate_session and palpate_status, not for a tool. */
palpate_client *palpate_connect_surface(const char *surface_endpoint, const char *session, const char *identity);

/* A tool of the server. */
typedef struct palpate_tool {
    uint32_t tool;     /* its number */
    int32_t taken;     /* not 0: somebody holds it */
    const char *name;  /* what palpate_attachment.tool takes */
    const char *shape; /* "ball", "capsule", "cylinder", "convex" or "compound" */
    double radius;     /* [m]; of the ball around the reference point that holds it, for the last two */
    double length;     /* [m] of a capsule's axis or of a cylinder, along the tool's own +z; 0 for the others */
} palpate_tool;

/* What the server simulates. Boxes are least x, y, z, then greatest, in body space. */
typedef struct palpate_session_info {
    uint32_t version_major; /* of the contract that the server speaks */
    uint32_t version_minor;
    const char *name;
    const char *body;
    uint64_t tick;          /* simulated time [ms] */
    double mass;            /* [kg] */
    double bounds[6];       /* of the body at rest [m] */
    double workspace[6];    /* [m]; poses outside are refused */
    double force_limit;     /* [N] of the scene; that of the device comes beside */
    double torque_limit;    /* [N m] */
    size_t tools;
    const palpate_tool *tool_list; /* tools */
} palpate_session_info;

/* Asks what the server simulates; waits up to 2 s for its answer, so not in a device's loop. Texts and tools are valid until
 * the next palpate_session of this client, or its end. */
int palpate_session(palpate_client *client, palpate_session_info *session);

/* How the server is doing. Counts are since its start. */
typedef struct palpate_server_status {
    uint64_t tick;             /* simulated time [ms] */
    double tick_rate_hz;       /* ticks a second, over the last one */
    double age;                /* of this status since its arrival [s]; they come once a second: 3 s mean that it is silent */
    double lateness;           /* of a tick's start, 99 % of them [s] */
    double compute;            /* time spent in a tick, 99 % of them [s] */
    uint64_t missed_deadlines; /* ticks that ended too late */
    uint64_t lapsed_ticks;     /* that the machine lost: time passed, the body stood still */
    uint64_t unmoved_ticks;    /* whose work the machine could not do */
    uint64_t restored_states;  /* that were not finite, or entangled, and were replaced */
    uint64_t refused;          /* messages of clients */
    uint64_t nodes;            /* simulated now */
    uint64_t elements;
    uint64_t clients;          /* that hold a tool now */
} palpate_server_status;

/* Fills in the newest status. Returns 1; 0 where none has come yet, which leaves it as it was; -1 where it failed. The first
 * call begins to listen, and the first status comes within a second or so. */
int palpate_status(palpate_client *client, palpate_server_status *status);

/* How to take a tool. Fill it with palpate_attachment_defaults and change what differs; NULL text means the default. */
typedef struct palpate_attachment {
    const char *client;  /* a name for people; "C client" */
    const char *tool;    /* name of the tool to take; any free one */
    double rate_hz;      /* how often poses will be sent [Hz]; 1000. 72 to 90 for a headset */
    const char *device;  /* "Touch", "PHANTOM Omni", "Touch X", "omega" ..., or a device file that ends in .toml;
                            "PHANTOM Omni" */
    const char *frame;   /* frame of poses and forces; "palpate" */
    const char *render;  /* "raw", "passive", "local" or "local-passive", the default */
    palpate_registration registration; /* the identity */
} palpate_attachment;

void palpate_attachment_defaults(palpate_attachment *attachment);

/* Takes a tool; one at a time for each client. The device's limits become those of the force and of the virtual
 * coupling: there is no gain to tune. */
int palpate_attach(palpate_client *client, const palpate_attachment *attachment);

/* Where the device holds the tool, in the frame and unit of the attachment. */
typedef struct palpate_pose {
    double position[3];    /* of the tool's reference point */
    double orientation[4]; /* unit quaternion, in the frame's order: x, y, z, w, but w, x, y, z for "haply" */
    uint32_t buttons;      /* bit i: button i is held */
    float opening;         /* how far the tool's jaws are to be open: 0, closed, to 1 */
} palpate_pose;

/* Sends a pose, as often as the attachment said. Does not wait for the network. A pose that is not finite, or whose
 * quaternion is zero, is a failure and not sent. While the tool is gone (see palpate_state) this is a failure, too; the
 * pose is sent in case that it comes back. */
int palpate_send_pose(palpate_client *client, const palpate_pose *pose);

/* The force [N] to give now, and the torque [N m] unless that is NULL: call it at the device's own rate, 1 kHz or more,
 * with the position and velocity just read, in the unit of the frame and that per second. The local model of the newest
 * wrench answers; it fades when wrenches stop coming, and never exceeds the device's limit. Does not wait for the network.
 * Where it fails, and it does while the tool is gone, the force is zero. */
int palpate_force(palpate_client *client, const double position[3], const double velocity[3], double force[3],
                  double torque[3]);

/* Whether the tool is still in the hand. */
enum palpate_hold {
    PALPATE_HELD = 0,    /* wrenches come and answer the poses */
    PALPATE_FADING = 1,  /* wrenches have stopped: the force fades, and is zero 70 ms after the last */
    PALPATE_REFUSED = 2, /* the server takes none of the poses since 0.2 s: they are outside the workspace */
    PALPATE_GONE = 3     /* no wrench for 1 s, or somebody else holds the tool: detach, and attach again */
};

/* Where a tool stands in its life: why there is no force. */
enum palpate_phase {
    PALPATE_DETACHED = 0, /* no pose has come to the server, or they stopped for 100 ms */
    PALPATE_WAITING = 1,  /* the tool has to leave the body before it can touch it */
    PALPATE_ENGAGED = 2,  /* forces are rendered */
    PALPATE_HOLDING = 3   /* poses are late: the force fades */
};

/* Bits of palpate_tool_state.flags: why the force differs from the physical one. */
enum palpate_flag {
    PALPATE_CLAMPED = 1,          /* by the force limit */
    PALPATE_SLEW_LIMITED = 2,     /* by the slew limit */
    PALPATE_RAMPING = 4,          /* by the ramp at engage or at loss */
    PALPATE_SPEED_LIMITED = 8,    /* the simulated tool lags the pose */
    PALPATE_STATE_RESTORED = 16,  /* a state that was not finite was replaced */
    PALPATE_SUBSTEPS_DROPPED = 32 /* the work budget did not cover the tick */
};

/* How the tool is doing. */
typedef struct palpate_tool_state {
    int32_t hold;            /* enum palpate_hold */
    int32_t phase;           /* enum palpate_phase, of the newest wrench */
    uint32_t flags;          /* of the newest wrench */
    uint32_t contact_points; /* that carry force in it; 0: free */
    double age;              /* of the newest wrench since its arrival, or of the attachment before the first [s] */
    double opening;          /* of the jaws of the simulated tool at the last palpate_force: 0, closed, to 1 */
    double grip_torque;      /* what opens them, for the angle between them, to give now [N m]; fades as the force does */
} palpate_tool_state;

/* Fills in how the tool is doing. A failure only where the client has attached none: that a tool is gone is an answer. */
int palpate_state(palpate_client *client, palpate_tool_state *state);

/* While the clutch is pressed (not 0) the tool stays where it is in the body and the hand moves freely; afterwards the
 * motion goes on from there, without a jump, and the force comes back within 0.2 s. Goes on the next pose or force. */
int palpate_clutch(palpate_client *client, int pressed);

/* Gives the tool back. The tool is let go also where this fails. */
int palpate_detach(palpate_client *client);

/* Closes the connection and frees the client, and gives back a tool that it still holds. NULL is allowed. */
void palpate_close(palpate_client *client);

/* ---- the surface as it moves ---- */

typedef struct palpate_watch palpate_watch;

/* Watches the surface: every frame (1) of 31.25 a second, every second (2), fourth (4) or eighth (8), with the level of
 * detail of each vertex (not 0) or without. Endpoint, session and identity are as for palpate_connect.
 * It goes on by itself after lost frames, a lost connection or a restart of the server. Returns NULL where it failed. */
palpate_watch *palpate_watch_open(const char *surface_endpoint, const char *session, const char *identity,
                                  uint32_t every, int levels);

/* A tool that somebody holds. */
typedef struct palpate_shown_tool {
    uint32_t tool;
    int32_t phase;        /* enum palpate_phase */
    float position[3];    /* [m] */
    float orientation[4]; /* quaternion x, y, z, w */
    float force[3];       /* [N] on the tool, rendered */
} palpate_shown_tool;

/* The surface at one tick, in body space [m]. The pointers are valid until the next call for this watch. */
typedef struct palpate_surface {
    uint32_t topology;      /* another number: other triangles */
    uint64_t tick;          /* simulated time [ms] */
    uint64_t sequence;      /* +1 with every frame of the server */
    size_t vertices;
    size_t triangles;
    size_t tools;
    const float *positions; /* 3 * vertices [m] */
    const float *normals;   /* 3 * vertices, unit, out of the body */
    const uint32_t *indices; /* 3 * triangles vertex numbers, counter-clockwise seen from outside */
    const uint8_t *levels;  /* vertices, 0 the coarsest; NULL without levels */
    const palpate_shown_tool *shown_tools; /* tools */
} palpate_surface;

/* Fills in the newest surface. Returns 1 where it is newer than that of the last call, 0 where none has come since, which
 * leaves the surface as it was, and -1 where it failed. Does not wait for the network. */
int palpate_watch_latest(palpate_watch *watch, palpate_surface *surface);

/* Ends a watch. NULL is allowed. */
void palpate_watch_close(palpate_watch *watch);

#ifdef __cplusplus
}
#endif

#endif /* PALPATE_H */
