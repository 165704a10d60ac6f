"""Every kernel of the map of objects, run once: so that no tick has to compile one."""

import numpy as np

from core.objects.records import Detection, FrameObjects
from core.objects.vector_map.object_map import ObjectMap
from core.objects.vector_map.quick_check import quick_check
from core.objects.vector_map.settings import ObjectMapSettings, QuickCheckSettings


def warm_object_map(settings: ObjectMapSettings, look: QuickCheckSettings | None = None) -> None:
    """Let a map see a box until it is in, and go until it is out; with the quick look, if given."""
    objects, origin = ObjectMap(settings), (0.0, 0.0)
    box = np.array([[1.0, -0.3], [1.5, -0.3], [1.5, 0.3], [1.0, 0.3]])
    near, far = (np.array([[0.0, 0.0], [x, -0.7 * x], [x, 0.7 * x]]) for x in (0.98, 3.0))
    seen = (Detection(box, 0.0, 0.4, 500),)
    for k in range(2 * settings.confirm_frames):
        objects.update(FrameObjects(0.1 * k, origin, near, seen, np.zeros((0, 4))))
    if look is not None:
        bearings = np.linspace(-0.5, 0.5, look.rays)
        quick_check(objects, origin, bearings, np.ones(look.rays), look)
    gone = FrameObjects(1e3, origin, far, (), np.array([[3.0, -1.0, 3.0, 1.0]]))
    for k in range(3 * settings.gone_frames):
        objects.update(gone._replace(at_s=1e3 + 0.1 * k))
