"""``rgbd-glue params``: the parameters of the method and of the node."""

from __future__ import annotations

import argparse

from rgbd_glue_ros.cli import arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """One parameter, or the configuration of all."""
    parser.add_argument(
        "name",
        metavar="NAME",
        nargs="?",
        help="parameter or section to explain, such as glue.k or glue; also of the node",
    ).completer = arguments.parameter_names  # type: ignore[attr-defined]
    arguments.add_config(parser)
    parser.add_argument(
        "--node", action="store_true", help="print the parameters that only the ROS node has"
    )
    parser.add_argument("--markdown", action="store_true", help="print a table, not YAML")


def run(args: argparse.Namespace) -> str:
    """The configuration as YAML or as a table, or the description of some parameters."""
    from rgbd_glue_ros.parameters import NodeConfig, explain, to_markdown, to_yaml

    config = arguments.config(args)
    if args.name:
        return explain(args.name, config)
    shown = NodeConfig() if args.node else config
    return to_markdown(shown) if args.markdown else to_yaml(shown)
