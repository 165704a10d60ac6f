"""A state machine of clients that come, read, write, send junk and go, while maps go by.

Whatever they do: nothing raises, every answer is a whole frame to what was asked, a window that was
read in pieces is one map, and no drive request holds longer than it said when it arrived.
"""

import asyncio

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from hw.modbus.client import MOST_WAITING, ServerContext
from hw.modbus.layout import DRIVE, WINDOW, WINDOW_CELLS, Refusal, stride_of
from hw.modbus.network import MOST_CONNECTIONS, TcpConnection, TcpService, take_requests
from hw.planner_link.requests import ReplayGuard, Requests
from hw.ports.url import parse_url
from tests.support.cases import examples
from tests.support.machine import modbus_rig as rig

CELLS = rig.SIZE * stride_of(rig.SIZE)


class Wire(asyncio.Transport):
    """The server's end of a connection without a network."""

    def __init__(self, host: str, number: int) -> None:
        super().__init__({"peername": (host, 50_000 + number)})
        self.sent, self.is_closed = bytearray(), False
        self.write = self.sent.extend  # type: ignore[assignment]

    def close(self) -> None:
        self.is_closed = True

    abort = close


class Reader:
    """A client: what it has asked, and how much of a window it has read."""

    def __init__(self, handler: TcpConnection, host: str, number: int) -> None:
        self.handler, self.wire, self.unit = handler, Wire(host, number), 2 + number
        self.is_local, self.asked = host == "127.0.0.1", list[tuple[int, int]]()
        self.generation, self.words = 0, list[int]()
        handler.connection_made(self.wire)


