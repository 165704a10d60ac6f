/* What to do where no motion leads on: wait, look around, go back, look from elsewhere, give up. */
#ifndef TACTICS_H
#define TACTICS_H

#include "driver.h"

#define TACTICS_AGAIN_FROM_MM 9700 /* from there the line lies before the same ground again */

/* Begins a tactic. */
void tactics_begin(struct driver *driver, enum driver_tactic tactic);
/* No motion is worth asking for, and has not been for a while: chooses what to do about it. */
void tactics_stuck(struct driver *driver);
/* Whether ground has not been looked at too often yet; counts that it is looked at. */
bool tactics_may_look_again(struct driver *driver, struct spot spot);
/* Whether the robot can turn around where it stands. */
bool tactics_has_room(const struct driver *driver);
/* No place shows the ground on the way: it is given up, for this goal; or the goal is. */
void tactics_no_view(struct driver *driver);
/* Notes the way that the robot comes. */
void tactics_note_way(struct driver *driver);
/* The last crumb that is not yet reached on the way back; false: there is none. */
bool tactics_crumb(struct driver *driver, struct spot *crumb);
/* Ends the drive. */
void tactics_give_up(struct driver *driver, enum driver_why why);

#endif
