"""Shape, dtype and value checks, used once at each public door; and types of options, by their annotations."""

from __future__ import annotations

import math
import numbers
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeGuard, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
import torch
from torch import Tensor

from torchrender.errors import GradientError, InputError, OptionError

ArrayLike = Tensor | Sequence[float] | float
Options = TypeVar("Options")


def check_tensor(name: str, value: object, shape: Sequence[int | str]) -> Tensor:
    """Return ``value`` if it is a tensor of the given shape; a string in ``shape`` stands for any size.

    Raises:
        InputError: not a tensor, not in the CPU's memory, or another shape; the message names the argument and both
            shapes.
    """
    if not isinstance(value, Tensor):
        raise InputError(f"{name} must be a torch tensor, got {type(value).__name__}")
    check_place(name, value)
    wanted = "(" + ", ".join(str(s) for s in shape) + ")"
    if value.dim() != len(shape) or any(
        isinstance(s, int) and s != have for s, have in zip(shape, value.shape, strict=True)
    ):
        raise InputError(f"{name} must have shape {wanted}, got {tuple(value.shape)}")
    return value


def check_place(name: str, value: Tensor, error: type[InputError] = InputError) -> Tensor:
    """Return ``value`` if it lies in the CPU's memory, element beside element: kernels read it there."""
    if value.device.type != "cpu":
        raise error(f"{name} must be on the CPU, is on the device {value.device}")
    if value.layout != torch.strided:
        raise error(f"{name} must be a dense tensor, its layout is {str(value.layout).removeprefix('torch.')}")
    return value


def check_finite(name: str, value: Tensor, error: type[InputError] = InputError) -> Tensor:
    """Return ``value`` if every element is finite; the error counts the others and names the first."""
    if value.numel() and value.is_floating_point() and _is_between(value, -math.inf, math.inf):
        return value
    finite = torch.isfinite(value)
    if not bool(finite.all()):
        bad = (~finite).reshape(-1).nonzero().reshape(-1)
        raise error(f"{name} must be finite: {bad.numel()} of {value.numel()} values are not, first at {int(bad[0])}")
    return value


def _is_between(value: Tensor, low: float, high: float) -> bool:
    """Whether all numbers are above ``low`` and below ``high``: one pass without a copy, which NaN does not pass."""
    least, most = torch.aminmax(value.detach())
    return bool(low < float(least) and float(most) < high)


def check_not_negative(name: str, value: Tensor, error: type[InputError] = InputError) -> Tensor:
    """Return ``value`` if no element is below zero; the error counts the others and names the first."""
    if value.numel() and value.is_floating_point() and _is_between(value, -5e-324, math.inf):
        return value
    below = value.detach() < 0
    if bool(below.any()):
        bad = below.reshape(-1).nonzero().reshape(-1)
        raise error(f"{name} must not be negative: {bad.numel()} of {value.numel()} values are, first at {int(bad[0])}")
    return value


def check_no_gradient(function: str, **inputs: object) -> None:
    """Refuse tensors that ask for a gradient which ``function`` does not give.

    Raises:
        GradientError: names the function and the input.
    """
    if torch.is_grad_enabled():
        for name, value in inputs.items():
            if isinstance(value, Tensor) and value.requires_grad:
                raise GradientError(
                    f"{function} gives no gradient to {name}: detach it, or call it under torch.no_grad()"
                )


def check_range(name: str, value: float, low: float, high: float = math.inf) -> float:
    """Return ``value`` if ``low <= value <= high``, which NaN never is; else an OptionError names option and range."""
    if not is_number(value):
        raise OptionError(f"{name} must be a number, got {value!r}")
    if not low <= value <= high:
        limit = f">= {low}" if high == math.inf else f"in [{low}, {high}]"
        raise OptionError(f"{name} must be {limit}, got {value}")
    return value


def check_count(name: str, value: object, low: int, high: float = math.inf) -> int:
    """As :func:`check_range`, for integers of Python or NumPy alone."""
    if not is_whole(value):
        raise OptionError(f"{name} must be an integer, got {value!r}")
    return int(check_range(name, value, low, high))


def is_number(value: object) -> bool:
    """A real number: of Python, of NumPy, or a tensor of one element."""
    return isinstance(value, numbers.Real | np.number) or (isinstance(value, Tensor) and value.numel() == 1)


