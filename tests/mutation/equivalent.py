"""Mutants that change nothing that could be seen, by name, each with the reason."""

FLOATS = "they differ where a measured number is exactly at a margin, and nowhere else"
ALL_AROUND = "the eight neighbours are the same, in another order"
UNMET = "ground that no beam of this run has met has no age, and is not free for that reason"
MORE_CELLS = "the cells that are looked at are more; the distance of each still decides"

CARVING, CLASSIFIER = "core/mapping/beams/carving.py", "core/mapping/beams/classifier.py"
FREE_ALL_OVER = "an infinite radius is everywhere, about whatever middle"
STOP_ZONE = "core/driving/stop_zone.py"
EQUIVALENT: dict[str, str] = {
    f"{CARVING} _passes: abs(h - middle) <= half -> abs(h - middle) < half": FLOATS,
    f"{CLASSIFIER} _is_among_soft: i + AROUND[side][0] -> i - AROUND[side][0]": ALL_AROUND,
    f"{CLASSIFIER} _is_among_soft: j + AROUND[side][1] -> j - AROUND[side][1]": ALL_AROUND,
    f"{CLASSIFIER} _state: cell.count == 0 or cell.looks < 0 -> "
    "cell.count == 0 and cell.looks < 0": UNMET,
    f"{STOP_ZONE} StopZone.clear_of: 0.0 -> 1.0": FREE_ALL_OVER,
    f"{STOP_ZONE} StopZone.clear_of: 0.0 -> 1.0 (2)": FREE_ALL_OVER,
    f"{STOP_ZONE} _sweep: math.floor((now[1] + reach) / cell_m) -> "
    "math.ceil((now[1] + reach) / cell_m)": MORE_CELLS,
}
