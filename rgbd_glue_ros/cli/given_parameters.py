"""The parameters that ``--preset``, ``--set`` and ``--depth-scale`` give to a command."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rgbd_glue_ros.errors import InputError

if TYPE_CHECKING:
    from rgbd_glue_ros.parameters import Config, InputConfig


def config(args: argparse.Namespace) -> Config:
    """The preset with the method's parameters in ``--set``.

    Raises:
        InputError: there is no such preset or parameter, or a value is not allowed.
    """
    from rgbd_glue_ros.parameters import Config, InputConfig, load_preset, load_yaml, with_values

    of_inputs, of_method = _assigned(args)
    with_values(InputConfig(), of_inputs)
    file = _preset_file(args)
    preset = load_yaml(file, Config()) if file else load_preset(args.preset)
    return with_values(preset, of_method)


def inputs_of(args: argparse.Namespace) -> InputConfig:
    """The parameters of the inputs in ``--set`` and the options.

    Raises:
        InputError: a parameter is not known, or a value not allowed.
    """
    from rgbd_glue_ros.parameters import Config, InputConfig, load_yaml, with_values

    of_inputs, of_method = _assigned(args)
    with_values(Config(), of_method)
    if args.depth_scale is not None:
        of_inputs["depth_scale"] = args.depth_scale
    file = _preset_file(args)
    return with_values(load_yaml(file, InputConfig()) if file else InputConfig(), of_inputs)


def _preset_file(args: argparse.Namespace) -> Path | None:
    """The file given as ``--preset``; None if it is a name, or the command has no preset."""
    preset = Path(vars(args).get("preset", ""))
    return preset if preset.suffix in (".yaml", ".yml") else None


def _assigned(args: argparse.Namespace) -> tuple[dict[str, object], dict[str, object]]:
    """The parameters in ``--set``, separated into those of the inputs and of the method."""
    from rgbd_glue_ros.parameters import (
        Config,
        InputConfig,
        NodeConfig,
        by_current_names,
        parse_assignment,
        unknown_parameter,
        values,
    )

    # some commands read recordings and have no parameters
    given = by_current_names(dict(map(parse_assignment, vars(args).get("set", ()))))
    own = values(InputConfig())
    declared = {**own, **values(Config())}
    for name in given:
        if name in declared:
            continue
        if name in values(NodeConfig()):
            raise InputError(
                name,
                "is a parameter of the node only",
                f"give it to the node: --ros-args -p {name}:=VALUE",
            )
        raise unknown_parameter(name, declared)
    of_inputs = {name: value for name, value in given.items() if name in own}
    return of_inputs, {name: value for name, value in given.items() if name not in own}
