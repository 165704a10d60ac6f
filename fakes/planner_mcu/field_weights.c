/* Distances to the nearest obstacle and to the nearest ground that is not known to be free, for all
 * cells at once, and what follows from them.
 *
 * Source: G. Borgefors, Distance transformations in digital images, 1986 (the 3-4 chamfer).
 */
#include "field_weights.h"

#define THIRDS 3      /* a distance of one cell */
#define DIAGONAL 4    /* and of one across */
#define FAR 60000u    /* no such cell in sight */
#define DIRECTIONS 128u
#define GIVEN_UP 3u   /* no state of a cell: ground that is an obstacle in any case */

#define OPEN 4u       /* weights */
#define AS_BEFORE 3u  /* on the path that was taken until now: else it changes its mind too often */
#define BESIDE 5u     /* more, where something is so near that the robot could not turn */
#define TIGHT 9u      /* more, where there is hardly room for the robot, within this: */
#define TIGHT_MM 160
#define NEARBY (FIELD_ROOM_WEIGHT - OPEN) /* more, within this beyond that: */
#define NEARBY_MM 400
#define UNSEEN_FAR 7u     /* may be seen as the robot drives there, */
#define UNSEEN_BEHIND 12u /* but for what stands before it */
#define UNSEEN_NEAR FIELD_MOST_WEIGHT /* only from farther away */
#define SEEN_FROM_MM (ROBOT_LINE_MM - 150) /* nearer, the laser's line on the ground has passed */

static uint16_t nearer(uint16_t a, uint32_t b)
{
    return (a < b) ? a : (uint16_t)b;
}

/* Distances in thirds of a cell: forth over all rows, and back. */
static void spread(const struct frame *frame, uint16_t *away)
{
    const int32_t width = frame->width;
    const int32_t count = width * frame->height;
    int32_t at;
    for (at = 0; at < count; at++) {
        const int32_t column = at % width;
        uint16_t best = away[at];
        if (column > 0) {
            best = nearer(best, away[at - 1] + (uint32_t)THIRDS);
        }
        if (at >= width) {
            const uint16_t *const below = &away[at - width];
            best = nearer(best, below[0] + (uint32_t)THIRDS);
            best = (column > 0) ? nearer(best, below[-1] + (uint32_t)DIAGONAL) : best;
            best = (column < (width - 1)) ? nearer(best, below[1] + (uint32_t)DIAGONAL) : best;
        }
        away[at] = best;
    }
    for (at = count - 1; at >= 0; at--) {
        const int32_t column = at % width;
        uint16_t best = away[at];
        if (column < (width - 1)) {
            best = nearer(best, away[at + 1] + (uint32_t)THIRDS);
        }
        if (at < (count - width)) {
            const uint16_t *const above = &away[at + width];
            best = nearer(best, above[0] + (uint32_t)THIRDS);
            best = (column > 0) ? nearer(best, above[-1] + (uint32_t)DIAGONAL) : best;
            best = (column < (width - 1)) ? nearer(best, above[1] + (uint32_t)DIAGONAL) : best;
        }
        away[at] = best;
    }
}

/* Cells of the ground as states; there is no path through what was given up. */
static void take_states(struct layer *layer, const struct ground *ground,
                        const struct field_task *task)
{
    const struct frame *const frame = &layer->frame;
    int32_t i, j;
    uint32_t at = 0u;
    for (j = 0; j < frame->height; j++) {
        for (i = 0; i < frame->width; i++) {
            layer->weight[at] = (uint8_t)ground_at(ground, frame->column0 + i, frame->row0 + j);
            at++;
        }
    }
    for (at = 0u; at < task->disc_count; at++) {
        const struct disc *const disc = &task->discs[at];
        const int32_t low_i = cell_of(frame, disc->at.x_mm - disc->radius_mm) - frame->column0;
        const int32_t low_j = cell_of(frame, disc->at.y_mm - disc->radius_mm) - frame->row0;
        const int32_t cells = ((2 * disc->radius_mm) / frame->cell_mm) + 1;
        for (j = most(0, low_j); j < least(frame->height, low_j + cells); j++) {
            for (i = most(0, low_i); i < least(frame->width, low_i + cells); i++) {
                uint8_t *const state = &layer->weight[(j * frame->width) + i];
                *state = ((*state == MAPOD_FREE) && (!disc->free_too)) ? *state : (uint8_t)GIVEN_UP;
            }
        }
    }
}

