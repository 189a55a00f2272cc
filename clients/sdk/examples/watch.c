/* Watches the server's body, and prints what a viewer would draw.
 *
 * On Linux, from the root of the repository, beside a running `palpate serve`:
 *
 *     cargo build --profile library -p palpate-sdk
 *     cc -std=c99 -Iclients/sdk/include clients/sdk/examples/watch.c target/library/libpalpate_sdk.so -o watch
 *     ./watch [SURFACE_ENDPOINT SESSION [FRAMES]]
 *
 * PALPATE_IDENTITY in the environment is the folder of a certificate, where the server asks for one.
 */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "palpate.h"

int main(int argc, char **argv)
{
    const char *surface_endpoint = argc > 1 ? argv[1] : NULL;
    const char *session = argc > 2 ? argv[2] : NULL;
    const char *identity = getenv("PALPATE_IDENTITY");
    const long frames = argc > 3 ? strtol(argv[3], NULL, 10) : 100;
    const struct timespec pause = {0, 5000000}; /* 5 ms; a viewer asks before each picture instead */
    palpate_session_info about;
    palpate_server_status status;
    palpate_surface surface;
    palpate_client *client = palpate_connect_surface(surface_endpoint, session, identity);
    palpate_watch *watch = palpate_watch_open(surface_endpoint, session, identity, 1, 0);
    long frame = 0;
    int newer = 0;

    if (watch == NULL || palpate_session(client, &about) != 0 || palpate_status(client, &status) < 0) {
        fprintf(stderr, "watch: %s\n", palpate_last_error());
        return EXIT_FAILURE;
    }
    printf("session %s: %s, %.3f kg\n", about.name, about.body, about.mass);
    while (frame < frames && (newer = palpate_watch_latest(watch, &surface)) >= 0) {
        size_t i, highest = 0;
        if (newer == 0) {
            nanosleep(&pause, NULL);
            continue;
        }
        for (i = 1; i < surface.vertices; i++)
            if (surface.positions[3 * i + 2] > surface.positions[3 * highest + 2])
                highest = i;
        printf("frame %lu: %lu vertices, %lu triangles, highest %.6f m, its normal %.3f up", (unsigned long)surface.sequence,
               (unsigned long)surface.vertices, (unsigned long)surface.triangles, surface.positions[3 * highest + 2],
               surface.normals[3 * highest + 2]);
        for (i = 0; i < surface.tools; i++)
            printf(", tool %u: %.3f N up", (unsigned)surface.shown_tools[i].tool, surface.shown_tools[i].force[2]);
        printf("\n");
        fflush(stdout);
        frame++;
    }
    if (newer < 0)
        fprintf(stderr, "surface: %s\n", palpate_last_error());
    if (palpate_status(client, &status) == 1)
        printf("server at tick %lu, %.1f ticks a second, %lu late\n", (unsigned long)status.tick, status.tick_rate_hz,
               (unsigned long)status.missed_deadlines);
    palpate_watch_close(watch);
    palpate_close(client);
    return newer < 0 ? EXIT_FAILURE : EXIT_SUCCESS;
}
