/* What it costs to drive over each cell, from how near obstacles and unknown ground are. */
#ifndef FIELD_WEIGHTS_H
#define FIELD_WEIGHTS_H

#include "field.h"

/* Fills a layer's weights; `distances` is room for as many numbers as it has cells. */
void field_weigh(struct layer *layer, uint16_t *distances, const struct ground *ground,
                 const struct field_task *task);

#endif
