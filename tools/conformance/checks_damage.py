"""Conformance test 3: damaged frames are refused, and a damaged line never changes the map."""

from tools.conformance.exam import BATCH, Exam, UnseenError
from tools.conformance.wire import FREE, KEEP, OBSTACLE, POSE, cobs


def bit_errors(exam: Exam) -> str:
    """3: every error of one and two bits in a short frame."""
    exam.begin(6, 5)
    exam.tell([(FREE, 30)])
    bits = 8 * len(victim(exam))
    single = [1 << i for i in range(bits)]
    double = [1 << i | 1 << j for i in range(bits) for j in range(i)]
    exam.random.shuffle(double)
    return _all_rejected(exam, single + double, "errors of one and two bits")


def bursts(exam: Exam) -> str:
    """3: bursts of up to 32 bits at every place of a short frame."""
    exam.begin(6, 5)
    exam.tell([(FREE, 30)])
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
    exam.begin(40, 30)
    exam.tell([(FREE, 1200)])
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
    seq = exam.seq
    tag = 8 if exam.key else 0
    runs = [(OBSTACLE, 1)] * (exam.max_frame - 22 - tag)
    if not long:
        runs = [(OBSTACLE, 3), (KEEP, 2)] * 4
    data = exam.next_map(runs, repaired=seq)
    exam.seq = seq
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
            damaged = number.to_bytes(len(due), "little")
            exam.bench.send(damaged if exam.bench.datagrams else cobs(damaged) + b"\0")
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
    exam.begin(30, 9)
    exam.tell([(FREE, 270)])
    done = 0
    for _ in exam.rounds(60):
        exam.tell([(OBSTACLE, 2), (FREE, 3)])
        for _ in range(BATCH):
            wanted = exam.next_map([(OBSTACLE, exam.random.randint(1, 90))] * 3, repaired=exam.seq)
            stream = _damaged(exam, cobs(wanted) + b"\0")
            if wanted[:-4] not in stream and cobs(wanted) not in stream:
                exam.bench.send(stream + b"\0")
                exam.tail.append(wanted)
                done += 1
        exam.check("damaged bytes on the line")
    return f"{done} frames with bytes changed, left out or put in"


def _damaged(exam: Exam, stream: bytes) -> bytes:
    """A few bytes changed, left out or put in."""
    data = bytearray(stream)
    for _ in range(exam.random.randint(1, 3)):
        at = exam.random.randrange(len(data))
        match exam.random.randrange(5):
            case 0:
                data[at] ^= 1 << exam.random.randrange(8)
            case 1:
                data[at] = exam.random.choice([0, 1, 0xFF, exam.random.randrange(256)])
            case 2:
                del data[at : at + exam.random.randint(1, 4)]
            case 3:
                data[at:at] = exam.random.randbytes(exam.random.randint(1, 3))
            case _:
                data[at:at] = b"\0"
        if not data:
            data += b"\x01"
    return bytes(data)
