"""What an Xsens MTi says and does on its line, for comparing a real one with its fake.

Reading needs Config state, so the sensor stops measuring for a moment, and measures again after it.
With `settings` also its self test, and a reset, after which it wakes up as it was stored.
"""

import math
from collections import Counter
from collections.abc import Callable

import numpy as np

from hw.mti.frames import (
    Mid,
    MtConfiguration,
    MtFrame,
    MtParser,
    describe_error,
    encode_frame,
    maybe_configuration,
)
from hw.mti.mtdata import MtDataDecoder, decode_mtdata2
from hw.mti.sample import MtSample
from tools.cli.attitude import DEFAULT_BAUD, mt_parser
from tools.cli.conversation import Conversation, NoAnswerError, conversation
from tools.compare.facts import (
    SILENT,
    Fact,
    Portrait,
    Sort,
    counts_in_words,
    delay_fact,
    noise_fact,
    number_facts,
    pace_facts,
    rate_fact,
    reply_to,
)

ANSWER_S, CONFIG_S, CONFIG_TRIES = 0.6, 0.25, 8
SELF_TEST_S, WAKE_S = 3.0, 3.0
NO_SUCH_MID = 0xEE
READS = (  # without data, each of these reads
    Mid.ReqDID, Mid.ReqProductCode, Mid.ReqFWRev, Mid.ReqHardwareVersion, Mid.ReqDataLength,
    Mid.ReqConfiguration, Mid.SetPeriod, Mid.SetOutputMode, Mid.SetOutputSettings,
    Mid.SetOutputSkipFactor, Mid.SetOutputConfiguration, Mid.SetHeading, Mid.SetLocationID,
    Mid.SetErrorMode, Mid.ReqAvailableScenarios, Mid.SetScenario,
)  # fmt: skip
OWN = {"ReqDID", "ReqFWRev", "ReqHardwareVersion", "ReqConfiguration", "SetLocationID",
       "SetHeading", "ReqAvailableScenarios"}  # fmt: skip
MIRRORED = (Mid.SetPeriod, Mid.SetOutputMode, Mid.SetOutputSettings, Mid.SetOutputSkipFactor,
            Mid.SetOutputConfiguration)  # fmt: skip
LEAST_SAMPLES = 20  # for their noise
COUNTER_WRAP = 2**16


def portrait(url: str, seconds: float, settings: bool) -> Portrait:
    """Everything that was found out. Raises NoAnswerError: it neither sends nor answers."""
    with conversation(url, mt_parser(url)) as talk:
        frames = [event for event in talk.hear(0.3) if isinstance(event, MtFrame)]
        mids = Counter(_name(frame.mid) for frame in frames)
        facts: Portrait = {"as found: sends": Fact(" ".join(sorted(mids)) or "nothing")}
        facts.update(_asked(talk, "GoToConfig", Mid.GoToConfig, CONFIG_TRIES, CONFIG_S))
        if facts["GoToConfig: answer"].value == SILENT:
            raise NoAnswerError("no answer to GoToConfig: does it hear us, at this baud rate?")
        for mid in READS:
            facts.update(_asked(talk, mid.name, mid))
        facts.update(_asked(talk, "no such message", NO_SUCH_MID))
        configuration = maybe_configuration(_maybe_data(talk, Mid.ReqConfiguration))
        if settings:
            facts.update(_settings(talk))
        facts.update(_asked(talk, "GoToMeasurement", Mid.GoToMeasurement))
        facts.update(_stream(talk, configuration, seconds))
    return facts


def make_alike(real: str, fake: str) -> None:
    """The fake gets the output settings of the real one. Raises NoAnswerError."""
    with conversation(real, mt_parser(real)) as talk:
        _asked(talk, "", Mid.GoToConfig, CONFIG_TRIES, CONFIG_S)
        wanted = {mid: _maybe_data(talk, mid) for mid in MIRRORED}
        reply_to(talk, encode_frame(Mid.GoToMeasurement), _is_any, ANSWER_S)
    with conversation(fake, MtParser(DEFAULT_BAUD)) as talk:
        _asked(talk, "", Mid.GoToConfig, CONFIG_TRIES, CONFIG_S)
        for mid, data in wanted.items():
            if data:
                reply_to(talk, encode_frame(mid, data), _is_answer_to(mid), ANSWER_S)
        reply_to(talk, encode_frame(Mid.GoToMeasurement), _is_any, ANSWER_S)


def _is_any(event: object) -> bool:
    return isinstance(event, MtFrame)


def _maybe_data(talk: Conversation, mid: int) -> bytes:
    """What a device tells of a setting; b"" where it does not know it."""
    reply = reply_to(talk, encode_frame(mid), _is_answer_to(mid), ANSWER_S)
    return b"" if reply is None or reply[0].mid == Mid.Error else bytes(reply[0].data)


def _name(mid: int) -> str:
    return Mid(mid).name if mid in Mid.__members__.values() else f"message {mid:02X}"


def _is_answer_to(mid: int) -> Callable[[object], bool]:
    return lambda event: isinstance(event, MtFrame) and event.mid in (mid + 1, Mid.Error)


def _asked(
    talk: Conversation, name: str, mid: int, tries: int = 2, seconds: float = ANSWER_S
) -> Portrait:
    reply = reply_to(talk, encode_frame(mid), _is_answer_to(mid), seconds, tries)
    if reply is None:
        return {f"{name}: answer": Fact(SILENT)}
    frame: MtFrame = reply[0]
    delay = {f"{name}: delay": delay_fact(reply[1])}
    if frame.mid == Mid.Error:
        return {f"{name}: answer": Fact(f"refused: {describe_error(frame.data)}"), **delay}
    sort: Sort = "own" if name in OWN else "same"
    return {
        f"{name}: answer": Fact(f"message {frame.mid:02X}"),
        **delay,
        f"{name}: size": Fact(len(frame.data), unit="bytes"),
        f"{name}: data": Fact(frame.data[:40].hex(" ") or "none", sort),
    }


