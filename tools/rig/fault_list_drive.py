"""The faults of the motor controller, its wire, and the planner's end; what must come of them.

Source of what must come: docs/devices.md, docs/protocols/planner-link.md (DRIVE), README ("Drive").
"""

from tools.rig.fault_kinds import BLIND, either, goes_on, stops, wire_faults

SILENT = "no counter for 0.4 s: the input is stale; where zero does not arrive, its watchdog stops"
RESTART = "its counters begin anew, so the maps are erased: unknown ground stops"
TROUBLE = "it takes the power away itself; the commander must let go first"
RADIO = "radio or sticks have it; only a restart can have brought that: the maps are erased"
TRAIT = "a line is read with it and without it"
STILL = "counters that stand while the motors have power are not believed"
LATER_S = 8.0  # a restart, listening, identity, modes, counters

DRIVE = (
    *wire_faults("drive", ("mute",), SILENT, "0.002", 4_000),
    stops("drive.mute", SILENT),
    stops("drive.deaf", SILENT),
    stops("drive.frozen", STILL, again=False),
    goes_on("drive.late_s", "the counters come late, in order", "0.02"),
    either("drive.late_s", "counters that come too late are stale", "0.5"),
    goes_on("drive.reply_delay_s", "slower answers, fewer counters a second", "0.01"),
    stops("drive.reply_delay_s", SILENT, "0.6"),
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
    stops("drive.reset", RESTART, lasts_s=0.0, again=False, recovers_s=LATER_S),
    stops("drive.restart", RESTART, lasts_s=0.0, again=False, recovers_s=LATER_S),
    stops("drive.power_cycle", RESTART, lasts_s=0.0, again=False, recovers_s=LATER_S),
    stops("drive.reset_after", RESTART, "20", again=False, recovers_s=LATER_S),
    *(
        stops(
            name,
            why,
            value,
            6.0,
            then=("drive.reset",),
            after=("drive.reset",),
            again=False,
            recovers_s=LATER_S,
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

SILENT_PLANNER = "no request is valid any more"
PLANNER = (
    stops("planner.mute", SILENT_PLANNER),
    goes_on("planner.deaf", "it asks on; it is its own duty to stop (docs/planner-link.md)"),
    either("planner.loss_rate", "what gets lost is sent again", "0.05"),
    either("planner.loss_rate", "as deaf: its own duty to stop", "0.9"),
    stops("planner.stopped", "it says that it has stopped"),
    either("planner.nonce", "a planner that has restarted must have heard this run first", "77"),
    either("planner.poll_only", "it takes only what it asks for", after=("planner.greet",)),
    goes_on("planner.acknowledge", "an ACK more", "", 0.0),
    goes_on("planner.greet", "a HELLO more", "", 0.0),
    stops("planner.wire.mute", SILENT_PLANNER),
    stops("planner.cut", SILENT_PLANNER),
    goes_on("planner.delay_s", "requests are that much older", "0.05"),
    stops("planner.delay_s", "a request that was on its way for too long is not valid", "0.6"),
    goes_on("planner.drop_rate", "the next request is there in time", "0.1"),
    stops("planner.drop_rate", SILENT_PLANNER, "1"),
    goes_on("planner.damage_rate", "a damaged request is none", "0.001"),
    stops("planner.damage_rate", SILENT_PLANNER, "0.5"),
    either("planner.host_drop_rate", "what gets lost is sent again", "0.1"),
    either("planner.host_damage_rate", "what gets lost is sent again", "0.002"),
    goes_on("planner.alter_at.4700", "one damaged request", "255"),
    goes_on("planner.drop_at", "one damaged request", "4700"),
)

NO_FAULTS = {
    "drive.amps_divider": "a property of the model",
    "drive.analog_v": "inputs that mapod does not ask for",
    "drive.model": "which one it is",
    "drive.flash_writes": "a count of the fake",
    "drive.watchdog_stops": "a count of the fake",
    "drive.log_numbers": "in R/C mode only: there it is in the catalogue",
    **{
        f"planner.{name}": "a reading of the receiver, no fault"
        for name in (
            *("accepted", "auth_failed", "digest_ok", "ignored_maps", "ignored_types"),
            *("need_full", "need_geom", "rejected", "repeated", "too_many_cells"),
        )
    },
    "planner.ack_every": "how often it acknowledges: its own choice",
    "planner.ack_period_s": "how often it acknowledges: its own choice",
    "planner.max_cells": "how much room it has",
    "planner.begin_stream": "told of a new connection: what its owner does, and no fault",
}
