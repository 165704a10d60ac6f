"""Conformance tests 1 and 4: vectors, what an ACK tells, frames that no sender writes."""

import struct

from tools.conformance.checks_damage import victim
from tools.conformance.exam import BATCH, Exam, UnseenError
from tools.conformance.vectors import (
    LAST_SEQ,
    NEWEST_T_MS,
    PLAIN,
    TAGGED,
    VECTOR_GEOM,
    VECTOR_KEY,
    VECTOR_NONCE,
    VECTOR_ORIGIN,
)
from tools.conformance.wire import (
    AUTH,
    AUTH_FAILED,
    DIGEST,
    FREE,
    GEOM,
    KEEP,
    MAP,
    MAX_FRAME,
    OBSTACLE,
    POSE,
    STOP_ZONE,
    TILE,
    UNKNOWN,
    Geom,
    Key,
    cobs,
    digest_body,
    frame,
    map_body,
    op,
    ops_of,
    pose_body,
    sealed,
)

WRONG_LENGTHS = [(GEOM, 15), (GEOM, 17), (POSE, 0), (POSE, 23), (POSE, 25), (MAP, 0), (MAP, 9)]
NEWER_TYPES = {  # frames that a receiver may or may not know: any body must leave the map alone
    STOP_ZONE: 20,
    TILE: 24,
}


def vectors(exam: Exam) -> str:
    """1: the worked example of section 13."""
    tagged = exam.key == VECTOR_KEY and exam.hello and exam.hello.nonce == VECTOR_NONCE
    if exam.key and not tagged:
        raise UnseenError("the vectors bear no tag, or that of another key and nonce")
    exam.begin(5, 4)
    exam.geom, exam.origin, exam.begun_seq = VECTOR_GEOM, VECTOR_ORIGIN, 0
    for name, text in PLAIN.items():
        data = bytes.fromhex(TAGGED[name] if tagged and name in TAGGED else text)
        exam.send(_with_tag(exam, data) if tagged and name not in TAGGED else data)
    exam.seq = LAST_SEQ
    exam.skipped_ms = NEWEST_T_MS - round(exam.bench.now_s() * 1000)
    ack = exam.ask()  # before a slow receiver's next ACKs, whose bits reach back no farther
    taken = [ack.has(n) for n in range(1, LAST_SEQ + 1)]
    exam.expect("section 13: bits of its frames", [True] * LAST_SEQ, taken)
    exam.check("section 13")
    return f"the {len(PLAIN)} frames of section 13"


def _with_tag(exam: Exam, data: bytes) -> bytes:
    """A vector that section 13 does not show tagged."""
    assert exam.key is not None
    content = bytes([data[0], data[1] | AUTH]) + data[2:-4]
    return sealed(content + Key(exam.key, VECTOR_GEOM.session, VECTOR_NONCE).tag(content))


def answers(exam: Exam) -> str:
    """1: what an ACK tells, and when it comes."""
    exam.begin(7, 5)
    exam.tell([(FREE, 35)])
    sent_s = exam.bench.now_s()
    t_ms = exam.t_ms
    ack = exam.ask()
    late_ms = (exam.t_ms - t_ms) + 2
    exam.expect("echo_t_ms is of the newest frame", True, 0 <= ack.echo_t_ms - t_ms <= late_ms)
    exam.expect("hold is no longer than it took", True, ack.hold_s <= late_ms / 1000)
    quiet = exam.hear_all(1.0)
    exam.expect("ACKs within a quiet second: 8 or more", True, len(quiet) >= 8)
    exam.expect("they tell of the same frame", {exam.seq}, {one.last_seq for one in quiet})
    for _ in range(17):
        exam.send(exam.next(POSE, pose_body()))
    soon_s = 0.02 if exam.bench.in_process else 0.25
    heard = [exam.seq - one.last_seq & 0xFFFF for one in exam.hear_all(soon_s)]
    exam.expect("an ACK at the latest after 16 frames", True, any(n < 16 for n in heard))
    return f"fields and times of {len(quiet) + 1} ACKs in {exam.bench.now_s() - sent_s:.1f} s"


