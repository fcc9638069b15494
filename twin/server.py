"""The twin process: `python -m twin.server --config twin.json`. Only this file knows viser."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import viser

from labweb.domain.errors import LabError
from twin import camera, palette
from twin.frames import Vector
from twin.palette import Role, Theme
from twin.scene import Caption, DrawnTube, Scene, Surface, Thing, describe
from twin.state import TwinLabView
from twin.sync import STALE_AFTER_S, FeedClient, read_config

logger = logging.getLogger(__name__)

_M_PER_MM = 0.001
_TICK_S = 0.1
_TUBE_M = 0.0026
_ASPECT = 1.6
_FROZEN = "/not live"
_SELECTED = "/selected"
_ROUTE_M = 0.005
_MOST_IN_ROUTE = 500


class Viewer(viser.ViserServer):
    """viser without its public tunnel: nobody can send the scene out of the building."""

    def request_share_url(self, verbose: bool = True) -> str | None:  # noqa: FBT001, FBT002 - viser's shape
        """Refuse, whoever asks; any browser could ask."""
        del verbose
        logger.warning("a request to publish the scene was refused")
        return None

    def disconnect_share_url(self) -> None:
        """Do nothing: there is never a tunnel."""


class Painter:
    """One viser server that shows the scene in one theme."""

    def __init__(self, theme: Theme) -> None:
        """Start a server on a free port of the loopback interface."""
        self.theme = theme
        self.scene = Scene()
        self._drawn = Scene()
        self._nodes: dict[str, Any] = {}
        self._server = Viewer(host="127.0.0.1", port=0, verbose=False)
        self.port = self._server.get_port()
        self._set_up()

    def _set_up(self) -> None:
        server = self._server
        server.gui.configure_theme(
            dark_mode=self.theme == "dark",
            show_share_button=False,
            show_logo=False,
            control_width="small",
            brand_color=palette.colour(self.theme, Role.RUN),
        )
        server.gui.set_panel_label("View")
        for name in camera.VIEWS:
            self._add_view(name)
        ground = np.full((2, 2, 3), palette.colour(self.theme, Role.GROUND), dtype=np.uint8)
        server.scene.set_background_image(ground, format="png")
        server.scene.configure_default_lights(enabled=True, cast_shadow=True)
        server.on_client_connect(self._welcome)

    def _welcome(self, client: viser.ClientHandle) -> None:
        """Give one person a view of the lab, and a hidden field that says which route to show."""
        self.look(client, "overview")
        field = client.gui.add_text("Route", "")
        drawn: list[Any] = []

        @field.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            del event
            while drawn:
                drawn.pop().remove()
            drawn.extend(self._draw_route(client, route_of(field.value)))

    def _draw_route(self, client: viser.ClientHandle, keys: list[str]) -> Iterator[Any]:
        """Light tubes for one person, and for nobody else; what is no tube is left out."""
        for key in keys:
            tube = self.scene.tubes.get(key)
            if tube is not None:
                yield self._spline(client, _name(key, "route"), tube, _ROUTE_M, Role.RUN)

    def _add_view(self, name: str) -> None:
        button = self._server.gui.add_button(name.capitalize())

        @button.on_click
        def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self.look(event.client, name)

    def look(self, client: viser.ClientHandle, name: str) -> None:
        """Move one person's camera so that the lab fills their picture."""
        found = camera.view(name, self.scene.low_mm, self.scene.high_mm, client.camera.aspect)
        with client.atomic():
            client.camera.fov = camera.FOV_RAD
            client.camera.position = _metres(found.position_mm)
            client.camera.look_at = _metres(found.look_at_mm)

    @property
    def clients_count(self) -> int:
        """How many pages show this scene."""
        return len(self._server.get_clients())

    def stop(self) -> None:
        """End the server."""
        self._server.stop()

    def paint(self, scene: Scene) -> None:
        """Bring what is shown in line with a scene; what did not change is not sent."""
        is_first = not self._drawn.things
        self.scene = scene
        with self._server.atomic():
            for key in self._drawn.things.keys() - scene.things.keys():
                self._remove(_name(key))
            for key, thing in scene.things.items():
                self._paint_thing(self._drawn.things.get(key), thing)
            self._paint_tubes(scene)
            self._paint_captions(scene)
        self._drawn = scene
        if is_first:
            self._aim()

    def _aim(self) -> None:
        first = camera.view("overview", self.scene.low_mm, self.scene.high_mm, _ASPECT)
        self._server.initial_camera.fov = camera.FOV_RAD
        self._server.initial_camera.position = _metres(first.position_mm)
        self._server.initial_camera.look_at = _metres(first.look_at_mm)
        for client in self._server.get_clients().values():
            self.look(client, "overview")

    def _paint_thing(self, old: Thing | None, new: Thing) -> None:
        if old == new:
            return
        name = _name(new.key)
        if old is None or old.frame != new.frame:
            self._nodes[name] = self._server.scene.add_frame(
                name,
                show_axes=False,
                wxyz=new.frame.wxyz,
                position=_metres(new.frame.position_mm),
            )
            old = None
        before = {} if old is None else {surface.name: surface for surface in old.surfaces}
        wanted = {surface.name: surface for surface in new.surfaces}
        for gone in before.keys() - wanted.keys():
            self._remove(f"{name}/{gone}")
        is_ghost = new.state == "offline"
        for surface in new.surfaces:
            same = before.get(surface.name)
            if same != surface or (old is not None and (old.state == "offline") != is_ghost):
                self._paint_surface(new, surface, same, is_ghost=is_ghost)

    def _paint_surface(
        self, thing: Thing, new: Surface, old: Surface | None, *, is_ghost: bool
    ) -> None:
        name = f"{_name(thing.key)}/{new.name}"
        mesh = new.mesh.for_display
        handle = self._nodes.get(name)
        colour = self._colour(new)
        opacity = self._opacity(new.role, is_ghost=is_ghost)
        if (
            old is not None
            and handle is not None
            and old.mesh.for_display.vertices_mm.shape == mesh.vertices_mm.shape
            and np.array_equal(old.mesh.for_display.faces, mesh.faces)
        ):
            handle.vertices = mesh.vertices_mm * _M_PER_MM
            handle.color, handle.opacity = colour, opacity
            return
        handle = self._server.scene.add_mesh_simple(
            name,
            mesh.vertices_mm * _M_PER_MM,
            mesh.faces,
            color=colour,
            opacity=opacity,
            side="double" if new.role is Role.GLASS else "front",
            cast_shadow=new.role not in {Role.GLASS, Role.LIQUID, Role.RUN, Role.DOUBT, Role.OFF},
        )
        self._nodes[name] = handle
        key = thing.key
        handle.on_click(lambda event: self._select(event.client, key))

    def _select(self, client: viser.ClientHandle, key: str) -> None:
        """Name a thing for the person who clicked on it, and for nobody else."""
        thing = self.scene.things.get(key)
        if thing is None:
            return
        at = thing.frame.to_room((0.0, 0.0, thing.height_mm + 24.0))
        client.scene.add_label(_SELECTED, thing.title, position=_metres(at), anchor="bottom-left")

    def _colour(self, surface: Surface) -> palette.Rgb:
        if surface.role is Role.LIQUID:
            return palette.liquid(self.theme, dict(surface.lots))
        return palette.colour(self.theme, surface.role)

    def _opacity(self, role: Role, *, is_ghost: bool) -> float | None:
        if role is Role.GLASS:
            return palette.GLASS_OPACITY[self.theme]
        return palette.GHOST_OPACITY if is_ghost and role is not Role.OFF else None

    def _paint_tubes(self, scene: Scene) -> None:
        for key in self._drawn.tubes.keys() - scene.tubes.keys():
            self._remove(_name(key, "tube"))
        for key, tube in scene.tubes.items():
            if self._drawn.tubes.get(key) != tube:
                self._paint_tube(tube)

    def _paint_tube(self, tube: DrawnTube) -> None:
        name = _name(tube.key, "tube")
        self._nodes[name] = self._spline(self._server, name, tube, _TUBE_M, Role.TUBE)

    def _spline(
        self,
        owner: Viewer | viser.ClientHandle,
        name: str,
        tube: DrawnTube,
        thick_m: float,
        role: Role,
    ) -> Any:  # noqa: ANN401 - a handle of viser
        return owner.scene.add_spline_catmull_rom(
            name,
            np.asarray(tube.points_mm, dtype=np.float32) * _M_PER_MM,
            curve_type="centripetal",
            thickness=thick_m,
            thickness_units="world",
            color=palette.colour(self.theme, role),
            segments=12 * len(tube.points_mm),
        )

    def _paint_captions(self, scene: Scene) -> None:
        for key in self._drawn.captions.keys() - scene.captions.keys():
            self._remove(_name(key, "caption"))
        for key, caption in scene.captions.items():
            if self._drawn.captions.get(key) != caption:
                self._paint_caption(_name(key, "caption"), caption)

    def _paint_caption(self, name: str, caption: Caption) -> None:
        self._nodes[name] = self._server.scene.add_label(
            name, caption.text, position=_metres(caption.at_mm), anchor="bottom-center"
        )

    def freeze(self, silence_s: float | None) -> None:
        """Say in the scene itself that the picture is old; None says that it is live."""
        if silence_s is None:
            self._remove(_FROZEN)
            return
        low, high = self.scene.low_mm, self.scene.high_mm
        at = ((low[0] + high[0]) / 2.0, low[1], high[2] + 80.0)
        self._paint_caption(_FROZEN, Caption(_FROZEN, f"Not live for {silence_s:.0f} s", at))

    def _remove(self, name: str) -> None:
        for known in [n for n in self._nodes if n == name or n.startswith(f"{name}/")]:
            self._nodes.pop(known).remove()


