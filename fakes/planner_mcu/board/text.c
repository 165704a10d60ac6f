/* Lines of the text port, as the board reads and writes them. */
#include "text.h"

#define LINE 96u

static char line[LINE];
static uint32_t line_size;
static uint32_t at; /* in the line: where the next word begins */

bool text_hear(void)
{
    uint8_t byte;
    if (!board_read_text(&byte)) {
        return false;
    }
    if (byte == (uint8_t)'\n') {
        line[line_size] = '\0';
        line_size = 0u;
        at = 0u;
        return true;
    }
    if (line_size < (LINE - 1u)) { /* nobody says more */
        line[line_size] = (char)byte;
        line_size++;
    }
    return false;
}

bool text_word(const char *word)
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

int32_t text_number(void)
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

uint8_t text_nibble(void)
{
    const char c = line[at];
    at += (c == '\0') ? 0u : 1u;
    if ((c >= '0') && (c <= '9')) {
        return (uint8_t)(c - '0');
    }
    return ((c >= 'a') && (c <= 'f')) ? (uint8_t)((c - 'a') + 10) : 0u;
}

void text_end(const char *name, int32_t number)
{
    board_say_number(name, number);
    board_say("\n");
}

void text_say(const char *word)
{
    board_say(word);
    board_say("\n");
}

void text_say_map(const struct mapod_link *link)
{
    const struct mapod_geom *const geom = mapod_link_geom(link);
    const uint32_t width = (geom == NULL) ? 0u : geom->width;
    const uint32_t height = (geom == NULL) ? 0u : geom->height;
    uint32_t row, column;
    board_say_number("map ", (int32_t)width);
    board_say_number(" ", (int32_t)height);
    board_say_number(" ", (int16_t)link->ox);
    text_end(" ", (int16_t)link->oy);
    for (row = 0u; row < height; row++) {
        for (column = 0u; column < width; column++) {
            const uint8_t digit = (uint8_t)('0' + mapod_link_cell(link, column, row));
            board_write(UART_TEXT, &digit, 1u);
        }
        board_say("\n");
    }
}
