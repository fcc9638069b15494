"""`python -m workers.ros2 interfaces --out FOLDER`: the ROS 2 package of all drivers' actions."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from drivers.catalog.inspect import PACKAGE as DRIVERS
from drivers.catalog.scan import scan
from labweb.domain.enrollment.driver_spec import DriverSpec
from workers.ros2.mapping import PACKAGE, action_name, action_text, offered_actions

_BUILD = """cmake_minimum_required(VERSION 3.8)
project({package})
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(${{PROJECT_NAME}}
{files}
)
ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""
_PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>{version}</version>
  <description>Actions of labweb's drivers</description>
  <maintainer email="root@localhost">labweb</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>action_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""


def files_of(specs: Sequence[DriverSpec]) -> dict[str, str]:
    """Return the package, by path."""
    actions = {
        f"action/{action_name(spec, action).rpartition('/')[2]}.action": action_text(action)
        for spec in specs
        for action in offered_actions(spec)
    }
    listed = "\n".join(f'  "{path}"' for path in sorted(actions))
    return {
        **{path: f"{text}\n" for path, text in actions.items()},
        "CMakeLists.txt": _BUILD.format(package=PACKAGE, files=listed),
        "package.xml": _PACKAGE.format(package=PACKAGE, version=version("labweb")),
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m workers.ros2", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    interfaces = commands.add_parser("interfaces", help="write the package of the actions")
    interfaces.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args(argv)
    for path, text in files_of(scan(DRIVERS).drivers).items():
        target = arguments.out / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
    sys.stdout.write(f"{arguments.out} holds the package {PACKAGE}: build it with colcon\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
