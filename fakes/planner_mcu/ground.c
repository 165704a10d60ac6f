/* The link's window in numbers that do not wrap, and the start that is assumed clear. */
#include "ground.h"

/* The whole number nearest to `near` that is `wrapped` modulo 65 536. */
static int32_t unwrapped(uint16_t wrapped, int32_t near)
{
    const uint32_t apart = ((uint32_t)wrapped - (uint32_t)near) & 0xFFFFu;
    return near + ((apart >= 32768u) ? ((int32_t)apart - 65536) : (int32_t)apart);
}

bool ground_from(struct ground *ground, const struct mapod_link *link, struct point robot,
                 int32_t clear_mm)
{
    const struct mapod_geom *const geom = mapod_link_geom(link);
    struct frame *const frame = &ground->frame;
    if ((geom == NULL) || mapod_link_blank(link)) {
        return false;
    }
    ground->link = link;
    ground->clear_mm = clear_mm;
    frame->cell_mm = geom->cell_mm;
    frame->width = geom->width;
    frame->height = geom->height;
    frame->column0 = unwrapped(link->ox, cell_of(frame, robot.x_mm) - (frame->width / 2));
    frame->row0 = unwrapped(link->oy, cell_of(frame, robot.y_mm) - (frame->height / 2));
    return true;
}

uint32_t ground_at(const struct ground *ground, int32_t i, int32_t j)
{
    const struct frame *const frame = &ground->frame;
    /* a column below 0 is, without its sign, one far beyond the last: UNKNOWN */
    const uint32_t state = mapod_link_cell(ground->link, (uint32_t)(i - frame->column0),
                                           (uint32_t)(j - frame->row0));
    if ((state == MAPOD_UNKNOWN) && (ground->clear_mm > 0)) {
        const int32_t x_mm = middle_of(frame, i);
        const int32_t y_mm = middle_of(frame, j);
        const int32_t reach_mm = least(ground->clear_mm, 30000);
        if ((magnitude(x_mm) <= reach_mm) && (magnitude(y_mm) <= reach_mm) &&
            (((x_mm * x_mm) + (y_mm * y_mm)) <= (reach_mm * reach_mm))) {
            return MAPOD_FREE;
        }
    }
    return state;
}

uint32_t ground_at_point(const struct ground *ground, struct point point)
{
    return ground_at(ground, cell_of(&ground->frame, point.x_mm),
                     cell_of(&ground->frame, point.y_mm));
}

int32_t cell_of(const struct frame *frame, int32_t at_mm)
{
    return floor_div(at_mm, frame->cell_mm);
}

int32_t middle_of(const struct frame *frame, int32_t cell)
{
    return (cell * frame->cell_mm) + (frame->cell_mm / 2);
}

struct point middle_at(const struct frame *frame, int32_t column, int32_t row)
{
    const struct point middle = {middle_of(frame, frame->column0 + column),
                                 middle_of(frame, frame->row0 + row)};
    return middle;
}

int32_t cell_index(const struct frame *frame, struct point point)
{
    const int32_t column = cell_of(frame, point.x_mm) - frame->column0;
    const int32_t row = cell_of(frame, point.y_mm) - frame->row0;
    if ((column < 0) || (row < 0) || (column >= frame->width) || (row >= frame->height)) {
        return -1;
    }
    return (row * frame->width) + column;
}
