"""Check a receiver of the planner link over its port, as section 14 of the sheet wants it.

Plays the sender: own frames for tests 1 to 6 and 15, mapod's sender for the rest of 5 and for 7.
All that it sees of the receiver are its ACK and HELLO frames; its map is compared by DIGEST frames.
Nothing here moves a robot, but a robot that trusts this map might: take its motors off.
Source: planner link, section 14 (docs/protocols/planner-link.md).
"""

import argparse
from collections.abc import Iterator

from config_file import read_key
from core.config import ConfigError
from hw.ports.wires import PortUrlError
from tools.cli.options import a_seed, fail, number_in, parser_of, whole_in
from tools.conformance.exam import Exam
from tools.conformance.over_port import TCP_BAUD, NotOpenError, OverPort
from tools.conformance.suite import CHECKS, CONTACT_S, Verdict, chosen, meet, run

PASSED, FAILED, NOT_EXAMINED = 0, 1, 2
SECONDS = 120.0  # that all tests may take, about
RESTART_S = 30.0  # to wait for a receiver that has to be started anew
LINE = "{:<4}{:<30}{:<9}{}"


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 passed, 1 something failed, 2 nothing could be examined."""
    options = _options(arguments)
    try:
        checks = chosen(options.only)
        key = read_key(options.key_file)
        bench = OverPort(options.port, options.gap_ms / 1000, options.baud)
    except (ConfigError, ValueError, OSError, PortUrlError) as error:
        return fail("link-test", error, NOT_EXAMINED)
    except NotOpenError as reason:
        return fail("link-test", f"{options.port} does not open: {reason}", NOT_EXAMINED)
    budget_s = options.seconds / max(1, len(checks))
    share = min(1.0, options.seconds / SECONDS)
    exam = Exam(
        bench, seed=options.seed, key=key, budget_s=budget_s, share=share, strict=options.strict
    )
    try:
        if not _met(exam):
            return NOT_EXAMINED
        print(LINE.format("no", "test", "outcome", "what was done"), flush=True)
        return report(list(_told(run(exam, checks, options.seed))), options.seed)
    finally:
        bench.close()


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = parser_of(
        "link-test",
        __doc__,
        "mapod link-test --port udp://192.168.1.7:9750",
        "mapod link-test --port 'serial:///dev/ttyUSB0?baud=115200' --only 2,5 --seconds 60",
    )
    numbers = ", ".join(dict.fromkeys(check.number for check in CHECKS))
    add = parser.add_argument
    add("--port", required=True, help="udp://..., tcp://... or serial:///...")
    parser.add_key()
    parser.add_seconds(f"about; {SECONDS:g}", SECONDS)
    add("--only", default="", help=f"numbers of section 14, of {numbers}")
    add(
        "--gap-ms",
        type=number_in(0, 1000),
        default=0.5,
        help="between two datagrams of a burst (0.5)",
    )
    add(
        "--baud",
        type=whole_in(300, 100_000_000),
        default=TCP_BAUD,
        help=f"of the line behind a tcp port, which is fed no faster ({TCP_BAUD})",
    )
    add(
        "--strict",
        action="store_true",
        help="want also what the sheet's first version left open: section 16",
    )
    add("--seed", type=a_seed, default=1, help="of all chance (default: 1)")
    return parser.parse_args(arguments)


def _met(exam: Exam) -> bool:
    wait_s = CONTACT_S
    if exam.key:
        print(
            f"link-test: waiting for a HELLO, which has the nonce: start it anew ({RESTART_S:g} s)"
        )
        wait_s = RESTART_S
    if why := meet(exam, wait_s):
        print(f"link-test: {why}; all tests skipped")
        return False
    if exam.hello:
        told = f"{exam.hello.max_cells} cells, frames of {exam.hello.max_frame} bytes"
        print(f"link-test: the receiver says that it takes {told}")
    else:
        print("link-test: it has said no HELLO; taken for one of 401 x 401 cells")
    if not exam.has_digest:
        print("link-test: it compares no DIGEST: its map can't be seen from here")
    return True


def _told(verdicts: Iterator[Verdict]) -> Iterator[Verdict]:
    for verdict in verdicts:
        check = verdict.check
        print(LINE.format(check.number, check.name, verdict.outcome, verdict.words), flush=True)
        yield verdict


def report(verdicts: list[Verdict], seed: int) -> int:
    counts = dict.fromkeys(("passed", "failed", "skipped"), 0)
    for verdict in verdicts:
        counts[verdict.outcome] += 1
    print("link-test: " + ", ".join(f"{count} {name}" for name, count in counts.items()))
    for verdict in verdicts:
        if failure := verdict.failure:
            print(f"\nfirst failure: {verdict.check.number} {verdict.check.name} (seed {seed})")
            print(f"  {failure.what}\n  expected {failure.expected}\n  got      {failure.got}")
            print("  newest frames before it, oldest first:")
            print(*(f"    {data.hex(' ')}" for data in failure.frames), sep="\n")
            return FAILED
    return PASSED if counts["passed"] else NOT_EXAMINED
