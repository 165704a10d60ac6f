"""The worked example of section 13 as a receiver gets it: the plain frames, and what tags them.

Source: planner link, section 13.
"""

from tools.conformance.wire import AUTH, Geom, Key, sealed

VECTOR_GEOM = Geom(7, 101, 101, 0x5A17C0DE)
VECTOR_ORIGIN = (196, -100)
VECTOR_KEY = Key(bytes(range(32)), VECTOR_GEOM.session, nonce=0x11223344)
NEWEST_T_MS = 1120  # the sender's clock at the last of them
LAST_SEQ = 21

VECTORS: dict[str, str] = {
    "geom": "11 00 01 00 e8 03 00 00 07 00 65 00 65 00 32 00 de c0 17 5a 14 00 96 00 f1 c9 34 1c",
    "pose": (
        "12 01 02 00 fc 03 00 00 34 30 00 00 3c f6 ff ff ae 1e cc ff 11 00 8a 02 88 ff 7f "
        "00 03 01 02 01 76 6e 3b f7"
    ),
    "map": (
        "13 00 03 00 fc 03 00 00 c4 00 9c ff 00 00 07 d4 17 00 82 ff 22 82 ff 22 7f 06 67 be f8 7b"
    ),
    "digest": "14 00 04 00 10 04 00 00 07 00 00 00 82 4b 96 55 a9 7d 2d 50",
    "stop_zone": (
        "15 00 05 00 10 04 00 00 e2 04 c8 05 00 00 ff ff 80 07 8a 02 00 00 ae 01 52 e1 02 "
        "03 1f cd b9 da"
    ),
    "tile_class": (
        "16 00 06 00 24 04 00 00 02 01 00 00 ec 00 d8 ff 05 00 03 00 00 00 00 07 0f 00 32 "
        "00 2a a8 50 15 12 4b ce 02"
    ),
    "tile_height": (
        "16 00 07 00 24 04 00 00 02 01 01 00 ec 00 d8 ff 05 00 03 00 00 00 00 07 0f 00 32 "
        "00 98 00 95 00 97 00 00 80 00 80 28 00 94 00 96 00 00 80 00 80 03 00 fe ff 00 00 "
        "01 00 fc ff 78 5b 09 4f"
    ),
    "tile_variance": (
        "16 00 08 00 24 04 00 00 02 01 02 00 ec 00 d8 ff 05 00 03 00 05 00 00 07 0a 00 32 "
        "00 90 01 19 00 1e 00 ff ff ff ff 09 00 09 00 09 00 0a 00 fe ff 71 2c 38 ad"
    ),
    "tile_slope": (
        "16 01 09 00 24 04 00 00 02 01 03 00 ec 00 d8 ff 05 00 03 00 00 00 00 07 05 00 32 "
        "00 ae 1e aa 1e b4 1e ff ff ff ff a3 6a ec 01"
    ),
    "tile_refused": (
        "16 00 0a 00 24 04 00 00 02 01 03 01 ec 00 d8 ff 05 00 03 00 00 00 00 07 00 00 32 "
        "00 25 85 c3 f1"
    ),
    "tile_cause": (
        "16 00 0b 00 24 04 00 00 02 01 04 00 ec 00 d8 ff 05 00 03 00 00 00 00 07 0f 00 32 "
        "00 80 80 82 01 08 80 83 81 01 06 40 40 42 43 40 ad f7 7c a9"
    ),
    "tile_age": (
        "16 00 0c 00 24 04 00 00 02 01 05 00 ec 00 d8 ff 05 00 03 00 05 00 00 07 0a 00 32 "
        "00 01 00 01 00 7d 00 ff ff 1e 00 00 00 01 00 02 00 03 00 fe ff 3d 71 ca 7e"
    ),
    "tile_z": (
        "16 01 0d 00 24 04 00 00 02 01 06 00 ec 00 d8 ff 05 00 03 00 00 00 00 07 05 00 32 "
        "00 36 01 31 01 50 fb 00 80 00 80 18 93 70 c3"
    ),
    "scan": (
        "17 01 0e 00 38 04 00 00 05 01 00 01 05 00 00 00 1d 02 00 00 1c 04 00 00 38 31 00 "
        "00 cc f7 ff ff c2 01 00 00 d0 07 f4 01 3e fe da 07 fa 00 40 fe dc 05 00 00 88 ff "
        "ac f0 61 e8"
    ),
    "scan_end": (
        "17 00 0f 00 38 04 00 00 05 01 00 01 05 00 03 00 1d 02 00 00 1c 04 00 00 38 31 00 "
        "00 cc f7 ff ff c2 01 00 00 d2 05 fc fe 8a ff ee 07 f8 fd 3d fe aa 42 67 23"
    ),
    "scan_refused": (
        "17 00 10 00 38 04 00 00 06 01 01 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 "
        "00 00 00 00 00 00 00 00 00 b5 80 7f ee"
    ),
    "tile_edge": (
        "16 00 11 00 4c 04 00 00 02 01 07 00 ec 00 d8 ff 05 00 03 00 05 00 00 07 0a 00 32 "
        "00 32 00 32 00 32 00 ff ff ff ff 47 00 32 00 32 00 47 00 70 00 5b f2 42 33"
    ),
    "tile_foothold": (
        "16 01 12 00 4c 04 00 00 02 01 08 00 ec 00 d8 ff 05 00 03 00 00 00 00 07 05 00 32 "
        "00 10 27 58 1d 00 00 ff ff ff ff f2 4b cb 19"
    ),
    "objects": (
        "1d 01 13 00 60 04 00 00 07 00 02 00 01 00 50 00 39 79 1d 8a 01 00 00 00 00 00 00 "
        "00 50 00 03 03 02 01 00 00 0e 38 00 00 50 fb ff ff 00 00 cc 06 58 02 06 ff cc 00 "
        "01 00 6a ff 38 ff 96 00 38 ff 00 00 c8 00 dc 05 01 04 03 00 00 00 10 27 00 00 48 "
        "f4 ff ff 00 00 d0 02 00 00 00 00 cc 00 01 00 70 fe d4 fe 90 01 d4 fe 90 01 2c 01 "
        "70 fe 2c 01 00 00 00 00 02 00 00 00 d7 0e e1 7b"
    ),
    "objects_range": (
        "1d 03 14 00 60 04 00 00 07 00 02 00 00 00 50 00 39 79 1d 8a 00 01 00 00 ff ff ff "
        "ff 50 00 03 03 02 01 00 00 0e 38 00 00 50 fb ff ff 00 00 cc 06 58 02 06 ff cc 00 "
        "01 00 6a ff 38 ff 96 00 38 ff 00 00 c8 00 0c d0 c0 b6"
    ),
    "path": (
        "1e 01 15 00 60 04 00 00 05 00 07 01 09 00 02 00 01 00 02 00 03 00 00 00 70 30 00 "
        "00 3c f6 ff ff 00 00 00 00 f4 01 00 00 f4 01 d4 fe cd f1 c8 94"
    ),
}


def tagged(plain: bytes) -> bytes:
    """The same frame with the worked example's tag."""
    content = bytes([plain[0], plain[1] | AUTH]) + plain[2:-4]
    return sealed(content + VECTOR_KEY.tag(content))
