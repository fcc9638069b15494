"""The strokes of a chain of syringes, pipelined: while one fills, the one before it empties.

For four hops (into pump 1, 1 to 2, 2 to 3, out of 3) and three strokes::

    slot      0     1     2     3     4     5     6     7
    stroke 1  in    1▸2   2▸3   out
    stroke 2              in    1▸2   2▸3   out
    stroke 3                          in    1▸2   2▸3   out
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import TypedDict

from labweb.domain.graph.elements import ElementRole
from labweb.domain.graph.port_network import Hop, Network
from labweb.domain.graph.syringe_chain import SyringeChain
from labweb.domain.workflows.passes.liquids.stroke_splitting import split_strokes


class DeviceCommand(TypedDict):
    """One device told to do one thing, as it is written in an answer."""

    device: str
    action: str
    parameters: dict[str, str | float]


Group = list[DeviceCommand]
"""Commands that run at the same time."""


def find_interval(hops: Sequence[Hop]) -> int:
    """Return the fewest slots between two strokes that never let two of them meet.

    Strokes that are `n` intervals apart are in hops that lie `n` intervals apart, so no two
    hops that share an element may lie a multiple of the interval apart.
    """
    places: dict[int, list[int]] = {}
    for place, hop in enumerate(hops):
        for index in hop.elements:
            places.setdefault(index, []).append(place)
    shared = {tuple(found) for found in places.values() if len(found) > 1}
    apart = {b - a for found in shared for a, b in combinations(found, 2)}
    return next(n for n in range(1, len(hops) + 2) if not any(gap % n == 0 for gap in apart))


def make_groups(
    network: Network,
    chain: SyringeChain,
    amount_nl: int,
    syringe_nl: int,
    rates_ul_s: Sequence[float],
) -> Iterator[Group]:
    """Yield the groups of commands that move an amount along a chain.

    `rates_ul_s` has one rate for each hop. Valves are turned while no plunger moves on
    their way, each only when this plan has not turned it there already. A solenoid is opened
    after the valves are turned, for the hops that need it, and closed before they turn
    again. Every syringe is empty before and after.
    """
    parts = split_strokes(amount_nl, syringe_nl)
    interval = find_interval(chain.hops)
    last = interval * (len(parts) - 1) + len(chain.hops) - 1
    standing: dict[int, str] = {}
    opened: set[int] = set()
    for slot in range(last + 1):
        newest = min(slot // interval, len(parts) - 1)
        oldest = max(0, -(-(slot - len(chain.hops) + 1) // interval))
        active = [(slot - stroke * interval, parts[stroke]) for stroke in range(oldest, newest + 1)]
        hops = [chain.hops[place] for place, _ in active]
        yield from _set(network, hops, standing, opened)
        yield [
            command
            for place, nl in active
            for command in _move(network, chain.hops[place], nl, rates_ul_s[place])
        ]
    if opened:
        yield [_say(network, index, "close") for index in sorted(opened)]


def _set(
    network: Network, hops: Sequence[Hop], standing: dict[int, str], opened: set[int]
) -> Iterator[Group]:
    """Yield what is closed, then what is turned, then what is opened, each when there is any."""
    wanted = {index: position for hop in hops for index, position in hop.settings}
    solenoids = {i for i in wanted if network.elements[i].role is ElementRole.SOLENOID}
    turned = {
        index: position
        for index, position in wanted.items()
        if index not in solenoids and standing.get(index) != position
    }
    if opened - solenoids:
        yield [_say(network, index, "close") for index in sorted(opened - solenoids)]
    if turned:
        yield [
            DeviceCommand(
                device=network.elements[index].key,
                action="set_port",
                parameters={"port": position},
            )
            for index, position in turned.items()
        ]
    if solenoids - opened:
        yield [_say(network, index, "open") for index in sorted(solenoids - opened)]
    standing |= turned
    opened.clear()
    opened |= solenoids


def _say(network: Network, index: int, action: str) -> DeviceCommand:
    return DeviceCommand(device=network.elements[index].key, action=action, parameters={})


def _move(network: Network, hop: Hop, amount_nl: int, rate_ul_s: float) -> Iterator[DeviceCommand]:
    for index, action in ((hop.start, "dispense"), (hop.end, "aspirate")):
        element = network.elements[index]
        if element.role is ElementRole.PUMP:
            yield DeviceCommand(
                device=element.key,
                action=action,
                parameters={"volume_ul": amount_nl / 1000, "rate_ul_s": rate_ul_s},
            )
