"""Questions and answers with a Hokuyo scanner, found at whatever rate and in whatever mode.

A scanner may be found in SCIP 1.1, streaming for a host that has died, in its mode of time
synchronisation, or at another rate: the rates are tried by turns, the set one first.
Source: urg04lx sheet, sections 2, 5 and 7.
"""

from typing import Any

from hw.device import DeviceStatus, Port, SetsRate
from hw.exchange import Exchange, StartAgainError, Steps
from hw.urg04lx import sensor as says
from hw.urg04lx.scip import Reply, encode_request

RATES = (19_200, 57_600, 115_200, 250_000, 500_000, 750_000)
BITS_A_BYTE = 10  # on a serial line
PAUSE_S, LONGEST_PAUSE_S = 0.1, 0.3  # an attempt itself puts few questions, and waits
QUIET_S, LONGEST_QUIET_S = 0.14, 0.5  # after a lone LF: the rest of what was being sent
ANSWER_S, TRIES = 0.5, 2
FOUND_S, LONGEST_REPLY = 0.2, 2200  # QT is answered; behind the rest of a scan, in bytes
MODES = 3  # that QT may find it in: of each it is led out once
RATE_S = 0.15  # after a change of the rate
NO_ANSWER = "no answer from the scanner: check power, cable and rate"


class Conversation:
    """One device on its port, whose rate follows the device's.

    Args:
        baud: of the port, as set; None: it has no rate.
    """

    def __init__(self, status: DeviceStatus, port: Port, baud: int | None) -> None:
        self.exchange = Exchange(status, pause_s=PAUSE_S, longest_pause_s=LONGEST_PAUSE_S)
        self.baud = self._wanted_baud = baud or 0  # that of the port now
        self.remark = ""  # on its rate
        self._maybe_line = port if isinstance(port, SetsRate) and baud else None

    def line_s(self, size: int) -> float:
        """How long so many bytes take on the wire."""
        return size * BITS_A_BYTE / self.baud if self.baud else 0.0

    def ask(
        self, command: str, wait_s: float = ANSWER_S, tries: int = TRIES
    ) -> Steps[Reply | None]:
        """The reply to a command; a damaged one is no answer."""

        def maybe_reply(event: Any) -> Reply | None:
            return event if isinstance(event, Reply) and event.command == command else None

        return (yield from self.exchange.ask(encode_request(command), maybe_reply, wait_s, tries))

    def must(self, command: str, *good: str) -> Steps[Reply]:
        """The same where nothing goes on without a good answer."""
        reply = yield from self.ask(command)
        if reply is None:
            raise StartAgainError(f"the scanner does not answer {command}")
        if reply.status not in (good or (says.OK,)):
            why = says.describe_status(reply.status, command)
            raise StartAgainError(f"the scanner refuses {command}: {why}")
        return reply

    def find(self) -> Steps[None]:
        """Until it is idle and speaks SCIP 2.0, at the rate that is wanted if it can."""
        wanted, self.remark = self._wanted_baud, ""
        others = [rate for rate in RATES if rate != wanted] if self._maybe_line else []
        for rate in (wanted, *others):
            self._go_to(rate)
            yield from self.exchange.until_quiet(QUIET_S, LONGEST_QUIET_S, out=b"\n")
            if (yield from self._is_idle()):
                if rate != wanted:
                    yield from self._change_rate()
                return
        raise StartAgainError(NO_ANSWER)

    def _go_to(self, rate: int) -> None:
        if self._maybe_line is not None and rate != self.baud:
            self._maybe_line.set_rate(rate)
            self.baud = rate

    def _is_idle(self) -> Steps[bool]:
        """Ends a stream, SCIP 1.1 and the mode of time synchronisation."""
        is_switched = False
        for _ in range(MODES + 1):
            reply = yield from self.ask("QT", FOUND_S + self.line_s(LONGEST_REPLY), tries=1)
            if reply is None:  # that SCIP 1.1 refuses what it does not know is said once only
                if is_switched or (yield from self.ask("SCIP2.0", FOUND_S, tries=1)) is None:
                    return False
                is_switched = True
            elif reply.status == says.OK:
                return True
            elif reply.status == says.SCIP1_REFUSES:
                yield from self.ask("SCIP2.0")
            elif reply.status in says.UNKNOWN:
                yield from self.ask("TM2")
            else:
                why = says.describe_status(reply.status, "QT")
                raise StartAgainError(f"the scanner: {why}")
        return False

    def _change_rate(self) -> Steps[None]:
        """From the rate at which it was found, if it knows the wanted one."""
        found, wanted = self.baud, self._wanted_baud
        reply = yield from self.ask(f"SS{wanted:06}", tries=1)
        if reply is not None and reply.status in (says.OK, *says.RATE_KEPT):
            self._go_to(wanted)
            yield from self.exchange.pause(RATE_S)
            if (yield from self.ask("QT")) is not None:
                return
            if reply.status == says.OK:
                raise StartAgainError(f"the scanner does not answer at {wanted} baud")
            self._go_to(found)
        self.remark = f"the scanner does not take {wanted} baud, and is left at {found}"
