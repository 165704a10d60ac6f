/* The planner's firmware for the emulated board: link on UART0, text on UART1.
 *
 * Text, one word and its numbers a line: `start NONCE` with the settings that were set before,
 * `set NAME VALUE`, `key HEX` (with MAPOD_LINK_AUTH), `goal X Y` (mm), `halt`, `status`, `dump`
 * (the whole window, a digit a cell). Each gives one line, `dump` one more for each row.
 * Until `start` the planner is silent. A robot's own firmware would have its settings in flash, and
 * draw its nonce at random.
 */
#include "planner.h"

#include "qemu/board.h"

#define LINE 96u

static struct planner planner;
static struct driver_settings settings = {0, 0, 1000, 1000, 520, 200, 600, 150, 300};
static const char *const names[] = {
    "clear_mm", "unknown_mmps", "max_mmps", "max_mradps", "front_mm",
    "rear_mm",  "width_mm",     "margin_mm", "goal_radius_mm",
};
#define NAMES (sizeof names / sizeof names[0])
static uint8_t key[32];
static bool has_key;
static bool runs;
static bool is_held; /* the clock */
static uint32_t held_ms;
static char line[LINE];
static uint32_t line_size;
static uint32_t at; /* in the line: where the next word begins */

/* Whether the line goes on with this word; moves behind it if so. */
static bool word_is(const char *word)
{
    uint32_t k = 0u;
    while ((word[k] != '\0') && (line[at + k] == word[k])) {
        k++;
    }
    if ((word[k] != '\0') || ((line[at + k] != ' ') && (line[at + k] != '\0'))) {
        return false;
    }
    at += k + ((line[at + k] == ' ') ? 1u : 0u);
    return true;
}

static int32_t next_number(void)
{
    const bool negative = line[at] == '-';
    int32_t number = 0;
    at += negative ? 1u : 0u;
    while ((line[at] >= '0') && (line[at] <= '9') && (number < 100000000)) {
        number = (number * 10) + (line[at] - '0');
        at++;
    }
    at += (line[at] == ' ') ? 1u : 0u;
    return negative ? -number : number;
}

static uint8_t next_nibble(void)
{
    const char c = line[at];
    at += (c == '\0') ? 0u : 1u;
    if ((c >= '0') && (c <= '9')) {
        return (uint8_t)(c - '0');
    }
    return ((c >= 'a') && (c <= 'f')) ? (uint8_t)((c - 'a') + 10) : 0u;
}

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
    board_say_number(" tactic=", driver->tactic);
    board_say_number(" v_mmps=", driver->asked.v_mmps);
    board_say_number(" w_mradps=", driver->asked.w_mradps);
    board_say_number(" x_mm=", (pose == NULL) ? 0 : pose->x_mm);
    board_say_number(" y_mm=", (pose == NULL) ? 0 : pose->y_mm);
    board_say_number(" yaw=", (pose == NULL) ? 0 : turn_from_link(pose->yaw));
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
    board_say_number(" stack=", (int32_t)stack_used());
    board_say("\n");
}

static void say_map(void)
{
    const struct mapod_geom *const geom = mapod_link_geom(&planner.link);
    const uint32_t width = (geom == NULL) ? 0u : geom->width;
    const uint32_t height = (geom == NULL) ? 0u : geom->height;
    uint32_t row, column;
    board_say_number("map ", (int32_t)width);
    board_say_number(" ", (int32_t)height);
    board_say_number(" ", (int16_t)planner.link.ox);
    board_say_number(" ", (int16_t)planner.link.oy);
    board_say("\n");
    for (row = 0u; row < height; row++) {
        for (column = 0u; column < width; column++) {
            const uint8_t digit = (uint8_t)('0' + mapod_link_cell(&planner.link, column, row));
            board_write(UART_TEXT, &digit, 1u);
        }
        board_say("\n");
    }
}

static void set(void)
{
    int32_t *const values = &settings.clear_mm;
    uint32_t k;
    for (k = 0u; k < NAMES; k++) {
        if (word_is(names[k])) {
            values[k] = next_number();
            board_say_number("set ", values[k]);
            board_say("\n");
            return;
        }
    }
    board_say("set what?\n");
}

static void take_key(void)
{
    uint32_t k;
    for (k = 0u; k < sizeof key; k++) {
        const uint8_t high = next_nibble();
        key[k] = (uint8_t)((uint32_t)high * 16u + next_nibble());
    }
    has_key = true;
    board_say("key\n");
}

static void start(void)
{
    planner_init(&planner, &settings, (uint32_t)next_number(), has_key ? key : NULL);
    runs = true;
    board_say("start\n");
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

static void hold_clock(void)
{
    held_ms = (uint32_t)next_number();
    is_held = true;
    board_say("clock\n");
}

static void poll(void)
{
    while (send_next()) {
    }
    board_say("poll\n");
}

static void obey(void)
{
    at = 0u;
    if (word_is("status")) {
        say_status();
    } else if (word_is("dump")) {
        say_map();
    } else if (word_is("goal")) {
        const int32_t x_mm = next_number();
        driver_goal(&planner.driver, x_mm, next_number());
        board_say("goal\n");
    } else if (word_is("halt")) {
        driver_halt(&planner.driver);
        board_say("halt\n");
    } else if (word_is("set")) {
        set();
    } else if (word_is("key")) {
        take_key();
    } else if (word_is("start")) {
        start();
    } else if (word_is("clock")) {
        hold_clock();
    } else if (word_is("poll")) {
        poll();
    } else {
        board_say("what?\n");
    }
}

static void hear_text(void)
{
    uint8_t byte;
    if (!board_read_text(&byte)) {
        return;
    }
    if (byte == (uint8_t)'\n') {
        line[line_size] = '\0';
        obey();
        line_size = 0u;
    } else if (line_size < (LINE - 1u)) {
        line[line_size] = (char)byte;
        line_size++;
    } else {
        /* Nobody says so much. */
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
        if (is_held || (!send_next())) {
            hear_text();
        }
    }
}
