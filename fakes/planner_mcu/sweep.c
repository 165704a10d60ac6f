/* The footprint's rectangle along an arc, against the cells about it, in whole millimetres. */
#include "sweep.h"

#define STEP_MM 40        /* of the fastest point, between two looks */
#define SLACK_MM 16       /* beside a wall within the margin, nobody goes along quite straight */
#define TOUCH_MM 5        /* nearer than that counts as met: whole millimetres round */
#define ANGLE_PER_MRAD 2670 /* 65 536 / (2 pi * 1000), in 1/256 */
#define ALL 0x7FFFFFFF

struct pose { /* from the robot's place, finer than mm */
    int32_t x_q8;
    int32_t y_q8;
    int32_t yaw_q8; /* binary angle, 1/256 */
};

static int32_t larger_of(int32_t a, int32_t b, int32_t c, int32_t d)
{
    return most(most(a, b), most(c, d));
}

/* By how much the rectangle must grow to meet a square cell; below 0: it does meet it. `x`, `y` of
 * the cell's middle from the axle's, mm; by the four axes on which two rectangles can be parted. */
static int32_t gap_mm(const struct sweep *sweep, int32_t x, int32_t y, binary_angle yaw)
{
    const struct shape *const shape = &sweep->shape;
    const int32_t c = cosine(yaw);
    const int32_t s = sine(yaw);
    const int32_t spread = magnitude(c) + magnitude(s);
    const int32_t cell = (sweep->half_cell_mm * spread) / ONE;
    const int32_t middle = (shape->front - shape->rear) / 2;
    const int32_t length = (shape->front + shape->rear) / 2;
    const int32_t ahead = ((c * x) + (s * y)) / ONE;
    const int32_t aside = ((c * y) - (s * x)) / ONE;
    const int32_t along_x = ((length * magnitude(c)) + (shape->half * magnitude(s))) / ONE;
    const int32_t along_y = ((length * magnitude(s)) + (shape->half * magnitude(c))) / ONE;
    const int32_t over_x = magnitude(((c * middle) / ONE) - x) - sweep->half_cell_mm - along_x;
    const int32_t over_y = magnitude(((s * middle) / ONE) - y) - sweep->half_cell_mm - along_y;
    return larger_of(magnitude(ahead - middle) - length - cell,
                     magnitude(aside) - shape->half - cell, (over_x * 1024) / (spread / 32),
                     (over_y * 1024) / (spread / 32));
}

/* Whether all four neighbours are not free either: such a cell is met after one of them. */
static bool is_inside(const struct ground *ground, int32_t i, int32_t j)
{
    return (ground_at(ground, i - 1, j) != MAPOD_FREE) &&
           (ground_at(ground, i + 1, j) != MAPOD_FREE) &&
           (ground_at(ground, i, j - 1) != MAPOD_FREE) &&
           (ground_at(ground, i, j + 1) != MAPOD_FREE);
}

static void note(struct sweep *sweep, int32_t x_mm, int32_t y_mm, uint32_t state)
{
    struct close_cell *const cell = &sweep->cells[sweep->count];
    const int32_t gap = gap_mm(sweep, x_mm, y_mm, sweep->yaw);
    if (sweep->count >= (SWEEP_CELLS - 1u)) {
        sweep->too_many = true;
        return;
    }
    cell->x_mm = (int16_t)x_mm;
    cell->y_mm = (int16_t)y_mm;
    cell->gap_mm = (int16_t)gap;
    cell->state = (uint8_t)state;
    sweep->count++;
    if ((gap >= 0) && (gap < (sweep->shape.margin - SLACK_MM)) &&
        ((gap - SLACK_MM) < sweep->kept_mm)) {
        sweep->kept_mm = most(0, gap - SLACK_MM);
    }
}

void sweep_begin(struct sweep *sweep, const struct ground *ground, const struct shape *shape,
                 struct place place)
{
    const struct frame *const frame = &ground->frame;
    const struct point at = place.at;
    const int32_t reach = SWEEP_LONGEST_MM + shape->reach + shape->margin + frame->cell_mm;
    /* up to a cell's diagonal beyond the margin, cells count even amid others that are not free */
    const int32_t near = (shape->reach - 1) + shape->margin + ((frame->cell_mm * 7) / 5);
    int32_t i, j;
    sweep->shape = *shape;
    sweep->yaw = place.yaw;
    sweep->half_cell_mm = (frame->cell_mm + 1) / 2;
    sweep->kept_mm = shape->margin;
    sweep->count = 0u;
    sweep->too_many = false;
    for (j = cell_of(frame, at.y_mm - reach); j <= cell_of(frame, at.y_mm + reach); j++) {
        const int32_t y_mm = middle_of(frame, j) - at.y_mm;
        for (i = cell_of(frame, at.x_mm - reach); i <= cell_of(frame, at.x_mm + reach); i++) {
            const uint32_t state = ground_at(ground, i, j);
            const int32_t x_mm = middle_of(frame, i) - at.x_mm;
            const int32_t square = (x_mm * x_mm) + (y_mm * y_mm);
            if ((state != MAPOD_FREE) && (square <= (reach * reach)) &&
                ((square < (near * near)) || !is_inside(ground, i, j))) {
                note(sweep, x_mm, y_mm, state);
            }
        }
    }
}

bool is_moving(struct motion motion)
{
    return (motion.v_mmps != 0) || (motion.w_mradps != 0);
}

