"""Logging in to a camera: what is sent for a password, and who has which level.

Source: visionary sheet, section 3.
"""

import hashlib

from hw.visionary.options import Level

LEVELS: dict[str, tuple[int, str]] = {
    "operator": (1, "Operator"),
    "maintenance": (2, "Maintenance"),
    "authorized_client": (3, "AuthorizedClient"),
    "service": (4, "Service"),
}
CHALLENGE_BYTES = SALT_BYTES = 16
REFUSALS = {
    1: "it does not know this client",
    2: "the password is wrong",
    3: "it does not know its own challenge any more",
    4: "its password cannot be changed",
    5: "it is locked for a time after wrong passwords",
}


def response(level: Level, password: str, challenge: bytes, salt: bytes = b"") -> bytes:
    """The answer to a challenge: 32 bytes; with a salt in the newer form.

    >>> numbers = bytes(range(32))
    >>> response("service", "CUST_SERV", numbers[:16]).hex()[:16]
    '86e9713bd27285ac'
    >>> response("service", "CUST_SERV", numbers[:16], numbers[16:]).hex()[:16]
    '17ca09b368afdbe4'
    """
    known = f"{LEVELS[level][1]}:SICK Sensor:{password}".encode()
    known += b":" + salt if salt else b""
    return hashlib.sha256(hashlib.sha256(known).digest() + challenge).digest()


def password_hash(password: str) -> int:
    """What `SetAccessMode` takes.

    >>> f"{password_hash('CLIENT'):08X}"
    'FB356CDE'
    """
    digest = hashlib.md5(password.encode(), usedforsecurity=False).digest()
    folded = 0
    for at in range(0, 16, 4):
        folded ^= int.from_bytes(digest[at : at + 4], "little")
    return folded
