"""Who may look and who may drive: hosts and origins of requests, and the token.

A page of a stranger in the same browser must reach nothing here, under whatever name it asks: the
host that a request names must be this machine by address or by name, and its origin must be that
host. A name that somebody has pointed at this machine (DNS rebinding) is refused by that.
"""

import hmac
import ipaddress
import os
import secrets
import socket
from pathlib import Path
from urllib.parse import urlsplit

TOKEN_BYTES, SHORTEST_TOKEN, LONGEST_TOKEN = 16, 16, 256
OTHERS = 0o077  # bits of a file's mode


class TokenError(Exception):
    """There is no token; the text says why."""


def token_of(path: Path | None) -> str:
    """The token in a file, which is made if it is not there; without a file a new one.

    Raises:
        TokenError: the file can't be used.
    """
    if path is None:
        return secrets.token_urlsafe(TOKEN_BYTES)
    try:
        with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(secrets.token_urlsafe(TOKEN_BYTES) + "\n")
    except FileExistsError:
        pass
    except OSError as error:
        raise TokenError(f"{path}: {error.strerror}") from None
    try:
        if path.stat().st_mode & OTHERS:
            raise TokenError(f"{path}: others can read the token; chmod 600 {path}")
        token = path.read_text(encoding="ascii").strip()
    except OSError as error:
        raise TokenError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        token = ""
    if not SHORTEST_TOKEN <= len(token) <= LONGEST_TOKEN or not token.isprintable():
        raise TokenError(f"{path}: a token has {SHORTEST_TOKEN} to {LONGEST_TOKEN} letters")
    return token


def is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Guard:
    """The rules of one server.

    Args:
        host: that it listens on.
    """

    def __init__(self, host: str, token: str) -> None:
        self.looking_needs_token = not is_loopback(host)
        self._token = token.encode()
        name = socket.gethostname().lower()
        self._names = {"localhost", host.lower(), name, f"{name}.local", socket.getfqdn().lower()}

    def token_is_right(self, given: str) -> bool:
        """Compares in constant time."""
        return hmac.compare_digest(given.encode("utf-8", "replace"), self._token)

    def refusal(self, host: str, origin: str | None) -> str:
        """Why a request is refused, by its headers Host and Origin; "" if it is not."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
            asking = host if origin is None else urlsplit(origin).netloc
        except ValueError:  # no URL has such a host
            name = asking = ""
        if not self._is_ours(name):
            return "this server has no such name: ask for it by its address"
        return "" if asking.lower() == host.lower() else "a page from elsewhere may not ask"

    def _is_ours(self, name: str) -> bool:
        try:
            ipaddress.ip_address(name)
        except ValueError:
            return name in self._names
        return True
