"""Every fault that the fakes and their wires can be given while the robot drives.

`draw` gives some of them by chance for one run, in a timetable's words. What a fake
can be told and is no fault stands in NO_FAULTS, with the reason: nothing is left out in silence.
"""

import random
from dataclasses import dataclass
from functools import partial
from typing import Literal

Must = Literal["stops", "goes on", "either"]

STANDS_S = 2.0  # an input's time-out, a loop, and the way to a stop from 0.8 m/s
RECOVERS_S = 6.0
THEN_S, AFTER_S = 0.1, 0.2
BLIND = "cannot be noticed"


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault and what must come of it. Orders are name[=value], as a timetable has them."""

    name: str  # device, and attribute or event; "scanner.wire.mute"
    why: str  # of what must come; begins with BLIND where nothing can be known of the fault
    value: str = ""  # as text; "" switches it on, or is an event without a number
    lasts_s: float = 3.0  # until it ends; 0: it happens at once, or ends by itself
    must: Must = "either"  # what the robot does meanwhile
    stands_s: float = STANDS_S  # where it must stop: after so long at most it stands
    recovers_s: float = RECOVERS_S  # after its end: all inputs well again, the map valid
    again: bool = True  # it then drives by itself; False: waits for a person, or seen ground
    also: tuple[str, ...] = ()  # orders that begin together with it and end with it
    then: tuple[str, ...] = ()  # events that happen 0.1 s after its begin
    after: tuple[str, ...] = ()  # events 0.2 s after its end, as a person would see to them
    drawn: bool = True  # a campaign may draw it at random
    robot: str = ""  # whose settings of robots/ it drives with; "": the shipped ones

    @property
    def device(self) -> str:
        return self.name.partition(".")[0]

    @property
    def own(self) -> str:
        """Its first order, without the time."""
        return f"{self.name}={self.value}" if self.value else self.name

    @property
    def title(self) -> str:
        title = " + ".join([self.own, *self.also, *self.then])
        return f"{self.robot}: {title}" if self.robot else title

    @property
    def is_noticed(self) -> bool:
        return not self.why.startswith(BLIND)

    def orders(self, start_s: float) -> list[str]:
        """What to order of the fakes, beginning at start_s of the run.

        >>> stops("drive.mute", "", lasts_s=2.0, after=("drive.reset",)).orders(5.0)
        ['drive.mute@5s+2s', 'drive.reset@7.2s']
        """
        span = f"@{start_s:g}s" + (f"+{self.lasts_s:g}s" if self.lasts_s else "")
        orders = [f"{order}{span}" for order in (self.own, *self.also)]
        orders += [f"{event}@{start_s + THEN_S:g}s" for event in self.then]
        return orders + [f"{event}@{start_s + self.lasts_s + AFTER_S:g}s" for event in self.after]


stops = partial(Fault, must="stops")
goes_on = partial(Fault, must="goes on")
either = partial(Fault, must="either")

LATER = "a delay that changes makes the clock doubtful until it is known again"
LATER_S = 15.0


def wire_faults(
    device: str,
    hidden: tuple[str, ...],  # attributes that the device has by the same name: behind "wire."
    stale: str,  # what the loss of this input means, in words
    rate: str,  # share of bytes of which few frames are hit
    byte: int,  # an offset in the device's stream that goes by while the fault lasts
) -> tuple[Fault, ...]:
    """The faults that every stream's wire has."""
    few = "the next frame is there in time, or the input is stale"
    host = "only what mapod asks gets lost: it asks again, or finds the input stale"
    mute, drop_rate = (
        f"{device}.wire.{name}" if name in hidden else f"{device}.{name}"
        for name in ("mute", "drop_rate")
    )
    return (
        stops(mute, stale),
        stops(f"{device}.cut", stale),
        either(f"{device}.delay_s", LATER, "0.03", recovers_s=LATER_S),
        either(f"{device}.delay_s", LATER, "0.5", recovers_s=LATER_S),
        either(drop_rate, few, rate),
        either(f"{device}.damage_rate", few, rate),
        either(f"{device}.host_drop_rate", host, "0.05"),
        either(f"{device}.host_damage_rate", host, "0.05"),
        goes_on(f"{device}.alter_at.{byte}", few, "255", drawn=False),
        goes_on(f"{device}.drop_at", few, f"{byte},{byte + 1}", drawn=False),
        goes_on(f"{device}.chunk", "a stream may be cut anywhere", "7"),
    )


# Scanner. Source of what must come: docs/devices.md, docs/maps.md

