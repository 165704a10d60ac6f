/* Places to look from. The laser sees ground only on a line far ahead: what is to be seen must lie a
 * little beyond that line, in sight, and there must be way to drive towards it, so that the line
 * passes over it.
 */
#include "views.h"

/* What may be tuned. */
#define LEAST_MM 8800   /* from there the line on the floor lies before what is to be seen */
#define MOST_MM 10300
#define RUN_MM 1200     /* to be driven from there towards it */
#define SHORT_MM 600    /* of the line of sight, that need not be clear at its end */
#define UNSEEN_SHARE 4  /* of a line of sight, at most: behind more, a wall may stand unseen */
#define STRIDE 3        /* cells from one place that is tried to the next */
#define ROWS 4          /* of places, in one step */
#define AIM_CELLS 5u    /* of the way, from one of what is to be seen to the next, */
#define AIM_TIMES 2u    /* so often, */
#define ASIDE_MM 400    /* and so far to either side */
#define BEYOND_MM 600   /* and beyond the way's end, at the goal */
#define SAME_MM 1200    /* a place so near to one that did not help does not help either */
#define MISSING_MM 20000 /* of way, which a place that shows nothing of it is worse by */

bool views_are_in_sight(const struct driver *driver, struct spot from, struct spot to)
{
    const struct frame *const frame = &driver->ground.frame;
    const int32_t away_mm = distance_mm(to.x_mm - from.x_mm, to.y_mm - from.y_mm);
    const int32_t steps = (away_mm / (frame->cell_mm / 2)) + 1;
    const int32_t last = ((away_mm - SHORT_MM) * steps) / most(1, away_mm);
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

/* One more that is to be seen, if it is not known yet. */
static void aim_at(struct driver *driver, int32_t x_mm, int32_t y_mm)
{
    const struct frame *const frame = &driver->ground.frame;
    if ((ground_at(&driver->ground, cell_of(frame, x_mm), cell_of(frame, y_mm)) ==
         MAPOD_UNKNOWN) &&
        (driver->aim_count < DRIVER_AIMS)) {
        driver->aims[driver->aim_count].x_mm = x_mm;
        driver->aims[driver->aim_count].y_mm = y_mm;
        driver->aim_count++;
    }
}

/* A cell of the way, and what lies beside it. */
static void aim_about(struct driver *driver, const struct step_cell *before,
                      const struct step_cell *cell)
{
    const int32_t dx = cell->x_mm - before->x_mm;
    const int32_t dy = cell->y_mm - before->y_mm;
    const int32_t length = most(1, distance_mm(dx, dy));
    const int32_t x = (dy * ASIDE_MM) / length;
    const int32_t y = (dx * ASIDE_MM) / length;
    aim_at(driver, cell->x_mm, cell->y_mm);
    aim_at(driver, cell->x_mm - x, cell->y_mm + y);
    aim_at(driver, cell->x_mm + x, cell->y_mm - y);
}

/* What lies beyond the way's last cell. */
static void aim_beyond(struct driver *driver, const struct step_cell *before,
                       const struct step_cell *last)
{
    const int32_t dx = last->x_mm - before->x_mm;
    const int32_t dy = last->y_mm - before->y_mm;
    const int32_t length = most(1, distance_mm(dx, dy));
    aim_at(driver, last->x_mm + ((dx * BEYOND_MM) / length),
           last->y_mm + ((dy * BEYOND_MM) / length));
}

void views_aim(struct driver *driver)
{
    const uint32_t first = driver->known_count;
    uint32_t k;
    driver->aim_count = 0u;
    for (k = 0u; k < AIM_TIMES; k++) {
        const uint32_t at = first + 2u + (k * AIM_CELLS);
        if (at < driver->way_count) {
            aim_about(driver, &driver->way[at - 2u], &driver->way[at]);
        } else if (driver->way_count > 2u) { /* at its end, what the robot needs ahead of it */
            aim_about(driver, &driver->way[driver->way_count - 3u],
                      &driver->way[driver->way_count - 1u]);
            aim_beyond(driver, &driver->way[driver->way_count - 3u],
                       &driver->way[driver->way_count - 1u]);
            break;
        } else {
            break;
        }
    }
    if (driver->aim_count == 0u) {
        driver->aims[0] = driver->unseen;
        driver->aim_count = 1u;
    }
}

static bool is_used(const struct driver *driver, struct spot spot)
{
    uint32_t k;
    for (k = 0u; (k < driver->viewed_count) && (k < DRIVER_VIEWED); k++) {
        if (distance_mm(driver->viewed[k].x_mm - spot.x_mm, driver->viewed[k].y_mm - spot.y_mm) <
            SAME_MM) {
            return true;
        }
    }
    return false;
}

/* Cost of going to look from a place; FIELD_NO_WAY: it is of no use. */
static uint32_t cost_of(const struct driver *driver, struct spot spot, uint32_t best)
{
    const struct spot to = driver->aims[0];
    const int32_t away_mm = distance_mm(to.x_mm - spot.x_mm, to.y_mm - spot.y_mm);
    const uint32_t each = ((field_cost_of_m(&driver->field) * (uint32_t)MISSING_MM) / 1000u) /
                          driver->aim_count;
    uint32_t cost, k;
    uint32_t in_sight = 0u;
    if ((away_mm < LEAST_MM) || (away_mm > MOST_MM)) {
        return FIELD_NO_WAY;
    }
    cost = field_cost(&driver->field, spot.x_mm, spot.y_mm);
    if ((cost >= best) || is_used(driver, spot) ||
        (!field_has_room(&driver->field, spot.x_mm, spot.y_mm)) ||
        (!field_is_straight(&driver->field, spot.x_mm, spot.y_mm,
                            spot.x_mm + (((to.x_mm - spot.x_mm) * RUN_MM) / away_mm),
                            spot.y_mm + (((to.y_mm - spot.y_mm) * RUN_MM) / away_mm),
                            FIELD_MOST_WEIGHT))) {
        return FIELD_NO_WAY;
    }
    for (k = 0u; (k < driver->aim_count) && (cost < best); k++) {
        if (views_are_in_sight(driver, spot, driver->aims[k])) {
            in_sight++;
        } else {
            cost += each;
        }
    }
    return (in_sight > 0u) ? cost : FIELD_NO_WAY;
}

void views_begin(struct driver *driver)
{
    driver->view_row = 0;
    driver->view_cost = FIELD_NO_WAY;
}

bool views_search(struct driver *driver)
{
    const struct frame *const frame = &driver->ground.frame;
    int32_t row, i;
    for (row = 0; (row < ROWS) && (driver->view_row < frame->height); row++) {
        for (i = 0; i < frame->width; i += STRIDE) {
            const struct spot spot = {middle_of(frame, frame->column0 + i),
                                      middle_of(frame, frame->row0 + driver->view_row)};
            const uint32_t cost = cost_of(driver, spot, driver->view_cost);
            if (cost < driver->view_cost) {
                driver->view_cost = cost;
                driver->view = spot;
            }
        }
        driver->view_row += STRIDE;
    }
    if (driver->view_row < frame->height) {
        return false;
    }
    if (driver->view_cost != FIELD_NO_WAY) {
        driver->viewed[driver->viewed_count % DRIVER_VIEWED] = driver->view;
        driver->viewed_count++;
    }
    return true;
}

struct sighting views_farthest(const struct driver *driver)
{
    struct sighting farthest = {0, 0};
    uint32_t k;
    for (k = 0u; k < driver->aim_count; k++) {
        const int32_t dx = driver->aims[k].x_mm - driver->place.x_mm;
        const int32_t dy = driver->aims[k].y_mm - driver->place.y_mm;
        const int32_t away_mm = distance_mm(dx, dy);
        if (away_mm > farthest.away_mm) {
            farthest.away_mm = away_mm;
            farthest.towards = direction(dx, dy);
        }
    }
    return farthest;
}
