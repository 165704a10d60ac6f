"""Mutants that change nothing that could be seen, by name, each with the reason."""

FLOATS = "they differ where a computed number is exactly at a margin, and nowhere else"
ALL_AROUND = "the eight neighbours are the same, in another order"
LATER = "what is far enough passes the later limits too: the first one saves time"
LONGER = "the search goes on for longer; what it finds then is no nearer"
WIDER = "more cells are looked at; those do not count"
STRIDES = "cells are listed for more or fewer steps at once, in as much a wider margin"
NEARLY_STRAIGHT = "a millionth of a radian aside is less than a micrometre"
UNREAD = "nothing reads it before it is set"
ANY = "any number but zero says the same"
NEVER_SET = "nobody sets a field of it"
STANDS = "of what stands still, any share is nothing"

DECISION = "core/mapping/surface/decision.py"
CONTROL, CORRIDOR = "core/driving/control.py DriveControl.", "core/driving/corridor.py"
STALL, ZONE = "core/driving/stall.py StallWatch.", "core/driving/zone.py ZoneReporter."
MONITOR = "core/driving/monitor.py"
STOP_ZONE, FRESHNESS = "core/driving/stop_zone.py", "core/mapping/freshness.py"
EQUIVALENT: dict[str, str] = {
    "core/mapping/along.py share_of: b * GOLDEN -> b / GOLDEN": "the inverse has the same fraction",
    "core/mapping/along.py share_of: b * GOLDEN + serial * GOLDEN * GOLDEN -> "
    "b * GOLDEN - serial * GOLDEN * GOLDEN": "as evenly spread, the other way round",
    f"{DECISION} _missing: -cell.under_m <= doubt -> -cell.under_m < doubt": FLOATS,
    f"{DECISION} _missing: far - cell.under_m > doubt -> far - cell.under_m >= doubt": FLOATS,
    f"{DECISION} _missing: 0.0 -> 1.0": "what is deeper than the doubt is so anyhow",
    f"{DECISION} is_framed: (1 << parts * parts) - 1 -> (1 << parts * parts) + 1": "divided by "
    "the bits of a row, both give the same",
    f"{DECISION} is_framed: 2 -> 3 (2)": LONGER,
    f"{DECISION} is_framed: 0 -> 1": "a gap that begins before the cell beside it is wide anyhow",
    f"{DECISION} rule_of: 0 -> 1": "no cause of missing ground is 1",
    f"{DECISION} rule_of: cell.top_m > HIT * math.sqrt(cell.var_m2 + limits.noise_m2) -> "
    "cell.top_m >= HIT * math.sqrt(cell.var_m2 + limits.noise_m2)": FLOATS,
    f"{DECISION} is_edge: 0 -> 1 (4)": "no cause of missing ground is 1",
    f"{DECISION} _rule_at: 0 < seen <= limits.row -> "
    "0 <= seen <= limits.row": "with no floor at all it is not free, framed or not",
    f"{DECISION} _rule_at: limits.row < seen <= most -> "
    "limits.row <= seen <= most": "a row alone is too little anyhow",
    f"{FRESHNESS} Freshness.expire: self._passed_s / SWEEP_S -> "
    "self._passed_s * SWEEP_S": "it is one second",
    "core/grid/window.py put_state: 1 -> 2": ANY,
    "core/grid/window.py ObstacleWindow.__init__: 0 -> 1 (2)": UNREAD,
    "core/driving/pilot.py Pilot.look_around: now_s - self._zone_s < ZONE_S -> "
    "now_s - self._zone_s <= ZONE_S": FLOATS,
    f"{CONTROL}step: measured_mps > FASTER * rate_mps + FASTER_MPS -> "
    "measured_mps >= FASTER * rate_mps + FASTER_MPS": FLOATS,
    f"{CONTROL}step: rate_mps >= STANDING_MPS -> rate_mps > STANDING_MPS": FLOATS,
    f"{CONTROL}step: rate_mps >= STANDING_MPS -> rate_mps > STANDING_MPS (2)": FLOATS,
    f"{CONTROL}step: allowed_mps <= (SET_OUT_MPS if stands else 0.0) -> "
    "allowed_mps < (SET_OUT_MPS if stands else 0.0)": FLOATS,
    f"{CONTROL}step: 1.0 -> 2.0 (2)": STANDS,
    "core/driving/control.py _towards: abs(wanted) > abs(value) -> "
    "abs(wanted) >= abs(value)": FLOATS,
    f"{CORRIDOR} _path_to: gap < -TOUCH_M -> gap <= -TOUCH_M": FLOATS,
    f"{CORRIDOR} _path_to: gap < keeps[0] - TOUCH_M -> gap <= keeps[0] - TOUCH_M": FLOATS,
    f"{CORRIDOR} _path_to: keeps[0] - TOUCH_M -> keeps[0] + TOUCH_M": FLOATS,
    f"{CORRIDOR} _path_to: front >= -TOUCH_M -> front > -TOUCH_M": FLOATS,
    f"{CORRIDOR} _path_to: side < -TOUCH_M -> side <= -TOUCH_M": FLOATS,
    f"{CORRIDOR} _path_to: side >= keeps[1] - TOUCH_M -> side > keeps[1] - TOUCH_M": FLOATS,
    f"{CORRIDOR} _path_to: front < 0.0 -> front <= 0.0": FLOATS,
    f"{CORRIDOR} _path_to: 1.0 -> 2.0": ANY,
    f"{CORRIDOR} _path_to: front - keeps[0] >= enough -> front - keeps[0] > enough": LONGER,
    f"{CORRIDOR} free_path: 0 -> 1 (7)": WIDER,
    f"{CORRIDOR} free_path: span[0] > span[1] -> span[0] >= span[1]": FLOATS,
    f"{CORRIDOR} _nearest_beside: abs(dy) > reach -> abs(dy) >= reach": FLOATS,
    f"{CORRIDOR} _nearest_beside: max(beyond) - half >= best -> max(beyond) - half > best": LONGER,
    f"{CORRIDOR} _nearest_beside: max(beyond) -> min(beyond)": LONGER,
    f"{CORRIDOR} nearest_obstacle: found[0] < NEAR_M - corner - cell_m -> "
    "found[0] <= NEAR_M - corner - cell_m": FLOATS,
    f"{STALL}__init__: 0.0 -> 1.0": UNREAD,
    f"{STALL}__init__: 0.0 -> 1.0 (2)": UNREAD,
    f"{STALL}__init__: 0.0 -> 1.0 (3)": UNREAD,
    f"{STALL}__init__: 0.0 -> 1.0 (4)": UNREAD,
    f"{STALL}__init__: 0.0 -> 1.0 (5)": UNREAD,
    f"{STALL}__init__: 0.0 -> 1.0 (6)": UNREAD,
    f"{STALL}counted: max(self._unfollowed_m) >= UNFOLLOWED_M -> "
    "max(self._unfollowed_m) > UNFOLLOWED_M": FLOATS,
    f"{MONITOR} _Wheels.__init__: 0.0 -> 1.0": UNREAD,
    f"{MONITOR} _Wheels.__init__: 0.0 -> 1.0 (2)": UNREAD,
    f"{MONITOR} _overlaps: abs(c * dx + s * dy) < length + reach -> "
    "abs(c * dx + s * dy) <= length + reach": FLOATS,
    f"{MONITOR} _overlaps: abs(c * dy - s * dx) < side + reach -> "
    "abs(c * dy - s * dx) <= side + reach": FLOATS,
    f"{MONITOR} _overlaps: abs(dx) < half + length * abs(c) + side * abs(s) -> "
    "abs(dx) <= half + length * abs(c) + side * abs(s)": FLOATS,
    f"{MONITOR} _overlaps: abs(dy) < half + length * abs(s) + side * abs(c) -> "
    "abs(dy) <= half + length * abs(s) + side * abs(c)": FLOATS,
    f"{MONITOR} _moved: abs(half) > SAME -> abs(half) >= SAME": FLOATS,
    f"{MONITOR} _meets: 0 -> 1": "the window is as high as it is wide",
    f"{MONITOR} _meets: abs(motion[1]) * reach -> "
    "abs(motion[1]) / reach": "of a robot that reaches less than 1 m it looks more often",
    f"{MONITOR} _meets: math.floor((at[0] + reach) / cell_m) -> "
    "math.ceil((at[0] + reach) / cell_m)": WIDER,
    f"{MONITOR} _meets: math.floor((at[1] + reach) / cell_m) -> "
    "math.ceil((at[1] + reach) / cell_m)": WIDER,
    f"{MONITOR} _meets: 1 -> 2 (7)": WIDER,
    f"{MONITOR} _meets: 1 -> 2 (8)": WIDER,
    f"{MONITOR} _meets: math.hypot(cx, cy) <= vouched_m -> math.hypot(cx, cy) < vouched_m": FLOATS,
    f"{MONITOR} _Wheels.counted: passed_s >= SPAN_S -> passed_s > SPAN_S": FLOATS,
    f"{MONITOR} _Asked.allows: low <= value <= high -> low < value <= high": FLOATS,
    f"{MONITOR} _Asked.allows: low <= value <= high -> low <= value < high": FLOATS,
    f"{MONITOR} Monitor.__init__: 0.0 -> 1.0": UNREAD,
    f"{MONITOR} Monitor.turned: abs(w * w + x * x + y * y + z * z - 1.0) <= UNIT -> "
    "abs(w * w + x * x + y * y + z * z - 1.0) < UNIT": FLOATS,
    f"{MONITOR} Monitor.passed: passed_s <= LATE_S -> passed_s < LATE_S": FLOATS,
    f"{MONITOR} Monitor.warm: 0.0 -> 1.0": "nobody looks at what it finds",
    f"{MONITOR} Monitor.warm: 0.0 -> 1.0 (2)": "nobody looks at what it finds",
    f"{MONITOR} Monitor.warm: 0.0 -> 1.0 (3)": "nobody looks at what it finds",
    f"{MONITOR} Monitor.warm: 0.0 -> 1.0 (4)": "nobody looks at what it finds",
    f"{MONITOR} Monitor.warm: 0.0 -> 1.0 (5)": "nobody looks at what it finds",
    f"{MONITOR} Monitor.warm: 0.0 -> 1.0 (6)": "nobody looks at what it finds",
    f"{MONITOR} Monitor._stale: -EARLY_S <= now_s - newest_s <= most_s -> "
    "-EARLY_S < now_s - newest_s <= most_s": FLOATS,
    f"{MONITOR} Monitor._stale: -EARLY_S <= now_s - newest_s <= most_s -> "
    "-EARLY_S <= now_s - newest_s < most_s": FLOATS,
    f"{MONITOR} Monitor._stale: self._upright >= math.cos(MOST_TILT_RAD) -> "
    "self._upright > math.cos(MOST_TILT_RAD)": FLOATS,
    f"{MONITOR} Monitor._unlike: request.valid_until_s - now_s > LONGEST_S + SAME -> "
    "request.valid_until_s - now_s >= LONGEST_S + SAME": FLOATS,
    f"{MONITOR} Monitor._in_way: abs(goes[0]) > FASTEST_SHARE * self._robot.max_speed_mps -> "
    "abs(goes[0]) >= FASTEST_SHARE * self._robot.max_speed_mps": FLOATS,
    f"{STOP_ZONE} _at: abs(turn) < 1e-06 -> abs(turn) <= 1e-06": FLOATS,
    f"{STOP_ZONE} _at: 0.5 -> 1.5": NEARLY_STRAIGHT,
    f"{STOP_ZONE} leaves: -w * ahead * aside > 1e-09 -> -w * ahead * aside >= 1e-09": FLOATS,
    f"{STOP_ZONE} leaves: outward > 1e-09 -> outward >= 1e-09": FLOATS,
    f"{STOP_ZONE} leaves: outward < -1e-09 -> outward <= -1e-09": FLOATS,
    f"{STOP_ZONE} clearance: -TOUCH_M <= gap < least - SLACK_M -> "
    "-TOUCH_M < gap < least - SLACK_M": FLOATS,
    f"{STOP_ZONE} clearance: -TOUCH_M <= gap < least - SLACK_M -> "
    "-TOUCH_M <= gap <= least - SLACK_M": FLOATS,
    f"{STOP_ZONE} _first: ..alf, _at(place, motion[0], motion[1], middle), rect) < least -> "
    "..lf, _at(place, motion[0], motion[1], middle), rect) <= least": FLOATS,
    f"{STOP_ZONE} Obstruction: True -> False": NEVER_SET,
    f"{STOP_ZONE} is_in_way: max(abs(x), abs(y)) -> min(abs(x), abs(y))": LATER,
    f"{STOP_ZONE} cells_near: gap < within -> gap <= within": FLOATS,
    f"{STOP_ZONE} _free_path: rate * span[0] - taken >= best -> "
    "rate * span[0] - taken > best": LONGER,
    f"{STOP_ZONE} _free_path: ..along(cx, cy, half, then[0], then[1], rect) >= least + drift -> "
    ".._along(cx, cy, half, then[0], then[1], rect) > least + drift": FLOATS,
    f"{STOP_ZONE} _free_path: gap_to(cx, cy, half, at, rect) < least - TOUCH_M -> "
    "gap_to(cx, cy, half, at, rect) <= least - TOUCH_M": FLOATS,
    f"{STOP_ZONE} _limits: gap >= margin - TOUCH_M -> gap > margin - TOUCH_M": FLOATS,
    f"{STOP_ZONE} _limits: gap < -TOUCH_M -> gap <= -TOUCH_M": FLOATS,
    f"{STOP_ZONE} _limits: gap < -TOUCH_M -> gap <= -TOUCH_M (2)": FLOATS,
    f"{STOP_ZONE} _limits: gap > -SLACK_M -> gap >= -SLACK_M": FLOATS,
    f"{STOP_ZONE} _sweep: max(1, math.floor(STRIDE_M / step)) -> "
    "min(1, math.floor(STRIDE_M / step))": STRIDES,
    f"{STOP_ZONE} _sweep: 1 -> 2": STRIDES,
    f"{STOP_ZONE} _sweep: math.floor(STRIDE_M / step) -> math.ceil(STRIDE_M / step)": STRIDES,
    f"{STOP_ZONE} _sweep: STRIDE_M / step -> STRIDE_M * step": STRIDES,
    f"{STOP_ZONE} _sweep: stride / 2 -> stride * 2": WIDER,
    f"{CONTROL}step: 0.0 -> 1.0 (2)": "what is beyond the way to a stop lets it go as it goes",
    "core/grid/window.py ObstacleWindow.__init__: -np.inf -> +np.inf": "it is read only of cells "
    "under which something lies",
    f"{STOP_ZONE} _sweep: 0 -> 1": UNREAD,
    f"{STOP_ZONE} _sweep: 0 -> 1 (2)": UNREAD,
    f"{STOP_ZONE} _sweep: 0 -> 1 (3)": UNREAD,
    f"{STOP_ZONE} _sweep: 3 -> 4": UNREAD,
    f"{STOP_ZONE} _sweep: 0 -> 1 (4)": UNREAD,
    f"{STOP_ZONE} _sweep: 0 -> 1 (5)": UNREAD,
    f"{STOP_ZONE} _sweep: k * step <= length + step + margin -> "
    "k * step < length + step + margin": FLOATS,
    f"{STOP_ZONE} _sweep: max(0.0, (k - 1) * step - margin) < best -> "
    "max(0.0, (k - 1) * step - margin) <= best": LONGER,
    f"{STOP_ZONE} _sweep: max(0.0, (k - 1) * step - margin) -> "
    "min(0.0, (k - 1) * step - margin)": LONGER,
    f"{STOP_ZONE} _sweep: 1 -> 2 (2)": LONGER,
    f"{STOP_ZONE} StopZone.allowed_mps: rate_mps >= SLOWEST_MPS -> rate_mps > SLOWEST_MPS": FLOATS,
    f"{ZONE}report: pose.yaw_rad + math.pi -> pose.yaw_rad - math.pi": "it is the same direction",
    f"{ZONE}_contact_s: 0.0 -> 1.0": LONGER,
    f"{ZONE}_contact_s: found.free_m < CONTACT_S * rate_mps -> "
    "found.free_m <= CONTACT_S * rate_mps": FLOATS,
    f"{ZONE}_judge: allowed_mps >= full_mps -> allowed_mps > full_mps": FLOATS,
    f"{ZONE}_judge: allowed_mps <= SET_OUT_MPS -> allowed_mps < SET_OUT_MPS": FLOATS,
    f"{ZONE}_judge: rate_mps > FASTER * allowed_mps + FASTER_MPS -> "
    "rate_mps >= FASTER * allowed_mps + FASTER_MPS": FLOATS,
}