NO_SCAN = "no scan for 0.15 s: the input is stale, free cells are taken back"
LESS = "fewer beams, no wrong ones: what they do not see stays unknown, and unknown stops"
UNSEEN = "it goes on over ground that was seen before, and to no other"
SEEN_AGAIN_S = 10.0  # restart, connection, login, spin-up, first scans

SCANNER = (
    *wire_faults("scanner", ("mute", "drop_rate"), NO_SCAN, "0.00003", 470_000),
    stops("scanner.mute", NO_SCAN),
    goes_on("scanner.deaf", "scans come on; mapod's questions are answered later"),
    either("scanner.late_s", LATER, "0.03", recovers_s=LATER_S),
    stops("scanner.late_s", LATER, "0.5", recovers_s=LATER_S),
    stops("scanner.frozen", "the same telegram again is no new scan"),
    goes_on("scanner.drop_rate", "the next scan is there in time", "0.2"),
    stops("scanner.drop_rate", NO_SCAN, "1"),
    goes_on("scanner.wrong_checksum_rate", "the next scan is there in time", "0.2"),
    stops("scanner.wrong_checksum_rate", NO_SCAN, "1"),
    goes_on("scanner.cut_next", "one telegram is lost", lasts_s=0.5),
    goes_on("scanner.slow_answer_s", "nothing waits for an answer while it runs", "0.8"),
    goes_on("scanner.answers_lost", "nothing waits for an answer while it runs", "3"),
    goes_on("scanner.drift_ppm", "its clock is followed", "200"),
    either("scanner.noise_m", "floor that scatters may look like obstacles", "0.05"),
    either("scanner.noise_m", "floor that scatters looks like obstacles", "0.1"),
    goes_on("scanner.offset_m", "as far off as its sheet allows", "0.03"),
    either("scanner.dazzled_rate", LESS, "0.2"),
    either("scanner.dazzled_rate", UNSEEN, "1"),
    either("scanner.implausible_rate", LESS, "0.2"),
    either("scanner.implausible_rate", UNSEEN, "1"),
    either("scanner.filtered_rate", LESS, "0.2"),
    either("scanner.filtered_rate", UNSEEN, "1"),
    either("scanner.max_range_m", UNSEEN, "6"),
    either("scanner.contamination", "a warning is told (health bit 8)", "1", 6.0),
    stops("scanner.contamination", "too dirty: asked every few seconds", "2", 9.0, stands_s=8.0),
    stops("scanner.contamination", "too dirty: asked every few seconds", "3", 9.0, stands_s=8.0),
    stops("scanner.device_status", "its scans are not documented as good", "1"),
    stops("scanner.device_status", "its scans are not documented as good", "2"),
    stops("scanner.device_status", "its scans are not documented as good", "4"),
    goes_on("scanner.in_error", "it is asked at the start only; each scan has a status of its own"),
    goes_on("scanner.temperature_bad", "it is told in words; the scans are good", lasts_s=6.0),
    either("scanner.mean_scans", "a filter set by another program smears what moves", "5"),
    either("scanner.two_in_a_row", "a filter set by another program: it only takes beams away"),
    stops("scanner.binary", "it speaks the other dialect", "off", 4.0, recovers_s=SEEN_AGAIN_S),
    stops("scanner.reboot", "it starts anew", lasts_s=0.0, recovers_s=SEEN_AGAIN_S),
    *(
        stops(name, why, value, 6.0, then=("scanner.reboot",), recovers_s=SEEN_AGAIN_S)
        for name, value, why in (
            ("scanner.start_silent_s", "3", "it starts anew, and is silent at first"),
            ("scanner.refuse_connections_s", "3", "it starts anew, and takes no host at first"),
            ("scanner.spin_up_s", "3", "it starts anew, and its mirror is slow to spin up"),
            ("scanner.settling_scans", "60", "it starts anew, its first scans are not valid"),
            ("scanner.clock_offset_us", "4294000000", "it starts anew, its clock wraps soon"),
            ("scanner.measures_at_power_up", "", "it starts anew, and measures as it was stored"),
            ("scanner.untrue_output_step", "off", "it starts anew, with another firmware"),
            ("scanner.refuse.SetAccessMode", "3", "it starts anew, and lets nobody log in"),
            ("scanner.max_clients", "0", "it starts anew, and has no room for a host"),
        )
    ),
)

# Attitude sensor. Source: docs/devices.md, docs/maps.md, docs/architecture.md

