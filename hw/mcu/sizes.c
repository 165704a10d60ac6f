/* What section 12 of the protocol counts as the decoder, for measuring it: see tools/rig/c_sizes.py.
 *
 * Init, feed byte or datagram, cell, newest pose, suspect, stale, build ACK. No program.
 */
#define MAPOD_LINK_IMPLEMENTATION
#include "mapod_link.h"


extern uint8_t size_of_link[sizeof(struct mapod_link)];
extern uint8_t size_of_talk[sizeof(struct mapod_talk)];
uint8_t size_of_link[sizeof(struct mapod_link)] = {1};
uint8_t size_of_talk[sizeof(struct mapod_talk)] = {1};