def cobs_forms(exam: Exam) -> str:
    """1: everything that section 2 lets a serial sender write."""
    if exam.bench.datagrams:
        raise UnseenError("datagrams are not COBS-encoded")
    if exam.max_frame < 300:
        raise UnseenError(f"the receiver takes no frame of 300 bytes, only {exam.max_frame}")
    exam.begin(40, 30)
    exam.tell([(FREE, 1200)])
    forms = 0
    for k in exam.rounds(12):
        data = _ends_in_full_run(exam)
        encoded = cobs(data, short_end=k % 2 == 0)
        exam.model.feed_datagram(exam.bench.now_s(), data)
        exam.tail.append(data)
        stream = b"\0" * (k % 3) + encoded + b"\0" * (1 + k % 4)
        pieces = [stream] if k < 6 else [bytes([byte]) for byte in stream]
        for piece in pieces:
            exam.bench.send(piece)
        forms += 1
        exam.check("a run of 254 bytes without a zero, " + ("short", "long")[k % 2] + " form")
    return f"{forms} frames that end in a run of exactly 254, both forms, empty frames between"


def _ends_in_full_run(exam: Exam) -> bytes:
    """A MAP frame whose last 254 bytes are not zero, and the one before is."""
    seq = exam.seq
    while True:
        exam.seq = seq
        states = [exam.random.choice((FREE, OBSTACLE)) for _ in range(250)]
        if exam.key:
            states = states[:242]
        data = exam.next_map([(UNKNOWN, 1)] + [(s, exam.random.randint(1, 4)) for s in states])
        if cobs(data) != cobs(data, short_end=True):
            return data


def junk(exam: Exam) -> str:
    """4: random bytes, and pieces of frames."""
    exam.begin(17, 11)
    exam.tell([(FREE, 100), (OBSTACLE, 87)])
    done = 0
    for k in exam.rounds(40):
        whole = victim(exam)
        pieces = [whole[:n] for n in range(len(whole))] if k == 0 else []
        pieces += [whole + exam.random.randbytes(exam.random.randint(1, 400)), whole * 2]
        pieces += [exam.random.randbytes(exam.random.randint(0, 500)) for _ in range(20)]
        pieces.append(sealed(whole[:-4] + bytes(MAX_FRAME + 1 - len(whole))))
        for piece in pieces:
            exam.bench.send(piece if exam.bench.datagrams else cobs(piece) + b"\0")
            if not exam.bench.datagrams:
                exam.bench.send(exam.random.randbytes(exam.random.randint(0, 40)) + b"\0\0")
        done += len(pieces)
        exam.check("random bytes")
    return f"{done} pieces of 0 to 736 bytes"


def arbitrary_bodies(exam: Exam) -> str:
    """4: frames with a right CRC that no sender writes."""
    exam.begin(30, 20)
    bad = _bad_ops(exam, 600)
    for ops in bad:
        exam.tell([(FREE, 600)])
        head = map_body(exam.origin, exam.seq - 0x7000, exam.geom.geom_id, 0, b"")
        exam.send(exam.next(MAP, head + ops), undecided=not exam.strict)
        exam.check_books(f"operations {ops[-6:].hex(' ')}", exam.ask())
        exam.tell([])
        exam.check_map(f"operations {ops[-6:].hex(' ')}")
    for kind, size in WRONG_LENGTHS:
        exam.tell([])
        exam.send(exam.next(kind, bytes(size)))
        exam.check_books(f"type {kind}, {size} bytes of body", exam.ask())
    done = len(bad) + len(WRONG_LENGTHS)
    for k in exam.rounds(60):
        width, height = exam.random.randint(3, 40), exam.random.randint(3, 40)
        if k % 5 == 0:
            exam.begin(width, height)
        exam.tell([(FREE, exam.geom.width * exam.geom.height)])
        for _ in range(BATCH):
            _send_arbitrary(exam)
            done += 1
        exam.check("frames with a right CRC")
        exam.tell([])
        exam.check("frames with a right CRC, and all repaired")
    return f"{done} frames"


