"""A fixed workload like the app's, Python over small arrays: `python -m tools.bench.peer`.

One round now and then, as the app wakes now and then, until SIGINT; prints the CPU time of each in
seconds. What the app costs in rounds of it compares between machines.
"""

import sys
import time

import numpy as np

STEPS = 3000
PAUSE_S = 0.2


def round_s() -> float:
    """CPU time of one round."""
    values, kept, total = np.arange(64.0), dict[int, float](), 0.0
    begun_s = time.thread_time()
    for step in range(STEPS):
        total += float(np.add(values, step)[step % 64])
        kept[step % 97] = total
    return time.thread_time() - begun_s


def main() -> int:
    while True:
        print(f"{round_s():.6f}", flush=True)
        time.sleep(PAUSE_S)


if __name__ == "__main__":
    sys.exit(main())
