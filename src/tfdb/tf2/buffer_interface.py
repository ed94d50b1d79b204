"""`BufferInterface`: transforms registered types; the registries; conversions between types."""

# ruff: noqa: ARG002  (the methods that subclasses give)

from __future__ import annotations

from copy import deepcopy
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

from tfdb.data.stamps import shown
from tfdb.ros.ros_messages import message_name

from .exceptions import TransformException
from .message_checks import WrongMessageError, refuse_unlike

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = [
    "BufferInterface",
    "ConvertRegistration",
    "NotImplementedException",
    "Stamped",
    "TransformRegistration",
    "TypeException",
    "convert",
]


class TypeException(TransformException, TypeError):  # noqa: N818 - tf2's name
    """No function is registered for a type."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr
        """The text, under tf2's name."""


class NotImplementedException(TransformException, NotImplementedError):  # noqa: N818 - tf2's name
    """A subclass of BufferInterface lacks a method."""

    def __init__(self) -> None:
        self.errstr = "CanTransform or LookupTransform not implemented"
        """The text, under tf2's name."""
        super().__init__(self.errstr)


def _registered(functions: dict[Any, Callable[..., Any]], key: Any) -> Callable[..., Any]:
    """Find the function for a type, its bases or its message's name; or TypeException."""
    for kind in key.__mro__ if isinstance(key, type) else (key,):
        found = functions.get(kind)
        if found is None and isinstance(kind, type):
            found = functions.get(message_name(kind))
        if found is not None:
            return found
    raise TypeException(f"Type {key} is not loaded or supported")


