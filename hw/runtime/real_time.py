"""Keeps the collector, the pager and other processes out of the loop, as far as permitted.

Source: design, section 3.
"""

import ctypes
import gc
import os

FIFO_PRIORITY = 20
MCL_CURRENT, MCL_FUTURE = 1, 2


def take_real_time() -> tuple[bool, bool]:
    """(memory locked, SCHED_FIFO taken); the garbage collector is frozen and off in any case."""
    gc.collect()
    gc.freeze()
    gc.disable()
    libc = ctypes.CDLL(None, use_errno=True)
    locked = libc.mlockall(MCL_CURRENT | MCL_FUTURE) == 0
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except OSError:
        return locked, False
    return locked, True


def leave_real_time() -> None:
    """The thread that calls this works on only when nothing else is due."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
