"""Play schedules: `python -m tests.simulation --seeds 0..9999 --jobs 2`; one seed, one schedule."""

from __future__ import annotations

import argparse
import gc
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import Pool

from tests.simulation import aborts, batches, clocks, halts, holding, schedule, vanishing
from tests.simulation.checks import ViolationError

BLOCK = 500
Run = Callable[..., object]


def play(seeds: range, run: Run = schedule.run) -> list[tuple[int, str]]:
    """Play a block of schedules; return what was violated."""
    found = []
    # Worlds are small and short-lived: looking for their cycles all the time costs a tenth.
    gc.disable()
    try:
        for seed in seeds:
            if seed % 200 == 0:
                gc.collect()
            problem = _play_one(seed, run)
            if problem is not None:
                found.append((seed, problem))
    finally:
        gc.enable()
    return found


def _play_one(seed: int, run: Run) -> str | None:
    try:
        run(seed)
    except ViolationError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - a crash of the rules is a finding too
        return f"{type(error).__name__}: {error}"
    return None


def show(seed: int, run: Run = schedule.run) -> bool:
    """Play one schedule and print all that happens."""
    trace: list[str] = []
    try:
        run(seed, trace=trace)
    except ViolationError as error:
        trace.append(f"seed {seed}: {error}")
        is_good = False
    else:
        trace.append(f"seed {seed}: nothing is violated")
        is_good = True
    print("\n".join(trace))
    return is_good


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tests.simulation", description=__doc__)
    parser.add_argument("--seeds", default="0..9999", help="A..B, both included, or one seed")
    parser.add_argument("--jobs", type=int, default=1, help="how many processes")
    parser.add_argument("--trace", action="store_true", help="print the first violation's schedule")
    parser.add_argument("--batches", action="store_true", help="runs that go in batches")
    parser.add_argument("--halts", action="store_true", help="devices that are halted")
    parser.add_argument("--aborts", action="store_true", help="runs aborted, devices stopped")
    parser.add_argument("--holds", action="store_true", help="runs that keep what they use")
    parser.add_argument("--lost", action="store_true", help="devices that lose what was set")
    parser.add_argument("--clocks", action="store_true", help="hosts whose clocks are set")
    arguments = parser.parse_args(argv)
    wanted = (
        (arguments.batches, batches.run),
        (arguments.halts, halts.run),
        (arguments.aborts, aborts.run),
        (arguments.holds, holding.run),
        (arguments.lost, vanishing.run),
        (arguments.clocks, clocks.run),
    )
    run: Run = next((play_one for is_asked, play_one in wanted if is_asked), schedule.run)
    first, _, last = arguments.seeds.partition("..")
    if not last:
        return 0 if show(int(first), run) else 1
    seeds = range(int(first), int(last) + 1)
    blocks = [seeds[at : at + BLOCK] for at in range(0, len(seeds), BLOCK)]
    began_s = time.monotonic()
    found: list[tuple[int, str]] = []
    with Pool(arguments.jobs) as pool:
        for number, block in enumerate(pool.imap(partial(play, run=run), blocks), start=1):
            found += block
            if number % 20 == 0:
                done = min(number * BLOCK, len(seeds))
                rate = done / (time.monotonic() - began_s)
                print(f"{done} seeds, {rate:.0f} a second, {len(found)} violations", flush=True)
    took_s = time.monotonic() - began_s
    rate = len(seeds) / took_s
    print(f"seeds {arguments.seeds}: {len(seeds)} in {took_s:.1f} s, {rate:.0f} a second, ", end="")
    print(f"{len(found)} violations")
    for seed, text in found[:20]:
        print(f"  seed {seed}: {text}")
    if found and arguments.trace:
        show(found[0][0], run)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
