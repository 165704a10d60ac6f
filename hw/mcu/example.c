/* A planner in a few lines of its own: to be copied. Serial line, window of up to 201 x 201 cells.
 * With MAPOD_LINK_OBJECTS it hears of the sender's objects besides. */
#define MAPOD_LINK_IMPLEMENTATION
#include "mapod_link.h"

#define REACH_MM 1000 /* along map x and y, both ways */

uint32_t board_now_ms(void);                             /* any millisecond clock */
bool board_read(uint8_t *byte);                          /* from the UART's ring; false: empty */
void board_write(const uint8_t *bytes, uint32_t count);  /* to the UART */
uint32_t board_random(void);                             /* another one at each start */
void board_obstacle(int32_t x_mm, int32_t y_mm);         /* from the robot, along map x and y */
void board_move(enum mapod_advice advice);               /* your planner: all obstacles are told */

static struct mapod_link link_to_mapod;
static struct mapod_talk talk;
static uint8_t cells[MAPOD_CELL_BYTES(201, 201)];

#ifdef MAPOD_LINK_OBJECTS
/* `all_known`: the list is the sender's; else some may be missing, gone or elsewhere. */
void board_object(const struct mapod_object *object, bool all_known);

static struct mapod_objects objects;

static void tell_objects(void)
{
    const uint32_t now_ms = board_now_ms();
    const enum mapod_worth worth = mapod_objects_worth(&objects, &link_to_mapod, now_ms);
    uint32_t k;
    for (k = 0u; k < objects.count; k++) {
        if (!mapod_objects_old(&objects, k, now_ms)) {
            board_object(&objects.items[k], worth == MAPOD_WORTH_KNOWN);
        }
    }
}
#endif

/* Each obstacle cell near the robot; the window does not turn with it. */
static void tell_obstacles(const struct mapod_pose *pose, const struct mapod_geom *geom)
{
    int32_t x_mm, y_mm;
    for (y_mm = -REACH_MM; y_mm <= REACH_MM; y_mm += geom->cell_mm) {
        for (x_mm = -REACH_MM; x_mm <= REACH_MM; x_mm += geom->cell_mm) {
            if (mapod_link_at(&link_to_mapod, pose->x_mm + x_mm, pose->y_mm + y_mm) ==
                MAPOD_OBSTACLE) {
                board_obstacle(x_mm, y_mm);
            }
        }
    }
}

void planner_start(void)
{
    mapod_link_init(&link_to_mapod, cells, 201u * 201u);
    mapod_talk_init(&talk, board_random() | 1u, false);
#ifdef MAPOD_LINK_OBJECTS
    mapod_objects_init(&objects);
#endif
}

void planner_loop(void) /* again and again, every 10 ms or sooner */
{
    const struct mapod_pose *pose;
    uint8_t byte, out[MAPOD_OUT_MAX];
    uint32_t size;
    while (board_read(&byte)) {
        const int outcome = mapod_link_byte(&link_to_mapod, board_now_ms(), byte);
        if (outcome == MAPOD_DIGEST) {
            (void)mapod_link_check_digest(&link_to_mapod);
        }
#ifdef MAPOD_LINK_OBJECTS
        if (outcome == MAPOD_OBJECTS) {
            (void)mapod_objects_from(&objects, &link_to_mapod);
        }
#endif
    }
    size = mapod_talk_poll(&talk, &link_to_mapod, board_now_ms(), out);
    if (size > 0u) {
        board_write(out, mapod_talk_serial(out, size));
    }
    pose = mapod_link_pose(&link_to_mapod);
    if ((pose != NULL) && (mapod_link_geom(&link_to_mapod) != NULL)) {
        tell_obstacles(pose, mapod_link_geom(&link_to_mapod));
    }
#ifdef MAPOD_LINK_OBJECTS
    tell_objects();
#endif
    board_move(mapod_link_advice(&link_to_mapod, board_now_ms()));
}