def check_class(name: str, value: object, *kinds: type) -> None:
    """Refuse an argument of another class than these with an InputError that names it, the classes and what it is."""
    if not isinstance(value, kinds):
        wanted = " or ".join(kind.__name__ for kind in kinds)
        raise InputError(f"{name} must be {wanted}, got {type(value).__name__}")


def options_of(options: Options | None, kind: type[Options]) -> Options:
    """Options as they are, the default ones for None; others, also empty ones such as ``{}``, are an InputError."""
    if options is None:
        return kind()
    check_class("options", options, kind)
    return options


def check_name(name: str, value: object) -> None:
    """Refuse a name that is no text, with an InputError."""
    if not isinstance(value, str):
        raise InputError(f"{name} must be text, got {type(value).__name__}")


def check_flag(name: str, value: object) -> None:
    """Refuse what is neither True nor False: "off" would count as True."""
    if not isinstance(value, bool | np.bool_):
        raise OptionError(f"{name} must be True or False, got {value!r}")


def check_choice(name: str, value: str, choices: Sequence[str]) -> str:
    """Return ``value`` if it is one of ``choices``; the error lists them."""
    if value not in choices:
        raise OptionError(f"{name} must be one of {', '.join(choices)}, got {value!r}")
    return value


def as_vector(name: str, value: ArrayLike, size: int = 3, dtype: torch.dtype = torch.float32) -> Tensor:
    """A finite tensor (size,) from a number (repeated), a sequence or a tensor."""
    try:
        out = torch.as_tensor(value, dtype=dtype)
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"{name} must be {size} numbers, got {value!r}") from error
    if out.dim() == 0:
        out = out.repeat(size)
    if out.shape != (size,):
        raise InputError(f"{name} must be {size} numbers, got shape {tuple(out.shape)}")
    return check_finite(name, check_place(name, out))


def check_picture(name: str, value: object, channels: Sequence[int]) -> Tensor:
    """A picture (H,W,C) of floats, with one of these numbers of channels; arrays of NumPy are taken as tensors.

    Raises:
        InputError: no array, another shape, or integers; says which.
    """
    shapes = " or ".join(f"(H, W, {c})" for c in channels)
    if not isinstance(value, Tensor | np.ndarray):
        raise InputError(f"{name} must be a picture {shapes}, a tensor or an array, got {type(value).__name__}")
    if len(value.shape) != 3 or value.shape[2] not in channels or 0 in value.shape:
        raise InputError(f"{name} must have shape {shapes}, got {tuple(value.shape)}")
    kind = str(value.dtype).removeprefix("torch.")
    if "float" not in kind:
        how = ": divide codes of 8 bits by 255, and undo sRGB" if kind == "uint8" else ""
        raise InputError(f"{name} must hold floats in linear light, got {kind}{how}")
    return check_place(name, value) if isinstance(value, Tensor) else as_array(name, value)


def as_array(
    name: str, value: object, dtype: torch.dtype = torch.float64, error: type[InputError] = InputError
) -> Tensor:
    """A tensor as it is; nested lists and arrays of NumPy as one, lists as ``dtype``.

    Arrays of floats keep their precision.

    Raises:
        InputError: rows of several lengths, no numbers, or a tensor elsewhere than on the CPU; names the argument.
    """
    if isinstance(value, Tensor):
        return check_place(name, value, error)
    try:
        array = np.array(value)  # a copy: what the caller does to his array later changes nothing here
        tensor = torch.from_numpy(array.astype(array.dtype.newbyteorder("=")))
    except (TypeError, ValueError, RuntimeError) as reason:
        raise error(f"{name} must be numbers in rows of one length ({reason})") from reason
    if tensor.is_floating_point() and tensor.numel() and (isinstance(value, np.ndarray) or not dtype.is_floating_point):
        return tensor  # as precise as it was given; floats that should be integers are for the caller to refuse
    return tensor.to(dtype)


# ---------------------------------------------------------------- fields of options
Kind = TypeVar("Kind", bound=type)
Accepts = Callable[[Any], bool]


@dataclass(frozen=True)
class _Rule:
    """What a field takes."""

    words: str
    accepts: Accepts
    exact: tuple[type, ...] = ()  # values of just these types need no look
    plain: Callable[[Any], Any] | None = None  # the value as it is kept, where another spelling was given