NO_ATTITUDE = "no attitude for 0.15 s: it brakes, and the wheels tell that way"
GRAVITY = "angles and gravity contradict each other: what was mapped so is not believed"
AGREES_S = 12.0  # of which both have to agree for ten
FIELD = "the gyro carries the heading, a field that is not the earth's does not count"
ONE = "one message is missing, the next one is there in time"
JUMP = "a counter that jumps makes the clock doubtful until it is known again"
SET_UP_S = 6.0  # wake-up, settings read and compared, clock locked

AHRS = (
    *wire_faults("ahrs", ("mute",), NO_ATTITUDE, "0.0005", 48_000),
    stops("ahrs.mute", NO_ATTITUDE),
    goes_on("ahrs.deaf", "data come on, nothing is asked while it runs"),
    either("ahrs.late_s", LATER, "0.02", recovers_s=LATER_S),
    either("ahrs.late_s", LATER, "0.5", recovers_s=LATER_S),
    stops("ahrs.frozen", "a counter that stands still is no new sample"),
    goes_on("ahrs.burst_s", "a USB adapter's bursts: the counter tells when", "0.016"),
    stops("ahrs.burst_s", NO_ATTITUDE, "0.5"),
    goes_on("ahrs.jitter_s", "the least delayed samples tell its clock", "0.005"),
    either("ahrs.jitter_s", LATER, "0.1", recovers_s=LATER_S),
    goes_on("ahrs.lost_byte_rate", "few messages are hit", "0.0005"),
    stops("ahrs.lost_byte_rate", NO_ATTITUDE, "0.2"),
    goes_on("ahrs.lost_rate", "the next sample is there in time", "0.2"),
    stops("ahrs.lost_rate", NO_ATTITUDE, "1"),
    goes_on("ahrs.wrong_checksum_rate", "the next sample is there in time", "0.2"),
    stops("ahrs.wrong_checksum_rate", NO_ATTITUDE, "1"),
    stops("ahrs.length_off", "messages of another length than set up", "1"),
    stops("ahrs.nan", "no number is no orientation"),
    goes_on("ahrs.half_frame", ONE, lasts_s=0.5),
    goes_on("ahrs.fa_ff", "a header within the data is no header"),
    either("ahrs.gap", JUMP, "10", recovers_s=LATER_S),
    either("ahrs.counter", JUMP, "300", recovers_s=LATER_S),
    goes_on("ahrs.error_next", "an Error in the stream is told in words", "40", 0.5),
    goes_on("ahrs.drift_ppm", "its clock is followed", "200"),
    goes_on("ahrs.deaf_acks", "nothing is asked while it runs", "3"),
    goes_on("ahrs.late_data", "nothing is asked while it runs", "3"),
    goes_on("ahrs.fine_next", "a stamp that this model does not send", "5"),
    stops("ahrs.brown_out", "it starts anew", lasts_s=0.0, recovers_s=SET_UP_S),
    stops("ahrs.brown_out", "it starts anew as shipped", "forgets", 0.0, recovers_s=SET_UP_S),
    stops("ahrs.power_up", "it starts anew", lasts_s=0.0, recovers_s=SET_UP_S),
    stops(
        "ahrs.another_host", "data of another kind: set up anew", "2,0", 0.0, recovers_s=SET_UP_S
    ),
    either(
        "ahrs.baud",
        "another rate of its line until it is off and on",
        "9600",
        after=("ahrs.power_up",),
    ),
    either("ahrs.angle_noise_rad", "floor that wobbles may look like obstacles", "0.01"),
    either("ahrs.angle_noise_rad", "the gyro carries roll and pitch", "0.06"),
    either("ahrs.rate_noise_radps", "the heading is less sure", "0.2"),
    either("ahrs.rate_bias_radps", "the bias is learnt while it stands", "0,0,0.02"),
    goes_on("ahrs.sheet_errors", "as wrong as its sheet allows"),
    either("ahrs.yaw_jump_rad", FIELD, "0.5"),
    goes_on("ahrs.earth_field", FIELD, "0.0,0.4,-0.9"),
    goes_on("ahrs.magnetic_noise", FIELD, "0.3"),
    goes_on("ahrs.pull_s", FIELD, "0.1", also=("ahrs.earth_field=0.2,0.35,-0.9",)),
    *(
        stops(name, GRAVITY, value, 8.0, stands_s=6.0, recovers_s=AGREES_S, again=False)
        for name, value in (("ahrs.tilt_off_rad", "0,0.105"), ("ahrs.accel_bias_mps2", "1,0,0"))
    ),
    goes_on("ahrs.accel_noise_mps2", "it averages out", "1"),
    goes_on("ahrs.temperature_deg", "not used", "80"),
)

