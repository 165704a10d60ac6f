/* The planner as a shared library for other languages, for simulations: link and driver behind a
 * handle. Only the standard library of a host is used beyond the planner's own sources.
 */
#include <stdlib.h>

#include "planner.h"

/* `key` is NULL or 32 bytes. NULL: no memory. */
struct planner *planner_new(const struct driver_settings *settings, uint32_t nonce,
                            const uint8_t *key)
{
    struct planner *const self = malloc(sizeof *self);
    if (self != NULL) {
        planner_init(self, settings, nonce, key);
    }
    return self;
}

void planner_free(struct planner *self)
{
    free(self);
}

void planner_goal(struct planner *self, int32_t x_mm, int32_t y_mm)
{
    driver_goal(&self->driver, x_mm, y_mm);
}

void planner_halt(struct planner *self)
{
    driver_halt(&self->driver);
}

struct planner_report { /* laid out for ctypes */
    int32_t v_mmps, w_mradps, goal_x_mm, goal_y_mm, width, height, ox, oy;
    uint32_t accepted;
    uint8_t state, why, recovery, blank, suspect;
};

/* Everything small that it knows. */
void planner_report(struct planner *self, struct planner_report *report)
{
    const struct driver *const driver = &self->driver;
    const struct mapod_geom *const geom = mapod_link_geom(&self->link);
    memset(report, 0, sizeof *report);
    report->v_mmps = driver->asked.v_mmps;
    report->w_mradps = driver->asked.w_mradps;
    report->goal_x_mm = driver->goal.x_mm;
    report->goal_y_mm = driver->goal.y_mm;
    report->width = (geom == NULL) ? 0 : geom->width;
    report->height = (geom == NULL) ? 0 : geom->height;
    report->ox = (int16_t)self->link.ox;
    report->oy = (int16_t)self->link.oy;
    report->accepted = self->accepted;
    report->state = driver->state;
    report->why = driver->why;
    report->recovery = driver->recovery;
    report->blank = mapod_link_blank(&self->link);
    report->suspect = mapod_link_suspect(&self->link);
}

/* All cells of the window, one a byte, row-major. */
void planner_window(const struct planner *self, uint8_t *cells)
{
    uint32_t row, column, at = 0;
    for (row = 0; row < self->link.geom.height; row++) {
        for (column = 0; column < self->link.geom.width; column++) {
            cells[at] = mapod_link_cell(&self->link, column, row);
            at++;
        }
    }
}
