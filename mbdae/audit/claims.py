"""Numbers that a text claims, beside what is counted: by numbers or functions that the caller of `audit` gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from mbdae.audit.reading import Claimed
from mbdae.values import BadValueError, option, whole

#: by the words of a claim: a number, or a function that returns one or (number, remark)
Counts = Mapping[str, int | Callable[[], int | tuple[int, str]]]


@dataclass(frozen=True)
class Count:
    """A claim with the number that was counted; None where nobody counts it."""

    claimed: Claimed
    counted: int | None
    remark: str = ""

    @property
    def verdict(self) -> str:
        """RIGHT, MISPRINT where the number is another, CANNOT JUDGE."""
        if self.counted is None:
            return "CANNOT JUDGE"
        return "RIGHT" if self.counted == self.claimed.count else "MISPRINT"


def counts_something(given: Any) -> bool:
    """Whether a value is a whole number, or may be a function that counts."""
    try:
        return callable(given) or whole(given, least=0) >= 0
    except BadValueError:
        return False


def count(claimed: Claimed, counts: Counts) -> Count:
    """The number given for the words of a claim, or what the function given for them returns."""
    words = claimed.words
    if words not in counts:
        remedy = f"audit(..., counts={{{words!r}: number, or a function that counts}})"
        return Count(claimed, None, f"nothing counts this: give {remedy}")
    given = counts[words]
    found = given() if callable(given) else given
    number, remark = found if isinstance(found, tuple) and len(found) == 2 else (found, "")
    counted = option(f"counts[{words!r}]", number, whole, "give a whole number, or a function that returns one", least=0)
    return Count(claimed, counted, str(remark))
