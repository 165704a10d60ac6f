"""What a fake LMS111 measures of a sweep, in one kernel: a thousand beams, 25 times a second."""

import math

import numpy as np

from fakes.lms1xx.scan import FIRST_VALID, NO_ECHO, U16
from fakes.rays.kernels import F64
from jit import kernel

DAZZLED = 1  # a code below FIRST_VALID


@kernel
def codes_from(true_m: F64, offset_m: float, sigma_m: float, noise: F64, most_m: float) -> U16:
    """The codes (n,) of true ranges (n,), with noise (n,) of `sigma_m`; nothing beyond `most_m`."""
    codes = np.empty(len(true_m), dtype=np.uint16)
    for k in range(len(true_m)):
        measured_m = true_m[k] + offset_m + sigma_m * noise[k]
        raw = 0.0
        if math.isfinite(measured_m) and measured_m <= most_m:
            raw = np.rint(1000 * measured_m)
        codes[k] = int(raw) if raw >= FIRST_VALID else NO_ECHO
        if true_m[k] == -math.inf:
            codes[k] = DAZZLED
    return codes
