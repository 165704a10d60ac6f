"""Who may write in the fake camera: challenges, and hashes of its password.

Source: visionary sheet, section 3.
"""

import hashlib
import random

NAMES = ("Run", "Operator", "Maintenance", "AuthorizedClient", "Service")
OK, WRONG, UNKNOWN_CHALLENGE = 0, 2, 3
SERVICE_PASSWORD = "CUST_SERV"  # public, as the maker's samples have it


def password_of(level: int, clients: str) -> str:
    return SERVICE_PASSWORD if level == 4 else clients


def folded(password: str) -> int:
    """The 32 bits of `SetAccessMode`."""
    digest = hashlib.md5(password.encode(), usedforsecurity=False).digest()
    groups = [digest[at::4] for at in range(4)]  # the first, second, .. bytes of the four groups
    return sum((g[0] ^ g[1] ^ g[2] ^ g[3]) << 8 * at for at, g in enumerate(groups))


class Challenges:
    """One host's: the newest that it was given."""

    def __init__(self, chance: random.Random) -> None:
        self._chance, self._challenge, self._salt = chance, b"", b""

    def given(self, with_salt: bool) -> bytes:
        self._challenge = self._chance.randbytes(16)
        self._salt = self._chance.randbytes(16) if with_salt else b""
        return b"\x00" + self._challenge + self._salt

    def verdict(self, answer: bytes, level: int, password: str) -> int:
        """0, or why the answer (32 bytes) is not accepted; a challenge is good once."""
        if not self._challenge:
            return UNKNOWN_CHALLENGE
        secret = hashlib.sha256()
        secret.update(f"{NAMES[level]}:SICK Sensor:{password}".encode())
        if self._salt:
            secret.update(b":" + self._salt)
        wanted = hashlib.sha256(secret.digest() + self._challenge).digest()
        self._challenge = b""
        return OK if answer == wanted else WRONG
