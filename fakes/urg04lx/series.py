"""What a host asks of scans: which steps, how many become one value, and how many scans.

Source: urg04lx sheet, section 5.
"""

from dataclasses import dataclass

from fakes.urg04lx.models import Model
from fakes.urg04lx.scip import (
    I32,
    SCANS,
    Request,
    StatusError,
    clustered,
    data_lines,
    number,
    summed,
)

# names, digits and statuses of what is no number, in the order in which they stand
FIELDS = ((4, b"01"), (4, b"02"), (2, b"03"), (1, b"06"), (2, b"07"))
OUT_OF_RANGE, REVERSED = b"04", b"05"


@dataclass(frozen=True, slots=True)
class Asked:
    """The parameters of GD, GS, MD or MS."""

    start: int
    end: int
    cluster: int
    interval: int = 0  # scans skipped between two
    count: int = 0  # 0: until QT

    def lines(self, stamp_ms: int, values: I32, width: int, lowest: int) -> list[bytes]:
        """Time and data of a scan, values of all steps."""
        wanted = clustered(values[self.start : self.end + 1], self.cluster, lowest)
        return [summed(number(stamp_ms, 4)), *data_lines(wanted, width)]


def asked(request: Request, model: Model) -> Asked:
    """What a request of the right length asks for.

    Raises:
        StatusError: 01 to 07; digits come before the range.
    """
    numbers, rest = [], request.parameters
    for width, status in FIELDS:
        if not rest:
            break
        if not rest[:width].isdigit():
            raise StatusError(status)
        numbers.append(int(rest[:width]))
        rest = rest[width:]
        if len(numbers) == 3:
            if numbers[1] > model.last:
                raise StatusError(OUT_OF_RANGE)
            if numbers[1] < numbers[0]:
                raise StatusError(REVERSED)
    return Asked(*numbers)


class Series:
    """A stream of scans under way."""

    def __init__(self, request: Request, wanted: Asked, first: int) -> None:
        self.wanted, self.next_scan = wanted, first
        self.is_checking = False  # it stopped to check an error
        self._request, self._left = request, wanted.count

    @property
    def width(self) -> int:
        return SCANS[self._request.command]

    @property
    def is_over(self) -> bool:
        return self.wanted.count > 0 and self._left == 0

    @property
    def echo(self) -> bytes:
        """With the scans that are left in place of the count."""
        request = self._request
        return request.command + request.parameters[:-2] + b"%02d" % self._left + request.text

    def sent(self, scan: int) -> None:
        """One more goes out; before its echo is made."""
        self._left -= self._left > 0
        self.next_scan = scan + 1 + self.wanted.interval
