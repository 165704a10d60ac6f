"""One Modbus client as the server sees it: requests in, answers out at a bounded pace.

A client that asks as fast as it can is slowed, not dropped: its answers come later. All clients
together have a pace as well, and no call answers more than a few requests, so that whatever else
lives in the loop has its turn. Drive requests from another machine are refused: nothing in Modbus
says who sent them.
"""

import asyncio
import ipaddress
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from hw.device import BadFrame, DeviceStatus
from hw.modbus.image import RegisterImage, TokenBucket, View
from hw.modbus.layout import Refusal
from hw.modbus.pdu import Access, answer, refused

CLIENT_HZ, CLIENT_BURST = 400.0, 60.0  # requests: lasting, and at once after a rest
BATCH = 4  # requests answered in one call
MOST_WAITING = 512  # requests of one client


class Request(NamedTuple):
    """One request as it arrived."""

    unit: int
    pdu: bytes  # function code and data, at least one byte
    transaction: int = 0  # told back; RTU has none


Send = Callable[[Request, bytes], None]


@dataclass(slots=True)
class ServerContext:
    """What all clients of one server share."""

    image: RegisterImage
    clock: Callable[[], float]
    utc_s: Callable[[], float]
    loop: asyncio.AbstractEventLoop
    views: Mapping[int, View | None]  # by unit id, those that are ours; None: the live registers
    is_silent: bool  # to requests for other units, as a serial line demands
    status: DeviceStatus

    def reject(self, reason: str, data: bytes = b"") -> None:
        self.status.reject(BadFrame(reason, data))


class Client:
    """The requests of one client, in order."""

    def __init__(self, context: ServerContext, who: str, is_local: bool, send: Send) -> None:
        self._context, self._who, self._is_local = context, who, is_local
        self._send: Send | None = send
        self._waiting: deque[tuple[float, Request]] = deque()
        self._pace = TokenBucket(CLIENT_HZ, CLIENT_BURST)
        self._timer: asyncio.Handle | None = None
        self._has_place = False  # at both paces, for the next request
        self._is_held = False
        self.asked_s = context.clock()  # when it last asked something

    @property
    def waiting(self) -> int:
        return len(self._waiting)

    def offer(self, requests: list[Request]) -> bool:
        """Take requests that have just arrived; False if too many wait, which are dropped."""
        if not requests:
            return True
        now_s = self.asked_s = self._context.clock()
        room = MOST_WAITING - len(self._waiting)
        self._waiting.extend((now_s, request) for request in requests[:room])
        if len(requests) > room:
            self._context.reject("more requests than can wait")
        if self._timer is None:
            self._work()
        return len(requests) <= room

    def hold(self, is_held: bool) -> None:
        """Answer nothing while its answers are not taken."""
        self._is_held = is_held
        if not is_held and self._timer is None:
            self._work()

    def close(self) -> None:
        self._waiting.clear()
        self._send = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _work(self) -> None:
        self._timer, context = None, self._context
        for _ in range(BATCH):
            if not self._waiting or self._is_held:
                return
            now_s = context.clock()
            if not self._has_place:
                self._has_place = True
                wait_s = max(self._pace.book(now_s), context.image.pace.book(now_s))
                if wait_s > 0.0:
                    self._timer = context.loop.call_later(wait_s, self._work)
                    return
            self._has_place = False
            self._answer(now_s, *self._waiting.popleft())
        if self._waiting:
            self._timer = context.loop.call_soon(self._work)

    def _answer(self, now_s: float, arrived_s: float, request: Request) -> None:
        context = self._context
        if request.unit in context.views:
            view, utc_s = context.views[request.unit], context.utc_s()
            pdu = answer(
                request.pdu,
                Access(context.image, view, self._who, self._is_local, now_s, arrived_s, utc_s),
            )
        elif context.is_silent:
            return
        else:
            pdu = refused(request.pdu[0], Refusal.NO_UNIT)
        if self._send is not None:
            self._send(request, pdu)


def is_loopback(host: str) -> bool:
    """Whether an address is of this very machine's own.

    >>> is_loopback("127.0.0.1"), is_loopback("::1"), is_loopback("::ffff:127.0.0.1")
    (True, True, True)
    >>> is_loopback("192.168.0.7"), is_loopback("fe80::1%eth0"), is_loopback("")
    (False, False, False)
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None)
    return bool((mapped or address).is_loopback)
