/* Link and driver joined: what comes in, and when what goes out. */
#define MAPOD_LINK_IMPLEMENTATION
#include "planner.h"

#define QUIET_STEPS 10u /* a zero may get lost: it is asked for so often before silence */

void planner_init(struct planner *planner, const struct driver_settings *settings, uint32_t nonce,
                  const uint8_t *key)
{
    (void)memset(planner, 0, sizeof *planner);
    mapod_link_init(&planner->link, planner->cells, PLANNER_CELLS);
    mapod_talk_init(&planner->talk, nonce, false);
#ifdef MAPOD_LINK_AUTH
    if (key != NULL) {
        (void)memcpy(planner->key, key, sizeof planner->key);
        mapod_link_set_key(&planner->link, planner->key, nonce);
    }
#else
    (void)key;
#endif
    driver_init(&planner->driver, settings);
}

/* What is to be done at once with a frame that has just been accepted. */
static int note(struct planner *planner, int outcome)
{
    planner->accepted += (outcome > 0) ? 1u : 0u;
    if (outcome == MAPOD_DIGEST) {
        (void)mapod_link_check_digest(&planner->link);
    } else if (outcome == MAPOD_STOP_ZONE) {
        (void)mapod_zone_from(&planner->link, &planner->zone);
    }
    return outcome;
}

int planner_byte(struct planner *planner, uint32_t now_ms, uint8_t byte)
{
    return note(planner, mapod_link_byte(&planner->link, now_ms, byte));
}

int planner_datagram(struct planner *planner, uint32_t now_ms, const uint8_t *data, uint32_t size)
{
    return note(planner, mapod_link_datagram(&planner->link, now_ms, data, size));
}

uint32_t planner_poll(struct planner *planner, uint32_t now_ms, uint8_t *out)
{
    struct driver *const driver = &planner->driver;
    const uint32_t size = mapod_talk_poll(&planner->talk, &planner->link, now_ms, out);
    if (size > 0u) {
        return size;
    }
    if (planner->has_stepped && ((now_ms - planner->stepped_ms) < DRIVER_PERIOD_MS)) {
        return 0u;
    }
    planner->stepped_ms = (planner->has_stepped &&
                           ((now_ms - planner->stepped_ms) < (2u * DRIVER_PERIOD_MS)))
                              ? (planner->stepped_ms + DRIVER_PERIOD_MS)
                              : now_ms;
    planner->has_stepped = true;
    if (driver_step(driver, &planner->link, &planner->zone, now_ms)) {
        planner->quiet = QUIET_STEPS;
    } else if (planner->quiet > 0u) {
        planner->quiet--;
    } else {
        return 0u;
    }
    return mapod_talk_drive(&planner->talk, &planner->link, now_ms,
                            (int16_t)driver->asked.v_mmps, (int16_t)driver->asked.w_mradps,
                            (uint16_t)PLANNER_VALID_MS, out);
}
