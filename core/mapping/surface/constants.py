"""Every number of method `surface`; what follows from others stands as an expression.

Source: docs/method.md, section 6, has the origin of each.
"""

import math

from core.mapping.along import STEP_M

# --- statistics
GATE = 3.0  # sigmas: what is farther off belongs to something else
WITNESSES = 15  # returns of one mind: fewer may lie on one thing
ROUNDS = 3  # of reweighting

# --- sensors
SIGMA_ANGLE_RAD = math.radians(0.03)  # of the attitude, from scan to scan: below its resolution
SIGMA_FAST_RAD, FAST_S = math.radians(0.15), 10.0  # what the tilt filter leaves, and how slowly
SIGMA_JUMP_RAD = math.radians(1.0)  # where it goes over to other angles (sheet: 2 deg is two)
SIGMA_STATIC_RAD = math.radians(0.25)  # of an attitude sensor for always (sheet: 0.5 deg is two)
ALIKE_S = 1.0  # so long, an attitude wanders little

# --- ground
BEND = 0.02  # 1 sigma: terrain departs so much from its tangent in a metre; beyond, by the root
CARRY_M = 1.0  # how far a slope carries
FLAT_M = 0.003  # roughness of floor within a cell, and under the wheels
STEEPEST = 0.2  # most that a wheel climbs
STEEP = STEEPEST / GATE  # 1 sigma of slopes
GUESS = 0.4  # of h_pos, 1 sigma: ground less sure is a guess
REACH = 2  # neighbours looked at: 5 x 5 places,
REACH_M = STEP_M  # so far apart, or a cell
FRONT = 3  # cells beside each other: through less nothing is reached

# --- evidence: log-odds
LIKELY = 3.0  # something stands here
CLEAR = -1.5  # nothing stands here
HIT, PASS_LOW, PASS_THROUGH = 2.0, -1.0, -0.5  # votes of a scan
MOST, LEAST = LIKELY - CLEAR, CLEAR - HIT  # they are never surer
KNOWN = CLEAR + PASS_LOW  # floor, beyond which floor was seen as well
RARE = 0.05  # chance of what is hardly ever so: of half of the returns of stalks each says a third
LET_IN, STOPPED = math.log(0.5 / RARE) / 3.0, math.log(0.5 / (1.0 - RARE)) / 3.0
HARD = math.log(RARE / (1.0 - RARE)) / 3.0
LOWERED = 0.5  # how far one scan moves what is known of ground that was not met
THING_M = 0.3  # so near lie returns of one thing
BESIDE, DARK = 2, 3  # beams: by which a face shows; in a row that do not come back
GAP_M = 5.0  # longest along a beam, from one ground to the next
WIDE, SHARE = 5, 0.3  # bins, half of h_pos, in which returns over a guess agree; of all of them
BINS = 16 * WIDE  # four h_pos up and down
