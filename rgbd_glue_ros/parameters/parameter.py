"""The declaration of a parameter, and configurations, which are trees of parameters.

A configuration is a frozen tree of dataclasses; a parameter's dotted name (``glue.k``) is its path
in that tree.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from numbers import Integral, Real
from typing import Any, TypeVar, cast

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.parameters.aliases import by_current_names
from rgbd_glue_ros.parameters.checks import Check
from rgbd_glue_ros.types.checks import check_class

Value = bool | int | float | str
C = TypeVar("C")


@dataclass(frozen=True)
class Parameter:
    """The declaration of one parameter.

    Attributes:
        name: dotted name.
        default: default value; its type is the parameter's type.
        description: what it means, one or two sentences.
        unit: SI unit or other unit; "" for a pure number or text.
        minimum: least allowed value, None if unbounded.
        maximum: greatest allowed value, None if unbounded.
        choices: allowed texts; empty if any text is allowed.
        fixed: why it cannot change while the node runs; "" if it can.
        check: additional check of the value as a text; None if there is none.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    fixed: str = ""
    check: Check | None = None

    @property
    def type(self) -> type:
        """bool, int, float or str."""
        return type(self.default)

    def convert(self, value: object) -> Value:
        """``value`` as this parameter's type.

        Raises:
            InputError: ``value`` has the wrong type, is out of range, or not among the choices.
        """
        # numbers may be NumPy's
        if self.type is float and not isinstance(value, bool) and isinstance(value, Real):
            value = float(value)
        if self.type is int and not isinstance(value, bool) and isinstance(value, Integral):
            value = int(value)
        if self.type is float and isinstance(value, str):
            # YAML 1.1 reads 1e-3 as a text, since it has no dot
            with suppress(ValueError):
                value = float(value)
        if self.type is str and isinstance(value, bool):
            # YAML 1.1 reads none of our texts as a bool, but does so with a user's "no" or "off"
            raise InputError(self.name, f"{value} is not a text", f"give {self.allowed}")
        if not isinstance(value, self.type) or (self.type is int and isinstance(value, bool)):
            raise InputError(
                self.name, f"{value!r} is not of type {self.type.__name__}", f"give {self.allowed}"
            )
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            too_low = self.minimum is not None and not value >= self.minimum
            too_high = self.maximum is not None and not value <= self.maximum
            if too_low or too_high:
                raise InputError(self.name, f"{value} is out of range", f"give {self.allowed}")
        if self.choices and value not in self.choices:
            near = difflib.get_close_matches(str(value), map(str, self.choices), n=1)
            hint = f"did you mean {near[0]}? Otherwise " if near else ""
            raise InputError(self.name, f"{value!r} is not known", f"{hint}give {self.allowed}")
        fault = self.check.fault(str(value)) if self.check else None
        if fault:
            raise InputError(self.name, fault, f"give {self.allowed}")
        return cast(Value, value)

    @property
    def allowed(self) -> str:
        """The allowed values, in words."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        if self.check:
            return self.check.allowed
        words = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}
        text = words[self.type]
        if self.minimum is not None and self.maximum is not None:
            text += f" from {self.minimum:g} to {self.maximum:g}"
        elif self.minimum is not None:
            text += f" of at least {self.minimum:g}"
        elif self.maximum is not None:
            text += f" of at most {self.maximum:g}"
        return text + (f" ({self.unit})" if self.unit else "")


# Choices that programs which use the package have added to parameters, by full name.
_added: dict[str, tuple[str, ...]] = {}


def add_choice(name: str, choice: str) -> None:
    """Adds an allowed text to a parameter (dotted name), in this process."""
    _added[name] = (*_added.get(name, ()), choice)


def parameter(default: Value, description: str, **declaration: Any) -> Any:
    """The field of a configuration that is a parameter.

    Args:
        default: as in ``Parameter``, like the rest.
        description: what it means.
        **declaration: unit, minimum, maximum, choices, fixed and check.
    """
    return field(
        default=default,
        metadata={"parameter": Parameter("", default, description, **declaration)},
    )


def section(config_class: type, *, fixed: str = "") -> Any:
    """The field of a configuration that is a part of it.

    Args:
        config_class: a configuration.
        fixed: why none of its parameters can change while the node runs; "" leaves it to them.
    """
    return field(default_factory=config_class, metadata={"fixed": fixed})


def parameters(config: object, prefix: str = "") -> Iterator[Parameter]:
    """The declarations of all parameters of a configuration (class or instance), in order."""
    for item in fields(config):  # type: ignore[arg-type]
        if "parameter" in item.metadata:
            declared, name = item.metadata["parameter"], prefix + item.name
            yield replace(declared, name=name, choices=declared.choices + _added.get(name, ()))
            continue
        fixed = item.metadata["fixed"]
        for inner in parameters(_section_class(item), f"{prefix}{item.name}."):
            yield replace(inner, fixed=inner.fixed or fixed)


def _section_class(item: Field[Any]) -> Any:
    return item.default_factory


def values(config: object) -> dict[str, Value]:
    """The dotted name and value of every parameter of a configuration, in order."""
    by_name: dict[str, Value] = {}
    for item in fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        if is_dataclass(value):
            by_name.update({f"{item.name}.{name}": v for name, v in values(value).items()})
        else:
            by_name[item.name] = value
    return by_name


def check_changes(before: object, after: object) -> None:
    """Refuses changes of parameters that are fixed while frames are tracked.

    Args:
        before: the configuration in use.
        after: one of the same class.

    Raises:
        InputError: a fixed parameter has another value.
    """
    given, wanted = values(before), values(after)
    for parameter in parameters(before):
        name = parameter.name
        if parameter.fixed and given[name] != wanted[name]:
            cause = f"cannot change from {given[name]!r} to {wanted[name]!r}: {parameter.fixed}"
            raise InputError(name, cause, "set it before the first frame")


def with_values(config: C, changes: Mapping[str, object]) -> C:
    """The configuration with the parameters in ``changes`` (dotted names or aliases) set.

    Raises:
        InputError: an unknown name, or a value of the wrong type or out of range.
    """
    check_class("with_values.changes", changes, Mapping, "{'glue.k': 3.0} or the like")
    declared = {p.name: p for p in parameters(config)}
    converted = {}
    for name, value in by_current_names(changes).items():
        if name not in declared:
            raise unknown_parameter(name, declared)
        converted[name] = declared[name].convert(value)
    return _replaced(config, converted)


def unknown_parameter(name: str, declared: Iterable[str]) -> InputError:
    """The error of a name that is not declared; its remedy is the nearest name that is."""
    # only the last part may have been given, such as k for glue.k
    by_part = {part: full for full in declared for part in (full, full.rpartition(".")[2])}
    near = difflib.get_close_matches(name, by_part, n=1)
    hint = f"did you mean {by_part[near[0]]}?" if near else "see `rgbd-glue params`"
    return InputError(name, "no such parameter", hint)


def _replaced(config: C, changes: Mapping[str, Value]) -> C:
    new: dict[str, Any] = {}
    for item in fields(config):  # type: ignore[arg-type]
        inside = {
            name.removeprefix(item.name + "."): value
            for name, value in changes.items()
            if name.startswith(item.name + ".")
        }
        if item.name in changes:
            new[item.name] = changes[item.name]
        elif inside:
            new[item.name] = _replaced(getattr(config, item.name), inside)
    return replace(config, **new)  # type: ignore[type-var]
