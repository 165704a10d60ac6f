"""The timer of the loop: it rings at its instant, not before, and keeps nobody else waiting."""

import asyncio
import time

from hw.runtime.timer import Timer


def test_it_rings_at_each_instant_and_never_before() -> None:
    async def run() -> list[float]:
        timer, early_s = Timer(asyncio.get_running_loop()), []
        due_s = time.monotonic()
        for _ in range(20):
            due_s += 0.002
            await timer.wait_until(due_s)
            early_s.append(due_s - time.monotonic())
        timer.close()
        return early_s

    assert max(asyncio.run(run())) <= 0.0


def test_others_go_on_while_it_waits_and_when_its_instant_is_past() -> None:
    async def run() -> None:
        timer, turns = Timer(asyncio.get_running_loop()), 0

        async def other() -> None:
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0)

        waiting = asyncio.create_task(timer.wait_until(time.monotonic() + 3600.0))
        task = asyncio.create_task(other())
        while turns < 5:
            await asyncio.sleep(0)
        assert not waiting.done()
        waiting.cancel()
        for instant_s in (time.monotonic() - 1.0, time.monotonic() - 1.0, 0.0):
            before = turns
            await timer.wait_until(instant_s)
            assert turns > before
        task.cancel()
        timer.close()

    asyncio.run(run())
