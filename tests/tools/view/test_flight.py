"""The flight recorder's key reaches the process that the frames come from, and no other."""

import signal
import socket
import subprocess

import pytest

from tests.tools.cli.test_demo import stub
from tools.view.flight import ELSEWHERE, save_flight

SENDER = """
    import socket
    signal.signal(signal.SIGUSR2, {handler})
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.connect(("127.0.0.1", int(sys.argv[1])))
    line.send(b"here")
    time.sleep(60)
"""


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("handler", "asked"), [("lambda *_: sys.exit(7)", True), ("signal.SIG_DFL", False)]
)
def test_who_listens_for_the_signal_gets_it_and_nobody_ends_by_it(
    handler: str, asked: bool
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        line.settimeout(60)
        code = stub(SENDER.format(handler=handler), "")
        with subprocess.Popen([*code, str(line.getsockname()[1])]) as sender:
            peer = line.recvfrom(16)[1]
            assert save_flight(peer) == ("" if asked else ELSEWHERE)
            if not asked:
                assert sender.poll() is None
                sender.kill()
            assert sender.wait(60) == (7 if asked else -signal.SIGKILL)
        assert save_flight(peer) == ELSEWHERE


def test_a_robot_elsewhere_is_not_asked() -> None:
    for peer in (None, "the line", ("192.0.2.7", 9750), ("::1", 9750, 0, 0), ("127.0.0.1", 1)):
        assert save_flight(peer) == ELSEWHERE
