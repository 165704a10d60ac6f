/* Where no motion leads on. The laser sees ground only on a line far ahead, so that ground near the
 * robot that is not known can be seen from a place some nine metres off, and from nowhere else.
 */
#include "tactics.h"

/* What may be tuned. */
#define TRIES 10u           /* tactics for one goal */
#define MOST_TRIES 16u      /* however far it drives meanwhile */
#define PAYS_MM 5000        /* of way, that strike one off */
#define CRUMB_MM 200        /* between two of them */
#define VIEW_LEAST_MM 9200  /* from there the line on the floor lies before what is to be seen */
#define VIEW_MOST_MM 10300
#define VIEW_RUN_MM 1000    /* to be driven from there towards it */
#define UNSEEN_SHARE 4 /* of a line of sight, at most: behind more, a wall may stand unseen */
#define VIEW_SHORT_MM 600   /* of the line of sight, that need not be clear at its end */
#define GIVEN_UP_MM 900     /* radius */
#define BACK_MM 2600        /* of way back, for a new try */
#define LOOKS 1u            /* at the same ground, from places chosen for it */
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

void tactics_give_up_ground(struct driver *driver)
{
    give_up(driver, driver->unseen, GIVEN_UP_MM, false);
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

bool tactics_is_in_sight(const struct driver *driver, struct spot from, struct spot to)
{
    const struct frame *const frame = &driver->ground.frame;
    const int32_t away_mm = distance_mm(to.x_mm - from.x_mm, to.y_mm - from.y_mm);
    const int32_t steps = (away_mm / (frame->cell_mm / 2)) + 1;
    const int32_t last = ((away_mm - VIEW_SHORT_MM) * steps) / most(1, away_mm);
    int32_t unseen = 0;
    int32_t k;
    for (k = 1; k < last; k++) {
        const int32_t x_mm = from.x_mm + (((to.x_mm - from.x_mm) * k) / steps);
        const int32_t y_mm = from.y_mm + (((to.y_mm - from.y_mm) * k) / steps);
        const uint32_t state =
            ground_at(&driver->ground, cell_of(frame, x_mm), cell_of(frame, y_mm));
        unseen += (state == MAPOD_UNKNOWN) ? 1 : 0;
        if ((state == MAPOD_OBSTACLE) || (unseen > (steps / UNSEEN_SHARE))) {
            return false;
        }
    }
    return true;
}

/* Cost of going to look from a place; FIELD_NO_WAY: nothing can be seen from there. */
static uint32_t view_cost(const struct driver *driver, struct spot spot, uint32_t best)
{
    const struct spot to = driver->unseen;
    const int32_t away_mm = distance_mm(to.x_mm - spot.x_mm, to.y_mm - spot.y_mm);
    uint32_t cost;
    if ((away_mm < VIEW_LEAST_MM) || (away_mm > VIEW_MOST_MM)) {
        return FIELD_NO_WAY;
    }
    cost = field_cost(&driver->field, spot.x_mm, spot.y_mm);
    if ((cost >= best) ||
        (!field_is_straight(&driver->field, spot.x_mm, spot.y_mm,
                            spot.x_mm + (((to.x_mm - spot.x_mm) * VIEW_RUN_MM) / away_mm),
                            spot.y_mm + (((to.y_mm - spot.y_mm) * VIEW_RUN_MM) / away_mm))) ||
        (!tactics_is_in_sight(driver, spot, to))) {
        return FIELD_NO_WAY;
    }
    return cost;
}

bool tactics_find_view(struct driver *driver)
{
    const struct frame *const frame = &driver->ground.frame;
    uint32_t best = FIELD_NO_WAY;
    int32_t i, j;
    for (j = 0; j < frame->height; j += 2) {
        for (i = 0; i < frame->width; i += 2) {
            const struct spot spot = {middle_of(frame, frame->column0 + i),
                                      middle_of(frame, frame->row0 + j)};
            const uint32_t cost = view_cost(driver, spot, best);
            if (cost < best) {
                best = cost;
                driver->view = spot;
            }
        }
    }
    return best != FIELD_NO_WAY;
}

bool tactics_may_look_again(struct driver *driver, struct spot spot)
{
    const struct spot *const before = &driver->looked_at;
    if (distance_mm(spot.x_mm - before->x_mm, spot.y_mm - before->y_mm) > SAME_MM) {
        driver->looked_at = spot;
        driver->looks = 0u;
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
        if (!backs_to_turn(driver, TACTIC_PROBE)) {
            tactics_begin(driver, TACTIC_PROBE);
        }
    } else {
        tactics_give_up_ground(driver);
        if (!backs_to_turn(driver, TACTIC_GO)) {
            tactics_begin(driver, TACTIC_GO);
        }
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
