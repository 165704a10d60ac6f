/* The planner: link and driver together, the same on a host and on a microcontroller.
 *
 * Feed it bytes or datagrams; poll it until it gives nothing more, every 10 to 50 ms. It sends
 * HELLO, ACK and, while it has a goal, DRIVE every DRIVER_PERIOD_MS. All sources that include this
 * are to be compiled with the same MAPOD_LINK_ settings.
 */
#ifndef PLANNER_H
#define PLANNER_H

#include "driver.h"

#define PLANNER_CELLS FIELD_CELLS /* of the largest window that it takes */
#define PLANNER_VALID_MS 300u     /* of a DRIVE */

struct planner {
    struct mapod_link link;
    struct mapod_talk talk;
    struct mapod_zone zone;
    uint32_t stepped_ms;
    uint32_t accepted; /* frames */
    bool has_stepped;
    uint8_t quiet; /* steps for which zero is still asked for */
    uint8_t key[32];
    uint8_t cells[MAPOD_CELL_BYTES(PLANNER_CELLS, 1)];
    struct driver driver;
};

/* Begins anew. `nonce`: random, not 0. `key`: 32 bytes or NULL; no use without MAPOD_LINK_AUTH. */
void planner_init(struct planner *planner, const struct driver_settings *settings, uint32_t nonce,
                  const uint8_t *key);
/* One byte of a serial line, or one datagram; an `enum mapod_outcome`. */
int planner_byte(struct planner *planner, uint32_t now_ms, uint8_t byte);
int planner_datagram(struct planner *planner, uint32_t now_ms, const uint8_t *data, uint32_t size);
/* The next frame to send, MAPOD_OUT_MAX bytes at most; its size, 0: nothing more for now. */
uint32_t planner_poll(struct planner *planner, uint32_t now_ms, uint8_t *out);

#endif
