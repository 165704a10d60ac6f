/* Keeps the field up, and reads the way from it. */
#include "route.h"

/* What may be tuned. */
#define FIELD_PERIOD 3u       /* steps from one field to the next */
#define FIELD_BUDGET 12000u   /* cells of a field, a step */
#define CROSSED_MM 9000       /* so near, what comes on to the way is waited for */
#define CROSSED_STEPS 15u     /* without more of it */
#define TARGET_MM 8000        /* how far ahead it aims, where a straight line leads there */

/* What the field in work is to lead to. */
static struct field_task task_of(const struct driver *driver)
{
    struct field_task task = {0, 0, 0, 0, 0, 0, 0, false, false, NULL, 0u, NULL, 0u};
    const struct spot to = (driver->tactic == TACTIC_VIEW) ? driver->view : driver->goal;
    task.x_mm = to.x_mm;
    task.y_mm = to.y_mm;
    task.radius_mm = (driver->tactic == TACTIC_VIEW) ? ROUTE_VIEW_MM
                                                     : ((driver->settings.goal_radius_mm * 3) / 4);
    task.robot_x_mm = driver->place.x_mm;
    task.robot_y_mm = driver->place.y_mm;
    task.half_mm = driver->shape.half + driver->settings.margin_mm;
    task.around_mm = driver->shape.reach + driver->settings.margin_mm;
    task.only_free = (driver->tactic == TACTIC_VIEW) || (driver->tactic == TACTIC_PROBE);
    task.doubts_obstacles = driver->doubts && (!task.only_free);
    task.discs = driver->discs;
    task.disc_count = (uint32_t)least((int32_t)driver->disc_count, (int32_t)FIELD_DISCS);
    task.before = driver->way;
    task.before_count = driver->field.has_any ? driver->way_count : 0u;
    if (driver->tactic == TACTIC_PROBE) { /* from the robot to everywhere */
        task.x_mm = driver->place.x_mm;
        task.y_mm = driver->place.y_mm;
        task.radius_mm = 300;
        task.robot_x_mm = driver->goal.x_mm + 1000000; /* out of the window: all cells are wanted */
    }
    return task;
}

/* How many cells of the way are known to be free. */
static uint32_t known_way(const struct driver *driver)
{
    uint32_t k = 0u;
    while ((k < driver->way_count) && (!driver->way[k].soft)) {
        k++;
    }
    return k;
}

/* Notes whether something has come to stand on the known way, where the ground was free. */
static void note_crossing(struct driver *driver)
{
    const struct place *const place = &driver->place;
    uint32_t k;
    for (k = 1u; k < driver->known_count; k++) {
        const struct step_cell *const cell = &driver->way[k];
        if (distance_mm(cell->x_mm - place->x_mm, cell->y_mm - place->y_mm) > CROSSED_MM) {
            return;
        }
        if (field_weight(&driver->field, cell->x_mm, cell->y_mm) == FIELD_CLOSED) {
            driver->crossing.x_mm = cell->x_mm;
            driver->crossing.y_mm = cell->y_mm;
            driver->crossed = CROSSED_STEPS;
            return;
        }
    }
}

bool route_work(struct driver *driver)
{
    struct field *const field = &driver->field;
    const uint32_t before = field->now;
    const bool had_any = field->has_any;
    driver->field_steps++;
    if (field->is_busy) {
        (void)field_work(field, FIELD_BUDGET);
    } else if ((driver->field_steps >= FIELD_PERIOD) || (!field->has_any)) {
        const struct field_task task = task_of(driver);
        driver->field_steps = 0u;
        if (!field_begin(field, &driver->ground, &task)) {
            return false;
        }
        (void)field_work(field, FIELD_BUDGET);
    } else {
        /* The newest one will do. */
    }
    if (had_any && (field->now != before) && (driver->tactic == TACTIC_GO)) {
        note_crossing(driver);
    }
    driver->way_count = field_way(field, driver->place.x_mm, driver->place.y_mm, driver->way,
                                  (uint32_t)(sizeof driver->way / sizeof driver->way[0]));
    driver->known_count = known_way(driver);
    return true;
}

struct place route_target(const struct driver *driver)
{
    const struct place *const from = &driver->place;
    const uint32_t known = driver->known_count;
    struct place target = *from;
    uint32_t heaviest = 2u * FIELD_ROOM_WEIGHT; /* where the way keeps off what stands, so does it */
    uint32_t k;
    for (k = 0u; k < known; k++) {
        const struct step_cell *const cell = &driver->way[k];
        const int32_t away = distance_mm(cell->x_mm - from->x_mm, cell->y_mm - from->y_mm);
        heaviest = (uint32_t)most((int32_t)heaviest,
                                  (int32_t)field_weight(&driver->field, cell->x_mm, cell->y_mm));
        if ((k > 2u) && ((away > TARGET_MM) ||
                         (!field_is_straight(&driver->field, from->x_mm, from->y_mm, cell->x_mm,
                                             cell->y_mm, heaviest)))) {
            break;
        }
        target.x_mm = cell->x_mm;
        target.y_mm = cell->y_mm;
    }
    return target;
}
