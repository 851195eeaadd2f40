"""What tf says, live."""

import time
from collections.abc import Callable
from typing import TypeVar

from edgemap.runtime.messages.tf_tree import TfTree
from edgemap.runtime.messages.topics import KINDS, TF, TF_STATIC
from edgemap.runtime.ros2.node import Node, Reliability

WAIT_S = 6.0  # Fast DDS announces latched topics to late readers every 3 s
Answer = TypeVar("Answer")


class TfListener:
    """Gathers /tf_static and /tf for questions about frames that do not move against each other. where: for
    messages."""

    def __init__(self, node: Node, where: str) -> None:
        latched = node.subscription(TF_STATIC, KINDS[TF_STATIC], Reliability.LATCHED, depth=100)
        self._topics = [latched, node.subscription(TF, KINDS[TF], depth=100)]
        self._tree = TfTree(where)

    def ask(self, question: Callable[[TfTree], Answer | None], wait_s: float = WAIT_S) -> Answer | None:
        """An answer out of the tree, once there is one; None where there is none within the time.

        Raises CameraError for a transform that is none.
        """
        until_s = time.monotonic() + wait_s
        while True:
            for topic in self._topics:
                for message in topic.take():
                    self._tree.add(message)
            answer = question(self._tree)
            if answer is not None or time.monotonic() > until_s:
                return answer
            time.sleep(0.02)
