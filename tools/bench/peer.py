"""A fixed workload like the app's, Python over small arrays: `python -m tools.bench.peer`.

One round now and then, as the app wakes now and then, until SIGINT. Prints when each ended and the
CPU time that it took, in seconds. What the app costs in rounds of it compares between machines.
"""

import sys
import time

import numpy as np

STEPS = 500
PAUSE_S = 0.05


def rounds_from_text(text: str) -> list[tuple[float, float]]:
    """(ended, CPU time), seconds, of all rounds told; the last line may not be whole."""
    lines = text.rpartition("\n")[0].splitlines()
    return [(float(ended), float(spent)) for ended, spent in map(str.split, lines)]


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
        spent_s = round_s()
        print(f"{time.monotonic():.6f} {spent_s:.6f}", flush=True)
        time.sleep(PAUSE_S)


if __name__ == "__main__":
    sys.exit(main())