class Modbus(RuleBasedStateMachine):
    """One server, up to all the clients that it takes, on a clock that the rules move."""

    @initialize()
    def begin(self) -> None:
        self.clock, self.number = rig.Clock(), 0
        self.requests = Requests(ReplayGuard(7))
        image = rig.new_image(ask=self.requests.ask)
        views = {unit: image.new_view() for unit in range(2, 2 + MOST_CONNECTIONS)}
        self.calls = rig.Loop(self.clock)
        self.context: ServerContext = rig.context_of(image, self.calls)
        self.context.views = {1: None, **views}
        self.service = TcpService(self.context, parse_url("tcp://127.0.0.1:5020"))
        self.readers: dict[int, Reader] = {}
        self.maps = {1: rig.raster(rig.some_cells(1), (-7, 3), True)}
        self.granted_until_s = 0.0  # by what was asked, counted from when it arrived

    @rule(seed=st.integers(0, 99), trusted=st.booleans(), epoch=st.integers(0, 1))
    def publish(self, seed: int, trusted: bool, epoch: int) -> None:
        self.run(0.1)
        cells, corner, image = rig.some_cells(seed), (seed, -seed), self.context.image
        window = rig.window_of(cells, corner, trusted=trusted, epoch=epoch)
        image.publish(self.clock.now_s, rig.GOOD, rig.CLEAR, window)
        head = image.read(self.clock.now_s, None, WINDOW, 1)
        assert isinstance(head, bytes)
        self.maps[int.from_bytes(head, "big")] = rig.raster(cells, corner, trusted)

    @rule(local=st.booleans(), slot=st.integers(0, MOST_CONNECTIONS - 1))
    def connect(self, local: bool, slot: int) -> None:
        if slot not in self.readers:
            host = "127.0.0.1" if local else "192.168.0.9"
            self.readers[slot] = Reader(TcpConnection(self.service), host, slot)

    def reader(self, slot: int) -> Reader:
        return [*self.readers.values()][slot % len(self.readers)]

    def ask(self, reader: Reader, request: bytes, first: int) -> None:
        reader.asked.append((self.number % 65_536, first))
        self.number += 1
        if not reader.wire.is_closed:
            reader.handler.data_received(request)

    some_reader = precondition(lambda self: bool(self.readers))

    @some_reader
    @rule(slot=st.integers(0, 7), count=st.integers(1, 125))
    def read_on(self, slot: int, count: int) -> None:
        reader = self.reader(slot)
        if reader.asked:  # one question at a time
            self.run(1.0)
        first = WINDOW_CELLS + len(reader.words) if reader.generation else WINDOW
        count = min(count, WINDOW_CELLS + CELLS + 1 - first) if reader.generation else 10
        request = rig.read_request(first, count, reader.unit, self.number % 65_536)
        self.ask(reader, request, first)
        self.run(0.0)

    @some_reader
    @rule(slot=st.integers(0, 7), valid_ms=st.integers(0, 1100), v_mms=st.integers(-900, 900))
    def drive(self, slot: int, valid_ms: int, v_mms: int) -> None:
        reader = self.reader(slot)
        words = [v_mms % 65_536, 0, valid_ms, self.number % 65_536]
        if reader.is_local and valid_ms <= 1000:
            until_s = self.clock.now_s + valid_ms / 1000
            self.granted_until_s = max(self.granted_until_s, until_s)
        self.ask(reader, rig.write_request(DRIVE, words, 1, self.number % 65_536), DRIVE)

    @some_reader
    @rule(slot=st.integers(0, 7), junk=st.binary(min_size=1, max_size=300))
    def send_junk(self, slot: int, junk: bytes) -> None:
        self.reader(slot).handler.data_received(junk)
        self.leave(slot)  # nobody knows what it has asked

    @some_reader
    @rule(slot=st.integers(0, 7), requests=st.integers(1, 600))
    def flood(self, slot: int, requests: int) -> None:
        self.send_junk(slot, rig.read_request(0, 1) * requests)

    @some_reader
    @rule(slot=st.integers(0, 7))
    def leave(self, slot: int) -> None:
        reader = self.reader(slot)
        self.readers = {at: one for at, one in self.readers.items() if one is not reader}
        reader.handler.connection_lost(None)

    @rule(dt_s=st.sampled_from([0.001, 0.05, 0.3, 1.5, 70.0]))
    def run(self, dt_s: float) -> None:
        """Time passes; what is due comes."""
        until_s = self.clock.now_s + dt_s
        while self.calls.calls and min(call.due_s for call in self.calls.calls) <= until_s:
            self.calls.step()
        self.clock.now_s = max(self.clock.now_s, until_s)
        self.service.tend(self.clock.now_s)
        for reader in list(self.readers.values()):
            self.look_at_answers(reader)
            if reader.wire.is_closed:
                reader.handler.connection_lost(None)
        self.readers = {at: one for at, one in self.readers.items() if not one.wire.is_closed}

    def look_at_answers(self, reader: Reader) -> None:
        """Each answers the oldest question."""
        answers, reason = take_requests(reader.wire.sent)
        assert not reader.wire.sent
        assert not reason
        for answer in answers:
            number, first = reader.asked.pop(0)
            assert answer.transaction == number
            if first == DRIVE:
                assert reader.is_local or answer.pdu == b"\x90\x01"
            elif answer.pdu[0] & 0x80:
                assert answer.pdu[1] == Refusal.BUSY
                reader.generation, reader.words = 0, []
            else:
                self.take_words(reader, first, answer.pdu[2:])

    def take_words(self, reader: Reader, first: int, data: bytes) -> None:
        words = rig.words_from(data)
        if first == WINDOW:
            reader.generation, reader.words = words[0], []
            return
        reader.words += words
        if len(reader.words) == CELLS + 1:
            assert reader.words[-1] == reader.generation
            assert rig.rows_of(reader.words[:-1], rig.SIZE) == self.maps[reader.generation]
            reader.generation = 0

    @invariant()
    def no_drive_request_holds_longer_than_it_said(self) -> None:
        if getattr(self, "requests", None) is not None and self.requests.newest is not None:
            assert self.requests.newest.valid_until_s <= self.granted_until_s + 1e-9

    @invariant()
    def what_waits_is_bounded(self) -> None:
        for reader in getattr(self, "readers", {}).values():
            client = reader.handler._client
            assert client is None or client.waiting <= MOST_WAITING


TestModbus = Modbus.TestCase
TestModbus.settings = settings(max_examples=examples(10), stateful_step_count=30, deadline=None)
