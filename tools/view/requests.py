"""What a page may say, checked: JSON of at most 4 kB, else one line that says what is wrong."""

from typing import Annotated

import msgspec
from msgspec import Meta, Struct

MOST_BYTES = 4096
Share = Annotated[float, Meta(ge=-1, le=1)]
Cell = Annotated[int, Meta(ge=-(2**31), lt=2**31)]
Token = Annotated[str, Meta(max_length=256)]
Moment = Annotated[float, Meta(ge=-1e12, le=1e12)]


class Ask(Struct, frozen=True, tag_field="type"):
    """Any message of a page."""


class Auth(Ask, frozen=True, tag="auth"):
    """Who I am, for the rest of this socket."""

    token: Token


class ShowLayers(Ask, frozen=True, tag="layers"):
    """Which layers to send; no others from now on."""

    names: Annotated[list[Annotated[str, Meta(max_length=32)]], Meta(max_length=16)]


class AskCell(Ask, frozen=True, tag="cell"):
    """What is known of a cell."""

    i: Cell
    j: Cell


class Drive(Ask, frozen=True, tag="drive"):
    """Drive on, for the next moment."""

    v: Share
    w: Share
    dead_man: bool
    t_s: Moment  # of the newest state that the page has
    token: Token = ""


class Stop(Ask, frozen=True, tag="stop"):
    """Let go."""


class AskHistory(Ask, frozen=True, tag="history"):
    """State, window and scan line as they were."""

    t_s: Moment


class Flight(Ask, frozen=True, tag="flight"):
    """Save the last half-minute."""

    token: Token = ""


Request = Auth | ShowLayers | AskCell | Drive | Stop | AskHistory | Flight


def request_of(data: str) -> Request | str:
    """The message, or why it is none."""
    try:
        request: Request = msgspec.json.decode(data, type=Request)
    except (msgspec.DecodeError, UnicodeEncodeError, RecursionError) as error:
        return f"not understood: {error}"[:200]
    return request
