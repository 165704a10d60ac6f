"""Files that are not what they should be, and what is said to each."""

import hashlib
import io
import struct
import zipfile

from core.saved.encoding import COMMENT_BYTES, MARK
from tests.support.robot.shipped import TEXT

MCAP = b"\x89MCAP0\r\n"
DEEP = 5000


def changed(old: str, new: str) -> bytes:
    assert old in TEXT
    return TEXT.replace(old, new, 1).encode()


def saved(*members: bytes, packed: int = zipfile.ZIP_STORED) -> bytes:
    """A saved map that is whole by its checksum, with these arrays."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", packed) as archive:
        for number, member in enumerate(members):
            archive.writestr(f"{number}.npy", member)
        archive.comment = bytes(COMMENT_BYTES)
    body = content.getvalue()[:-COMMENT_BYTES]
    return body + MARK + hashlib.sha256(body).hexdigest().encode()


def npy(dtype: str, shape: str, data: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    head = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY" + version + struct.pack("<H", len(head)) + head + data


def npy_with(head: bytes) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head


SETTINGS = {  # what is said of the file, behind its name
    "empty": (b"", "loop.rate_hz: missing; robot.wheel_radius_m: missing; "),
    "not UTF-8": (TEXT.encode("utf-16"), "must be UTF-8 text: "),
    "NUL": (changed("lms111", "lms\0"), "not valid TOML: Illegal character '\\x00' (at line "),
    "cut off": (TEXT.partition("[scanner]")[0].encode(), "scanner.driver: missing; "),
    "cut off in a line": (TEXT.partition(" true")[0].encode(), "not valid TOML: "),
    "a key twice": (changed("[robot]", "[robot]\nwidth_m = 1.0"), "not valid TOML: Cannot over"),
    "a section twice": (TEXT.encode() + b"\n[loop]\n", "not valid TOML: Cannot declare"),
    "a list 5000 deep": (
        changed('level = "info"', f"level = {'[' * DEEP}"),
        "not valid TOML: lists or tables are nested too deeply",
    ),
    "tables 5000 deep": (
        changed('level = "info"', f"level.{'a.' * DEEP}b = 1"),
        "log.level: must be 'debug' or 'error' or 'info' or 'warning', is too large to be shown",
    ),
    "a number of 5000 digits": (
        changed("encoder_ppr = 500", f"encoder_ppr = {'9' * DEEP}"),
        "not valid TOML: Exceeds the limit (4300 digits)",
    ),
    "a hexadecimal number of 5000 digits": (
        changed("encoder_ppr = 500", f"encoder_ppr = 0x{'f' * DEEP}"),
        "robot.encoder_ppr: must be a whole number from 1 to 100000, is too large to be shown",
    ),
    "a text of a hundred thousand": (
        changed("lms111", "x" * 100_000),
        "scanner.driver: must be 'lms111' or 'urg04lx' or 'stripe', is 'xxx",
    ),
    "more than a megabyte": (TEXT.encode() + b"#" * 1_000_000, "must be at most 1000000 bytes"),
    "an unknown section": (changed("[log]", "[lag]"), "[lag]: unknown section; allowed are loop, "),
    "a list of sections": (changed("[log]", "[[log]]"), "log: must be a section, is [{"),
    "a section that is a number": (b"map = 3\n" + TEXT.encode(), "not valid TOML: Cannot "),
    "an unknown key": (changed("[log]", "[log]\nlavel = 1"), "log.lavel: unknown key; allowed are"),
    "a key with a line break": (
        changed("[log]", '[log]\n"a\\nb" = 1'),
        "log.'a\\nb': unknown key; allowed are level, format",
    ),
    "a section with a control character": (
        TEXT.encode() + b'\n["\\u001b[31m"]\n',
        "['\\x1b[31m']: unknown section; allowed are",
    ),
    "no driver": (changed('driver = "lms111"', ""), "scanner.driver: missing"),
    "keys of another driver": (
        changed('driver = "lms111"', 'driver = "urg04lx"'),
        "scanner.dialect: unknown key for driver 'urg04lx'; allowed are driver, port, ",
    ),
    "one line for two devices": (
        changed("serial:///dev/mti?baud=115200", "serial:///dev/ax3500?baud=9600"),
        "drive.port: 'serial:///dev/ax3500?baud=9600&parity=E&bytesize=7' is ahrs.port already",
    ),
    "no wheels, and nothing else that tells the place": (
        changed("gear_ratio = 1.0", "gear_ratio = 1.0")
        .replace(b'source = "wheels"', b'source = "rail"')
        .replace(b"enable_motors = false", b"enable_motors = true"),
        "robot.enable_motors: must be false unless motion.source is 'wheels'",
    ),
}

MAPS = {  # what is said of a map to go on from
    "empty": (b"", "it is empty"),
    "text": (b"hello\n" * 100, "its end is missing, or it is no saved map"),
    "cut off": (saved(npy("<f8", "()", bytes(8)))[:-1], "its end is missing, or it is no saved"),
    "one byte changed": (b"x" + saved(b"")[1:], "it is damaged: its content does not fit"),
    "no zip": (b"abc" + MARK + hashlib.sha256(b"abc").hexdigest().encode(), "it can't be read: "),
    "nothing in it": (saved(), "it is no saved map"),
    "packed": (saved(b"x" * 99, packed=zipfile.ZIP_DEFLATED), "it is packed in a way that no"),
    "no array": (saved(b"x"), "it can't be read: "),
    "another version of arrays": (
        saved(npy("<f8", "()", bytes(8), b"\x02\x00")),
        "it can't be read: an array is of another version",
    ),
    "an array of terabytes": (
        saved(npy("<f8", "(1000000000, 1000000000)")),
        "it can't be read: an array is shorter or longer than it says",
    ),
    "an array of negative size": (saved(npy("<f8", "(-1,)")), "it can't be read: an array is of a"),
    "an array of objects": (saved(npy("|O", "(1,)", bytes(8))), "it can't be read: an array is of"),
    "an array of truth values long": (saved(npy("<f8", "(True,)", bytes(8))), "it can't be read: "),
    "a head that ends nowhere": (saved(npy_with(b"{'a'")), "it can't be read: "),
    "a head of brackets": (saved(npy_with(b"(" * 3000)), "it can't be read: "),
    "a head that calls": (saved(npy_with(b"__import__('os')\n")), "it can't be read: "),
}

RECORDINGS = {  # what is said of a recording to replay
    "its first bytes alone": (MCAP, "is not a recording of mapod"),
    "its ends alone": (MCAP * 2, "is damaged before byte 16"),
    "a record of exabytes": (
        MCAP + struct.pack("<BQ", 1, 1 << 60) + bytes(99),
        "is not a recording of mapod",
    ),
    "a record of no kind": (MCAP + struct.pack("<BQ", 99, 4) + bytes(4), "is damaged before byte"),
    "a chunk of nothing": (MCAP + struct.pack("<BQ", 6, 4) + bytes(4), "is damaged before byte"),
    "metadata that lie about their size": (
        MCAP + struct.pack("<BQI", 12, 4, 1 << 31),
        "is damaged in what it says of the run",
    ),
    "another form": (b'{"mapod_recording": 1}\n', "a recording of form 1, not "),
    "a capture of nothing": (
        bytes.fromhex("D4C3B2A1") + bytes(20),
        "holds no conversation with a scanner",
    ),
    "a capture that is damaged": (
        bytes.fromhex("0A0D0D0A") + b"\xff" * 20,
        "is damaged before byte 12",
    ),
}

AXIS = "x_axis_east_of_north_deg = 0\n"
WALL = '[[solid]]\nname = "wall"\ny = [0, 1]\nz = [0, 1]\n'
SCENES = {  # what is said of a scene
    "empty": ("", "x_axis_east_of_north_deg is missing"),
    "no TOML": ("x =", "Invalid value"),
    "a list 5000 deep": (f"x = {'[' * DEEP}", "nested too deeply"),
    "an unknown key": (AXIS + "zz = 1", "scene: no key 'zz'"),
    "an angle that is a text": ('x_axis_east_of_north_deg = "x"', "must be a number, is 'x'"),
    "solids that are a number": (AXIS + "solid = 3", "solid: must be a list of tables, is 3"),
    "solids that are numbers": (AXIS + "solid = [3]", "solid: must be a list of tables, is [3]"),
    "goals that are a number": (AXIS + "goals = 3", "goals: must be a table, is 3"),
    "areas that are numbers": (AXIS + "[goals]\nareas = [3]", "areas: must be a list of tables"),
    "rooms that are a number": (AXIS + "rooms = 3", "rooms: must be a table, is 3"),
    "rooms of a single count": (AXIS + "[rooms]\ncount = 3", "count: must be [from, to]"),
    "things that are numbers": (AXIS + "scatter = [3]", "scatter: must be a list of tables"),
    "upsets that are a number": (AXIS + "upsets = 3", "upsets: must be a table, is 3"),
    "a route that is a number": (AXIS + "route = 3", "route: must be a table, is 3"),
    "a way of one number": (AXIS + "[route]\nwaypoints = [1]", "waypoints: must be a list of ["),
    "a speed that is a list": (AXIS + "[route]\nspeed_mps = []", "speed_mps: must be a number"),
    "a wall of one edge": (AXIS + WALL + "x = [1]", "solid, x: must be [from, to], is [1]"),
    "a wall of three edges": (AXIS + WALL + "x = [1, 2, 3]", "solid, x: must be [from, to]"),
    "a wall inside out": (AXIS + WALL + "x = [2, 1]", "must be [from, to] with from < to"),
    "a wall at no number": (AXIS + WALL + "x = [nan, 1]", "must be [from, to] with from < to"),
    "a wall without x": (AXIS + WALL, "solid: x is missing"),
    "a wall of jelly": (AXIS + WALL + 'x = [0, 1]\nmaterial = "jelly"', "must be plain, glass,"),
}

KEYS = {  # by mode and content: what is said of the planner link's key
    "others may read it": (0o644, bytes(32), "only its owner may have access to "),
    "a group may write it": (0o620, bytes(32), "only its owner may have access to "),
    "empty": (0o600, b"", "must hold 64 hex digits, "),
    "too short": (0o600, bytes(31), "must hold 32 bytes or 64 hex digits, "),
    "too long": (0o600, bytes(33), "must hold 32 bytes or 64 hex digits, "),
    "half of the digits": (0o600, b"ab" * 16, "must hold 64 hex digits, "),
    "a megabyte": (0o600, bytes(1_000_000), "must hold 32 bytes or 64 hex digits, "),
}
