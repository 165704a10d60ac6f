"""What docs/security.md claims of the whole tree: who listens, what is never loaded, what is kept.

Claims about one room are proved where that room's tests are; the document names them.
"""

import ast
import base64
import os
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from config_file import load_config
from core.driving.control import link_refusal
from core.summary import describe_robot
from logs import LOG, set_up_logging
from recording.mcap_stream import McapStream
from tests import ROOT, Capsys
from tests.support.robot.recorded import RecordedLoop
from tests.support.robot.shipped import shipped
from tools.cli.command import main
from tools.cli.view import PAGE_AT
from tools.foxglove_bridge import LOOPBACK

WRITTEN = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
ON_A_ROBOT = ["core", "hw", "recording", "mapod", "mapod_link", "robots"]
TOOLS = ["cli", "view", "replay", "doctor", "why", "terminal", "export", "flash", "calibration"]
UNPICKLERS = {"pickle", "_pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "yaml"}
RUNNERS = {"eval", "exec"}
LISTENS = r"create_server\(|create_datagram_endpoint\(|\.bind\(|TCPSite\(|start_server\("
KEY = bytes(range(100, 132))


def sources() -> Iterator[tuple[Path, ast.Module]]:
    """What runs on a robot, and the tools that read files of others."""
    folders = [ROOT / room for room in ON_A_ROBOT] + [ROOT / "tools" / room for room in TOOLS]
    for path in [
        *ROOT.glob("*.py"),
        *(path for folder in folders for path in folder.rglob("*.py")),
    ]:
        yield path, ast.parse(path.read_text(encoding="utf-8"))


def test_nothing_unpickles_or_runs_what_a_file_says() -> None:
    for path, tree in sources():
        for node in ast.walk(tree):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert UNPICKLERS.isdisjoint(name.split(".")[0] for name in names), path
            if not isinstance(node, ast.Call):
                continue
            called = node.func.id if isinstance(node.func, ast.Name) else ""
            called = node.func.attr if isinstance(node.func, ast.Attribute) else called
            assert called not in RUNNERS | {"system", "popen"}, f"{path}:{node.lineno}"
            for given in node.keywords:
                is_true = isinstance(given.value, ast.Constant) and given.value.value is True
                assert not (given.arg in ("allow_pickle", "shell") and is_true), path


def test_whoever_listens_stands_in_the_document() -> None:
    rooms = [room for room in ROOT.glob("*/") if room.name not in ("tests", ".venv", "build")]
    listen = {
        path.relative_to(ROOT).as_posix()
        for path in [*ROOT.glob("*.py"), *(path for room in rooms for path in room.rglob("*.py"))]
        if re.search(LISTENS, path.read_text(encoding="utf-8"))
    }
    assert listen == set(re.findall(r"^\| [^|]+ \| `([\w/]+\.py)` \|", WRITTEN, re.M))


@pytest.mark.parametrize("path", [ROOT / "mapod.toml", *(ROOT / "robots").glob("*.toml")], ids=str)
def test_as_shipped_everything_listens_and_talks_on_this_machine(path: Path) -> None:
    config = load_config(path.read_text(encoding="utf-8"))
    for url in (*config.planner.ports, *config.modbus.ports):
        assert not link_refusal(url, has_key=False, enabled=True), url
    assert not config.robot.enable_motors
    assert (PAGE_AT[0], LOOPBACK) == ("127.0.0.1", "127.0.0.1")


@pytest.mark.parametrize(
    "url",
    ["udp://0.0.0.0:9750", "udp://[::]:9750", "tcp://10.0.0.2:1", "udp://127.0.0.1.example:1"],
)
def test_a_port_of_no_loopback_moves_no_motor_without_a_key(url: str) -> None:
    assert urlsplit(url).hostname
    assert "takes a key" in link_refusal(url, has_key=False, enabled=True)
    assert not link_refusal(url, has_key=True, enabled=True)


def forms(secret: bytes) -> list[bytes]:
    """As bytes, as hex in both cases, and in base64."""
    numbers = ", ".join(map(str, secret)).encode()
    return [secret, secret.hex().encode(), secret.hex().upper().encode(),
            base64.b64encode(secret)[:40], repr(secret)[2:-1].encode(), numbers]  # fmt: skip


def test_a_key_is_neither_recorded_nor_logged_nor_told_by_the_doctor(
    tmp_path: Path, capsys: Capsys
) -> None:
    key_file, path = tmp_path / "key", tmp_path / "run.mcap"
    key_file.write_text(KEY.hex(), encoding="ascii")
    key_file.chmod(0o600)
    config = shipped(planner={"key_file": str(key_file)}, log={"format": "json", "level": "debug"})
    read_end, write_end = os.pipe()
    writer = set_up_logging(config, write_end)
    loop = RecordedLoop(path, config, key=KEY)
    loop.run(2.0)
    loop.recorder.close()
    writer.close()
    os.close(write_end)
    LOG.close()
    with os.fdopen(read_end, "rb") as far_end:
        said = far_end.read()
    said += describe_robot(config, [None]).encode()
    said += b"".join(content for _, content in McapStream(path).records())
    settings = tmp_path / "mapod.toml"
    text = (ROOT / "mapod.toml").read_text(encoding="utf-8")
    settings.write_text(text.replace('key_file = ""', f'key_file = "{key_file}"'), encoding="utf-8")
    assert f'"{key_file}"' in settings.read_text(encoding="utf-8")
    main(["doctor", "--config", str(settings), "--json"])
    said += capsys.readouterr().out.encode()
    assert b"planner" in said
    for form in forms(KEY):
        assert form not in said