def checked_fields(kind: Kind) -> Kind:
    """A decorator beneath ``@dataclass``, of every class of options: fields are of the type they are annotated with.

    Booleans are True or False, integers are no floats and no booleans, floats are numbers but not NaN, options within
    options are of their class, and lists are kept as tuples where these are declared. Ranges and choices stay with the
    class, in its ``__post_init__``, which finds every field of the type that it declares.

    Raises:
        OptionError: on construction, where a value is of another type; names the field and the type.
        TypeError: on the first construction, where a field has an annotation that cannot be checked.
    """
    own = kind.__dict__.get("__post_init__")
    plans: list[tuple[str, frozenset[type], _Rule]] = []

    def __post_init__(self: Any) -> None:
        if not plans:
            plans.extend(_plan(kind))
        held = self.__dict__
        for name, exact, rule in plans:
            value = held[name]
            if type(value) not in exact or (type(value) is float and value != value):
                held[name] = _checked(name, value, rule)
        if own is not None:
            own(self)

    kind.__post_init__ = __post_init__  # type: ignore[attr-defined]
    return kind


def _plan(kind: type) -> list[tuple[str, frozenset[type], _Rule]]:
    """Of every annotated field its rule; ``kind`` is a dataclass by now."""
    hints = get_type_hints(kind)
    rules = {name: _rule(hints[name]) for name in kind.__dataclass_fields__}  # type: ignore[attr-defined]
    return [(name, frozenset(rule.exact), rule) for name, rule in rules.items()]


def _checked(name: str, value: Any, rule: _Rule) -> Any:
    if not rule.accepts(value):
        raise OptionError(f"{name} must be {rule.words}, got {_short(value)}")
    return value if rule.plain is None else rule.plain(value)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _rule(hint: Any) -> _Rule:
    """What an annotation means."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in _SIMPLE:
        return _SIMPLE[hint]
    if origin in (Union, types.UnionType):
        return _any_of([_rule(one) for one in inner])
    if origin is tuple:
        return _tuple_of(inner)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return _Rule("a mapping", lambda value: isinstance(value, Mapping))
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return _Rule("a sequence", _is_sequence)
    if isinstance(hint, type) and origin is None:
        return _Rule(hint.__name__, lambda value: isinstance(value, hint), (hint,))
    raise TypeError(f"options have no way to check {hint!r}")


def _any_of(rules: Sequence[_Rule]) -> _Rule:
    tuples = [rule for rule in rules if rule.plain is not None]

    def plain(value: Any) -> Any:
        return tuples[0].plain(value) if isinstance(value, list) and tuples[0].plain else value

    return _Rule(
        " or ".join(rule.words for rule in rules),
        lambda value: any(rule.accepts(value) for rule in rules),
        tuple(one for rule in rules for one in rule.exact),
        plain if tuples else None,
    )


def _tuple_of(inner: Sequence[Any]) -> _Rule:
    """Tuples of any length (``tuple[str, ...]``) or of a certain one; lists are taken as such."""
    if len(inner) == 2 and inner[1] is Ellipsis:
        rule = _rule(inner[0])
        words, length = f"a tuple, each {rule.words}", None
    else:
        rule = _any_of([_rule(one) for one in dict.fromkeys(inner)])
        words, length = f"{len(inner)} values, each {rule.words}", len(inner)

    def accepts(value: Any) -> bool:
        fits = isinstance(value, tuple | list) and length in (None, len(value))
        return fits and all(rule.accepts(one) for one in value)

    return _Rule(words, accepts, (), plain=lambda value: tuple(value) if isinstance(value, list) else value)


def _is_sequence(value: Any) -> bool:
    return isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)


def is_whole(value: object) -> TypeGuard[int]:
    """An integer of Python or NumPy; True and False are none."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def _is_float(value: Any) -> bool:
    return is_number(value) and not isinstance(value, bool | np.bool_) and not math.isnan(value)


_SIMPLE: dict[Any, _Rule] = {
    Any: _Rule("anything", lambda _: True),
    bool: _Rule("True or False", lambda value: isinstance(value, bool | np.bool_), (bool,)),
    int: _Rule("an integer", is_whole, (int,)),
    float: _Rule("a number", _is_float, (float, int)),
    str: _Rule("text", lambda value: isinstance(value, str), (str,)),
    type(None): _Rule("None", lambda value: value is None, (type(None),)),
}
