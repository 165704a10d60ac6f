/* Points to look from. The laser sees ground only on a line far ahead: what is to be seen must lie
 * a little beyond that line, in sight, and there must be room to drive towards it, so that the line
 * passes over it.
 */
#include "views.h"

/* What may be tuned. */
#define LEAST_MM (ROBOT_LINE_MM + 350) /* from there the line lies before what is to be seen */
#define MOST_MM (ROBOT_LINE_MM + 1850)
#define RUN_MM 1200     /* to be driven from there towards it */
#define SHORT_MM 600    /* of the line of sight, that need not be clear at its end */
#define UNSEEN_SHARE 64u /* in 256ths of a line of sight: behind more, a wall may stand unseen */
#define BARRED 256u     /* of such a share: an obstacle stands there */
#define DIM_COST (FIELD_NO_PATH / 2u) /* of a point behind unseen ground: only if there is no other */
#define STRIDE 2        /* cells from one point that is tried to the next */
#define ROWS 6          /* of points, in one step */
#define AIM_CELLS 5u    /* of the path, from one of what is to be seen to the next, */
#define AIM_TIMES 2u    /* so often, */
#define ASIDE_MM 400    /* and so far to either side */
#define BEYOND_MM 600   /* and beyond the path's end, at the goal */
#define SAME_MM 1200    /* a point so near to one that did not help does not help either */
#define FARTHEST_MM 3200 /* farther off, at most: the line lies on ground that falls 2 degrees */
#define MISSING_MM 20000 /* of path: a point that shows nothing is worse by that */

/* How much of the ground between two points was not seen, in 256ths; BARRED: an obstacle stands
 * there. The last bit does not count.
 */
static uint32_t unseen_between(const struct driver *driver, struct point from, struct point to)
{
    const struct frame *const frame = &driver->ground.frame;
    const int32_t away_mm = apart_mm(from, to);
    const int32_t steps = (away_mm / most(1, frame->cell_mm / 2)) + 1;
    const int32_t last = ((away_mm - SHORT_MM) * steps) / most(1, away_mm);
    int32_t unseen = 0;
    int32_t k;
    for (k = 1; k < last; k++) {
        const uint32_t state = ground_at_point(&driver->ground, between(from, to, k, steps));
        unseen += (state == MAPOD_UNKNOWN) ? 1 : 0;
        if (state == MAPOD_OBSTACLE) {
            return BARRED;
        }
    }
    return (uint32_t)((unseen * 255) / steps);
}

bool views_are_in_sight(const struct driver *driver, struct point from, struct point to)
{
    return unseen_between(driver, from, to) <= UNSEEN_SHARE;
}

/* One more that is to be seen, if it is not known yet. */
static void aim_at(struct driver *driver, int32_t x_mm, int32_t y_mm)
{
    const struct point point = {x_mm, y_mm};
    if ((ground_at_point(&driver->ground, point) == MAPOD_UNKNOWN) &&
        (driver->aim_count < DRIVER_AIMS)) {
        driver->aims[driver->aim_count] = point;
        driver->aim_count++;
    }
}

/* A cell of the path, what lies beside it, and beyond if it is the last. */
static void aim_about(struct driver *driver, struct point before, struct point at, bool is_last)
{
    const int32_t dx = at.x_mm - before.x_mm;
    const int32_t dy = at.y_mm - before.y_mm;
    const int32_t length = most(1, distance_mm(dx, dy));
    const int32_t x = (dy * ASIDE_MM) / length;
    const int32_t y = (dx * ASIDE_MM) / length;
    aim_at(driver, at.x_mm, at.y_mm);
    aim_at(driver, at.x_mm - x, at.y_mm + y);
    aim_at(driver, at.x_mm + x, at.y_mm - y);
    if (is_last) {
        aim_at(driver, at.x_mm + ((dx * BEYOND_MM) / length),
               at.y_mm + ((dy * BEYOND_MM) / length));
    }
}

void views_aim(struct driver *driver)
{
    const struct path_cell *const path = driver->path;
    const uint32_t count = driver->path_count;
    uint32_t at = driver->known_count + 2u;
    uint32_t k;
    driver->aim_count = 0u;
    for (k = 0u; (k < AIM_TIMES) && (at < count); k++) {
        aim_about(driver, path[at - 2u].at, path[at].at, false);
        at += AIM_CELLS;
    }
    if ((k < AIM_TIMES) && (count > 2u)) { /* at its end, what the robot needs ahead of it */
        aim_about(driver, path[count - 3u].at, path[count - 1u].at, true);
    }
    if (driver->aim_count == 0u) {
        driver->aims[0] = driver->unseen;
        driver->aim_count = 1u;
    }
}

