/* The motion of a step: along the path, or what the recovery behaviour asks for. */
#ifndef MANOEUVRES_H
#define MANOEUVRES_H

#include "driver.h"

/* Zero: nothing is worth asking for; `driver->why` says why. */
struct motion manoeuvre(struct driver *driver, const struct limits *limits);

#endif