def _send_arbitrary(exam: Exam) -> None:
    """One frame: strange in its operations, its length, its flags, its version or its type."""
    chance, cells = exam.random, exam.geom.width * exam.geom.height
    head = map_body(exam.origin, exam.seq - 0x7000, exam.geom.geom_id, 0, b"")
    match chance.randrange(9 if exam.strict else 8):
        case 0:
            ops = chance.randbytes(chance.randint(0, 60))
            start = chance.randrange(cells)
            body = head[:7] + struct.pack("<I", start)[:3] + ops
            exam.send(exam.next(MAP, body), undecided=not exam.strict)
        case 1:
            body = head + chance.choice(_bad_ops(exam, cells))
            exam.send(exam.next(MAP, body), undecided=not exam.strict)
        case 2:
            kind, size = chance.choice([(GEOM, 16), (POSE, 24), (MAP, 9), (DIGEST, 8)])
            size = chance.randint(0, 9) if kind == MAP else size + chance.choice([-8, -1, 1, 30])
            exam.send(exam.next(kind, chance.randbytes(size)), undecided=kind == DIGEST)
        case 3:
            exam.send(exam.next(chance.choice([0, 7, 13, 14, 15]), chance.randbytes(20)))
        case 4:
            kind, size = chance.choice(list(NEWER_TYPES.items()))
            exam.send(exam.next(kind, chance.randbytes(size)), undecided=True)
        case 5:
            flags = chance.choice([0x20, 0x40, 0x80, 0x04, 0x08, 0x0F, 0xE0])
            exam.send(exam.next(MAP, head + ops_of([(OBSTACLE, 2)]), flags))
        case 6:
            data = exam.next(MAP, head + ops_of([(OBSTACLE, 3)]))
            version = chance.choice([0, 2, 3, 8, 15])
            exam.send(sealed(bytes([version << 4 | MAP]) + data[1:-4]))
        case 7:
            wrong = digest_body(exam.geom.geom_id ^ 1, exam.model.window())
            exam.send(exam.next(DIGEST, wrong), undecided=True)
        case _:
            geom = exam.geom
            width, height = chance.choice([(0, geom.height), (geom.width, 0), (0, 0)])
            none = Geom(geom.geom_id ^ 1, width, height, geom.session)
            exam.send(exam.next(GEOM, none.body()))


def _bad_ops(exam: Exam, cells: int) -> list[bytes]:
    """Operations that write some cells, and are then not to be obeyed."""
    writes = op(OBSTACLE, min(5, cells - 1))
    left = cells - min(5, cells - 1)
    last = exam.random.choice([FREE, OBSTACLE, KEEP, UNKNOWN])
    return [
        writes + ops_of([(last, 1)] * min(left, 200)) + ops_of([(last, left + 1)]),
        writes + op(last, max(64, left + 1)),
        writes + bytes([last << 6 | 63]),
        writes + bytes([last << 6 | 63, 0x80]),
        writes + bytes([last << 6 | 63, 0x80, 0x80]),
        writes + bytes([last << 6 | 63, 0x80, 0x80, 0x80, 0x00]),
        writes + bytes([last << 6 | 63, 0xFF, 0xFF, 0x7F]),
        writes + bytes([last << 6 | 63, 0xFF, 0xFF, 0xFF, 0xFF, 0x0F]),
        op(last, cells + 1) if cells > 63 else op(last, 63) + op(last, 63),
    ]


def tags(exam: Exam) -> str:
    """9, seen as test 4: with a key, no frame without a valid tag counts."""
    if exam.key is None:
        raise UnseenError("no key was given")
    exam.begin(9, 9)
    exam.tell([(FREE, 81)])
    secret = exam.secret
    assert secret is not None
    wrong_keys = {
        "no tag": None,
        "another key": Key(bytes(32), secret.session, secret.nonce),
        "another session": Key(secret.key, secret.session ^ 1, secret.nonce),
        "another nonce": Key(secret.key, secret.session, secret.nonce ^ 1),
    }
    for why, key in wrong_keys.items():
        body = map_body(exam.origin, exam.seq, exam.geom.geom_id, 0, ops_of([(OBSTACLE, 9)]))
        exam.seq = exam.seq + 1 & 0xFFFF
        exam.send(frame(MAP, exam.seq, exam.t_ms, body, 0, key))
        heard = [ack.status & AUTH_FAILED for ack in exam.hear_all(0.3)]
        exam.expect(f"{why}: AUTH_FAILED told", True, any(heard))
        exam.check(why)
    old, body = exam.seq, map_body(exam.origin, exam.seq, exam.geom.geom_id, 0, b"\x88")
    exam.seq = old + 1 & 0xFFFF
    exam.send(frame(MAP, exam.seq, exam.t_ms - 1000, body, 0, secret))
    exam.check("a tagged frame whose t_ms goes back")
    left, t_ms = Geom(exam.geom.geom_id, 9, 9, exam.geom.session), exam.t_ms
    exam.begin(8, 7)
    exam.tell([(FREE, 56)])
    exam.check("the next run")
    exam.send(frame(GEOM, exam.seq + 1, t_ms + 9000, left.body(), 0, secret))
    exam.next(POSE, b"")
    exam.check("a GEOM of a session that was left")
    return "no tag, other keys, sessions and nonces, a t_ms that goes back, a session that was left"