static bool is_used(const struct driver *driver, struct point point)
{
    uint32_t k;
    for (k = 0u; (k < driver->viewed_count) && (k < DRIVER_VIEWED); k++) {
        if (apart_mm(driver->viewed[k], point) < SAME_MM) {
            return true;
        }
    }
    return false;
}

/* Cost of going to look from a point; FIELD_NO_PATH: it is of no use. */
static uint32_t cost_of(const struct driver *driver, struct point point, uint32_t best)
{
    const struct point to = driver->aims[0];
    const int32_t away_mm = apart_mm(to, point);
    const uint32_t each = ((field_cost_of_m(&driver->field) * (uint32_t)MISSING_MM) / 1000u) /
                          driver->aim_count;
    uint32_t cost, k;
    uint32_t in_sight = 0u;
    uint32_t dim = 0u;
    if ((away_mm < (LEAST_MM + driver->farther_mm)) ||
        (away_mm > (MOST_MM + driver->farther_mm))) {
        return FIELD_NO_PATH;
    }
    cost = field_cost(&driver->field, point);
    if ((cost >= best) || is_used(driver, point) ||
        (!field_has_room(&driver->field, point)) ||
        (!field_is_straight(&driver->field, point, between(point, to, RUN_MM, away_mm),
                            FIELD_MOST_WEIGHT))) {
        return FIELD_NO_PATH;
    }
    for (k = 0u; (k < driver->aim_count) && (cost < best); k++) {
        const uint32_t unseen = unseen_between(driver, point, driver->aims[k]);
        if (unseen <= UNSEEN_SHARE) {
            in_sight++;
        } else {
            dim += (unseen < BARRED) ? 1u : 0u;
            cost += each;
        }
    }
    if (in_sight > 0u) {
        return cost;
    }
    return (dim > 0u) ? (DIM_COST + (cost / 2u)) : FIELD_NO_PATH;
}

void views_begin(struct driver *driver)
{
    driver->view_row = 0;
    driver->view_cost = FIELD_NO_PATH;
}

bool views_search(struct driver *driver)
{
    const struct frame *const frame = &driver->ground.frame;
    int32_t row, i;
    for (row = 0; (row < ROWS) && (driver->view_row < frame->height); row++) {
        for (i = 0; i < frame->width; i += STRIDE) {
            const struct point point = middle_at(frame, i, driver->view_row);
            const uint32_t cost = cost_of(driver, point, driver->view_cost);
            if (cost < driver->view_cost) {
                driver->view_cost = cost;
                driver->view = point;
            }
        }
        driver->view_row += STRIDE;
    }
    if (driver->view_row < frame->height) {
        return false;
    }
    if (driver->view_cost != FIELD_NO_PATH) {
        driver->viewed[driver->viewed_count % DRIVER_VIEWED] = driver->view;
        driver->viewed_count++;
    }
    return true;
}

/* The line has passed what was to be seen. Where that did not show, the line lay beyond it from the
 * beginning, as it does on the way up to a crest: the next view is from farther off. Where that
 * shows nothing either, it is looked at less often.
 */
void views_end(struct driver *driver)
{
    const int32_t from_mm = driver->farther_mm;
    uint32_t k;
    driver->farther_mm = 0;
    for (k = 0u; k < driver->aim_count; k++) {
        if (ground_at_point(&driver->ground, driver->aims[k]) == MAPOD_UNKNOWN) {
            driver->farther_mm = least(from_mm + VIEWS_FARTHER_MM, FARTHEST_MM);
        }
    }
    driver->looks += ((from_mm > 0) && (driver->farther_mm > 0)) ? 1u : 0u;
}

struct sighting views_farthest(const struct driver *driver)
{
    struct sighting farthest = {0, 0};
    uint32_t k;
    for (k = 0u; k < driver->aim_count; k++) {
        const int32_t away_mm = apart_mm(driver->aims[k], driver->place.at);
        if (away_mm > farthest.away_mm) {
            farthest.away_mm = away_mm;
            farthest.towards = bearing(driver->place.at, driver->aims[k]);
        }
    }
    return farthest;
}
