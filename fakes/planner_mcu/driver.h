/* A small reactive driver: goes to a goal over ground that is known to be free, and stops on doubt.
 *
 * Every 100 ms it takes map, pose and stop zone of the link and says which motion to ask for. It
 * asks for none that can't end before a cell that is not FREE, but for ground that the operator
 * assumes to be clear at the start, or, where the settings allow it, for unknown ground at so low a
 * speed. No heap, no floating point, no clock of its own: the same bytes give the same motion on
 * every processor. What it knows of the robot and of its laser's mount stands in robot.h, which the
 * build makes from the settings of mapod.
 */
#ifndef DRIVER_H
#define DRIVER_H

#include "arcs.h"

#define DRIVER_PERIOD_MS 100u
#define DRIVER_GOAL_MM 225  /* so near to the goal it stands */
#define DRIVER_CRUMBS 64u /* points that it came by, one each CRUMB_MM */
#define DRIVER_AIMS 6u    /* points that are to be seen from one view */
#define DRIVER_VIEWED 6u  /* points to look from that are remembered */
#define DRIVER_PATH 420u  /* cells */

struct driver_settings {
    int32_t clear_mm;     /* radius about the map's origin where UNKNOWN counts as FREE, in the
                             first run of the sender that is heard */
    int32_t unknown_mmps; /* how slowly it may enter unknown ground; 0: never */
};

enum driver_state { DRIVER_IDLE = 0, DRIVER_DRIVING, DRIVER_ARRIVED, DRIVER_STOPPED };

enum driver_why { /* up to 15: those of the link, `enum mapod_why` */
    DRIVER_WHY_NOTHING = 0,
    DRIVER_WHY_ZONE = 16,     /* the sender's stop zone is unknown or too old */
    DRIVER_WHY_ZONE_STOP,     /* it says stop in this direction */
    DRIVER_WHY_WAITS,         /* something is in the way; it may go away */
    DRIVER_WHY_UNSEEN,        /* ground ahead was not seen: looks for a point to see it from */
    DRIVER_WHY_REFUSED,       /* the sender does not move the robot although it is asked to */
    DRIVER_WHY_LOOKS,         /* turns to look around */
    DRIVER_WHY_BACKS,         /* goes back where it came from, to see the ground ahead */
    DRIVER_WHY_VIEWS,         /* goes to a point from which it will see the ground ahead */
    DRIVER_WHY_NO_PATH,       /* no path over seen ground: given up */
    DRIVER_WHY_GOAL_BLOCKED,  /* the goal is too near to an obstacle: given up */
    DRIVER_WHY_TOO_LONG,      /* not there after the longest time: given up */
    DRIVER_WHY_NEW_SESSION,   /* the sender has started anew: its map begins elsewhere */
    DRIVER_WHY_HALTED,        /* told to stop */
    DRIVER_WHY_WINDOW         /* the window has more cells than this driver can think through */
};

enum recovery { /* behaviours where no motion leads on */
    RECOVERY_NONE = 0, /* along the field */
    RECOVERY_WAIT,     /* stand, and see whether it clears */
    RECOVERY_LOOK,     /* turn once around */
    RECOVERY_BACK,     /* along the crumbs */
    RECOVERY_PROBE,    /* wait for the field of what can be reached, choose a point to look from */
    RECOVERY_VIEW,     /* to that point, over known ground only */
    RECOVERY_FACE,     /* turn there towards what is to be seen */
    RECOVERY_PASS      /* drive towards it, until the line on the ground has passed it */
};

struct driver {
    struct driver_settings settings;
    struct shape shape;
    uint8_t state; /* enum driver_state */
    uint8_t why;   /* enum driver_why, or mapod_why */
    uint8_t recovery;
    uint8_t then; /* after going back to where there is room to turn; RECOVERY_NONE: not for that */
    struct point goal;
    struct motion asked; /* what to ask for now */
    struct choice last;
    struct place place; /* as the newest pose tells */
    struct motion moves;
    uint32_t session;
    bool has_session;
    uint32_t steps;       /* since the goal was set */
    uint32_t since;       /* steps in this behaviour, */
    struct point begun;   /* and where it was begun */
    uint32_t field_steps; /* since the field in work was begun */
    uint32_t stuck;       /* steps without a motion worth asking for */
    uint32_t refused;     /* steps in which the robot did not move although it was asked to */
    uint32_t zone_stops;  /* of the sender, since the robot moved or something was done about it */
    uint32_t refusals;    /* times that it was given up, since it moved */
    uint32_t tries;       /* recoveries for this goal, less those that have been made good */
    uint32_t spent;       /* all recoveries for this goal */
    uint32_t turned_back; /* times, to let the line pass a band again */
    uint32_t doubted;     /* times that obstacles were doubted */
    int32_t credit_mm;    /* driven since a try was made good */
    struct point crossing; /* there something has come on to the path, newest */
    uint32_t crossed;      /* steps that are left to wait for it */
    uint32_t crossed_for;  /* steps for which it has been waited for without a pause */
    bool crossed_back;     /* has gone back for it since it last drove on */
    struct point boxed;     /* where a path led on and no motion did, newest */
    struct point looked_at; /* ground, newest */
    uint32_t looks;        /* at it */
    bool doubts;           /* no path leads on: obstacles may be there by mistake */
    bool looked;           /* has turned around since it last drove on */
    struct point unseen;   /* ground that it wants to see */
    struct point aims[DRIVER_AIMS]; /* of it, and about it */
    uint32_t aim_count;
    struct point view;    /* from there */
    uint32_t view_cost;   /* FIELD_NO_PATH: there is no such point */
    int32_t view_row;     /* of the window, where the search for it goes on */
    uint32_t view_backs;  /* times that the robot had to go back as it drove there */
    struct point viewed[DRIVER_VIEWED]; /* from there it has looked at `looked_at` before */
    uint32_t viewed_count;
    int32_t farther_mm;   /* to look from, for the line has passed ground that did not show */
    uint32_t hidden;      /* times that no point showed ground on the path to this goal */
    int32_t turned;       /* binary angle of a look around, not wrapped */
    int32_t back_mm;      /* left to go back */
    struct point crumbs[DRIVER_CRUMBS];
    uint32_t crumb_count;
    struct disc discs[FIELD_DISCS];
    uint32_t disc_count;
    struct ground ground;
    struct path_cell path[DRIVER_PATH];
    uint32_t path_count;
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
