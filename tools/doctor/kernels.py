"""Whether all kernels lie compiled on disk, so that a start compiles none."""

from numba.core import event

from app import warm_kernels
from core.config import Config
from jit import COMPILED
from tools.doctor.finding import Finding


class Compiled(event.Listener):
    """Counts the kernels of ours that had to be compiled."""

    def __init__(self) -> None:
        self.count = 0

    def on_start(self, event: event.Event) -> None:
        """Nothing is told of what only begins."""

    def on_end(self, event: event.Event) -> None:
        """One more, if it is a kernel of ours and no part of Numba."""
        self.count += not event.data["dispatcher"].py_func.__module__.startswith("numba.")


def of_kernels(config: Config) -> Finding:
    """Uses every kernel once, as a start does."""
    if not COMPILED:
        advice = "Start without NUMBA_DISABLE_JIT: a robot needs compiled kernels"
        return Finding("fault", "kernels", "run as Python", advice)
    compiled = Compiled()
    with event.install_listener("numba:compile", compiled):
        warm_kernels(config)
    if compiled.count:
        says = f"{compiled.count} had to be compiled: a start takes that much longer"
        advice = "Run `mapod warm` as a user who may write where mapod is installed"
        return Finding("warning", "kernels", says, advice)
    return Finding("OK", "kernels", "all compiled")