int32_t sweep_rate_mmps(const struct shape *shape, struct motion motion)
{
    return magnitude(motion.v_mmps) + ((magnitude(motion.w_mradps) * shape->reach) / 1000);
}

/* Moves a pose on along the arc of a motion. */
static void advance(struct pose *pose, struct motion motion, int32_t rate_mmps, int32_t travel_mm)
{
    const int32_t ahead_q8 = (motion.v_mmps * travel_mm * 8) / rate_mmps * 32;
    const int32_t turn_q8 =
        (((motion.w_mradps * travel_mm * 256) / rate_mmps) * ANGLE_PER_MRAD) / 256;
    const binary_angle yaw = (binary_angle)((pose->yaw_q8 + (turn_q8 / 2)) / 256);
    pose->x_q8 += (ahead_q8 * cosine(yaw)) / ONE;
    pose->y_q8 += (ahead_q8 * sine(yaw)) / ONE;
    pose->yaw_q8 += turn_q8;
}

/* Whether a cell under the rectangle is about to leave it, over the edge that it is nearest to. */
static bool leaves(const struct sweep *sweep, const struct close_cell *cell, struct motion motion)
{
    const int32_t c = cosine(sweep->yaw);
    const int32_t s = sine(sweep->yaw);
    const int32_t ahead = ((c * cell->x_mm) + (s * cell->y_mm)) / ONE;
    const int32_t aside = ((c * cell->y_mm) - (s * cell->x_mm)) / ONE;
    const int32_t to_front = sweep->shape.front - ahead;
    const int32_t to_rear = sweep->shape.rear + ahead;
    const int32_t to_side = sweep->shape.half - magnitude(aside);
    const int32_t outward = ((motion.w_mradps * aside) / 1000) - motion.v_mmps;
    if ((to_side <= to_front) && (to_side <= to_rear)) {
        const int32_t sideways = (-motion.w_mradps * ahead) / 1000;
        return ((sideways > 0) && (aside > 0)) || ((sideways < 0) && (aside < 0));
    }
    return (to_front <= to_rear) ? (outward > 0) : (outward < 0);
}

/* How much of `travel_mm`, at whose end the rectangle stands at `pose`, a cell leaves free; ALL: it
 * is not met there. */
static int32_t free_of(const struct sweep *sweep, const struct close_cell *cell,
                       const struct pose *pose, struct motion motion, int32_t travel_mm)
{
    const int32_t x = cell->x_mm - (pose->x_q8 / 256);
    const int32_t y = cell->y_mm - (pose->y_q8 / 256);
    const int32_t near = sweep->shape.reach + sweep->shape.margin + (2 * sweep->half_cell_mm);
    int32_t gap;
    if ((magnitude(x) > near) || (magnitude(y) > near)) {
        return ALL;
    }
    gap = gap_mm(sweep, x, y, (binary_angle)(pose->yaw_q8 / 256));
    if (cell->gap_mm >= sweep->shape.margin) {
        return (gap >= sweep->kept_mm) ? ALL : (travel_mm - STEP_MM);
    }
    if (gap >= ((cell->gap_mm >= 0) ? least(TOUCH_MM, cell->gap_mm - 1) : 0)) {
        return ALL;
    }
    if (cell->gap_mm >= 0) {
        return travel_mm - STEP_MM - sweep->shape.margin;
    }
    if ((cell->state == MAPOD_UNKNOWN) || leaves(sweep, cell, motion)) {
        return ALL;
    }
    return 0;
}

int32_t sweep_free_mm(const struct sweep *sweep, struct motion motion, int32_t wanted_mm,
                      bool over_unknown)
{
    const int32_t rate_mmps = sweep_rate_mmps(&sweep->shape, motion);
    const int32_t beyond_mm = wanted_mm + sweep->shape.margin;
    struct pose pose = {0, 0, (int32_t)sweep->yaw * 256};
    int32_t free_mm = wanted_mm;
    int32_t travel_mm;
    uint32_t k;
    if ((rate_mmps <= 0) || sweep->too_many) {
        return sweep->too_many ? 0 : wanted_mm;
    }
    for (travel_mm = STEP_MM; (travel_mm <= beyond_mm) && (free_mm > 0); travel_mm += STEP_MM) {
        advance(&pose, motion, rate_mmps, STEP_MM);
        if ((travel_mm - STEP_MM - sweep->shape.margin) >= free_mm) {
            break;
        }
        for (k = 0u; k < sweep->count; k++) {
            const struct close_cell *const cell = &sweep->cells[k];
            if (over_unknown && (cell->state == MAPOD_UNKNOWN)) {
                continue;
            }
            free_mm = least(free_mm, most(0, free_of(sweep, cell, &pose, motion, travel_mm)));
        }
    }
    return free_mm;
}

struct place sweep_end(struct place from, struct motion motion, int32_t rate_mmps,
                       int32_t travel_mm)
{
    struct pose pose = {0, 0, (int32_t)from.yaw * 256};
    int32_t left_mm;
    for (left_mm = travel_mm; left_mm > 0; left_mm -= 2 * STEP_MM) {
        advance(&pose, motion, rate_mmps, least(left_mm, 2 * STEP_MM));
    }
    from.at.x_mm += pose.x_q8 / 256;
    from.at.y_mm += pose.y_q8 / 256;
    from.yaw = (binary_angle)(pose.yaw_q8 / 256);
    return from;
}
