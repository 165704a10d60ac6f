"""What a SICK LMS1xx says and does on its port, for comparing a real one with its fake.

Reads only, and a subscription of this connection, which ends with it. With `settings` also what
needs a login: that stops the scanner's measuring for a moment, and ends with Run.
"""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from hw.lms1xx import commands
from hw.lms1xx.cola import Dialect
from hw.lms1xx.commands import Command
from hw.lms1xx.telegrams import (
    LEAST_RANGE_RAW,
    Answer,
    Refusal,
    ScanTelegram,
    new_parser,
    ranges_m_from_channel,
)
from tools.cli.conversation import Conversation, NoAnswerError, RefusedError, conversation
from tools.cli.scanner import Scanner, dialect_of
from tools.compare.facts import (
    SILENT,
    Fact,
    Portrait,
    counts_in_words,
    delay_fact,
    noise_fact,
    number_facts,
    pace_facts,
    reply_to,
)

ANSWER_S, SPIN_UP_S = 1.0, 3.0
OWN = {"DeviceIdent", "FirmwareVersion", "LocationName", "ODoprh", "ODpwrc", "STlms", "LCMstate",
       "SCdevicestate"}  # fmt: skip
READS = (
    commands.READ_IDENT,
    commands.READ_FIRMWARE,
    commands.READ_LOCATION,
    commands.READ_HOURS,
    commands.READ_POWER_ONS,
    commands.READ_STATE,
    commands.READ_DEVICE_STATE,
    commands.READ_CONTAMINATION,
    commands.READ_SCAN_CONFIG,
    commands.READ_OUTPUT_RANGE,
    commands.READ_CONTENT,
    commands.READ_DIALECT,
    commands.read("LIDinputstate"),
    commands.read("NoSuchVariable"),
    Command("sMN", "NoSuchMethod"),
    Command("sEN", "NoSuchEvent", b"\1", "1"),
)
FORBIDDEN = (  # without a login: refused, and nothing changes
    commands.STOP_MEASURING,
    commands.set_content("first"),
)
MIRRORED = (commands.READ_CONTENT, commands.READ_OUTPUT_RANGE)  # besides rate and step
READY = 1  # of SCdevicestate
MIRROR = 0.01  # share by which mirrors turn faster or slower: a recorded one by 0.0075
LEAST_SCANS = 10  # for their noise


def portrait(url: str, seconds: float, settings: bool) -> Portrait:
    """Everything that was found out. Raises NoAnswerError: it does not answer at all."""
    with conversation(url, new_parser("auto")) as talk:
        dialect = dialect_of(talk)
        facts: Portrait = {"dialect": Fact(dialect)}
        for command in READS:
            facts.update(_asked(talk, command, dialect))
        for command in FORBIDDEN:
            facts.update(_asked(talk, command, dialect, "without login"))
        if settings:
            facts.update(_settings(talk, dialect))
        facts.update(_stream(talk, dialect, seconds))
    return facts


def make_alike(real: str, fake: str) -> None:
    """The fake gets the scanner's settings, and starts. Raises NoAnswerError, RefusedError."""
    with conversation(real, new_parser("auto")) as talk:
        scanner = Scanner(talk, dialect_of(talk))
        read = [(command.name, _maybe_told(scanner, command)) for command in MIRRORED]
        wanted = [_written(name, told) for name, told in read if told is not None]
        state = _maybe_told(scanner, commands.READ_DEVICE_STATE)
        measures = state is not None and commands.maybe_number(state) == READY
    with conversation(fake, new_parser(scanner.dialect)) as talk:
        scanner = Scanner(talk, scanner.dialect)
        scanner.logged_in(*wanted, *([commands.START_MEASURING] if measures else []))
        _wait_until_ready(talk, scanner)


def _maybe_told(scanner: Scanner, command: Command) -> Answer | None:
    try:
        return scanner.ask(command)
    except (NoAnswerError, RefusedError):
        return None


def _written(name: str, told: Answer) -> Command:
    is_text = told.dialect == "ascii"
    return Command("sWN", name, told.values, told.values.decode("latin-1") if is_text else "")


def _wait_until_ready(talk: Conversation, scanner: Scanner) -> None:
    until_s = talk.now_s() + SPIN_UP_S
    while talk.now_s() < until_s:
        if commands.maybe_number(scanner.ask(commands.READ_DEVICE_STATE)) == READY:
            return


def _asked(talk: Conversation, command: Command, dialect: Dialect, how: str = "") -> Portrait:
    name = f"{command.kind} {command.name}{f' {how}' if how else ''}"

    def is_answer(event: object) -> bool:
        return isinstance(event, Refusal) or command.is_answered_by(event)

    reply = reply_to(talk, command.encode(dialect), is_answer, ANSWER_S)
    if reply is None:
        return {f"{name}: answer": Fact(SILENT)}
    event, delay = reply[0], delay_fact(reply[1])
    if isinstance(event, Refusal):
        return {f"{name}: answer": Fact(f"refused: {event.reason}"), f"{name}: delay": delay}
    facts = {f"{name}: answer": Fact(str(event.kind)), f"{name}: delay": delay}
    if command.name in OWN:
        return facts | {f"{name}: values": Fact(_readable(event), "own")}
    size = Fact(len(event.values), "same", unit="bytes")
    return facts | {f"{name}: size": size, f"{name}: values": Fact(_readable(event))}


def _readable(event: Answer) -> str:
    values = event.values
    printable = all(0x20 <= byte < 0x7F for byte in values)
    return values.decode("ascii") if printable else values.hex(" ")


