"""Asks the app on this machine to keep what its flight recorder has: SIGUSR2.

The app is the process whose socket the link's frames come from, so that nobody has to name it, and
no number of a process that has ended can mean another one. A process that does not listen for the
signal would end by it, and gets none.
Source: proc(5): net/udp, fd, status.
"""

import contextlib
import ipaddress
import os
import signal
from pathlib import Path

PROC = Path("/proc")
ELSEWHERE = "the robot's flight recorder is not on this machine, or not ours to ask"
LOCAL, INODE = 1, 9  # fields of net/udp


def save_flight(peer: object) -> str:
    """Where the frames come from, of a UDP wire; "", or why nothing is kept."""
    handle = maybe_app(peer)
    if handle is None:
        return ELSEWHERE
    try:
        signal.pidfd_send_signal(handle, signal.SIGUSR2)
    except OSError:
        return ELSEWHERE
    finally:
        os.close(handle)
    return ""


def maybe_app(peer: object) -> int | None:
    """A descriptor of the process, to be closed; None where there is none that can be asked."""
    match peer:
        case (str(host), int(port), *_):
            inodes = sockets_of(host, port)
        case _:
            return None
    if not inodes:
        return None
    for folder in PROC.glob("[0-9]*"):
        with contextlib.suppress(OSError), contextlib.ExitStack() as opened:
            handle = os.pidfd_open(int(folder.name))
            opened.callback(os.close, handle)
            if has_socket(folder, inodes) and listens(folder):
                opened.pop_all()
                return handle
    return None


def sockets_of(host: str, port: int) -> set[str]:
    """What the kernel calls the UDP sockets of a loopback address."""
    address = ipaddress.ip_address(host)
    if not address.is_loopback or address.version != 4:
        return set()
    local = f"{int.from_bytes(address.packed, 'little'):08X}:{port:04X}"
    anywhere = f"00000000:{port:04X}"
    lines = (PROC / "net" / "udp").read_text().splitlines()[1:]
    rows = [line.split() for line in lines]
    return {f"socket:[{row[INODE]}]" for row in rows if row[LOCAL] in (local, anywhere)}


def has_socket(folder: Path, inodes: set[str]) -> bool:
    return any(os.readlink(path) in inodes for path in (folder / "fd").iterdir())


def listens(folder: Path) -> bool:
    """Whether it has a handler of its own for the signal."""
    status = (folder / "status").read_text()
    caught = int(status.partition("SigCgt:")[2].split()[0], 16)
    return bool(caught >> (signal.SIGUSR2 - 1) & 1)
