"""What is kept for the page's next question, bounded by bytes: the least recently asked for goes first."""

from __future__ import annotations

from collections import OrderedDict
from typing import Generic, TypeVar

T = TypeVar("T")


class Store(Generic[T]):
    """A mapping of at most so many bytes; what was put in last is always kept."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._size = 0
        self._items: OrderedDict[str, tuple[T, int]] = OrderedDict()

    def __len__(self) -> int:
        return len(self._items)

    @property
    def bytes(self) -> int:
        """What is kept in all."""
        return self._size

    def get(self, key: str) -> T | None:
        """What was kept under a key, or None."""
        found = self._items.get(key)
        if found is None:
            return None
        self._items.move_to_end(key)
        return found[0]

    def put(self, key: str, item: T, size: int) -> list[str]:
        """Keep an item of so many bytes; returns the keys that had to go."""
        self.drop(key)
        self._items[key] = item, size
        self._size += size
        gone = []
        while self._size > self._most and len(self._items) > 1:
            oldest = next(iter(self._items))
            self.drop(oldest)
            gone.append(oldest)
        return gone

    def drop(self, key: str) -> None:
        """Forget an item, if it is there."""
        if key in self._items:
            self._size -= self._items.pop(key)[1]
