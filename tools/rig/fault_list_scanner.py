"""The faults of the laser scanner and its wire, and what must come of them.

Source of what must come: docs/devices.md, docs/maps.md.
"""

from tools.rig.fault_kinds import LATER, LATER_S, either, goes_on, stops, wire_faults

SILENT = "no scan for 0.15 s: the input is stale, free cells are taken back"
LESS = "fewer beams, no wrong ones: what they do not see stays unknown, and unknown stops"
UNSEEN = "it goes on over ground that was seen before, and to no other"
REBOOT = "scanner.reboot"
SEEN_AGAIN_S = 10.0  # restart, connection, login, spin-up, first scans

SCANNER = (
    *wire_faults("scanner", ("mute", "drop_rate"), SILENT, "0.00003", 470_000),
    stops("scanner.mute", SILENT),
    goes_on("scanner.deaf", "scans come on; mapod's questions are answered later"),
    either("scanner.late_s", LATER, "0.03", recovers_s=LATER_S),
    stops("scanner.late_s", LATER, "0.5", recovers_s=LATER_S),
    stops("scanner.frozen", "the same telegram again is no new scan"),
    goes_on("scanner.drop_rate", "the next scan is there in time", "0.2"),
    stops("scanner.drop_rate", SILENT, "1"),
    goes_on("scanner.wrong_checksum_rate", "the next scan is there in time", "0.2"),
    stops("scanner.wrong_checksum_rate", SILENT, "1"),
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
    stops(REBOOT, "it starts anew", lasts_s=0.0, recovers_s=SEEN_AGAIN_S),
    *(
        stops(name, why, value, 6.0, then=(REBOOT,), recovers_s=SEEN_AGAIN_S)
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

NO_FAULTS = {
    "scanner.comment": "a text that mapod does not ask for",
    "scanner.name": "a text that mapod does not ask for",
    "scanner.encoder": "a field of the telegram that mapod does not ask for",
    "scanner.dialect_change_s": "only where a tool changes the dialect; scanner.binary is that",
    "scanner.power_ons": "a count of the device",
}