/* Distances in thirds of a cell from the cells whose state has these bits, or from all not free. */
static void measure(const struct layer *layer, uint16_t *away, uint32_t bits, bool not_free)
{
    const uint32_t count = (uint32_t)(layer->frame.width * layer->frame.height);
    uint32_t at;
    for (at = 0u; at < count; at++) {
        const uint32_t state = (uint32_t)layer->weight[at] & 3u;
        const bool counts = not_free ? (state != MAPOD_FREE) : ((state & bits) == bits);
        away[at] = counts ? 0u : FAR;
    }
    spread(&layer->frame, away);
}

static uint32_t sector_of(struct point robot, struct point at)
{
    return (uint32_t)bearing(robot, at) / (65536u / DIRECTIONS);
}

/* In each direction from the robot (of DIRECTIONS): mm to the nearest obstacle. */
static void find_shadows(const struct layer *layer, const struct field_task *task,
                         uint16_t *shadows)
{
    const struct frame *const frame = &layer->frame;
    int32_t i, j;
    uint32_t k;
    for (k = 0u; k < DIRECTIONS; k++) {
        shadows[k] = (uint16_t)FAR;
    }
    for (j = 0; j < frame->height; j++) {
        for (i = 0; i < frame->width; i++) {
            if (((uint32_t)layer->weight[(j * frame->width) + i] & 3u) == MAPOD_OBSTACLE) {
                const struct point at = middle_at(frame, i, j);
                const uint32_t sector = sector_of(task->robot, at);
                shadows[sector] = nearer(shadows[sector], (uint32_t)apart_mm(at, task->robot));
            }
        }
    }
}

/* Of ground that is not known to be free, by how far off the robot it is and what stands before. */
static uint8_t unseen(const struct layer *layer, const struct field_task *task, uint32_t at,
                      const uint16_t *shadows)
{
    const int32_t width = layer->frame.width;
    const struct point middle =
        middle_at(&layer->frame, (int32_t)at % width, (int32_t)at / width);
    const int32_t away_mm = apart_mm(middle, task->robot);
    uint32_t weight = UNSEEN_NEAR;
    if (away_mm >= SEEN_FROM_MM) {
        weight = (shadows[sector_of(task->robot, middle)] < away_mm) ? UNSEEN_BEHIND : UNSEEN_FAR;
    }
    return (uint8_t)(FIELD_SOFT | weight);
}

/* Of ground that is known to be free, by how near the next is that is not. */
static uint8_t seen(const struct field_task *task, int32_t away_mm)
{
    uint32_t weight = OPEN;
    if (away_mm < (task->half_mm + TIGHT_MM)) {
        weight += TIGHT;
    }
    if (away_mm < task->around_mm) {
        weight += BESIDE;
    }
    if (away_mm < (task->around_mm + NEARBY_MM)) {
        weight += NEARBY;
    }
    return (uint8_t)weight;
}

/* Makes open ground at a cell of the path before a little cheaper. */
static void favour(struct layer *layer, const struct path_cell *cell)
{
    const int32_t at = cell_index(&layer->frame, cell->at);
    if ((at >= 0) && (layer->weight[at] == OPEN)) {
        layer->weight[at] = (uint8_t)AS_BEFORE;
    }
}

void field_weigh(struct layer *layer, uint16_t *distances, const struct ground *ground,
                 const struct field_task *task)
{
    const int32_t cell_mm = layer->frame.cell_mm;
    const uint32_t count = (uint32_t)(layer->frame.width * layer->frame.height);
    const int32_t half_mm = task->half_mm + (cell_mm / 2);
    uint16_t shadows[DIRECTIONS];
    uint32_t at;
    take_states(layer, ground, task);
    find_shadows(layer, task, shadows);
    measure(layer, distances, task->doubts_obstacles ? GIVEN_UP : MAPOD_OBSTACLE, false);
    for (at = 0u; at < count; at++) {
        if (((distances[at] * cell_mm) / THIRDS) < half_mm) {
            layer->weight[at] |= 4u; /* closed, once all distances are known */
        }
    }
    measure(layer, distances, 0u, true);
    for (at = 0u; at < count; at++) {
        const int32_t away_mm = (distances[at] * cell_mm) / THIRDS;
        if (((uint32_t)layer->weight[at] & 4u) != 0u) {
            layer->weight[at] = FIELD_CLOSED;
        } else if (away_mm < half_mm) {
            layer->weight[at] = task->only_free ? (uint8_t)FIELD_CLOSED
                                                : unseen(layer, task, at, shadows);
        } else {
            layer->weight[at] = seen(task, away_mm - (cell_mm / 2));
        }
    }
    for (at = 0u; at < task->before_count; at++) {
        favour(layer, &task->before[at]);
    }
}
