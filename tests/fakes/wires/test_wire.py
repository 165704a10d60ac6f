"""The wire in memory between fakes and the app: its port, its faults."""

from hypothesis import given
from hypothesis import strategies as st

from fakes.wires.wire import DatagramWire, MemoryPort, Wire
from hw.device import Port
from tests.support.devices.talker import Talker

RATES = st.sampled_from([0.0, 0.1, 0.5, 1.0])


class Memory:
    """A talker, a port and the wire between."""

    def __init__(self, seed: int = 1) -> None:
        self.fake, self.port = Talker(), MemoryPort()
        self.wire = Wire(self.fake, self.port, seed)

    def hear(self, now_s: float, says: bytes) -> bytes:
        """What of it reaches the host in the same step."""
        self.fake.says = says
        self.wire.step(now_s)
        return b"".join(self.port.read())


def test_bytes_pass_both_ways_and_the_backlog_counts_what_waits() -> None:
    memory = Memory()
    port: Port = memory.port
    assert (port.datagrams, port.cause, port.opened, port.fileno()) == (False, "", 1, -1)
    port.write(b"abc")
    port.write(b"de")
    assert port.backlog == 5
    assert memory.hear(0.0, b"xyz") == b"xyz"
    assert (memory.fake.heard, port.backlog) == (b"abcde", 0)
    assert port.read() == []


def test_a_cut_loses_what_is_on_the_way_and_a_new_connection_is_told() -> None:
    memory = Memory()
    memory.hear(0.0, b"")
    memory.wire.delay_s = 1.0
    memory.hear(0.1, b"late")
    memory.port.write(b"never heard")
    memory.wire.cut = True
    assert memory.hear(0.2, b"into the void") == b""
    assert not memory.port.poll(0.2)
    assert memory.port.cause == "the wire in memory is cut"
    memory.port.write(b"dropped")
    assert memory.port.backlog == 0
    memory.wire.cut, memory.wire.delay_s = False, 0.0
    assert memory.hear(3.0, b"new") == b"new"
    assert memory.port.poll(3.0)
    assert (memory.port.cause, memory.port.opened) == ("", 2)
    assert memory.fake.heard == b""
    assert memory.fake.clients == [0.0, 3.0]


def test_a_port_that_somebody_else_pulled_stays_pulled_and_a_closed_one_never_opens() -> None:
    memory = Memory()
    memory.hear(0.0, b"")
    memory.port.connected = False
    assert memory.hear(1.0, b"lost") == b""
    assert not memory.port.poll(1.0)
    memory.port.connected = True
    assert memory.hear(2.0, b"new") == b"new"
    assert memory.fake.clients == [0.0, 2.0]
    memory.port.close()
    memory.port.connected = memory.wire.cut = True
    memory.hear(3.0, b"x")
    memory.wire.cut = False
    assert memory.hear(4.0, b"x") == b""
    assert (memory.port.poll(4.0), memory.port.cause, memory.port.opened) == (False, "closed", 2)


def test_late_bytes_keep_their_order_when_the_delay_shrinks() -> None:
    memory = Memory()
    memory.wire.delay_s = 0.5
    assert memory.hear(0.0, b"one ") == b""
    memory.wire.delay_s = 0.0
    assert memory.hear(0.1, b"two ") == b""
    assert memory.hear(0.49, b"") == b""
    assert memory.hear(0.5, b"three") == b"one two three"


def test_a_mute_device_still_hears() -> None:
    memory = Memory()
    memory.wire.mute = True
    memory.port.write(b"hello?")
    assert memory.hear(0.0, b"swallowed") == b""
    memory.wire.mute = False
    assert memory.hear(0.1, b"back") == b"back"
    assert (memory.fake.heard, memory.wire.sent) == (b"hello?", 13)


def test_offsets_count_every_byte_that_was_sent_whatever_became_of_it() -> None:
    memory = Memory()
    memory.wire.alter_at, memory.wire.drop_at = {1: 0x20, 6: 0x01}, {4, 7}
    assert memory.hear(0.0, b"ABCD") == b"AbCD"
    assert memory.hear(0.1, b"EFGHI") == b"FFI"
    memory.wire.cut = True
    memory.hear(0.2, b"12345")
    memory.wire.cut, memory.wire.alter_at = False, {14: 0xFF}
    assert memory.hear(0.3, b"\x0f") == b"\xf0"


@given(data=st.binary(max_size=50), chunk=st.integers(1, 9))
def test_chunks_are_small_and_lose_nothing(data: bytes, chunk: int) -> None:
    memory = Memory()
    memory.wire.chunk, memory.fake.says = chunk, data
    memory.wire.step(0.0)
    pieces = memory.port.read()
    assert b"".join(pieces) == data
    assert all(0 < len(piece) <= chunk for piece in pieces)


@given(pieces=st.lists(st.binary(max_size=30)), drop=RATES, damage=RATES, seed=st.integers(0, 9))
def test_chance_repeats_itself_by_seed(
    pieces: list[bytes], drop: float, damage: float, seed: int
) -> None:
    def left() -> list[bytes]:
        memory = Memory(seed)
        memory.wire.drop_rate, memory.wire.damage_rate = drop, damage
        return [memory.hear(0.0, piece) for piece in pieces]

    assert left() == left()
    for sent, came in zip(pieces, left(), strict=True):
        same = [a == b for a, b in zip(sent, came, strict=drop == 0.0)]
        assert drop < 1.0 or came == b""
        assert drop > 0.0 or damage not in (0.0, 1.0) or set(same) <= {damage == 0.0}


def test_rates_are_shares_of_the_bytes() -> None:
    memory = Memory()
    memory.wire.drop_rate = 0.1
    assert 8800 < len(memory.hear(0.0, bytes(10000))) < 9200
    memory.wire.drop_rate, memory.wire.damage_rate = 0.0, 0.1
    assert 800 < 10000 - memory.hear(0.0, bytes(10000)).count(0) < 1200


def test_the_way_to_the_device_has_its_own_faults() -> None:
    memory = Memory()
    memory.wire.host_damage_rate = 1.0
    memory.port.write(bytes(100))
    assert memory.hear(0.0, b"clean") == b"clean"
    assert len(memory.fake.heard) == 100
    assert 0 not in memory.fake.heard
    memory.wire.host_drop_rate = 1.0
    memory.port.write(bytes(100))
    memory.wire.step(0.1)
    assert len(memory.fake.heard) == 100


def test_datagrams_stay_whole_and_are_lost_as_a_whole() -> None:
    fake, port = Talker(), MemoryPort(datagrams=True)
    wire = DatagramWire(fake, port, 1)
    port.write(b"one")
    port.write(b"two")
    assert port.backlog == 0
    fake.says_datagrams = [b"three", b"four"]
    wire.step(0.0)
    assert (fake.heard_datagrams, fake.clients) == ([b"one", b"two"], [0.0])
    assert port.read() == [b"three", b"four"]
    wire.drop_rate = wire.host_drop_rate = 0.3
    fake.says_datagrams = [b"datagram"] * 1000
    for _ in range(1000):
        port.write(b"request")
    wire.step(0.0)
    arrived = port.read()
    assert 600 < len(arrived) < 800
    assert set(arrived) == {b"datagram"}
    assert 600 < len(fake.heard_datagrams) < 800
    assert wire.sent == 8009
