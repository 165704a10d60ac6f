/* A planner in ten lines of its own: to be copied. Serial line, window of up to 201 x 201 cells. */
#define MAPOD_LINK_IMPLEMENTATION
#include "mapod_link.h"

uint32_t board_now_ms(void);                                /* any millisecond clock */
bool board_read(uint8_t *byte);                             /* from the UART's ring; false: empty */
void board_write(const uint8_t *bytes, uint32_t count);     /* to the UART */
uint32_t board_random(void);                                /* another one at each start */
void board_move(enum mapod_advice advice, uint8_t in_front); /* your planner */

static struct mapod_link link_to_mapod;
static struct mapod_talk talk;
static uint8_t cells[MAPOD_CELL_BYTES(201, 201)];

void planner_start(void)
{
    mapod_link_init(&link_to_mapod, cells, 201u * 201u);
    mapod_talk_init(&talk, board_random() | 1u, false);
}

void planner_loop(void) /* again and again, every 10 ms or sooner */
{
    uint8_t byte, out[MAPOD_OUT_MAX];
    uint32_t size;
    while (board_read(&byte)) {
        if (mapod_link_byte(&link_to_mapod, board_now_ms(), byte) == MAPOD_DIGEST) {
            (void)mapod_link_check_digest(&link_to_mapod);
        }
    }
    size = mapod_talk_poll(&talk, &link_to_mapod, board_now_ms(), out);
    if (size > 0u) {
        board_write(out, mapod_talk_serial(out, size));
    }
    board_move(mapod_link_advice(&link_to_mapod, board_now_ms()),
               mapod_link_cell(&link_to_mapod, 110u, 100u)); /* 10 cells from the middle */
}
