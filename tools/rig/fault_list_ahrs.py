"""The faults of the attitude sensor and its wire, and what must come of them.

Source of what must come: docs/devices.md, docs/maps.md, docs/architecture.md.
"""

from dataclasses import replace

from tools.rig.fault_kinds import LATER, LATER_S, Fault, either, goes_on, stops, wire_faults

SILENT = "no attitude for 0.15 s: it brakes without a heading, so the maps are erased"
NOT_USED = "not used: attitude and rate of turn are all that mapod takes"
FIELD = "the gyro carries the heading, a field that is not the earth's does not count"
ONE = "one message is missing, the next one is there in time"
JUMP = "a counter that jumps makes the clock doubtful until it is known again"
POWER_UP = "ahrs.power_up"
SET_UP_S = 6.0  # wake-up, settings read and compared, clock locked

_AHRS = (
    *wire_faults("ahrs", ("mute",), SILENT, "0.0005", 48_000),
    stops("ahrs.mute", SILENT),
    goes_on("ahrs.deaf", "data come on, nothing is asked while it runs"),
    either("ahrs.late_s", LATER, "0.02", recovers_s=LATER_S),
    either("ahrs.late_s", LATER, "0.5", recovers_s=LATER_S),
    stops("ahrs.frozen", "a counter that stands still is no new sample"),
    goes_on("ahrs.burst_s", "a USB adapter's bursts: the counter tells when", "0.016"),
    stops("ahrs.burst_s", SILENT, "0.5"),
    goes_on("ahrs.jitter_s", "the least delayed samples tell its clock", "0.005"),
    either("ahrs.jitter_s", LATER, "0.1", recovers_s=LATER_S),
    goes_on("ahrs.lost_byte_rate", "few messages are hit", "0.0005"),
    stops("ahrs.lost_byte_rate", SILENT, "0.2"),
    goes_on("ahrs.lost_rate", "the next sample is there in time", "0.2"),
    stops("ahrs.lost_rate", SILENT, "1"),
    goes_on("ahrs.wrong_checksum_rate", "the next sample is there in time", "0.2"),
    stops("ahrs.wrong_checksum_rate", SILENT, "1"),
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
    stops(POWER_UP, "it starts anew", lasts_s=0.0, recovers_s=SET_UP_S),
    stops(
        "ahrs.another_host", "data of another kind: set up anew", "2,0", 0.0, recovers_s=SET_UP_S
    ),
    either(
        "ahrs.baud", "another rate of its line until it is off and on", "9600", after=(POWER_UP,)
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
    goes_on("ahrs.accel_bias_mps2", NOT_USED, "1,0,0"),
    goes_on("ahrs.accel_noise_mps2", NOT_USED, "1"),
    goes_on("ahrs.temperature_deg", NOT_USED, "80"),
)


def _waits(fault: Fault) -> Fault:
    """Whatever stops this sensor while the robot drives ends the map: it waits for a person."""
    goes_on_after = fault.must == "goes on" or fault.name in MAP_STAYS
    return fault if goes_on_after else replace(fault, again=False)


MAP_STAYS: tuple[str, ...] = ()
AHRS = tuple(_waits(fault) for fault in _AHRS)

NO_FAULTS = {
    "ahrs.self_test": "told to who asks for it: tools/cli/attitude.py",
}