def _settings(talk: Conversation) -> Portrait:
    """Self test and reset; the sensor is in Config state before and after."""
    facts = _asked(talk, "RunSelfTest", Mid.RunSelfTest, 1, SELF_TEST_S)
    facts.update(_asked(talk, "Reset", Mid.Reset))
    begun_s = talk.now_s()
    for event in talk.hear(WAKE_S):
        if isinstance(event, MtFrame) and event.mid == Mid.WakeUp:
            facts["Reset: WakeUp after"] = delay_fact(talk.now_s() - begun_s)
            talk.say(encode_frame(Mid.WakeUpAck))
            break
    else:
        facts["Reset: WakeUp after"] = Fact(SILENT)
    facts.update(_asked(talk, "GoToConfig after the reset", Mid.GoToConfig, CONFIG_TRIES, CONFIG_S))
    return facts


def _stream(talk: Conversation, configuration: MtConfiguration | None, seconds: float) -> Portrait:
    frames, heard_before = list[MtFrame](), len(talk.heard)
    for event in talk.hear(seconds + 1.0):
        if isinstance(event, MtFrame) and event.mid in (Mid.MTData, Mid.MTData2):
            frames.append(event)
            if event.arrived_s - frames[0].arrived_s > seconds:
                break
    size = len(talk.heard) - heard_before
    mids = Counter(_name(frame.mid) for frame in frames)
    facts: Portrait = {"stream: messages": Fact(" ".join(sorted(mids)) or "none")}
    if not frames:
        return facts
    sizes = Counter(len(frame.data) for frame in frames)
    spare = size - sum(frame.wire_bytes for frame in frames)
    facts["stream: data bytes each"] = Fact(" and ".join(str(n) for n in sorted(sizes)))
    facts["stream: bytes that belong to no data message"] = Fact(spare, "near", 0.0, 200, "bytes")
    facts |= dict(pace_facts("stream", [frame.arrived_s for frame in frames]))
    return facts | _samples(frames, configuration)


def _samples(frames: list[MtFrame], configuration: MtConfiguration | None) -> Portrait:
    decoder = None
    if configuration is not None and frames[0].mid == Mid.MTData:
        decoder = MtDataDecoder(configuration.output_mode, configuration.output_settings)
    read = [
        decoder.decode(frame.data) if decoder is not None else decode_mtdata2(frame.data)
        for frame in frames
    ]
    samples = [sample for sample in read if isinstance(sample, MtSample)]
    facts: Portrait = {
        "sample: readable by mode and settings": Fact(
            "all" if len(samples) == len(read) else "not all"
        )
    }
    if not samples:
        return facts
    there = [name for name in FIELDS if getattr(samples[-1], name) is not None]
    facts["sample: holds"] = Fact(" ".join(there))
    counters = [sample.counter for sample in samples if sample.counter is not None]
    steps = Counter(int(step) % COUNTER_WRAP for step in np.diff(counters))
    wrong = {step: count for step, count in steps.items() if step != 1}
    facts["sample: steps of the counter"] = Fact("always 1" if not wrong else "not always 1")
    facts["sample: other steps"] = Fact(counts_in_words(wrong), "own")
    passed_s = frames[-1].arrived_s - frames[0].arrived_s
    if len(counters) > 2 and passed_s > 0:
        counted = sum(int(step) % COUNTER_WRAP for step in np.diff(counters))
        facts["sample: rate by the counter"] = rate_fact(counted / passed_s, passed_s)
    return facts | _measured(samples)


FIELDS = ("q_earth_sensor", "rate_radps", "accel_mps2", "magnetic", "counter", "temperature_c",
          "fine_ticks", "status")  # fmt: skip


def _measured(samples: list[MtSample]) -> Portrait:
    """Sizes of what was measured; a device at rest on earth should agree in the "near" ones."""
    facts: Portrait = {}
    sorts: dict[str, tuple[str, Sort]] = {"accel_mps2": ("m/s2", "near"), "magnetic": ("", "own")}
    for name, (unit, sort) in sorts.items():
        sizes = [math.hypot(*value) for s in samples if (value := getattr(s, name)) is not None]
        if sizes:
            middle = float(np.median(sizes))
            facts[f"sample: |{name}|, median"] = Fact(middle, sort, 0.05, 0.0, unit)
    rates = [math.hypot(*s.rate_radps) for s in samples if s.rate_radps is not None]
    if rates:
        facts |= number_facts("sample: |rate of turn|", rates, "rad/s")
    facts |= _noise(samples)
    norms = [
        math.sqrt(sum(part * part for part in s.q_earth_sensor))
        for s in samples
        if s.q_earth_sensor is not None
    ]
    if norms:
        worst = max(abs(norm - 1.0) for norm in norms)
        words = "within 0.001" if worst < 0.001 else f"off by {worst:.3g}"
        facts["sample: length of the quaternion is 1"] = Fact(words)
    return facts


def _noise(samples: list[MtSample]) -> Portrait:
    facts: Portrait = {}
    units = {"q_earth_sensor": "", "rate_radps": "rad/s", "accel_mps2": "m/s2", "magnetic": ""}
    for name, unit in units.items():
        values = [value for s in samples if (value := getattr(s, name)) is not None]
        if len(values) >= LEAST_SAMPLES:
            steps = np.diff(np.array(values, dtype=float), axis=0)
            spread = float(np.median(steps.std(axis=0))) / math.sqrt(2.0)
            facts[f"sample: noise of {name}"] = noise_fact(spread, unit)
    return facts