def _callable(callback: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function; TypeError for an object that cannot be called."""
    if not callable(callback):
        raise TypeError(f"callback must be callable, got {type(callback).__name__}")
    return callback


class TransformRegistration:
    """The transform functions by type; one table for the process."""

    _functions: ClassVar[dict[Any, Callable[[Any, Any], Any]]] = {}

    def print_me(self) -> None:
        """Print the table."""
        print(self._functions)

    def add(self, key: type | str, callback: Callable[[Any, Any], Any]) -> None:
        """Register `callback(object, transform)`, which transforms objects of a type.

        `key` is a class, or the name of a message such as `geometry_msgs/PointStamped`, which
        stands for the classes of that name in ROS 1, ROS 2 and tfdb.
        """
        self._functions[key] = _callable(callback)

    def get(self, key: type) -> Callable[[Any, Any], Any]:
        """Return the function of a type; raise TypeException if it is missing."""
        return _registered(self._functions, key)


class ConvertRegistration:
    """The conversion functions of types; one table for the process."""

    _from_msg: ClassVar[dict[Any, Callable[[Any], Any]]] = {}
    _to_msg: ClassVar[dict[Any, Callable[[Any], Any]]] = {}
    _convert: ClassVar[dict[Any, Callable[[Any], Any]]] = {}

    def add_from_msg(self, key: type | str, callback: Callable[[Any], Any]) -> None:
        """Register `callback(message)`, which makes objects of type `key`."""
        self._from_msg[key] = _callable(callback)

    def add_to_msg(self, key: type | str, callback: Callable[[Any], Any]) -> None:
        """Register `callback(object)`, which makes messages of objects of type `key`."""
        self._to_msg[key] = _callable(callback)

    def add_convert(self, key: tuple[type, type], callback: Callable[[Any], Any]) -> None:
        """Register `callback(object)`, a conversion from the first to the second type of `key`."""
        self._convert[key] = _callable(callback)

    def get_from_msg(self, key: type) -> Callable[[Any], Any]:
        """Return the function that makes objects; raise TypeException if it is missing."""
        return _registered(self._from_msg, key)

    def get_to_msg(self, key: type) -> Callable[[Any], Any]:
        """Return the function that makes messages; raise TypeException if it is missing."""
        return _registered(self._to_msg, key)

    def get_convert(self, key: tuple[type, type]) -> Callable[[Any], Any]:
        """Return the function between two types; raise TypeException if it is missing."""
        return _registered(self._convert, key)


def convert(a: Any, b_type: Any) -> Any:
    """Make an object of another type: directly, as a copy of its own type, or through a message.

    Raises TypeException if no conversion is registered, or its message has another type.
    """
    registry = ConvertRegistration()
    try:
        direct = registry.get_convert((type(a), b_type))
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
        to_msg, from_msg = registry.get_to_msg(type(a)), registry.get_from_msg(b_type)
        made = from_msg(to_msg(a))
        kind: type = type(made)
        wanted = message_name(b_type) if isinstance(b_type, type) else None
        if wanted and message_name(kind) not in (None, wanted):
            raise TypeException(f"Type {type(a)} does not convert to {b_type}") from None
        return made
    return direct(a)


def Stamped(obj: Any, stamp: Any, frame_id: str) -> Any:  # noqa: N802 - tf2's name
    """Give an object a header with a stamp and a frame, and return it.

    Objects without free attributes, such as PyKDL's vectors, are copied into a subclass.
    """
    from tfdb.ros.ros_messages import make_header  # noqa: PLC0415 - ROS takes long to import

    return with_header(obj, make_header(stamp, frame_id))


def with_header(obj: Any, header: Any) -> Any:
    """Give an object a header, as `Stamped`."""
    try:
        obj.header = header
    except AttributeError:
        kind: Any = type(obj)
        if kind.__module__.partition(".")[0] != "PyKDL":
            text = f"obj must be an object that can have a header, got {shown(obj)}"
            raise WrongMessageError(text) from None
        obj = _open_class(kind)(obj)
        obj.header = header
    return obj


@cache
def _open_class(kind: type) -> type:
    """Make a subclass whose objects can have attributes."""
    return type(kind.__name__, (kind,), {})


class BufferInterface:
    """Transforms objects by lookups; base of `Buffer` and `BufferClient`."""

    def __init__(self) -> None:
        self.registration: TransformRegistration = TransformRegistration()
        """The table of transform functions."""

    def transform(
        self, object_stamped: Any, target_frame: str, timeout: Any = None, new_type: Any = None
    ) -> Any:
        """Transform an object with a header into a frame, at its own stamp.

        Parameters
        ----------
        object_stamped
            An object of a registered type; it is not changed.
        target_frame
            Frame to transform into.
        timeout
            How long to wait for the transform; None: no wait.
        new_type
            Type to convert the result to; None: the object's type.

        Raises TypeException, and the exceptions of `lookup_transform`.
        """
        function = self.registration.get(type(object_stamped))
        refuse_unlike(object_stamped, "object_stamped", "an object with a header", "header")
        header = object_stamped.header
        found = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        result = function(object_stamped, found)
        return convert(result, new_type) if new_type else result

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: Any,
        fixed_frame: str,
        timeout: Any = None,
        new_type: Any = None,
    ) -> Any:
        """Transform an object into a frame at another time, through a fixed frame.

        Arguments as in `transform`.
        """
        function = self.registration.get(type(object_stamped))
        refuse_unlike(object_stamped, "object_stamped", "an object with a header", "header")
        header = object_stamped.header
        found = self.lookup_transform_full(
            target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout
        )
        result = function(object_stamped, found)
        return convert(result, new_type) if new_type else result

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> Any:
        """T[target_frame<-source_frame]; a subclass implements it."""
        raise NotImplementedException

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = None,
    ) -> Any:
        """T[target_frame<-source_frame] between two times; a subclass implements it."""
        raise NotImplementedException

    def can_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> Any:
        """Whether `lookup_transform` would succeed; a subclass implements it."""
        raise NotImplementedException

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = None,
    ) -> Any:
        """Whether `lookup_transform_full` would succeed; a subclass implements it."""
        raise NotImplementedException
