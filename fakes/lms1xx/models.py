"""The LMS1xx found on shelves: what tells one from another on the wire.

The texts of the LMS10x are recorded; those of the sisters are made after them.
Source: lms111 sheet, sections 1, 3 and 6.
"""

from dataclasses import dataclass, field

from fakes.lms1xx.cola import WRITE_DENIED


@dataclass(frozen=True, slots=True)
class Model:
    """One kind of device."""

    ident: tuple[bytes, bytes]  # DeviceIdent
    firmware: bytes
    max_range_m: float = 20.0
    telegram_version: int = 1
    refuse: dict[str, int] = field(default_factory=dict)  # kind and name -> sFA code


LMS10X = (b"LMS10x_FieldEval", b"V1.36-21.10.2010")
MODELS = {
    "LMS111": Model(LMS10X, b"V1.80.2  "),
    "LMS100": Model(LMS10X, b"V1.80.1"),
    "LMS100-1.23": Model(LMS10X, b"V1.23", refuse={"sWN LMPoutputRange": WRITE_DENIED}),
    "LMS151": Model(
        (b"LMS15x_FieldEval", b"V1.36-21.10.2010"), b"V1.80.1", max_range_m=50.0, telegram_version=0
    ),
}
