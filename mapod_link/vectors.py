"""Objects and path at the receiver's end: which frames are of this epoch, what is to be asked for.

Source: planner link, sections 3 (OBJECTS, PATH), 5 and 6.
"""

from mapod_link.asking import ASK_OBJECTS, ASK_PATH, ask_body
from mapod_link.bodies import Geometry
from mapod_link.counting import Numbers
from mapod_link.frames import OBJECTS, PATH
from mapod_link.objects import LinkObject, Objects, ObjectsPiece
from mapod_link.paths import Path, PathPiece

__all__ = ["ObjectsPiece", "PathPiece", "Vectors"]


class Vectors:
    """What is told besides the map.

    Attributes:
        objects, path: what has arrived; `objects_state` and `path_state` say what it is worth.
    """

    def __init__(self, numbers: Numbers) -> None:
        self._numbers = numbers
        self.objects, self.path = Objects(), Path()
        self._wanted = 0  # bits of ASK

    def objects_state(self, now_s: float) -> tuple[str, str]:
        """("known" | "suspect" | "none", why): but for "known", objects may be missing or gone."""
        return self.objects.state(now_s, self._numbers.gaps)

    def path_state(self, now_s: float) -> tuple[str, str]:
        """("known" | "suspect" | "none", why)."""
        return self.path.state(now_s, self._numbers.gaps)

    def fresh_objects(self, now_s: float) -> list[LinkObject]:
        """Those that stand, and those that move and were seen lately."""
        told = self.objects.by_id.values()
        return [one for one in told if not self.objects.is_old(one, now_s)]

    def take(
        self, now_s: float, piece: ObjectsPiece | PathPiece, t_ms: int, geom: Geometry | None
    ) -> None:
        """One frame; of another epoch: left alone."""
        if geom is None or piece.geom_id != geom.geom_id:
            return
        if isinstance(piece, ObjectsPiece):
            self.objects.take(now_s, piece, t_ms, self._numbers.gaps)
        else:
            self.path.take(now_s, piece, self._numbers.gaps)

    def damage(self, frame_type: int) -> None:
        """A frame whose body can not be read: what it told is missing."""
        if frame_type == OBJECTS:
            self.objects.damage()
        elif frame_type == PATH:
            self.path.damage()

    def forget(self) -> None:
        """A new epoch or run, or a long silence."""
        self.objects.forget()
        self.path.forget()

    def ask(self, *, objects: bool = False, path: bool = False) -> None:
        """Ask for all objects, or for all of the path, with the next `poll` of the receiver."""
        self._wanted |= ASK_OBJECTS * objects | ASK_PATH * path

    def questions(self, now_s: float) -> list[bytes]:
        """Body of the ASK frame that is due: wanted, or not repaired by the sender itself."""
        objects, path = self.objects.is_question_due(now_s), self.path.is_question_due(now_s)
        self.ask(objects=objects, path=path)
        what, self._wanted = self._wanted, 0
        return [ask_body(0, what)] if what else []
