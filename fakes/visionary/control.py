"""The fake camera's control port: sessions, login, variables and methods.

Source: visionary sheet, sections 2 to 4.
"""

import math
from collections.abc import Callable
from typing import Protocol

from fakes.visionary.access import Challenges, folded, password_of
from fakes.visionary.cola import Command, Reader, telegram
from fakes.visionary.faults import Faults
from fakes.visionary.models import BEST_US, LONGEST_US, STREAM_PORT, Kind

DENIED, NO_METHOD, NO_VARIABLE, RANGE, UNDERFLOW = 0x01, 0x02, 0x03, 0x04, 0x08
WRITE_DENIED, NO_COMMAND, NO_ROOM, NO_SESSION = 0x0A, 0x0C, 0x21, 0x22
CLIENT_LEVEL = 3
MOST_SESSION_S = 255


class Plays(Protocol):
    """What methods do to the device."""

    def play(self, now_s: float) -> None: ...
    def halt(self) -> None: ...
    def play_one(self, now_s: float) -> None: ...


def text(value: str) -> bytes:
    return len(value).to_bytes(2, "big") + value.encode("ascii")


class Memory:
    """The device's variables, which all hosts see."""

    def __init__(self, kind: Kind, faults: Faults) -> None:
        self._faults = faults
        fixed = {
            "DeviceIdent": text(kind.ident) + text(kind.version),
            "SerialNumber": text("26480042"),
            "FirmwareVersion": text(kind.version),
            "DIornr": text("1115342"),
            "DImanf": text("SICK AG"),
        }
        self._fixed = fixed
        self.written = {
            "BlobTransportProtocolAPI": b"\x00",
            "BlobTcpPortAPI": STREAM_PORT.to_bytes(2, "big"),
            "frontendMode": b"\x01",
            "acquisitionMode": b"\x00",
        }
        if kind.has_period:
            self.written |= {
                "framePeriodUs": (50_000).to_bytes(4, "big"),
                "binningOption": b"\x00",
                "enDepthMask": b"\x01",
            }
        else:
            self.written |= {
                "integrationTimeUs": (3000).to_bytes(4, "big"),
                "enDepthAPI": b"\x01",
                "enPolarAPI": b"\x00",
            }

    @property
    def period_s(self) -> float:
        period = self.written.get("framePeriodUs")
        return (int.from_bytes(period, "big") if period else BEST_US) * 1e-6

    @property
    def halvings(self) -> int:
        """Times that pixels are put together in pairs."""
        return self.written.get("binningOption", b"\x00")[0] + bool(self._faults.small)

    def read(self, name: str) -> bytes | None:
        faults = self._faults
        if name == faults.unknown:
            return None
        measured = {
            "deviceState": (1).to_bytes(2, "big"),
            "TmpLvl": bytes([faults.warning]),
            "OpVoltageStatus": bytes([faults.warning]),
            "SysTemperatureCurrentValue": (412).to_bytes(2, "big"),
            "CurPwrMode": bytes([5 if faults.standby else 6]),
        }
        return (self._fixed | measured | self.written).get(name)

    def write(self, name: str, data: bytes) -> int:
        """0, or the error."""
        if name == self._faults.unknown or name not in self.written:
            return WRITE_DENIED if self.read(name) is not None else NO_VARIABLE
        if len(data) < len(self.written[name]):
            return UNDERFLOW
        value, most = int.from_bytes(data, "big"), {"binningOption": 2, "frontendMode": 2}
        if name == "framePeriodUs" and not BEST_US <= value <= LONGEST_US:
            return RANGE
        if value > most.get(name, value) or (name == "BlobTcpPortAPI" and value < 1025):
            return RANGE
        self.written[name] = data
        return 0


class Session:
    """What the device keeps of a host that has introduced itself."""

    def __init__(self, now_s: float, patience_s: float, challenges: Challenges) -> None:
        self.level, self.heard_s, self.patience_s = 0, now_s, patience_s
        self.challenges = challenges


