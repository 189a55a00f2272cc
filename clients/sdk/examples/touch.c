/* Presses a ball on the server's body with an imagined device, and prints what the hand would feel.
 *
 * On Linux, from the root of the repository, beside a running `palpate serve`:
 *
 *     cargo build --profile library -p palpate-sdk
 *     cc -std=c99 -Iclients/sdk/include clients/sdk/examples/touch.c target/library/libpalpate_sdk.so -lm -o touch
 *     ./touch [FORCE_ENDPOINT SURFACE_ENDPOINT SESSION [X Y Z]]
 *
 * X Y Z [m] is the place in the body that is touched; the origin without it. PALPATE_IDENTITY in the environment is the
 * folder of a certificate, where the server asks for one.
 *
 * With a real device, read_device asks its driver and the force goes to its motors; nothing else changes.
 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "palpate.h"

/* Where the imagined device is after `seconds`: from 25 mm above the place down to 1 mm, in a second. In the axes and
 * the millimetres of a PHANTOM, where +y is up. */
static void read_device(double seconds, palpate_pose *pose, double velocity[3])
{
    double travel = seconds < 1.0 ? seconds : 1.0;
    palpate_pose now = {{0.0, 25.0 - 24.0 * travel, 0.0}, {0.0, 0.0, 0.0, 1.0}, 0, 0.0f};
    velocity[0] = velocity[2] = 0.0;
    velocity[1] = seconds < 1.0 ? -24.0 : 0.0;
    *pose = now;
}

static int fail(const char *what)
{
    fprintf(stderr, "%s: %s\n", what, palpate_last_error());
    return EXIT_FAILURE;
}

int main(int argc, char **argv)
{
    const char *force_endpoint = argc > 1 ? argv[1] : NULL;
    const char *surface_endpoint = argc > 2 ? argv[2] : NULL;
    const char *session = argc > 3 ? argv[3] : NULL;
    const struct timespec period = {0, 1000000}; /* 1 ms; a real device's driver calls back instead */
    double force[3] = {0.0, 0.0, 0.0};
    palpate_session_info session_info;
    palpate_server_status status;
    palpate_tool_state state;
    const double device_origin[3] = {0.0, 0.0, 0.0};
    double place[3] = {0.0, 0.0, 0.0};
    palpate_attachment attachment;
    palpate_client *client;
    int tick, i;

    for (i = 0; i < 3 && argc > 6; i++)
        place[i] = strtod(argv[4 + i], NULL);
    client = palpate_connect(force_endpoint, surface_endpoint, session, getenv("PALPATE_IDENTITY"));
    if (client == NULL)
        return fail("connect");
    if (palpate_session(client, &session_info) != 0)
        return fail("ask for the session");
    printf("session %s: %s, %lu tools, the first a %s called %s\n", session_info.name, session_info.body,
           (unsigned long)session_info.tools, session_info.tools > 0 ? session_info.tool_list[0].shape : "tool",
           session_info.tools > 0 ? session_info.tool_list[0].name : "nothing");
    if (palpate_status(client, &status) < 0)
        return fail("listen to the status");
    palpate_attachment_defaults(&attachment);
    attachment.client = "touch.c";
    attachment.device = "Touch";
    attachment.frame = "phantom";
    if (palpate_registration_place(&attachment.registration, device_origin, place) != 0)
        return fail("register");
    if (palpate_attach(client, &attachment) != 0)
        return fail("attach");

    for (tick = 0; tick < 1500; tick++) {
        palpate_pose pose;
        double velocity[3];
        read_device(tick * 0.001, &pose, velocity);
        if (palpate_send_pose(client, &pose) != 0)
            return fail("send a pose");
        if (palpate_force(client, pose.position, velocity, force, NULL) != 0)
            return fail("render");
        if (tick % 100 == 0)
            printf("%4d ms: %6.1f mm, %6.3f N\n", tick, pose.position[1], force[1]);
        nanosleep(&period, NULL);
    }
    printf("library %s, at the end %.3f N up, %.3f N aside\n", palpate_version(), force[1],
           sqrt(force[0] * force[0] + force[2] * force[2]));

    if (palpate_state(client, &state) != 0)
        return fail("state");
    printf("%s, %s, newest wrench %.3f s old\n", state.hold == PALPATE_HELD ? "held" : "not held",
           state.phase == PALPATE_ENGAGED ? "engaged" : "not engaged", state.age);
    if (palpate_status(client, &status) == 1)
        printf("server at tick %lu, %.1f ticks a second, %lu clients, said %.3f s ago\n", (unsigned long)status.tick,
               status.tick_rate_hz, (unsigned long)status.clients, status.age);

    if (palpate_detach(client) != 0)
        return fail("detach");
    palpate_close(client);
    return EXIT_SUCCESS;
}
