"""Judges the telegrams of a SICK LMS1xx that is measuring: new, usable, as configured, and well.

It refuses to deliver what is not known to be good: a repeated telegram, a device status that is not
documented as good, a window too dirty to see through. Source: lms111 sheet, sections 3 and 5.
"""

import math

from hw.device import BadFrame, DeviceStatus
from hw.lms1xx.exchange import ScanStream
from hw.lms1xx.scan import ScanSettings
from hw.lms1xx.setup import SCAN_MODE, covers
from hw.lms1xx.status import (
    CONTAMINATIONS,
    TOO_DIRTY,
    ScannerCondition,
    describe_status,
    is_usable,
)
from hw.lms1xx.telegrams import ScanTelegram

UNUSABLE_S = 0.5  # without a scan that may be believed, after which it runs no longer


class TelegramWatch:
    """Takes the telegrams of one connection, and sets the status by them."""

    def __init__(self, status: DeviceStatus, stream: ScanStream, settings: ScanSettings) -> None:
        self._status, self._stream, self._settings = status, stream, settings
        self._last: ScanTelegram | None = None
        self._usable_s = -math.inf  # host clock, last telegram that may be believed
        self._told: tuple[object, ...] = ()  # what the cause was last made of

    def begin(self) -> None:
        """A new subscription: nothing is compared with what came before it."""
        self._last, self._told = None, ()

    def is_new(self, telegram: ScanTelegram) -> bool:
        """False for a telegram that was there before; counts those that never came."""
        last, self._last = self._last, telegram
        if last is None:
            return True
        if (telegram.telegram_counter, telegram.sent_us) == (last.telegram_counter, last.sent_us):
            self._status.reject(BadFrame("scan telegram repeated", b""))
            return False
        gap = (telegram.scan_counter - last.scan_counter - 1) % 2**16
        passed_s = (telegram.scan_us - last.scan_us) % 2**32 * 1e-6
        if gap <= 1.5 * passed_s * telegram.scan_hz + 1:  # else the counter began anew
            self._status.missed += gap
        return True

    def take(self, now_s: float, telegram: ScanTelegram, remarks: list[str]) -> bool:
        """Hand it to the side that measures, if it may be believed; whether it was."""
        self._stream.newest = telegram
        if doubt := self._doubt(telegram):
            self._stream.not_ready += 1
            if now_s - self._usable_s >= UNUSABLE_S:
                self._status.fall_back("starting", f"the scanner {doubt}")
                self._told = ()
            return False
        self._usable_s = now_s
        self._stream.telegrams.append(telegram)
        geometry = [
            (channel.first_deg, channel.step_deg, len(channel.raw))
            for channel in telegram.channels.values()
        ]
        health = (self._stream.contamination, self._stream.temperature_ok, telegram.status)
        if self._told != (told := (telegram.scan_hz, *health, *geometry)):
            self._told = told
            self._status.state, self._status.cause = "running", self._remark(telegram, remarks)
        return True

    def _doubt(self, telegram: ScanTelegram) -> str:
        """Why its ranges are not to be used; "" if they are."""
        if not is_usable(telegram.status, self._settings.accepted_status):
            return describe_status(telegram.status)
        dirt = self._stream.contamination or 0
        return CONTAMINATIONS.get(dirt, "") if dirt >= TOO_DIRTY else ""

    def _remark(self, telegram: ScanTelegram, remarks: list[str]) -> str:
        """What is not as configured, or not well, in one sentence; "" if all is."""
        settings, channels = self._settings, telegram.channels
        faults = list(remarks)
        channel = channels.get("DIST1") or channels.get("DIST2")
        if channel is not None:
            is_hz, is_deg = telegram.scan_hz, channel.step_deg
            if (is_hz, is_deg) != (settings.scan_rate_hz, settings.angular_step_deg):
                faults = [fault for fault in faults if SCAN_MODE not in fault]  # said once
                faults.append(
                    f"scans at {is_hz:g} Hz in steps of {is_deg:g} deg, configured are "
                    f"{settings.scan_rate_hz:g} Hz and {settings.angular_step_deg:g} deg"
                )
            last_deg = channel.first_deg + (len(channel.raw) - 1) * is_deg
            span_deg = (channel.first_deg - is_deg / 2, last_deg + is_deg / 2)
            if not covers(span_deg, (settings.first_deg, settings.last_deg)):
                faults.append(f"sends {channel.first_deg:g} to {last_deg:g} deg only")
        if settings.echo != "first" and "DIST2" not in channels:
            faults.append("sends no second echo")
        if message := condition_of(self._stream).message:
            faults.append(message)
        return f"the scanner {', '.join(faults)}" if faults else ""


def condition_of(stream: ScanStream) -> ScannerCondition:
    """What is known of the scanner, without its beams."""
    newest = stream.newest
    return ScannerCondition(
        contamination=stream.contamination,
        temperature_ok=stream.temperature_ok,
        device_status=newest.status if newest else (0, 0),
        firmware=stream.firmware,
        serial_number=newest.serial_number if newest else None,
    )
