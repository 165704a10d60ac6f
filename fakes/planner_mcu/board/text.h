/* The board's text port: one command a line, words and numbers parted by blanks. */
#ifndef TEXT_H
#define TEXT_H

#include "board.h"
#include "mapod_link.h"

/* Takes a byte from the port; true: a whole line has come, and the words begin. */
bool text_hear(void);
/* Whether the line goes on with this word; moves behind it if so. */
bool text_word(const char *word);
int32_t text_number(void);  /* the next one; 0: there is none */
uint8_t text_nibble(void);  /* the next hexadecimal digit; 0: there is none */
void text_end(const char *name, int32_t number); /* says both, and ends the line */
void text_say(const char *word);                 /* a line of one word */
/* Size and origin of the map, then a line for each row, a digit a cell. */
void text_say_map(const struct mapod_link *link);

#endif