# Motor controller, and the planner's end. Source: docs/devices.md, README ("Before motors move"),
# docs/protocols/planner-link.md (DRIVE)

NO_COUNTER = (
    "no counter for 0.4 s: the input is stale; where zero does not arrive, its watchdog stops"
)
RESTART = "its counters begin anew: where it can have rolled unseen, ground is unknown and stops"
TROUBLE = "it takes the power away itself; the commander must let go first"
RADIO = "radio or sticks have it; only a restart can have brought that: the maps are erased"
TRAIT = "a line is read with it and without it"
STILL = "counters that stand while the motors have power are not believed"
RESTARTED_S = 8.0  # a restart, listening, identity, modes, counters

DRIVE = (
    *wire_faults("drive", ("mute",), NO_COUNTER, "0.002", 4_000),
    stops("drive.mute", NO_COUNTER),
    stops("drive.deaf", NO_COUNTER),
    stops("drive.frozen", STILL, again=False),
    goes_on("drive.late_s", "the counters come late, in order", "0.02"),
    either("drive.late_s", "counters that come too late are stale", "0.5"),
    goes_on("drive.reply_delay_s", "slower answers, fewer counters a second", "0.01"),
    stops("drive.reply_delay_s", NO_COUNTER, "0.6"),
    stops("drive.counter_offset", RESTART, "100000,100000", again=False),
    either("drive.counter_offset", "a jump of one counter is not believed", "5000,0", again=False),
    either("drive.rollover", "matters at a counter's end only", "zero"),
    stops("drive.encoder", "it has no counters any more", "off"),
    stops("drive.refuse", "it refuses to tell a counter", "?Q0"),
    stops("drive.emergency_stop", TROUBLE, again=False, after=("drive.reset",)),
    stops("drive.status", TROUBLE, "128", again=False),
    stops("drive.battery_v", TROUBLE, "7.0"),
    stops("drive.battery_v", TROUBLE, "44.0"),
    stops("drive.celsius", TROUBLE, "95,95"),
    goes_on("drive.internal_v", "told to who asks; the motors run on", "9.0"),
    goes_on("drive.amps", "told to who asks; the motors run on", "20,20"),
    either("drive.load_a", "the battery sags, and the controller may cut out", "80"),
    stops("drive.mode", RADIO, "rc", again=False),
    stops("drive.mode", RADIO, "analog", again=False),
    goes_on("drive.mode", f"{BLIND}: its watchdog is off", "rs232"),
    stops("drive.mode", RADIO, "rc", again=False, also=("drive.log_numbers=16",)),
    goes_on("drive.radio_overrides", "the sticks are at rest: they do not override"),
    goes_on("drive.command", "sticks do not count in RS-232 mode", "60,60", 0.0),
    stops("drive.reset", RESTART, lasts_s=0.0, again=False, recovers_s=RESTARTED_S),
    stops("drive.restart", RESTART, lasts_s=0.0, again=False, recovers_s=RESTARTED_S),
    stops("drive.power_cycle", RESTART, lasts_s=0.0, again=False, recovers_s=RESTARTED_S),
    stops("drive.reset_after", RESTART, "20", again=False, recovers_s=RESTARTED_S),
    *(
        stops(
            name,
            why,
            value,
            6.0,
            then=("drive.reset",),
            after=("drive.reset",),
            again=False,
            recovers_s=RESTARTED_S,
        )
        for name, value, why in (
            ("drive.boot_s", "3", "it restarts slowly"),
            ("drive.parameters.0", "0", "it restarts in R/C mode: the radio has it"),
            ("drive.parameters.1", "3", "it restarts in a motor mode that steers positions"),
            ("drive.says_ok", "off", "it restarts and says less"),
            ("drive.never_written", "0,1", "it restarts and does not tell its modes"),
            ("drive.register_sign", "$", "it restarts with an older encoder module"),
            ("drive.echoes_take_over", "", "it restarts"),
        )
    ),
    either("drive.echoes", "an exchange needs the echo, or does without", "off"),
    goes_on("drive.plus_after_read", TRAIT, "off"),
    goes_on("drive.minus_on_empty", TRAIT),
    goes_on("drive.lf_after_cr", TRAIT),
    goes_on("drive.paced", "characters that take no time are early, no more", "off"),
    either("drive.baud", "another rate of its line", "19200"),
    either("drive.send_w", "a W may mean that the watchdog stopped the motors", "", 0.0),
    either("drive.w_rate", "a W may mean that the watchdog stopped the motors", "0.02"),
    goes_on("drive.inputs", "told to who asks", "1,1"),
    goes_on("drive.outputs.C", "told to who asks", "on"),
)

