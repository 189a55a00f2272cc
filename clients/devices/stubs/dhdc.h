/* Of Force Dimension's <dhdc.h> what forcedimension.c uses, with an imagined device behind it (forcedimension.c here): to
 * compile and run the example where there is no DHD library. */
#ifndef STUB_DHDC_H
#define STUB_DHDC_H

#define DHD_ON 1

int dhdOpen(void);
int dhdClose(char id);
const char *dhdErrorGetLastStr(void);
double dhdGetTime(void);
int dhdEnableForce(unsigned char on, char id);
int dhdGetPosition(double *x, double *y, double *z, char id);
int dhdGetLinearVelocity(double *x, double *y, double *z, char id);
int dhdGetButton(int index, char id);
int dhdSetForce(double x, double y, double z, char id);

#endif
