/* Where no motion leads on. The laser sees ground only on a line far ahead, so that ground near the
 * robot that is not known can be seen from a place some nine metres off, and from nowhere else.
 */
#include "tactics.h"

#include "views.h"

/* What may be tuned. */
#define TRIES 10u           /* tactics for one goal */
#define MOST_TRIES 16u      /* however far it drives meanwhile */
#define PAYS_MM 5000        /* of way, that strike one off */
#define CRUMB_MM 200        /* between two of them */
#define GIVEN_UP_MM 900     /* radius */
#define BACK_MM 2600        /* of way back, for a new try */
#define LOOKS 3u            /* at the same ground, from places chosen for it */
#define MOST_HIDDEN 3u       /* times that no place shows the ground about the goal */
#define BACK_TO_TURN_MM 4000 /* at most, to where there is room to turn */
#define SAME_MM 1000
#define BOXED_AHEAD_MM 900
#define BOXED_MM 300

void tactics_begin(struct driver *driver, enum driver_tactic tactic)
{
    driver->tactic = (uint8_t)tactic;
    driver->since = 0u;
    driver->stuck = 0u;
    driver->turned = 0;
    driver->doubts = false;
    driver->then = TACTIC_GO;
    field_clear(&driver->field);
    views_begin(driver);
}

void tactics_give_up(struct driver *driver, enum driver_why why)
{
    driver->state = DRIVER_STOPPED;
    driver->why = (uint8_t)why;
    driver->tactic = TACTIC_GO;
}

static void give_up(struct driver *driver, struct spot spot, int32_t radius_mm, bool free_too)
{
    struct disc *const disc = &driver->discs[driver->disc_count % FIELD_DISCS];
    disc->x_mm = spot.x_mm;
    disc->y_mm = spot.y_mm;
    disc->radius_mm = radius_mm;
    disc->free_too = free_too;
    driver->disc_count++;
}

static bool give_up_ground(struct driver *driver)
{
    const int32_t needs_mm = GIVEN_UP_MM + driver->shape.half + driver->shape.margin +
                             (2 * driver->ground.frame.cell_mm);
    if (distance_mm(driver->goal.x_mm - driver->unseen.x_mm,
                    driver->goal.y_mm - driver->unseen.y_mm) <= needs_mm) {
        return false;
    }
    give_up(driver, driver->unseen, GIVEN_UP_MM, false);
    return true;
}

/* A way leads on, and no motion does. The second time in the same place, that way is given up. */
static void note_boxed(struct driver *driver)
{
    const struct place *const place = &driver->place;
    const struct spot here = {place->x_mm, place->y_mm};
    uint32_t k = 0u;
    if (distance_mm(here.x_mm - driver->boxed.x_mm, here.y_mm - driver->boxed.y_mm) < SAME_MM) {
        while (((k + 1u) < driver->known_count) &&
               (distance_mm(driver->way[k].x_mm - here.x_mm, driver->way[k].y_mm - here.y_mm) <
                BOXED_AHEAD_MM)) {
            k++;
        }
        give_up(driver, (struct spot){driver->way[k].x_mm, driver->way[k].y_mm}, BOXED_MM, true);
    }
    driver->boxed = here;
}

void tactics_note_way(struct driver *driver)
{
    const struct place *const place = &driver->place;
    struct spot *const last = &driver->crumbs[most(0, (int32_t)driver->crumb_count - 1)];
    uint32_t k;
    int32_t moved_mm;
    if (driver->tactic == TACTIC_BACK) {
        return;
    }
    moved_mm = (driver->crumb_count == 0u)
                   ? CRUMB_MM
                   : distance_mm(place->x_mm - last->x_mm, place->y_mm - last->y_mm);
    if (moved_mm < CRUMB_MM) {
        return;
    }
    driver->refusals = 0u;
    driver->paid_mm += moved_mm;
    if (driver->paid_mm >= PAYS_MM) {
        driver->paid_mm = 0;
        driver->looked = false;
        driver->crossed_back = false;
        driver->tries -= (driver->tries > 0u) ? 1u : 0u;
    }
    if (driver->crumb_count == DRIVER_CRUMBS) {
        for (k = 1u; k < DRIVER_CRUMBS; k++) {
            driver->crumbs[k - 1u] = driver->crumbs[k];
        }
        driver->crumb_count--;
    }
    driver->crumbs[driver->crumb_count].x_mm = place->x_mm;
    driver->crumbs[driver->crumb_count].y_mm = place->y_mm;
    driver->crumb_count++;
}

