"""The wires that join a fake to the app or to any other program, under one roof.

In memory with a simulated clock, over TCP or UDP, or on a pty; all with the same faults.
"""

from fakes.wires.disturbance import DatagramFake, Fake, tell_reconnected
from fakes.wires.memory import DatagramWire, MemoryPort, Wire
from fakes.wires.pty import PTY_BACKLOG, PtyWire
from fakes.wires.sockets import READ_SIZE, TCP_BACKLOG, TcpWire, UdpWire

__all__ = [
    "PTY_BACKLOG",
    "READ_SIZE",
    "TCP_BACKLOG",
    "DatagramFake",
    "DatagramWire",
    "Fake",
    "MemoryPort",
    "PtyWire",
    "TcpWire",
    "UdpWire",
    "Wire",
    "tell_reconnected",
]