def _settings(talk: Conversation, dialect: Dialect) -> Portrait:
    """A login, the settings that it has once more, start and Run; what was stored stays."""
    scanner = Scanner(talk, dialect)
    config = commands.maybe_scan_config(scanner.ask(commands.READ_SCAN_CONFIG))
    wanted = [commands.LOGIN, commands.set_content("first")]
    if config is not None:
        wanted += [commands.set_scan_config(config), commands.set_output_range(config.step)]
    facts: Portrait = {}
    for command in (*wanted, commands.START_MEASURING, commands.RUN):
        facts.update(_asked(talk, command, dialect, "after login"))
    _wait_until_ready(talk, scanner)
    return facts


def _stream(talk: Conversation, dialect: Dialect, seconds: float) -> Portrait:
    begin, subscribed_s = commands.subscribe(), talk.now_s()
    talk.say(begin.encode(dialect))
    heard_before, telegrams, arrivals_s = len(talk.heard), list[ScanTelegram](), list[float]()
    facts: Portrait = {}
    for event in talk.hear(seconds + 2.0):
        now_s = talk.now_s()
        if begin.is_answered_by(event):
            facts["subscription: delay"] = delay_fact(now_s - subscribed_s)
        if isinstance(event, Refusal):
            facts["subscription: refused"] = Fact(event.reason)
        if isinstance(event, ScanTelegram) and not event.polled:
            telegrams.append(event)
            arrivals_s.append(now_s)
        if arrivals_s and now_s - arrivals_s[0] > seconds:
            break
    size = len(talk.heard) - heard_before
    talk.say(commands.subscribe(False).encode(dialect))
    facts["scans: come by themselves"] = Fact("yes" if telegrams else "no")
    if telegrams:
        facts["scans: bytes each"] = Fact(size / len(telegrams), "near", 0.05, 0.0, "bytes")
        facts |= dict(pace_facts("scans", arrivals_s, MIRROR))
        facts |= _format(telegrams[-1])
        facts |= dict(_counters(telegrams, arrivals_s))
        facts |= _ranges(telegrams)
    return facts


def _format(scan: ScanTelegram) -> Portrait:
    facts: Portrait = {
        "scan: version": Fact(str(scan.version)),
        "scan: device status": Fact(f"{scan.status[0]} {scan.status[1]}"),
        "scan: scans a second": Fact(scan.scan_hz, "same"),
        "scan: measurements a second": Fact(scan.measurement_hz, "near", 0.001),
        "scan: encoders": Fact(str(len(scan.encoders))),
        "scan: inputs": Fact(str(scan.inputs), "own"),
        "scan: outputs": Fact(str(scan.outputs), "own"),
        "scan: channels": Fact(" ".join(scan.channels)),
    }
    for option in ("position", "name", "comment", "clock", "event"):
        facts[f"scan: {option}"] = Fact("not sent" if getattr(scan, option) is None else "there")
    for channel in scan.channels.values():
        facts[f"scan {channel.content}: layout"] = Fact(
            f"{len(channel.raw)} values from {channel.first_deg:g} deg in steps of "
            f"{channel.step_deg:g} deg, x {channel.scale:g} + {channel.offset:g}"
        )
    return facts


def _counters(scans: list[ScanTelegram], arrivals_s: list[float]) -> Iterator[tuple[str, Fact]]:
    for name in ("telegram_counter", "scan_counter"):
        values = [getattr(scan, name) for scan in scans]
        steps = Counter(int(step) % 2**16 for step in np.diff(values))
        wrong = {step: count for step, count in steps.items() if step != 1}
        words = "always 1" if not wrong else "not always 1"
        yield f"scan: steps of {name}", Fact(words)
        yield f"scan: other steps of {name}", Fact(counts_in_words(wrong), "own")
    sent_s = np.unwrap([scan.sent_us for scan in scans], period=2**32) * 1e-6
    ahead_ms = [((scan.sent_us - scan.scan_us) % 2**32) / 1000 for scan in scans]
    yield (
        "scan: stamp before transmission",
        Fact(float(np.median(ahead_ms)), "near", 0.1, 1.0, "ms"),
    )
    if len(scans) > 2:
        gap_ms = float(np.median(np.diff(sent_s))) * 1000
        yield "scan: period by its own clock", Fact(gap_ms, "near", MIRROR, 0.0, "ms")
        drift = (sent_s[-1] - sent_s[0]) / (arrivals_s[-1] - arrivals_s[0]) - 1.0
        yield "scan: its clock against ours", Fact(drift * 1e6, "own", unit="ppm")


def _ranges(scans: list[ScanTelegram]) -> Portrait:
    """What was measured: the room's own, but for codes and noise."""
    channels = [scan.channels["DIST1"] for scan in scans if "DIST1" in scan.channels]
    if not channels or len({len(channel.raw) for channel in channels}) > 1:
        return {}
    ranges_m = np.array([ranges_m_from_channel(channel, slice(None)) for channel in channels])
    codes = Counter(int(raw) for raw in channels[-1].raw if raw < LEAST_RANGE_RAW)
    seen = np.isfinite(ranges_m).all(axis=0)
    facts = number_facts("scan: ranges", list(ranges_m[-1][np.isfinite(ranges_m[-1])]), "m")
    if seen.any() and len(scans) >= LEAST_SCANS:
        spread_m = float(np.median(ranges_m[:, seen].std(axis=0)))
        facts["scan: noise of a range, median"] = noise_fact(spread_m, "m")
    return facts | {"scan: codes instead of ranges": Fact(counts_in_words(codes), "own")}
