"""Some recordings of a session: what is fitted to, or kept aside."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import overload


@dataclass(frozen=True)
class Subset(Sequence[int]):
    """Recordings by their indices in the session, each once; an index for arrays of all of them.

    Rows are their places among these, as in arrays of theirs; names of files are the session's
    (:meth:`tiago_mj.gap.simulation.session.Session.subset`).

    Attributes:
        indices: in the session.
    """

    indices: tuple[int, ...]

    @classmethod
    def of(cls, indices: Iterable[int]) -> Subset:
        """Of indices in the session."""
        return cls(tuple(indices))

    def rows_of(self, some: Iterable[int]) -> list[int]:
        """Rows of recordings of this subset.

        Raises:
            ValueError: one is not of this subset.
        """
        return [self.indices.index(one) for one in some]

    def at(self, rows: Iterable[int]) -> Subset:
        """Those at some rows."""
        return Subset(tuple(self.indices[row] for row in rows))

    def without(self, excluded: Container[int]) -> Subset:
        """Those that are not among others."""
        return Subset(tuple(one for one in self.indices if one not in excluded))

    def holds(self, some: Iterable[int]) -> bool:
        """Whether all of some recordings are of this subset."""
        return set(some) <= set(self.indices)

    def __len__(self) -> int:
        return len(self.indices)

    def __iter__(self) -> Iterator[int]:
        return iter(self.indices)

    @overload
    def __getitem__(self, row: int) -> int: ...

    @overload
    def __getitem__(self, row: slice) -> Subset: ...

    def __getitem__(self, row: int | slice) -> int | Subset:
        return Subset(self.indices[row]) if isinstance(row, slice) else self.indices[row]
