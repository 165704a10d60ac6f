"""`make fuzz`, or `python -m tools.fuzz --target mti`: each target in a process of its own.

Inputs are guided by what code they reach, or long ones by chance (--streams). The first that
raises, hangs or fills the memory ends the target, and lies in fuzz-... then: --input runs it again.
With --count it is added to docs/fuzz.json and the table of docs/security.md; --tell prints that.
"""

import argparse
import gc
import importlib
import itertools
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from tools.fuzz import corpus, ledger
from tools.fuzz.ledger import GUIDED, STREAMS, Tally
from tools.fuzz.streams import streams
from tools.fuzz.targets import TARGETS, Target

ROOT = Path(__file__).resolve().parents[2]
FOUND = ROOT / "build" / "fuzz"  # inputs that reached something, of each target
WORDS = {name: target.what for name, target in TARGETS.items()}
HANG_S = 10
MOST_INPUT = 8192
COLLECT_EVERY = 20  # inputs: a device is a circle, and a depth camera's has 8 MB


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("--target", choices=(*TARGETS, "all"), default="all")
    parser.add_argument("--seconds", type=int, default=600, help="in all; 0: by --runs")
    parser.add_argument("--runs", type=int, default=2000, help="inputs for each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--streams", action="store_true", help="long inputs, by chance")
    parser.add_argument("--input", help="run one input again, say fuzz-crash-...")
    parser.add_argument("--count", action="store_true", help="add it to what was run so far")
    parser.add_argument("--keep", action="store_true", help="renew tests/vectors/fuzz afterwards")
    parser.add_argument("--tell", action="store_true", help="print what was run so far")
    parser.add_argument("--tally", type=Path, help=argparse.SUPPRESS)  # of a process of its own
    options = parser.parse_args()
    if options.tell:
        print(ledger.table(ledger.read(), WORDS))
        return 0
    if options.input:
        TARGETS[options.target].run(Path(options.input).read_bytes())
        return 0
    if options.tally:
        return run_one(options)
    return run_all(options)


def run_all(options: argparse.Namespace) -> int:
    """Each target in turn; the worst of their exit statuses."""
    names = list(TARGETS) if options.target == "all" else [options.target]
    if options.streams:
        names = [name for name in names if TARGETS[name].most]
    for name in names:
        if TARGETS[name].lacks:
            print(f"mapod: {name} is left out: it needs {TARGETS[name].lacks}", flush=True)
    names = [name for name in names if not TARGETS[name].lacks]
    seconds = max(1, options.seconds // len(names)) if options.seconds else 0
    common = ["--seconds", str(seconds), "--runs", str(options.runs), "--seed", str(options.seed)]
    common += ["--streams"] if options.streams else []
    worst = 0
    for name in names:
        print(f"mapod: fuzzing {name}", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            tally, begun_s = Path(folder) / "tally", time.monotonic()
            tally.write_bytes(bytes(ledger.COUNTS.size))
            again = [sys.executable, "-m", "tools.fuzz", "--target", name, "--tally", str(tally)]
            status = abs(subprocess.run([*again, *common], check=False).returncode)
            spent_s, (inputs, given) = time.monotonic() - begun_s, ledger.counted(tally)
        worst = max(worst, status)
        print(f"mapod: {name}: {inputs} inputs, {given} bytes in {spent_s:.0f} s", flush=True)
        if options.count:
            way = STREAMS if options.streams else GUIDED
            ledger.note(name, way, inputs, given, spent_s)
            ledger.write_table(WORDS)
        if options.keep and not status:
            print(f"mapod: {name}: {corpus.keep(name, [FOUND / name])} inputs are kept", flush=True)
    return worst


def run_one(options: argparse.Namespace) -> int:
    """In this process, until its time is over or it finds something."""
    target, tally = TARGETS[options.target], Tally.at(options.tally)
    folder = FOUND / options.target if options.seconds else options.tally.with_name("inputs")
    folder.mkdir(parents=True, exist_ok=True)
    target.write_seeds(folder)
    for path in corpus.kept(options.target):
        (folder / path.name).write_bytes(path.read_bytes())
    gc.collect()
    gc.freeze()

    def one_input(data: bytes) -> None:
        target.run(data)
        tally.add(len(data))
        if tally.inputs % COLLECT_EVERY == 0:
            gc.collect()

    if options.streams:
        return run_streams(options, one_input)
    atheris: Any = importlib.import_module("atheris")  # no wheel for some processors, no types
    for module in watched(target):
        mark(atheris, module)
    limits = [f"-max_total_time={options.seconds}"] if options.seconds else []
    limits += [] if options.seconds else [f"-runs={options.runs}"]
    flags = [f"-seed={options.seed}", f"-max_len={MOST_INPUT}", f"-timeout={HANG_S}"]
    flags += ["-rss_limit_mb=2048", "-print_final_stats=1", f"-artifact_prefix={ROOT}/fuzz-"]
    atheris.Setup([sys.argv[0], *limits, *flags, str(folder)], one_input)
    atheris.Fuzz()  # ends the process
    return 1


def run_streams(options: argparse.Namespace, one_input: Any) -> int:
    """Long inputs by chance; 1 at the first that raises or hangs, which is written down."""
    target, end_s = TARGETS[options.target], time.monotonic() + options.seconds
    running = ROOT / f"fuzz-stream-{options.target}"  # stays where a run ends in its middle
    with tempfile.TemporaryDirectory() as seeds:
        target.write_seeds(Path(seeds))
        paths = [*sorted(Path(seeds).iterdir()), *corpus.kept(options.target)]
        given = [path.read_bytes() for path in paths]
    for number, data in enumerate(streams(given, options.seed, target.most, target.joined)):
        if time.monotonic() >= end_s if options.seconds else number >= options.runs:
            break
        signal.alarm(HANG_S)
        running.write_bytes(data)
        one_input(data)
        signal.alarm(0)
    running.unlink(missing_ok=True)
    return 0


def watched(target: Target) -> Iterator[ModuleType]:
    """The modules that are loaded of what a target watches."""
    for name, module in sorted(sys.modules.items()):
        if any(name == one or name.startswith(f"{one}.") for one in target.marked):
            yield module


def mark(atheris: Any, module: ModuleType) -> None:
    """Let each function of a module tell where it goes; kernels are as before."""
    classes = [one for one in vars(module).values() if isinstance(one, type)]
    mine = [one for one in classes if one.__module__ == module.__name__]
    for found in itertools.chain([vars(module)], map(vars, mine)):
        for value in list(found.values()):
            for function in functions_of(value):
                if function.__module__ == module.__name__:
                    atheris.instrument_func(function)


def functions_of(value: object) -> list[FunctionType]:
    """A function, or those of a property, a class method or a static method."""
    if isinstance(value, property):
        return [one for one in (value.fget, value.fset) if isinstance(one, FunctionType)]
    value = getattr(value, "__func__", value)
    return [value] if isinstance(value, FunctionType) else []


if __name__ == "__main__":
    sys.exit(main())