NO_REQUEST = "no request is valid any more"
PLANNER = (
    stops("planner.mute", NO_REQUEST),
    goes_on("planner.deaf", "it asks on; it is its own duty to stop (docs/planner-link.md)"),
    either("planner.loss_rate", "what gets lost is sent again", "0.05"),
    either("planner.loss_rate", "as deaf: its own duty to stop", "0.9"),
    stops("planner.stopped", "it says that it has stopped"),
    either("planner.nonce", "a planner that has restarted must have heard this run first", "77"),
    either("planner.poll_only", "it takes only what it asks for", after=("planner.greet",)),
    goes_on("planner.acknowledge", "an ACK more", "", 0.0),
    goes_on("planner.greet", "a HELLO more", "", 0.0),
    stops("planner.wire.mute", NO_REQUEST),
    stops("planner.cut", NO_REQUEST),
    goes_on("planner.delay_s", "requests are that much older", "0.05"),
    stops("planner.delay_s", "a request that was on its way for too long is not valid", "0.6"),
    goes_on("planner.drop_rate", "the next request is there in time", "0.1"),
    stops("planner.drop_rate", NO_REQUEST, "1"),
    goes_on("planner.damage_rate", "a damaged request is none", "0.001"),
    stops("planner.damage_rate", NO_REQUEST, "0.5"),
    either("planner.host_drop_rate", "what gets lost is sent again", "0.1"),
    either("planner.host_damage_rate", "what gets lost is sent again", "0.002"),
    goes_on("planner.alter_at.4700", "one damaged request", "255"),
    goes_on("planner.drop_at", "one damaged request", "4700"),
)

CATALOGUE: tuple[Fault, ...] = (*SCANNER, *AHRS, *DRIVE, *PLANNER)
NO_FAULTS = {
    "scanner.comment": "a text that mapod does not ask for",
    "scanner.name": "a text that mapod does not ask for",
    "scanner.encoder": "a field of the telegram that mapod does not ask for",
    "scanner.dialect_change_s": "only where a tool changes the dialect; scanner.binary is that",
    "scanner.power_ons": "a count of the device",
    "scanner.first_scan": "where a count begins: any number is right",
    "ahrs.self_test": "told to who asks for it: tools/cli/attitude.py",
    "drive.amps_divider": "a property of the model",
    "drive.analog_v": "inputs that mapod does not ask for",
    "drive.model": "which one it is",
    "drive.flash_writes": "a count of the fake",
    "drive.watchdog_stops": "a count of the fake",
    "drive.log_numbers": "in R/C mode only: there it is in the catalogue",
    "planner.ask_scan": "a question that a planner may ask",
    "planner.accepted": "a reading of the receiver, no fault",
    "planner.rejected": "a reading of the receiver, no fault",
    "planner.begin_stream": "told of a new connection: what its owner does, and no fault",
    **dict.fromkeys(
        ("scanner.unplugged", "ahrs.gone", "drive.gone"),  # a cable, an adapter is pulled
        'of real sockets and ptys: in the live rig (`make rig ARGS="--fault ..."`)',
    ),
}
DRAWN_DEVICES = ("scanner", "ahrs", "drive")  # the planner's end differs from run to run
SHARES: dict[Must, float] = {"stops": 0.5, "either": 0.35, "goes on": 0.15}  # of what is drawn
DRAW_FROM_S, DRAW_TO_S = 4.0, 40.0  # of a run


def draw(seed: int, n: int, from_s: float = DRAW_FROM_S, to_s: float = DRAW_TO_S) -> list[str]:
    """Orders of n faults by chance, always the same of a seed; no device has two at once."""
    chance = random.Random(f"faults {seed}")
    drawn = [fault for fault in CATALOGUE if fault.drawn and fault.device in DRAWN_DEVICES]
    orders: list[str] = []
    busy: list[tuple[str, float, float]] = []
    while n > 0:
        [must] = chance.choices(list(SHARES), list(SHARES.values()))
        fault = chance.choice([fault for fault in drawn if fault.must == must])
        start_s = round(chance.uniform(from_s, to_s), 1)
        end_s = start_s + fault.lasts_s + 1.0
        if any(d == fault.device and start_s < e and s < end_s for d, s, e in busy):
            continue
        busy.append((fault.device, start_s, end_s))
        orders += fault.orders(start_s)
        n -= 1
    return orders
