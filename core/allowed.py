"""What a setting may be, in words, by the type of its field."""

from typing import Any

import msgspec

LONGEST_SHOWN = 500  # characters of what was given


def allowed(field_type: Any) -> str:
    """What a key of that type may be, as it stands after "must be"."""
    info = msgspec.inspect.type_info(field_type)
    if isinstance(info, msgspec.inspect.Metadata):
        info = info.type
    match info:
        case msgspec.inspect.ListType(item_type=msgspec.inspect.IntType()):
            return f"a list of whole numbers {_span(info.item_type)}"
        case msgspec.inspect.ListType(item_type=msgspec.inspect.FloatType()):
            return f"a list of {info.min_length} numbers"
        case msgspec.inspect.ListType():
            return f"a list, each of it {_allowed_literal(info.item_type)}"
        case msgspec.inspect.LiteralType():
            return _allowed_literal(info)
        case msgspec.inspect.IntType():
            return f"a whole number {_span(info)}".rstrip()
        case msgspec.inspect.FloatType():
            return f"a number {_span(info)}".rstrip()
        case msgspec.inspect.BoolType():
            return "true or false"
        case msgspec.inspect.StrType(min_length=int()):
            return "a text that is not empty"
        case msgspec.inspect.UnionType():
            return "a text, or a list of up to 8 texts that are not empty"
        case _:
            return "a text"


def shown(value: Any) -> str:
    """What was given, on one line that a person can read."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested thousandfold; a number of thousands of digits
        return "too large to be shown"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def _allowed_literal(info: Any) -> str:
    return " or ".join(repr(value) for value in info.values)


def _span(info: Any) -> str:
    bounds = (("from", info.ge), ("above", info.gt), ("to", info.le), ("below", info.lt))
    return " ".join(f"{word} {bound:g}" for word, bound in bounds if bound is not None)
