"""A fake that tests of wires put words into, for streams and for datagrams."""


class Talker:
    """Sends what it is told to, and remembers what it heard."""

    def __init__(self) -> None:
        self.says = b""
        self.says_datagrams: list[bytes] = []
        self.heard = b""
        self.heard_datagrams: list[bytes] = []
        self.clients: list[float] = []

    def exchange(self, now_s: float, received: bytes) -> bytes:
        self.heard += received
        says, self.says = self.says, b""
        return says

    def feed_datagram(self, now_s: float, data: bytes) -> None:
        self.heard_datagrams.append(data)

    def poll(self, now_s: float) -> list[bytes]:
        says, self.says_datagrams = self.says_datagrams, []
        return says

    def reconnected(self, now_s: float) -> None:
        self.clients.append(now_s)
