/* The planner's firmware for the emulated board: link on UART0, text on UART1.
 *
 * Text, one word and its numbers a line: `start NONCE` with the settings that were set before,
 * `set NAME VALUE`, `key HEX` (with MAPOD_LINK_AUTH), `goal X Y` (mm), `halt`, `status`, `dump`
 * (the whole window, a digit a cell), `clock MS` (from then on it stands there, and the planner
 * speaks only when told to), `poll`. Each gives one line, `dump` one more for each row. Until
 * `start` the planner is silent. A robot's own firmware would have its settings in flash, and draw
 * its nonce at random.
 */
#include "board/text.h"
#include "planner.h"

static struct planner planner;
static struct driver_settings settings;
static uint8_t key[32];
static bool has_key;
static bool runs;
static bool is_held; /* the clock */
static uint32_t held_ms;

static uint32_t now(void)
{
    return is_held ? held_ms : board_now_ms();
}

static void say_status(void)
{
    const uint32_t now_ms = now();
    const struct driver *const driver = &planner.driver;
    const struct mapod_pose *const pose = mapod_link_pose(&planner.link);
    board_say_number("status state=", driver->state);
    board_say_number(" why=", driver->why);
    board_say_number(" recovery=", driver->recovery);
    board_say_number(" v_mmps=", driver->asked.v_mmps);
    board_say_number(" w_mradps=", driver->asked.w_mradps);
    board_say_number(" x_mm=", (pose == NULL) ? 0 : pose->x_mm);
    board_say_number(" y_mm=", (pose == NULL) ? 0 : pose->y_mm);
    board_say_number(" yaw=", (pose == NULL) ? 0 : angle_from_link(pose->yaw));
    board_say_number(" goal_x_mm=", driver->goal.x_mm);
    board_say_number(" goal_y_mm=", driver->goal.y_mm);
    board_say_number(" advice=", (int32_t)mapod_link_advice(&planner.link, now_ms));
    board_say_number(" link_why=", (int32_t)mapod_link_why(&planner.link, now_ms));
    board_say_number(" blank=", mapod_link_blank(&planner.link));
    board_say_number(" suspect=", mapod_link_suspect(&planner.link));
    board_say_number(" stale=", mapod_link_stale(&planner.link, now_ms));
    board_say_number(" tries=", (int32_t)driver->tries);
    board_say_number(" accepted=", (int32_t)planner.accepted);
    board_say_number(" bad_frames=", planner.link.bad_frames);
    board_say_number(" last=", planner.link.last);
    board_say_number(" ox=", (int16_t)planner.link.ox);
    board_say_number(" oy=", (int16_t)planner.link.oy);
    text_end(" stack=", (int32_t)stack_used());
}

static void set(void)
{
    int32_t *const value = text_word("clear_mm")       ? &settings.clear_mm
                           : text_word("unknown_mmps") ? &settings.unknown_mmps
                                                       : NULL;
    if (value == NULL) {
        text_say("set what?");
        return;
    }
    *value = text_number();
    text_end("set ", *value);
}

static void take_key(void)
{
    uint32_t k;
    for (k = 0u; k < sizeof key; k++) {
        const uint8_t high = text_nibble();
        key[k] = (uint8_t)((uint32_t)high * 16u + text_nibble());
    }
    has_key = true;
}

/* The next frame that is to be said, if there is one; whether there was. */
static bool send_next(void)
{
    uint8_t out[MAPOD_OUT_MAX];
    const uint32_t size = runs ? planner_poll(&planner, now(), out) : 0u;
    if (size > 0u) {
        board_write(UART_LINK, out, mapod_talk_serial(out, size));
    }
    return size > 0u;
}

/* The commands that are answered by their own name; NULL: it is none of these. */
static const char *obey_simple(void)
{
    if (text_word("goal")) {
        const int32_t x_mm = text_number();
        driver_goal(&planner.driver, x_mm, text_number());
        return "goal";
    }
    if (text_word("halt")) {
        driver_halt(&planner.driver);
        return "halt";
    }
    if (text_word("key")) {
        take_key();
        return "key";
    }
    if (text_word("start")) {
        planner_init(&planner, &settings, (uint32_t)text_number(), has_key ? key : NULL);
        runs = true;
        return "start";
    }
    if (text_word("clock")) {
        held_ms = (uint32_t)text_number();
        is_held = true;
        return "clock";
    }
    if (text_word("poll")) {
        while (send_next()) {
        }
        return "poll";
    }
    return NULL;
}

static void obey(void)
{
    if (text_word("status")) {
        say_status();
    } else if (text_word("dump")) {
        text_say_map(&planner.link);
    } else if (text_word("set")) {
        set();
    } else {
        const char *const done = obey_simple();
        text_say((done == NULL) ? "what?" : done);
    }
}

int main(void)
{
    uint8_t byte;
    board_start();
    for (;;) {
        while (board_read(&byte)) {
            if (runs) {
                (void)planner_byte(&planner, now(), byte);
            }
        }
        if ((is_held || (!send_next())) && text_hear()) {
            obey();
        }
    }
}
