"""What each kind of scanner is: its steps and reach, its wire, and what it says of itself.

Texts of the URG-04LX are the vendor's example; those of the sisters are made after them [U].
Source: urg04lx sheet, sections 1, 5 and 7.
"""

from dataclasses import dataclass
from typing import Literal

RATES = (19200, 57600, 115200, 250000, 500000, 750000)
KNOWN_RATES = (*RATES, 38400)  # of the family
OPTIONAL = frozenset((b"HS", b"DB", b"%ST", b"RB"))  # commands that not all have


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """One kind of device; lengths in mm as it tells them."""

    name: str
    product: str
    firmware: str
    serial: str = "H0614967"
    wire: Literal["serial", "usb", "tcp"]
    starts_in_scip2: bool = True
    extras: frozenset[bytes] = frozenset()  # of the optional commands
    dmin: int = 20
    dmax: int = 5600
    ares: int = 1024  # steps of a turn
    amin: int = 44
    amax: int = 725
    afrt: int = 384
    last: int = 768  # step that exists
    rpm: int = 600
    is_phase_shift: bool = True  # else it times pulses
    noise_m: float = 0.003  # 1 sigma, up to 1 m [U]
    noise_share: float = 0.003  # of the range, far: three times that is the maker's 1 % [U]
    spot_rad: float = 0.010  # 40 mm at 4 m [U]
    reach_m: float = 9.0  # at which white is just seen, square to the beam [U]

    def version(self) -> list[str]:
        return [
            "VEND:Hokuyo Automatic Co.,Ltd.",
            f"PROD:{self.product}",
            f"FIRM:{self.firmware}",
            "PROT:SCIP 2.0",
            f"SERI:{self.serial}",
        ]

    def parameters(self) -> list[str]:
        return [
            f"MODL:{self.name}(Hokuyo Automatic Co.,Ltd.)",
            f"DMIN:{self.dmin}",
            f"DMAX:{self.dmax}",
            f"ARES:{self.ares}",
            f"AMIN:{self.amin}",
            f"AMAX:{self.amax}",
            f"AFRT:{self.afrt}",
            f"SCAN:{self.rpm}",
        ]


MODELS = {
    "URG-04LX": Model(
        name="URG-04LX",
        product="SOKUIKI Sensor URG-04LX",
        firmware="3.1.00(18/Jan./2007)",
        wire="serial",
        starts_in_scip2=False,
    ),
    "URG-04LX-UG01": Model(
        name="URG-04LX-UG01",
        product="SOKUIKI Sensor URG-04LX-UG01",
        firmware="3.4.03(17/Dec./2012)",
        wire="usb",
        extras=frozenset((b"HS", b"DB")),
    ),
    "UTM-30LX": Model(
        name="UTM-30LX",
        product="SOKUIKI Sensor TOP-URG UTM-30LX",
        firmware="1.19.01(10/Nov./2011)",
        wire="tcp",
        extras=frozenset((b"HS", b"%ST", b"RB")),
        dmin=23,
        dmax=60000,
        ares=1440,
        amin=0,
        amax=1080,
        afrt=540,
        last=1080,
        rpm=2400,
        is_phase_shift=False,
        noise_m=0.010,
        noise_share=0.001,
        reach_m=60.0,
    ),
}