def route_of(text: str) -> list[str]:
    """Read the keys of tubes that a page asks for; what is no list of them asks for nothing."""
    try:
        told = json.loads(text or "[]")
    except (ValueError, RecursionError):
        return []
    keys = told if isinstance(told, list) else []
    return list(dict.fromkeys(key for key in keys if isinstance(key, str)))[:_MOST_IN_ROUTE]


def _name(key: str, group: str = "") -> str:
    """Return the node's name: the resource's key, so that anyone can find it."""
    plain = quote(key, safe=" ")
    return f"/{group}/{plain}" if group else f"/{plain}"


def _metres(point_mm: Vector) -> Vector:
    x, y, z = (value * _M_PER_MM for value in point_mm)
    return x, y, z


class Twin:
    """The painters, and what they are fed with."""

    def __init__(self, config_path: Path) -> None:
        """Read the configuration and start one viewer for each theme."""
        config, token = read_config(config_path)
        self._view = TwinLabView()
        self._painters = {theme: Painter(theme) for theme in palette.THEMES}
        self._feed = FeedClient(config, token, self._view, self._alive)

    def _alive(self) -> dict[str, Any]:
        silence_s = self._feed.silence_s()
        return {
            "ports": {theme: painter.port for theme, painter in self._painters.items()},
            "is_fresh": silence_s is not None and silence_s <= STALE_AFTER_S,
            "clients_count": sum(painter.clients_count for painter in self._painters.values()),
        }

    async def run(self) -> None:
        """Follow the feed and paint until a signal."""
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stop.set)
        tasks = [asyncio.create_task(self._feed.run()), asyncio.create_task(self._paint())]
        ending = asyncio.create_task(stop.wait())
        done, _ = await asyncio.wait([*tasks, ending], return_when=asyncio.FIRST_COMPLETED)
        for task in (*tasks, ending):
            task.cancel()
        for painter in self._painters.values():
            await asyncio.to_thread(painter.stop)
        for task in done - {ending}:
            task.result()

    async def _paint(self) -> None:
        shown = 0
        told_s = 0.0
        while True:
            snapshot = self._view.snapshot
            if snapshot is not None and shown != self._view.version:
                shown = self._view.version
                scene = describe(snapshot)
                for painter in self._painters.values():
                    await asyncio.to_thread(painter.paint, scene)
            told_s = self._tell_age(told_s)
            await asyncio.sleep(_TICK_S)

    def _tell_age(self, told_s: float) -> float:
        silence_s = self._feed.silence_s() or 0.0
        if silence_s <= STALE_AFTER_S:
            if told_s:
                for painter in self._painters.values():
                    painter.freeze(None)
            return 0.0
        if silence_s - told_s >= 1.0:
            for painter in self._painters.values():
                painter.freeze(silence_s)
            return silence_s
        return told_s


def main(arguments: list[str] | None = None) -> int:
    """Run the twin until a signal and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m twin.server", description=__doc__)
    parser.add_argument("--config", type=Path, required=True)
    given = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s %(message)s")
    try:
        twin = Twin(given.config)
    except LabError as error:
        sys.stderr.write(f"twin: {error}\n")
        return 1
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(twin.run())
    return 0


if __name__ == "__main__":
    sys.exit(main())
