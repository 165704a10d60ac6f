"""Conformance tests 1, 3, 4: vectors, what an ACK tells, damage, frames that no sender writes."""

import struct

from tools.conformance.exam import BATCH, Exam, UnseenError
from tools.conformance.rough_wire import damaged
from tools.conformance.vectors import (
    LAST_SEQ,
    NEWEST_T_MS,
    VECTOR_GEOM,
    VECTOR_KEY,
    VECTOR_ORIGIN,
    VECTORS,
    tagged,
)
from tools.conformance.wire import (
    AUTH_FAILED,
    DIGEST,
    FREE,
    GEOM,
    KEEP,
    MAP,
    MAX_FRAME,
    OBSTACLE,
    POSE,
    SCAN,
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
    sealed,
)

WRONG_LENGTHS = [(GEOM, 15), (GEOM, 17), (POSE, 0), (POSE, 23), (POSE, 25), (MAP, 0), (MAP, 9)]
NEWER_TYPES = {  # frames that a receiver may or may not know: any body must leave the map alone
    STOP_ZONE: 20,
    TILE: 24,
    SCAN: 34,
}


def vectors(exam: Exam) -> str:
    """1: the worked example of section 13."""
    keyed = Key(exam.key, VECTOR_GEOM.session, exam.nonce) if exam.key else None
    if keyed and keyed != VECTOR_KEY:
        raise UnseenError("the vectors bear no tag, or that of another key and nonce")
    exam.begin(5, 4)
    exam.geom, exam.origin, exam.begun_seq = VECTOR_GEOM, VECTOR_ORIGIN, 0
    for text in VECTORS.values():
        plain = bytes.fromhex(text)
        exam.send(tagged(plain) if keyed else plain)
    exam.seq = LAST_SEQ
    exam.skipped_ms = NEWEST_T_MS - round(exam.bench.now_s() * 1000)
    ack = exam.ask()  # before a slow receiver's next ACKs, whose bits reach back no farther
    taken = [bool(ack.mask >> ack.last_seq - n - 1 & 1) for n in range(1, LAST_SEQ + 1)]
    exam.expect("section 13: bits of its frames", [True] * LAST_SEQ, taken)
    exam.check("section 13")
    return f"the {len(VECTORS)} frames of section 13"


def answers(exam: Exam) -> str:
    """1: what an ACK tells, and when it comes."""
    exam.begin_free(7, 5)
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
        exam.send_pose()
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
    exam.begin_free(40, 30)
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
            exam.bench.send(exam.on_wire(piece))
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
    exam.begin_free(9, 9)
    secret = exam.secret
    assert secret is not None
    wrong_keys = {
        "no tag": None,
        "another key": Key(bytes(32), secret.session, secret.nonce),
        "another session": Key(secret.key, secret.session ^ 1, secret.nonce),
        "another nonce": Key(secret.key, secret.session, secret.nonce ^ 1),
    }
    for why, key in wrong_keys.items():
        body = exam.map_body([(OBSTACLE, 9)])
        exam.seq = exam.seq + 1 & 0xFFFF
        exam.send(frame(MAP, exam.seq, exam.t_ms, body, 0, key))
        heard = [ack.status & AUTH_FAILED for ack in exam.hear_all(0.3)]
        exam.expect(f"{why}: AUTH_FAILED told", True, any(heard))
        exam.check(why)
    body = exam.map_body([(OBSTACLE, 9)])
    exam.seq = exam.seq + 1 & 0xFFFF
    exam.send(frame(MAP, exam.seq, exam.t_ms - 1000, body, 0, secret))
    exam.check("a tagged frame whose t_ms goes back")
    left, t_ms = Geom(exam.geom.geom_id, 9, 9, exam.geom.session), exam.t_ms
    exam.begin_free(8, 7)
    exam.check("the next run")
    exam.send(frame(GEOM, exam.seq + 1, t_ms + 9000, left.body(), 0, secret))
    exam.next(POSE, b"")
    exam.check("a GEOM of a session that was left")
    return "no tag, other keys, sessions and nonces, a t_ms that goes back, a session that was left"


# Test 3: damage


