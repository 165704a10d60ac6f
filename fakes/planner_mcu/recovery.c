/* Where no motion leads on. The laser sees ground only on a line far ahead: unknown ground near the
 * robot can be seen from a point a little farther off than that line, and from nowhere else.
 */
#include "recovery.h"

#include "views.h"

/* What may be tuned. */
#define TRIES 10u           /* recoveries for one goal */
#define MOST_TRIES 16u      /* however far it drives meanwhile */
#define CREDIT_MM 5000      /* driven, make one good */
#define CRUMB_MM 200        /* between two of them */
#define GIVEN_UP_MM 900     /* radius */
#define BACK_MM 2600        /* to go back, for a new try */
#define LOOKS 3u            /* at the same ground, from points chosen for it */
#define MOST_HIDDEN 3u       /* times that no point shows the ground about the goal */
#define BACK_TO_TURN_MM 4000 /* at most, to where there is room to turn */
#define SAME_MM 1000
#define BOXED_AHEAD_MM 900
#define BOXED_MM 300

void recovery_begin(struct driver *driver, enum recovery recovery)
{
    driver->recovery = (uint8_t)recovery;
    driver->since = 0u;
    driver->begun = driver->place.at;
    driver->stuck = 0u;
    driver->turned = 0;
    driver->doubts = false;
    driver->then = RECOVERY_NONE;
    field_clear(&driver->field);
    views_begin(driver);
}

void recovery_give_up(struct driver *driver, enum driver_why why)
{
    driver->state = DRIVER_STOPPED;
    driver->why = (uint8_t)why;
    driver->recovery = RECOVERY_NONE;
}

static void give_up(struct driver *driver, struct point point, int32_t radius_mm, bool free_too)
{
    struct disc *const disc = &driver->discs[driver->disc_count % FIELD_DISCS];
    disc->at = point;
    disc->radius_mm = radius_mm;
    disc->free_too = free_too;
    driver->disc_count++;
}

static bool give_up_ground(struct driver *driver)
{
    const int32_t needs_mm = GIVEN_UP_MM + driver->shape.half + driver->shape.margin +
                             (2 * driver->ground.frame.cell_mm);
    if (apart_mm(driver->goal, driver->unseen) <= needs_mm) {
        return false;
    }
    give_up(driver, driver->unseen, GIVEN_UP_MM, false);
    return true;
}

/* A path leads on, and no motion does. The second time in the same place, that path is given up. */
static void note_boxed(struct driver *driver)
{
    const struct point here = driver->place.at;
    uint32_t k = 0u;
    if (apart_mm(here, driver->boxed) < SAME_MM) {
        while (((k + 1u) < driver->known_count) &&
               (apart_mm(driver->path[k].at, here) < BOXED_AHEAD_MM)) {
            k++;
        }
        give_up(driver, driver->path[k].at, BOXED_MM, true);
    }
    driver->boxed = here;
}

void recovery_drop_crumb(struct driver *driver)
{
    const struct point here = driver->place.at;
    int32_t moved_mm = CRUMB_MM;
    uint32_t k;
    if (driver->crumb_count > 0u) {
        moved_mm = apart_mm(here, driver->crumbs[driver->crumb_count - 1u]);
    }
    if ((driver->recovery == RECOVERY_BACK) || (moved_mm < CRUMB_MM)) {
        return;
    }
    driver->refusals = 0u;
    driver->credit_mm += moved_mm;
    if (driver->credit_mm >= CREDIT_MM) {
        driver->credit_mm = 0;
        driver->looked = false;
        driver->crossed_back = false;
        driver->tries -= (driver->tries > 0u) ? 1u : 0u;
    }
    if (driver->crumb_count == DRIVER_CRUMBS) {
        driver->crumb_count--;
        for (k = 0u; k < driver->crumb_count; k++) {
            driver->crumbs[k] = driver->crumbs[k + 1u];
        }
    }
    driver->crumbs[driver->crumb_count] = here;
    driver->crumb_count++;
}