bool tactics_crumb(struct driver *driver, struct spot *crumb)
{
    const struct place *const place = &driver->place;
    while (driver->crumb_count > 0u) {
        *crumb = driver->crumbs[driver->crumb_count - 1u];
        if (distance_mm(crumb->x_mm - place->x_mm, crumb->y_mm - place->y_mm) >= (2 * CRUMB_MM)) {
            return true;
        }
        driver->crumb_count--;
    }
    return false;
}

bool tactics_may_look_again(struct driver *driver, struct spot spot)
{
    const struct spot *const before = &driver->looked_at;
    if (distance_mm(spot.x_mm - before->x_mm, spot.y_mm - before->y_mm) > SAME_MM) {
        driver->looked_at = spot;
        driver->looks = 0u;
        driver->viewed_count = 0u;
    }
    driver->looks++;
    return driver->looks <= LOOKS;
}

bool tactics_has_room(const struct driver *driver)
{
    const struct motion left = {0, 500};
    const struct motion right = {0, -500};
    return (sweep_free_mm(&driver->sweep, left, SWEEP_LONGEST_MM, false) >= SWEEP_LONGEST_MM) &&
           (sweep_free_mm(&driver->sweep, right, SWEEP_LONGEST_MM, false) >= SWEEP_LONGEST_MM);
}

/* Backwards to where there is room to turn, and then what was to be done. */
static bool backs_to_turn(struct driver *driver, enum driver_tactic then)
{
    if (tactics_has_room(driver) || (driver->crumb_count < 3u)) {
        return false;
    }
    driver->back_mm = BACK_TO_TURN_MM;
    tactics_begin(driver, TACTIC_BACK);
    driver->then = (uint8_t)then;
    return true;
}

/* Ground on the way cannot be seen from here. */
static void stuck_unseen(struct driver *driver)
{
    if (tactics_may_look_again(driver, driver->unseen)) {
        views_aim(driver);
        if (!backs_to_turn(driver, TACTIC_PROBE)) {
            tactics_begin(driver, TACTIC_PROBE);
        }
    } else {
        tactics_no_view(driver);
    }
}

void tactics_no_view(struct driver *driver)
{
    const int32_t away_mm = distance_mm(driver->unseen.x_mm - driver->place.x_mm,
                                        driver->unseen.y_mm - driver->place.y_mm);
    const bool given_up = give_up_ground(driver);
    if ((!given_up) && (driver->hidden >= MOST_HIDDEN)) {
        tactics_give_up(driver, DRIVER_WHY_NO_WAY);
        return;
    }
    driver->looks = 0u;
    driver->viewed_count = 0u;
    if (!given_up) { /* back along its own way, until the line lies before it again */
        driver->hidden++;
        driver->back_mm = most(BACK_MM, TACTICS_AGAIN_FROM_MM - away_mm);
        tactics_begin(driver, TACTIC_BACK);
    } else if (!backs_to_turn(driver, TACTIC_GO)) {
        tactics_begin(driver, TACTIC_GO);
    } else {
        /* Goes back first. */
    }
}

void tactics_stuck(struct driver *driver)
{
    driver->tries++;
    driver->spent++;
    if ((driver->why == DRIVER_WHY_WAITS) && (driver->known_count > 3u)) {
        note_boxed(driver);
    }
    if ((driver->tries > TRIES) || (driver->spent > MOST_TRIES)) {
        tactics_give_up(driver, DRIVER_WHY_NO_WAY);
    } else if (driver->why == DRIVER_WHY_UNSEEN) {
        stuck_unseen(driver);
    } else if ((driver->crumb_count > 3u) && ((driver->tries % 3u) == 1u)) {
        driver->back_mm = BACK_MM; /* what was told by mistake goes when seen from farther */
        tactics_begin(driver, TACTIC_BACK);
    } else if (!driver->looked) {
        driver->looked = true;
        if (!backs_to_turn(driver, TACTIC_LOOK)) {
            tactics_begin(driver, TACTIC_LOOK);
        }
    } else {
        tactics_begin(driver, TACTIC_WAIT);
    }
}
