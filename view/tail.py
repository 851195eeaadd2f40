"""A bounded history that one thread writes and readers follow, each from where it stopped."""

import threading
from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import Generic, TypeVar

T = TypeVar("T")


class Tail(Generic[T]):
    """The last `limit` of all appended items, numbered from 0."""

    def __init__(self, limit: int) -> None:
        self._items: deque[T] = deque(maxlen=limit)
        self._total = 0
        self._lock = threading.Lock()

    def append(self, item: T) -> None:
        """Adds an item, and drops the oldest beyond the limit."""
        with self._lock:
            self._items.append(item)
            self._total += 1

    def replace(self, change: Callable[[T], T]) -> None:
        """Replaces each item by its changed version."""
        with self._lock:
            self._items = deque(map(change, self._items), maxlen=self._items.maxlen)

    def all(self) -> list[T]:
        """All stored items, oldest first."""
        return list(self._items)

    @property
    def total(self) -> int:
        """Number of items appended so far."""
        return self._total

    def since(self, number: int, most: int) -> tuple[list[T], int]:
        """At most `most` items from `number` on, oldest first, and the number of the next one."""
        with self._lock:
            oldest = self._total - len(self._items)
            first = min(max(number, oldest), self._total)
            items = list(islice(self._items, first - oldest, first - oldest + most))
        return items, first + len(items)
