"""A stream of ROS 2 messages while it arrives."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from . import _splatseg
from .forking import use_threads
from .objects import Objects, parse
from .predicted_depth import is_function, with_network
from .segmenters import Segmenter, chosen
from .settings import combined

if TYPE_CHECKING:
    from typing_extensions import Self

_LONGEST_WAIT_S = 1e9


@dataclass(frozen=True)
class Output:
    """A kind of messages that a session publishes.

    ``topic`` starts with ``~`` for the name of the node. Whoever subscribes later gets the latest message of a
    ``latched`` topic.
    """

    name: str
    topic: str
    type: str
    latched: bool


OUTPUTS = {output[0]: Output(*output) for output in _splatseg.Live.outputs()}
"""``objects``, ``markers``, ``ids``, ``overlay``, ``points``, ``map``, ``map_frame``, ``scene_graph``, ``transform`` and
``diagnostics``."""


class Live:
    """Objects from a camera's messages while they arrive::

        with ss.Live(map="home.ply") as live:
            live.subscribe("objects")
            for topic, type, data in messages:   # CDR, e.g. of rclpy's raw subscriptions
                live.feed(topic, type, data)
                for output, message in live.messages():
                    publish(output.topic, message)

    The newest frame wins; frames are processed on a thread of their own. ``map`` is loaded if it exists, and saved every
    ``save_interval`` seconds and at the end. With ``every_frame`` no frame is dropped: :meth:`feed` waits. With a ``lag``,
    ids and overlays come that many seconds later, decided again with what has been seen since. ``config`` and all other
    keywords are settings, as for :class:`Pipeline`; ``segmenter`` may be a :class:`Segmenter` and ``depth_predictor``
    :func:`ss.depth(...) <depth>`, but no function. A camera without depth needs it and ``dataset={"depth": "none"}``.

    Raises ``TypeError`` for unknown settings, ``ValueError`` for invalid values and files.
    """

    def __init__(
        self,
        map: str | os.PathLike[str] | None = None,
        *,
        save_interval: float = 30.0,
        every_frame: bool = False,
        config: str | os.PathLike[str] | None = None,
        lag: float = 0.0,
        segmenter: str | Segmenter | None = None,
        **settings: Any,
    ) -> None:
        use_threads()
        of_segmenter, function = chosen(segmenter)
        if function is not None or is_function(settings.get("depth_predictor")):
            raise TypeError("a live session calls no functions as segmenter or depth_predictor: use Pipeline.step")
        settings = combined(of_segmenter, with_network(settings))
        self._live = _splatseg.Live(settings, map, save_interval, every_frame, config, lag)

    def feed(self, topic: str, type: str, data: bytes) -> None:
        """Takes in a message in CDR of a type such as ``sensor_msgs/msg/Image``, from any thread.

        Messages that cannot be read or used are counted, see :attr:`status`.
        """
        self._live.feed(topic, type, data)

    def wants(self, topic: str, type: str) -> bool:
        """Whether messages of a topic may be used: of suitable types at first, later of the chosen topics."""
        return self._live.wants(topic, type)

    def subscribe(self, *outputs: str) -> None:
        """Sets the kinds of messages, keys of ``OUTPUTS``, that :meth:`messages` returns. Others are not made."""
        self._live.set_wanted(list(outputs))

    def messages(self, timeout: float = 0.0) -> list[tuple[Output, bytes]]:
        """Waits for results, ``timeout`` seconds at most, and returns the newest message of each kind, in CDR."""
        if not 0 <= timeout <= _LONGEST_WAIT_S:
            raise ValueError(f"timeout is {timeout}, expected 0 to {_LONGEST_WAIT_S:.0f} seconds")
        return [(OUTPUTS[name], data) for name, data in self._live.take(timeout)]

    def save(self) -> str:
        """Saves the map now, and returns what was done."""
        return self._live.request("save")

    def load(self) -> str:
        """Replaces the map by the saved one."""
        return self._live.request("load")

    def reset(self) -> str:
        """Forgets everything."""
        return self._live.request("reset")

    def pause(self, paused: bool = True) -> str:
        """Leaves out frames, or goes on."""
        return self._live.request("pause" if paused else "resume")

    def objects(self) -> Objects:
        """All objects so far."""
        return Objects(parse(entry) for entry in json.loads(self._live.objects())["objects"])

    @property
    def status(self) -> str:
        """Rate, age, objects, and what was dropped and why, in a sentence, renewed once a second."""
        return self._live.status

    @property
    def frames(self) -> int:
        """Frames with a result, as of the latest status."""
        return self._live.frames

    @property
    def sources(self) -> list[str]:
        """The topics used, one line each; empty until they are chosen."""
        return self._live.sources

    def close(self, finish: bool = False) -> None:
        """Ends the session and saves the map; with ``finish``, after all complete frames."""
        self._live.close(finish)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
