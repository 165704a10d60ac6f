"""The page's server over real sockets on loopback: what pages get, and what they may do."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from aiohttp import WSMsgType, WSServerHandshakeError

from tests import Patch
from tests.support.machine.view_site import FREE_AND_OBSTACLE, TOKEN, Browser, Robot, Site, site
from tools.view import driving

pytestmark = pytest.mark.real_time
STATE = {
    "type", "t_s", "pose", "mode", "mode_name", "advice", "inputs", "health_bits", "zone", "rates",
    "latency_ms", "link", "driving", "history",
}  # fmt: skip
ZONE = {
    "state", "causes", "text", "free_ahead_m", "free_behind_m", "allowed_ahead_mps",
    "allowed_behind_mps", "nearest_m", "bearing_rad",
}  # fmt: skip


def with_site(
    test: Callable[[Site], Coroutine[Any, Any, None]], host: str = "127.0.0.1", refusal: str = ""
) -> None:
    async def run() -> None:
        async with site(host, refusal) as running:
            await test(running)

    asyncio.run(run())


def is_live(browser: Browser) -> bool:
    return bool(browser.states and not browser.states[-1]["link"]["stale"])


def test_a_page_gets_hello_then_states_and_the_window() -> None:
    async def test(at: Site) -> None:
        at.robot.begin(FREE_AND_OBSTACLE)
        at.robot.tell_zone()
        async with at.browser() as page:
            await page.until(lambda b: b.kinds(1) and is_live(b) and b.states[-1]["zone"])
        hello, state = page.texts[0], page.states[-1]
        assert (hello["type"], hello["link"], hello["robot"]) == ("hello", at.server.end.url, None)
        assert {layer["name"] for layer in hello["layers"]} >= {"height", "variance", "slope"}
        assert set(state) == STATE
        assert set(state["zone"]) == ZONE
        assert set(state["pose"]) == {"x", "y", "yaw", "pitch", "roll", "v", "w"}
        assert [entry["name"] for entry in state["inputs"][:3]] == [
            "scanner", "attitude sensor", "encoders",
        ]  # fmt: skip
        assert state["advice"] == ["go", ""]
        header, cells = page.kinds(1)[-1]
        assert (header["size"], header["cell_m"]) == (9, 0.05)
        assert cells == bytes([1] * 9 + [2] + [0] * 71)

    with_site(test)


def test_what_is_not_heard_any_more_is_said_to_be_stale() -> None:
    async def test(at: Site) -> None:
        async with at.browser() as page:
            await page.until(lambda b: b.states)
            link = page.states[-1]["link"]
            assert (link["stale"], link["blank"], link["age_s"]) == (True, True, None)
            at.robot.begin(FREE_AND_OBSTACLE)
            await page.until(is_live)
            at.server.end.receiver.numbers.map_s -= 100.0  # as if a hundred seconds had passed
            await page.until(lambda b: b.states[-1]["link"]["stale"])
            assert page.states[-1]["link"]["age_s"] >= 100.0
            assert page.states[-1]["link"]["text"].startswith("STALE")

    with_site(test)


def test_a_stranger_gets_nothing_but_a_refusal() -> None:
    async def test(at: Site) -> None:
        port = at.url.rpartition(":")[2]
        strangers: list[dict[str, str]] = [
            {"Origin": "http://evil.example"},
            {"Origin": "http://localhost:" + port},
            {"Origin": "http://evil.example:" + port, "Host": "evil.example:" + port},
            {"Host": "evil.example:" + port},
        ]
        for headers in strangers:
            with pytest.raises(WSServerHandshakeError) as refused:
                await at.session.ws_connect(f"{at.url}/ws", headers=headers)
            assert refused.value.status == 403
            async with at.session.get(at.url, headers=headers) as answer:
                assert answer.status == 403
        async with at.session.get(f"{at.url}/../server.py") as answer:
            assert answer.status == 404
            assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
            assert answer.headers["Cache-Control"] == "no-cache"

    with_site(test)


def test_looking_from_elsewhere_needs_the_token_and_then_driving_needs_no_other() -> None:
    async def test(at: Site) -> None:
        for query in ("", "?token=", "?token=wrong"):
            async with at.browser(query) as page:
                message = await page.socket.receive()
                assert message.type is WSMsgType.CLOSE
                assert (message.data, message.extra) == (4401, "needs the token")
        at.robot.begin(FREE_AND_OBSTACLE)
        at.robot.tell_zone()
        async with at.browser(f"?token={TOKEN}") as page:
            await page.until(is_live)
            await page.drive(1.0, token="")
            await page.until(lambda _: at.robot.drives)
            assert page.of_type("error") == []

    with_site(test, host="0.0.0.0")


def test_driving_needs_the_token_and_who_guesses_is_shown_out() -> None:
    async def test(at: Site) -> None:
        at.robot.begin(FREE_AND_OBSTACLE)
        async with at.browser() as page:
            await page.until(is_live)
            for _ in range(6):
                await page.drive(1.0, token="wrong")
            assert await page.until_closed() == 1000
        async with at.browser() as page:
            await page.say(type="auth", token="wrong")
            await page.say(type="auth", token=TOKEN)
            await page.until(lambda b: len(b.of_type("auth")) == 2)
            assert [said["ok"] for said in page.of_type("auth")] == [False, True]
            assert at.robot.drives == []
            await page.drive(1.0, token="")
            await page.until(lambda _: at.robot.drives)

    with_site(test)


def test_where_motors_are_not_enabled_nothing_leaves_and_the_page_knows_why() -> None:
    async def test(at: Site) -> None:
        at.robot.begin(FREE_AND_OBSTACLE)
        async with at.browser() as page:
            await page.until(is_live)
            for _ in range(5):
                await page.drive(1.0)
            await page.until(lambda b: b.states[-1]["driving"]["why_not"] == "off")
        assert len(page.of_type("error")) == 1
        assert page.texts[0]["drive"] == {"allowed": False, "why": "off"}
        assert page.of_type("error")[0]["text"] == "not driven: off"
        assert at.robot.drives == []

    with_site(test, refusal="off")


@pytest.mark.parametrize("ends", ["closes", "falls silent", "stops"])
def test_whatever_becomes_of_the_page_the_robot_is_told_to_stop(
    ends: str, monkeypatch: Patch
) -> None:
    if ends != "falls silent":  # at once, not when the dead man's time is over
        monkeypatch.setattr(driving, "DEAD_MAN_S", 1e6)

    async def test(at: Site) -> None:
        at.robot.begin(FREE_AND_OBSTACLE)
        async with at.browser() as watching:
            async with at.browser() as page:
                at.robot.tell_zone()
                await page.drive(1.0, -0.5)
                await watching.until(lambda b: b.states and b.states[-1]["driving"]["by"])
                assert watching.states[-1]["driving"]["by"] == "another page"
                if ends == "stops":
                    await page.say(type="stop")
                if ends != "closes":
                    await watching.until(lambda _: (0, 0, 0) in at.robot.drives)
            await watching.until(lambda _: (0, 0, 0) in at.robot.drives)
            await watching.until(lambda b: b.states[-1]["driving"]["by"] is None)
        assert at.robot.drives[0][1:] == (-400, 300)
        assert set(at.robot.drives[1:]) == {(0, 0, 0)}

    with_site(test)


def test_two_pages_see_what_each_has_asked_for() -> None:
    async def test(at: Site) -> None:
        at.robot.begin(FREE_AND_OBSTACLE)
        async with at.browser() as one, at.browser() as other:
            await one.say(type="layers", names=["height", "state"])
            await one.say(type="cell", i=3, j=1)
            await one.until(lambda b: b.kinds(3) and b.of_type("cell"))
            seen = len(other.states)
            await other.until(lambda b: len(b.states) > seen + 3 and b.kinds(1))
        header, payload = one.kinds(3)[-1]
        assert (header["name"], header["unit"], len(payload)) == ("height", "m", 4 * 81)
        assert one.of_type("cell")[0]["height_m"] == pytest.approx(0.003)
        assert (other.kinds(3), other.of_type("cell")) == ([], [])

    with_site(test)


def test_a_page_that_does_not_keep_up_gets_the_newest_and_nothing_queues() -> None:
    async def test(at: Site) -> None:
        at.robot.begin(FREE_AND_OBSTACLE)
        async with at.browser(autoping=False) as slow, at.browser() as quick:
            await quick.until(lambda b: len(b.states) >= 15)
            pings, states = list[bytes](), 0
            while len(pings) < 3:
                message = await slow.socket.receive()
                states += message.type is WSMsgType.TEXT and '"state"' in message.data[:20]
                pings += [message.data] if message.type is WSMsgType.PING else []
            assert states <= 3
            for data in pings:
                await slow.socket.pong(data)
            await slow.until(lambda b: b.states)
            assert slow.states[0]["t_s"] >= quick.states[14]["t_s"]

    with_site(test)


def test_a_robot_that_starts_anew_begins_an_empty_map() -> None:
    async def test(at: Site) -> None:
        at.robot.begin(FREE_AND_OBSTACLE)
        async with at.browser() as page:
            await page.until(lambda b: b.kinds(1) and any(b.kinds(1)[-1][1]))
            before = page.kinds(1)[-1][0]["epoch"]
            again = Robot(at.server.end.url, session=77)
            again.begin()
            await page.until(lambda b: b.kinds(1)[-1][0]["epoch"] != before and is_live(b))
            assert not any(page.kinds(1)[-1][1])
            again.close()

    with_site(test)


def test_a_handshake_whose_key_is_no_text_is_refused_and_no_mistake_of_ours() -> None:
    async def test(at: Site) -> None:
        host = at.url.removeprefix("http://")
        reader, writer = await asyncio.open_connection(*host.split(":"))
        lines = [
            "GET /ws HTTP/1.1", f"Host: {host}", "Connection: Upgrade", "Upgrade: websocket",
            "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAA\xff\xff\xff\xffAAAAAA==",
        ]  # fmt: skip
        writer.write("\r\n".join([*lines, "", ""]).encode("latin-1"))
        assert (await reader.readline()).startswith(b"HTTP/1.1 400 ")
        writer.close()

    with_site(test)


def test_what_nobody_understands_gets_one_line_each_and_harms_nothing() -> None:
    async def test(at: Site) -> None:
        async with at.browser() as page:
            bad: list[str | bytes] = [
                "", "{", "[]", "null", '{"type":"fly"}', '{"type":"cell","i":1}', b"\x00\x01",
                '{"type":"layers","names":["warmth"]}', '{"type":"drive","v":9}',
            ]  # fmt: skip
            for number, message in enumerate(bad):
                if isinstance(message, bytes):
                    await page.socket.send_bytes(message)
                else:
                    await page.socket.send_str(message)
                await page.until_errors(number + 1)
            for _ in range(200):
                await page.say(type="cell", i=0, j=0)
            await page.say(type="history", t_s=1)
            await page.until_errors(len(bad) + 1)
            seen = len(page.states)
            await page.until(lambda b: len(b.states) > seen)
            assert "too many messages" in page.of_type("error")[-1]["text"]
            await page.socket.send_str("x" * 5000)
            assert await page.until_closed() == 1009  # too big
        async with at.browser() as page:
            await page.until(lambda b: b.states)

    with_site(test)


def test_a_page_that_opens_late_is_told_what_was() -> None:
    async def test(at: Site) -> None:
        at.robot.begin(FREE_AND_OBSTACLE)
        async with at.browser() as page:
            await page.until(lambda b: is_live(b) and b.kinds(1))
            asked_s = page.states[-1]["t_s"]
            at.robot.begin()
            again = Robot(at.server.end.url, session=77)
            again.begin()
            await page.until(lambda b: not any(b.kinds(1)[-1][1]))
            again.close()
        async with at.browser() as late:
            await late.until(lambda b: b.kinds(1))
            await late.say(type="history", t_s=asked_s)
            await late.until(lambda b: b.past)
            await late.until(lambda b: b.kinds(1)[-1][0].get("history"))
        assert late.past[0]["t_s"] == asked_s
        assert late.kinds(1)[-1][1] == bytes([1] * 9 + [2] + [0] * 71)

    with_site(test)