bool recovery_crumb(struct driver *driver, struct point *crumb)
{
    while (driver->crumb_count > 0u) {
        *crumb = driver->crumbs[driver->crumb_count - 1u];
        if (apart_mm(*crumb, driver->place.at) >= (2 * CRUMB_MM)) {
            return true;
        }
        driver->crumb_count--;
    }
    return false;
}

bool recovery_may_look_again(struct driver *driver, struct point point)
{
    if (apart_mm(point, driver->looked_at) > SAME_MM) {
        driver->looked_at = point;
        driver->looks = 0u;
        driver->viewed_count = 0u;
    }
    driver->looks++;
    return driver->looks <= LOOKS;
}

bool recovery_has_room(const struct driver *driver)
{
    const struct motion left = {0, 500};
    const struct motion right = {0, -500};
    return (sweep_free_mm(&driver->sweep, left, SWEEP_LONGEST_MM, false) >= SWEEP_LONGEST_MM) &&
           (sweep_free_mm(&driver->sweep, right, SWEEP_LONGEST_MM, false) >= SWEEP_LONGEST_MM);
}

/* Backwards to where there is room to turn, and then what was to be done. */
static bool backs_to_turn(struct driver *driver, enum recovery then)
{
    if (recovery_has_room(driver) || (driver->crumb_count < 3u)) {
        return false;
    }
    driver->back_mm = BACK_TO_TURN_MM;
    recovery_begin(driver, RECOVERY_BACK);
    driver->then = (uint8_t)then;
    return true;
}

/* Ground on the path cannot be seen from here. */
static void stuck_unseen(struct driver *driver)
{
    if (recovery_may_look_again(driver, driver->unseen)) {
        views_aim(driver);
        if (!backs_to_turn(driver, RECOVERY_PROBE)) {
            recovery_begin(driver, RECOVERY_PROBE);
        }
    } else {
        recovery_no_view(driver);
    }
}

void recovery_no_view(struct driver *driver)
{
    const int32_t away_mm = apart_mm(driver->unseen, driver->place.at);
    const bool given_up = give_up_ground(driver);
    if ((!given_up) && (driver->hidden >= MOST_HIDDEN)) {
        recovery_give_up(driver, DRIVER_WHY_NO_PATH);
        return;
    }
    driver->looks = 0u;
    driver->viewed_count = 0u;
    if (!given_up) {
        /* back along its own path, until the line lies before it again, and farther each time; then
         * straight towards it */
        driver->back_mm = most(BACK_MM, RECOVERY_AGAIN_FROM_MM - away_mm) +
                          ((int32_t)driver->hidden * VIEWS_FARTHER_MM);
        driver->hidden++;
        views_aim(driver);
        recovery_begin(driver, RECOVERY_BACK);
        driver->then = (uint8_t)RECOVERY_FACE;
    } else if (!backs_to_turn(driver, RECOVERY_NONE)) {
        recovery_begin(driver, RECOVERY_NONE);
    }
}

void recovery_stuck(struct driver *driver)
{
    driver->tries++;
    driver->spent++;
    if ((driver->why == DRIVER_WHY_WAITS) && (driver->known_count > 3u)) {
        note_boxed(driver);
    }
    if ((driver->tries > TRIES) || (driver->spent > MOST_TRIES)) {
        recovery_give_up(driver, DRIVER_WHY_NO_PATH);
    } else if (driver->why == DRIVER_WHY_UNSEEN) {
        stuck_unseen(driver);
    } else if ((driver->crumb_count > 3u) && ((driver->tries % 3u) == 1u)) {
        driver->back_mm = BACK_MM; /* what was told by mistake goes when seen from farther */
        recovery_begin(driver, RECOVERY_BACK);
    } else if (!driver->looked) {
        driver->looked = true;
        if (!backs_to_turn(driver, RECOVERY_LOOK)) {
            recovery_begin(driver, RECOVERY_LOOK);
        }
    } else {
        recovery_begin(driver, RECOVERY_WAIT);
    }
}
