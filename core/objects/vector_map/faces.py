"""Which parts of an upright plane lie on things, and which on none."""

import numpy as np
import shapely

from core.objects.records import Floats


def parted(
    segment: Floats, outlines: list[Floats], margin_m: float
) -> tuple[list[Floats], list[Floats]]:
    """Parts of a segment (4,) m: what lies beside each outline (n, 2), and what lies beside none.

    A part is as long as the outline is along the segment, no longer: what is seen of a face does
    not make a thing longer. What lies on none begins a margin beyond the outlines.

    Returns:
        For each outline the ends (2, 2) of a part, or (0, 2); and ends of parts of at least a
        margin.
    """
    begin, length = segment[:2], float(np.hypot(*(segment[2:] - segment[:2])))
    along = (segment[2:] - segment[:2]) / length
    line, faces, taken = shapely.LineString(segment.reshape(2, 2)), list[Floats](), [(0.0, 0.0)]
    for outline in outlines:
        at = np.clip((outline - begin) @ along, 0.0, length)
        low, high = float(at.min()), float(at.max())
        is_beside = low < high and line.dwithin(shapely.Polygon(outline), margin_m)
        faces.append(begin + np.array([[low], [high]]) * along if is_beside else np.zeros((0, 2)))
        if is_beside:
            taken.append((low - margin_m, high + margin_m))
    rest, end_m = list[Floats](), 0.0
    for low, high in [*sorted(taken), (length, length)]:
        if low - end_m > margin_m:
            rest.append(begin + np.array([[end_m], [low]]) * along)
        end_m = max(end_m, high)
    return faces, rest
