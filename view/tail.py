"""A bounded history that one thread writes and readers follow, each from where it stopped."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import Generic, TypeVar

T = TypeVar("T")


class Tail(Generic[T]):
    """The last `limit` of all items ever appended, numbered from 0."""

    def __init__(self, limit: int) -> None:
        self._items: deque[T] = deque(maxlen=limit)
        self._total = 0
        self._lock = threading.Lock()

    def append(self, item: T) -> None:
        """Add an item; the oldest goes where there are too many."""
        with self._lock:
            self._items.append(item)
            self._total += 1

    def replace(self, change: Callable[[T], T]) -> None:
        """Put a changed item in the place of each one."""
        with self._lock:
            self._items = deque(map(change, self._items), maxlen=self._items.maxlen)

    def all(self) -> list[T]:
        """All that are kept, oldest first."""
        return list(self._items)

    @property
    def total(self) -> int:
        """How many were ever appended."""
        return self._total

    def since(self, number: int, most: int) -> tuple[list[T], int]:
        """At most so many items from `number` on, oldest first, and the number to ask for next."""
        with self._lock:
            oldest = self._total - len(self._items)
            first = min(max(number, oldest), self._total)
            items = list(islice(self._items, first - oldest, first - oldest + most))
        return items, first + len(items)
