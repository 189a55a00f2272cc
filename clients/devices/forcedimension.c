/* An omega, delta or sigma of Force Dimension in the hand: forces at the rate of the device, up to 4 kHz, a clutch on its first
 * button.
 *
 *     cc -std=c99 -IINCLUDE -I$DHD/include forcedimension.c libpalpate_sdk.so -L$DHD/lib -ldhd -lm -o omega
 *     ./omega [FORCE_ENDPOINT SURFACE_ENDPOINT SESSION [X Y Z [SECONDS]]]
 *
 * X Y Z [m] is the place in the body that the middle of the device's workspace is registered to.
 */
#include <dhdc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "palpate.h"

/* The only device, or the first. */
#define FIRST ((char)-1)

static int fail(const char *what, const char *why)
{
    fprintf(stderr, "%s: %s\n", what, why);
    dhdClose(FIRST);
    return EXIT_FAILURE;
}

int main(int argc, char **argv)
{
    const double middle[3] = {0.0, 0.0, 0.0}, quarter = sqrt(0.5);
    double place[3] = {0.0, 0.0, 0.0}, seconds = argc > 7 ? strtod(argv[7], NULL) : HUGE_VAL;
    double begun, sent = -1.0, again = 0.0;
    palpate_attachment attachment;
    palpate_client *client;
    int held = 1, i;

    for (i = 0; i < 3 && argc > 6; i++)
        place[i] = strtod(argv[4 + i], NULL);
    if (dhdOpen() < 0)
        return fail("the device", dhdErrorGetLastStr());
    client = palpate_connect(argc > 1 ? argv[1] : NULL, argc > 2 ? argv[2] : NULL, argc > 3 ? argv[3] : NULL,
                                   getenv("PALPATE_IDENTITY"));
    palpate_attachment_defaults(&attachment);
    attachment.client = "forcedimension.c";
    attachment.device = "omega";
    /* Its x points to the user and its y to the right: a quarter turn about z makes them Palpate's -y and x. */
    attachment.registration.rotation[2] = -quarter;
    attachment.registration.rotation[3] = quarter;
    if (client == NULL || palpate_registration_place(&attachment.registration, middle, place) != 0
        || palpate_attach(client, &attachment) != 0)
        return fail("palpate", palpate_last_error());
    dhdEnableForce(DHD_ON, FIRST);

    for (begun = dhdGetTime(); dhdGetTime() < begun + seconds;) {
        palpate_pose pose = {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}, 0, 0.0f};
        double velocity[3], force[3] = {0.0, 0.0, 0.0}, now = dhdGetTime();
        dhdGetPosition(&pose.position[0], &pose.position[1], &pose.position[2], FIRST); /* m */
        dhdGetLinearVelocity(&velocity[0], &velocity[1], &velocity[2], FIRST);          /* m/s */
        pose.buttons = dhdGetButton(0, FIRST) == DHD_ON;
        if (held) {
            held = palpate_clutch(client, pose.buttons != 0) == 0;
            /* The force each time, a pose once a millisecond: the server takes no more. */
            if (held && now >= sent + 0.001) {
                held = palpate_send_pose(client, &pose) == 0;
                sent = now;
            }
            held = held && palpate_force(client, pose.position, velocity, force, NULL) == 0;
            if (!held) {
                fprintf(stderr, "no tool: %s\n", palpate_last_error());
                force[0] = force[1] = force[2] = 0.0;
            }
        }
        /* Waits for the device's next cycle. */
        if (dhdSetForce(force[0], force[1], force[2], FIRST) < 0)
            return fail("the device", dhdErrorGetLastStr());
        if (!held && now >= again) {
            /* Once a second, without force meanwhile. */
            again = now + 1.0;
            palpate_detach(client);
            held = palpate_attach(client, &attachment) == 0;
        }
    }
    dhdClose(FIRST);
    palpate_close(client);
    return EXIT_SUCCESS;
}
