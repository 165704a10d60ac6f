/* What to do where no motion leads on: wait, look around, go back, look from elsewhere, give up. */
#ifndef RECOVERY_H
#define RECOVERY_H

#include "driver.h"

/* From there the laser's line lies before the same ground again. */
#define RECOVERY_AGAIN_FROM_MM (ROBOT_LINE_MM + 1250)

/* Begins a behaviour. */
void recovery_begin(struct driver *driver, enum recovery recovery);
/* No motion is worth asking for, and has not been for a while: chooses what to do about it. */
void recovery_stuck(struct driver *driver);
/* Whether ground has not been looked at too often yet; counts that it is looked at. */
bool recovery_may_look_again(struct driver *driver, struct point point);
/* Whether the robot can turn around where it stands. */
bool recovery_has_room(const struct driver *driver);
/* No point shows the ground on the path: it is given up, for this goal; or the goal is. */
void recovery_no_view(struct driver *driver);
/* Notes where the robot comes by. */
void recovery_drop_crumb(struct driver *driver);
/* The last crumb that is not yet reached on the path back; false: there is none. */
bool recovery_crumb(struct driver *driver, struct point *crumb);
/* Ends the drive. */
void recovery_give_up(struct driver *driver, enum driver_why why);

#endif