class Desk:
    """All sessions of the device; CoLa-B has one for each connection."""

    def __init__(
        self,
        kind: Kind,
        faults: Faults,
        memory: Memory,
        plays: Plays,
        challenges: Callable[[], Challenges],
    ) -> None:
        self.kind, self._faults, self._memory, self._plays = kind, faults, memory, plays
        self._new_challenges = challenges
        self.sessions: dict[int, Session] = {}
        self._next = 0x4E11BA11

    @property
    def is_occupied(self) -> bool:
        """Whether somebody is logged in: then the device does not stream."""
        return any(session.level for session in self.sessions.values())

    def forget_idle(self, now_s: float) -> None:
        idle = [k for k, s in self.sessions.items() if now_s - s.heard_s > s.patience_s]
        for number in idle:
            del self.sessions[number]

    def opened(self, now_s: float, patience_s: float) -> int:
        number, self._next = self._next, (self._next + 0x10001) & 0xFFFFFFFF or 1
        self.sessions[number] = Session(now_s, patience_s, self._new_challenges())
        return number

    def answer(self, now_s: float, command: Command, own: int) -> bytes:
        """The telegram for one command.

        Args:
            own: the connection's session, of CoLa-B.
        """
        self.forget_idle(now_s)
        is_cola_2, letters = self.kind.is_cola_2, command.letters
        number = command.session if is_cola_2 else own
        if is_cola_2 and letters.upper() == "OX":
            if len(self.sessions) >= self._faults.sessions:
                content = _refusal(NO_ROOM)
            else:
                patience_s = min(MOST_SESSION_S, command.data[0] if command.data else 0)
                number, content = self.opened(now_s, patience_s), b"OA"
        elif number not in self.sessions:
            content = _refusal(NO_SESSION)
        elif letters.upper() == "CX":
            del self.sessions[number]
            content = b"CA"
        else:
            session = self.sessions[number]
            session.heard_s = now_s
            content = self._content(now_s, command, session)
        return telegram(is_cola_2, number, command.request, content)

    def _content(self, now_s: float, command: Command, session: Session) -> bytes:
        letters, name = command.letters, command.name
        if self._faults.refuse:
            return _refusal(self._faults.refuse)
        encoded = name.encode("latin-1")
        if letters == "RN":
            value = self._memory.read(name)
            return _refusal(NO_VARIABLE) if value is None else b"RA " + encoded + b" " + value
        if letters == "WN":
            is_known = self._memory.read(name) is not None
            error = WRITE_DENIED if is_known and session.level < CLIENT_LEVEL else 0
            error = error or self._memory.write(name, command.data)
            return _refusal(error) if error else b"WA " + encoded + b" "
        if letters == "MN":
            result = self._called(now_s, name, command.data, session)
            if isinstance(result, int):
                return _refusal(result)
            return b"AN " + encoded + b" " + result
        return _refusal(NO_COMMAND)

    def _called(self, now_s: float, name: str, data: bytes, session: Session) -> bytes | int:
        """What a method gives, or its error."""
        if name == self._faults.unknown:
            return NO_METHOD
        if name in ("PLAYSTART", "PLAYSTOP", "PLAYNEXT", "GetBlobClientConfig"):
            self._play(now_s, name)
            return b""
        if name == "Run":
            session.level = 0
            return b"\x01"
        if name == "mEEwriteall":
            return b"\x01" if session.level else DENIED
        if name in ("GetChallenge", "SetUserLevel", "SetAccessMode"):
            return self._login(name, data, session)
        return NO_METHOD

    def _play(self, now_s: float, name: str) -> None:
        if name == "PLAYSTART":
            self._plays.play(now_s)
        elif name == "PLAYSTOP":
            self._plays.halt()
        elif name == "PLAYNEXT":
            self._plays.play_one(now_s)

    def _login(self, name: str, data: bytes, session: Session) -> bytes | int:
        faults, old = self._faults, self._faults.has_old_login
        if name == "GetChallenge":
            return UNDERFLOW if not data and not old else session.challenges.given(not old)
        if name == "SetUserLevel":
            if len(data) < 33:
                return UNDERFLOW
            level = min(4, data[32])
            verdict = session.challenges.verdict(
                data[:32], level, password_of(level, faults.password)
            )
            session.level = session.level if verdict else level
            return bytes([verdict])
        if self.kind.is_cola_2:
            return NO_METHOD
        if len(data) < 5:
            return UNDERFLOW
        level = min(4, data[0])
        if int.from_bytes(data[1:5], "big") != folded(password_of(level, faults.password)):
            return b"\x00"
        session.level = level
        return b"\x01"


class Host:
    """One connection to the control port: `fakes.wires` serves it."""

    def __init__(self, desk: Desk) -> None:
        self._desk, self._reader = desk, Reader(desk.kind.is_cola_2)
        self.own = -1  # its session, of CoLa-B

    def begin(self, now_s: float) -> None:
        """A new connection."""
        self._reader = Reader(self._desk.kind.is_cola_2)
        self.end()
        if not self._desk.kind.is_cola_2:
            self.own = self._desk.opened(now_s, math.inf)

    def end(self) -> None:
        if self.own >= 0:  # CoLa-2's sessions stay until they are idle for too long
            self._desk.sessions.pop(self.own, None)
        self.own = -1

    def heard(self, now_s: float, received: bytes) -> bytes:
        """The answers to what came."""
        commands = self._reader.commands(received) if received else []
        return b"".join(self._desk.answer(now_s, command, self.own) for command in commands)


def _refusal(error: int) -> bytes:
    return b"FA" + error.to_bytes(2, "big")
