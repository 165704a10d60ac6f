"""The whole way over ssh, to a real sshd on this machine with keys and settings of its own."""

import hashlib
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.tools.flash.stand_in import bundle, runs
from tools.cli.flash import main
from tools.flash.remote import TAKE
from tools.flash.wheels import Target

pytestmark = pytest.mark.real_time
SSHD = shutil.which("sshd", path=f"{os.environ['PATH']}:/usr/sbin")
CONFIG = """
ListenAddress 127.0.0.1
Port {port}
HostKey {folder}/host
AuthorizedKeysFile {folder}/key.pub
PidFile none
StrictModes no
UsePAM no
PermitRootLogin yes
"""
Capfd = pytest.CaptureFixture[str]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def ssh(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[str]]:
    """The words that reach it."""
    if SSHD is None or shutil.which("ssh") is None:
        pytest.skip("there is no sshd here: apt install openssh-server")
    folder, port = tmp_path_factory.mktemp("ssh"), free_port()
    for name in ("host", "key"):
        command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)]
        subprocess.run(command, check=True)
    (folder / "config").write_text(CONFIG.format(port=port, folder=folder))
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)
    command = [SSHD, "-D", "-e", "-f", str(folder / "config")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as server:
        assert server.stderr
        for line in server.stderr:
            if "listening" in line:
                break
        options = [
            "StrictHostKeyChecking=no",
            f"UserKnownHostsFile={folder}/known",
            "BatchMode=yes",
        ]
        yield [
            "127.0.0.1", "--ssh-port", str(port), "--identity", str(folder / "key"),
            *(word for option in options for word in ("--ssh-option", option)),
        ]  # fmt: skip
        server.terminate()


def test_a_bundle_goes_over_ssh_and_back(ssh: list[str], tmp_path: Path, capfd: Capfd) -> None:
    root = tmp_path / "root"
    root.mkdir()
    at = ["--root", str(root)]
    first, second = bundle(tmp_path, 1), bundle(tmp_path, 2)
    assert main([*ssh, *at, "--from", str(first)]) == 0, capfd.readouterr().err
    assert runs(root) == "app 1 with a"
    there = Path(f"/var/tmp/mapod-flash-{os.getuid()}")
    half = there / f"{second.name}.part"
    for began_with in (second.read_bytes()[:5000], bytes(5000), bytes(10**6)):
        (there / second.name).unlink(missing_ok=True)
        half.write_bytes(began_with)  # where a connection broke off, or something else
        assert main([*ssh, *at, "--from", str(second)]) == 0, capfd.readouterr().err
        assert (there / second.name).read_bytes() == second.read_bytes()
    assert runs(root) == "app 2 with a"
    assert {path.name for path in there.iterdir()} == {second.name}
    (there / second.name).unlink()
    capfd.readouterr()
    assert main([*ssh, *at, "--status"]) == 0
    assert f"runs {second.name.split('-x')[0].removeprefix('mapod-')}" in capfd.readouterr().out
    assert main([*ssh, *at, "--rollback"]) == 0
    assert runs(root) == "app 1 with a"


def test_a_copy_that_is_cut_off_goes_on_where_it_ended(tmp_path: Path) -> None:
    content = bytes(range(256)) * 1000
    digest = hashlib.sha256(content).hexdigest()
    take = TAKE.format(folder=tmp_path, name="x", digest=digest, total=len(content))
    part, whole = tmp_path / "x.part", tmp_path / "x"
    for piece, status, words in (
        (content[:70_000], 1, b""),
        (content[70_000:], 0, b"taken\n"),
        (content[::-1], 0, b"damaged\n"),
    ):
        done = subprocess.run(["sh", "-c", take], input=piece, capture_output=True, check=False)
        assert (done.returncode, done.stdout) == (status, words)
        assert part.exists() == (status == 1)
    assert whole.read_bytes() == content


def test_what_fails_on_the_way_is_one_line(ssh: list[str], tmp_path: Path, capfd: Capfd) -> None:
    good, other = bundle(tmp_path, 1), bundle(tmp_path / "o", 1, target=Target("riscv64", "311"))
    closed = [*ssh[:2], str(free_port()), *ssh[3:]]
    nowhere = ["--root", str(tmp_path / "nowhere"), "--from", str(good)]
    for words, status, told in (
        ([*closed, "--status"], 1, "can't reach 127.0.0.1"),
        ([*ssh, "--from", str(other)], 1, "the bundle is for riscv64, 127.0.0.1 is"),
        ([*ssh, *nowhere], 1, "there is no folder"),
        ([*ssh, "--root", str(tmp_path), "--rollback"], 1, "nothing is flashed there"),
    ):
        capfd.readouterr()
        assert main(words) == status
        lines = [line for line in capfd.readouterr().err.splitlines() if "copying" not in line]
        assert len(lines) == 1
        assert told in lines[0]
