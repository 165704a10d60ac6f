/* A small reactive driver: goes to a goal over ground that is known to be free, and stops on doubt.
 *
 * Every 100 ms it takes map, pose and stop zone of the link and says which motion to ask for. It
 * asks for none whose way to a stop covers a cell that is not FREE, but for ground that the
 * operator vouches for at the start, or, where the settings allow it, for unknown ground at so low
 * a speed. No heap, no floating point, no clock of its own: the same bytes give the same motion on
 * every processor.
 */
#ifndef DRIVER_H
#define DRIVER_H

#include "arcs.h"

#define DRIVER_PERIOD_MS 100u
#define DRIVER_CRUMBS 64u /* of the way that it came, one each CRUMB_MM */
#define DRIVER_AIMS 6u    /* places that are to be seen from one view */
#define DRIVER_VIEWED 6u  /* places to look from that are remembered */

struct driver_settings { /* mm, mm/s, mrad/s */
    int32_t clear_mm;     /* radius about the map's origin where UNKNOWN counts as FREE, in the
                             first run of the sender that is heard */
    int32_t unknown_mmps; /* how slowly it may enter unknown ground; 0: never */
    int32_t max_mmps;
    int32_t max_mradps;
    int32_t front_mm; /* footprint: ahead of the drive axle, behind it, and how wide */
    int32_t rear_mm;
    int32_t width_mm;
    int32_t margin_mm; /* kept free all around */
    int32_t goal_radius_mm;
};

enum driver_state { DRIVER_IDLE = 0, DRIVER_DRIVING, DRIVER_ARRIVED, DRIVER_STOPPED };

enum driver_why { /* up to 15: those of the link, `enum mapod_why` */
    DRIVER_WHY_NOTHING = 0,
    DRIVER_WHY_ZONE = 16,     /* the sender's stop zone is unknown or too old */
    DRIVER_WHY_ZONE_STOP,     /* it says stop in this direction */
    DRIVER_WHY_WAITS,         /* something is in the way; it may go away */
    DRIVER_WHY_UNSEEN,        /* ground in the way that was not seen: looks for a place to see it */
    DRIVER_WHY_REFUSED,       /* the sender does not move the robot although it is asked to */
    DRIVER_WHY_LOOKS,         /* turns to look around */
    DRIVER_WHY_BACKS,         /* goes back along the way it came, to see the ground ahead */
    DRIVER_WHY_VIEWS,         /* goes to a place from which it will see the ground ahead */
    DRIVER_WHY_NO_WAY,        /* no way over seen ground: given up */
    DRIVER_WHY_GOAL_BLOCKED,  /* the goal is too near to an obstacle: given up */
    DRIVER_WHY_TOO_LONG,      /* not there after the longest time: given up */
    DRIVER_WHY_NEW_SESSION,   /* the sender has started anew: its map begins elsewhere */
    DRIVER_WHY_HALTED,        /* told to stop */
    DRIVER_WHY_WINDOW         /* the window is larger than this driver can think through */
};

enum driver_tactic {
    TACTIC_GO = 0, /* along the field */
    TACTIC_WAIT,   /* stand, and see whether it clears */
    TACTIC_LOOK,   /* turn once around */
    TACTIC_BACK,   /* along the crumbs */
    TACTIC_PROBE,  /* wait for the field of what can be reached, to choose a place to look from */
    TACTIC_VIEW,   /* to that place, over known ground only */
    TACTIC_FACE,   /* turn there towards what is to be seen */
    TACTIC_PASS    /* drive towards it, until the line on the floor has passed it */
};

struct spot { /* map frame, mm */
    int32_t x_mm;
    int32_t y_mm;
};

struct driver {
    struct driver_settings settings;
    struct shape shape;
    uint8_t state; /* enum driver_state */
    uint8_t why;   /* enum driver_why, or mapod_why */
    uint8_t tactic;
    uint8_t then; /* after going back to where there is room to turn; TACTIC_GO: not for that */
    struct spot goal;
    struct motion asked; /* what to ask for now */
    struct choice last;
    struct place place; /* as the newest pose tells */
    struct motion moves;
    uint32_t session;
    bool has_session;
    uint32_t steps;       /* since the goal was set */
    uint32_t since;       /* steps in this tactic */
    uint32_t field_steps; /* since the field in work was begun */
    uint32_t stuck;       /* steps without a motion worth asking for */
    uint32_t refused;     /* steps in which the robot did not move although it was asked to */
    uint32_t refusals;    /* times that it was given up, since it moved */
    uint32_t tries;       /* tactics for this goal, less those that have paid */
    uint32_t spent;       /* all tactics for this goal */
    uint32_t turned_back; /* times, to let the line pass a band again */
    uint32_t doubted;     /* times that obstacles were doubted */
    int32_t paid_mm;      /* way driven since one was struck off */
    struct spot crossing; /* there something has come on to the way, newest */
    uint32_t crossed;     /* steps that are left to wait for it */
    uint32_t crossed_for; /* steps for which it has been waited for without a pause */
    bool crossed_back;    /* has gone back for it since it last drove on */
    struct spot boxed;     /* where a way led on and no motion did, newest */
    struct spot looked_at; /* ground, newest */
    uint32_t looks;        /* at it */
    bool doubts;          /* no way leads on: obstacles may be there by mistake */
    bool looked;          /* has turned around since it last drove on */
    struct spot unseen;   /* ground that it wants to see */
    struct spot aims[DRIVER_AIMS]; /* of it, and about it */
    uint32_t aim_count;
    struct spot view;     /* from there */
    uint32_t view_cost;   /* FIELD_NO_WAY: there is no such place */
    int32_t view_row;     /* of the window, where the search for it goes on */
    uint32_t view_backs;  /* times that the robot had to go back on its way there */
    struct spot viewed[DRIVER_VIEWED]; /* from there it has looked at `looked_at` before */
    uint32_t viewed_count;
    uint32_t hidden;      /* times that no place showed ground on the way to this goal */
    int32_t turned;       /* turns, of a look around */
    int32_t back_mm;      /* left to go back */
    struct spot crumbs[DRIVER_CRUMBS];
    uint32_t crumb_count;
    struct disc discs[FIELD_DISCS];
    uint32_t disc_count;
    struct ground ground;
    struct step_cell way[420];
    uint32_t way_count;
    uint32_t known_count; /* of them, up to the first that is not known to be free */
    struct sweep sweep;
    struct field field;
};

/* Begins anew, without a goal. */
void driver_init(struct driver *driver, const struct driver_settings *settings);
void driver_goal(struct driver *driver, int32_t x_mm, int32_t y_mm);
void driver_halt(struct driver *driver);
/* One step, every DRIVER_PERIOD_MS; `driver->asked` is the motion. True: ask for it, also if it is
 * zero; false: there is nothing to ask for. */
bool driver_step(struct driver *driver, struct mapod_link *link, struct mapod_zone *zone,
                 uint32_t now_ms);

#endif