def bit_errors(exam: Exam) -> str:
    """3: every error of one and two bits in a short frame."""
    exam.begin_free(6, 5)
    bits = 8 * len(victim(exam))
    single = [1 << i for i in range(bits)]
    double = [1 << i | 1 << j for i in range(bits) for j in range(i)]
    exam.random.shuffle(double)
    return _all_rejected(exam, single + double, "errors of one and two bits")


def bursts(exam: Exam) -> str:
    """3: bursts of up to 32 bits at every place of a short frame."""
    exam.begin_free(6, 5)
    bits, masks = 8 * len(victim(exam)), []
    for length in range(3, 33):
        ends, full = 1 | 1 << length - 1, (1 << length) - 1
        for first in range(bits - length + 1):
            inner = [0, full, exam.random.getrandbits(length), exam.random.getrandbits(length)]
            masks += [(bits_between | ends) << first for bits_between in inner]
    exam.random.shuffle(masks)
    return _all_rejected(exam, masks, "bursts of up to 32 bits")


def long_frames(exam: Exam) -> str:
    """3: the same in the longest frame, by chance."""
    exam.begin_free(40, 30)
    bits, masks = 8 * exam.max_frame, []
    for _ in range(max(200, round(6000 * exam.share))):
        count = exam.random.randint(1, 4)
        mask = sum(1 << bit for bit in exam.random.sample(range(bits), count))
        if exam.random.random() < 0.5:
            length = exam.random.randint(1, 32)
            mask = (exam.random.getrandbits(length) | 1) << exam.random.randrange(bits - length)
        masks.append(mask)
    return _all_rejected(exam, masks, f"errors in a frame of {exam.max_frame} bytes", long=True)


def victim(exam: Exam, long: bool = False) -> bytes:
    """A MAP frame that would be taken if it were whole, and would show in the map."""
    runs = [(OBSTACLE, 3), (KEEP, 2)] * 4
    if long:
        runs = [(OBSTACLE, 1)] * (exam.max_frame - 22 - (8 if exam.key else 0))
    data = exam.next_map(runs, repaired=exam.seq)
    exam.seq = exam.seq - 1 & 0xFFFF  # not sent
    return data


def _all_rejected(exam: Exam, masks: list[int], what: str, long: bool = False) -> str:
    """Each mask of bits, laid over a frame that is due, must make it one that is refused."""
    step = 64 if exam.bench.datagrams and not exam.bench.in_process else 500
    done, refused = 0, exam.ask().bad_frames
    for k in exam.rounds(10**6):
        some = masks[k * step : (k + 1) * step] if k < len(masks) / step * exam.share + 1 else []
        if not some:
            break
        exam.tell([(OBSTACLE, 1), (FREE, 1)])
        due = victim(exam, long)
        for mask in some:
            number = int.from_bytes(due, "little") ^ mask
            exam.bench.send(exam.on_wire(number.to_bytes(len(due), "little")))
        exam.tail.append(due)
        exam.next(POSE, b"")  # its number is the victim's
        ack = exam.ask()
        exam.check_books(f"{len(some)} {what}", ack)
        counted = ack.bad_frames - refused & 0xFFFF
        least = len(some) if exam.bench.in_process else 1
        exam.expect(f"{what}: all of them counted bad", True, least <= counted <= len(some))
        refused, done = ack.bad_frames, done + len(some)
        if k % 8 == 0:
            exam.check_map(what)
    exam.check(what)
    return f"{done} of {len(masks)} {what}"


def damaged_stream(exam: Exam) -> str:
    """3: damage to the encoded bytes never changes the map."""
    if exam.bench.datagrams:
        raise UnseenError("datagrams are not COBS-encoded")
    exam.begin_free(30, 9)
    done = 0
    for _ in exam.rounds(60):
        exam.tell([(OBSTACLE, 2), (FREE, 3)])
        for _ in range(BATCH):
            wanted = exam.next_map([(OBSTACLE, exam.random.randint(1, 90))] * 3, repaired=exam.seq)
            stream = damaged(exam.random, cobs(wanted) + b"\0")
            if wanted[:-4] not in stream and cobs(wanted) not in stream:
                exam.bench.send(stream + b"\0")
                exam.tail.append(wanted)
                done += 1
        exam.check("damaged bytes on the line")
    return f"{done} frames with bytes changed, left out or put in"
