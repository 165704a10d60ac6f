"""Devices of an app with other settings: they measure what the recorded app's devices measured.

A device is asked, and its answers are in the recording at their instants. An app that steps at
other instants would ask at others and miss them. So where its own keys are the recorded ones, a
device follows that of an app that runs as it ran.
"""

from collections.abc import Sequence
from typing import Any, cast

from core.config import Config
from hw.device import Port
from wiring import Devices


class Lead:
    """A device of the app that runs as it ran; keeps what it measures for its follower too."""

    def __init__(self, device: Any) -> None:
        self._device = device
        self.measured_since: list[Any] = []  # the follower's last step

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def step(self, now_s: float) -> Sequence[Any]:
        measurements: Sequence[Any] = self._device.step(now_s)
        self.measured_since += measurements
        return measurements


class Follower:
    """Measures what another device has measured; what it is told goes nowhere."""

    settled = True

    def __init__(self, lead: Lead, port: Port) -> None:
        self._lead, self.port = lead, port

    def __getattr__(self, name: str) -> Any:
        """How it is: as the other one is."""
        return getattr(self._lead, name)

    @property
    def has_heard(self) -> bool:
        return bool(self._lead.measured_since)

    def hear(self, now_s: float) -> None: ...

    def keep(self, now_s: float) -> None: ...

    def step(self, now_s: float) -> Sequence[Any]:
        measurements, self._lead.measured_since = self._lead.measured_since, []
        return measurements

    def drive(self, left: float, right: float) -> None: ...

    def stop(self) -> None: ...


def leads_of(devices: Devices) -> Devices:
    """The same devices, which somebody may follow."""
    return Devices(*(cast(Any, Lead(device)) for device in devices.of_scans))


def followers(leads: Devices, own: Devices, lead_config: Config, config: Config) -> Devices:
    """Of an app with other settings: `own` where a device's own keys are others."""
    chosen = {}
    names = "ahrs", "drive", "scanner"
    for name, lead, mine in zip(names, leads.of_scans, own.of_scans, strict=True):
        its, keys = getattr(lead_config, name), getattr(config, name)
        is_same = (its.driver, its.options) == (keys.driver, keys.options)
        chosen[name] = cast(Any, Follower(cast(Any, lead), mine.port) if is_same else mine)
    return Devices(**chosen)
