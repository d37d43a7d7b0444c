"""The table of claims, ``claims.yaml``, and how a verdict follows from facts."""

import operator
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from types import SimpleNamespace
from typing import Any, NamedTuple

import pandas as pd
import yaml

REPRODUCED = "reproduced"
PARTLY = "partly reproduced"
NOT_REPRODUCED = "not reproduced"
INPUT = "input"
CALIBRATED = "calibrated"
BEYOND = "not in the paper"
EVIDENCE = "evidence"
COULD_FAIL = (REPRODUCED, PARTLY, NOT_REPRODUCED)
"""Verdicts on claims that could have failed."""
VERDICTS = (*COULD_FAIL, INPUT, CALIBRATED, BEYOND)
"""The same, and those on inputs, on values calibrated to, and on what the paper does not have."""

Facts = Mapping[str, Any]

_SIGNS = {"==": operator.eq, "<": operator.lt, "<=": operator.le, ">": operator.gt,
          ">=": operator.ge}  # fmt: skip


class Claim(NamedTuple):
    """A row of ``tables/paper_vs_ours.csv``.

    `result` is this library's result, `value` the same in short, `rule` the rule of comparison.
    `kind` says whether the row could have failed ("evidence"), is an "input", "calibrated", or
    "beyond" the paper; `budget` is that of the search it rests on.
    """

    where: str
    claim: str
    paper: str
    result: str
    rule: str
    verdict: str
    value: str
    kind: str
    budget: str


@cache
def table() -> dict[str, Any]:
    """The table of claims; limits by attribute, phrases with the limits filled in."""
    found = yaml.safe_load((files(__package__) / "claims.yaml").read_text(encoding="utf-8"))
    found["limits"] = SimpleNamespace(**found["limits"])
    found["phrases"] = {
        name: text.format(limits=found["limits"]) for name, text in found["phrases"].items()
    }
    return found


def known(facts: Facts) -> Facts:
    """Facts with the limits and phrases of the table."""
    return {"limits": table()["limits"], **table()["phrases"], **facts}


def _value(name: str, facts: Facts) -> Any:
    """A fact, an attribute of one, a number, or the text itself."""
    first, *attributes = name.split(".")
    if first in facts:
        value = facts[first]
        for attribute in attributes:
            value = getattr(value, attribute)
        return value
    try:
        return float(name)
    except ValueError:
        return name


def holds(condition: str, facts: Facts) -> bool:
    """Whether a condition of the table holds: a fact, or two values and a sign between."""
    left, *rest = condition.split()
    if not rest:
        return bool(_value(left, facts))
    sign, right = rest
    return bool(_SIGNS[sign](_value(left, facts), _value(right, facts)))


def verdict(row: Mapping[str, Any], facts: Facts) -> str:
    """The verdict of a row of the table.

    The row has `reproduced` and perhaps `partly` (a condition or several that must all hold), or
    `each` (conditions: reproduced if all hold, partly if more than half do), or neither. What would
    be reproduced is an input or calibrated where all conditions under `input` or `calibrated` hold.
    """
    facts = known(facts)
    reached, kind = _reached(row, facts), _kind(row, facts)
    return kind if reached == REPRODUCED and kind != EVIDENCE else reached


def _kind(row: Mapping[str, Any], facts: Facts) -> str:
    """Whether a row could have failed, whatever its result."""
    for kind in (INPUT, CALIBRATED):
        if kind in row and all(holds(condition, facts) for condition in row[kind]):
            return kind
    return EVIDENCE if "each" in row or "reproduced" in row else "beyond"


def _reached(row: Mapping[str, Any], facts: Facts) -> str:
    """The verdict as if every row could fail."""
    if "each" in row:
        found = [holds(condition, facts) for condition in row["each"]]
        mostly = PARTLY if 2 * sum(found) > len(found) else NOT_REPRODUCED
        return REPRODUCED if all(found) else mostly
    if "reproduced" not in row:
        return BEYOND
    for name, reached in (("reproduced", REPRODUCED), ("partly", PARTLY)):
        conditions = row.get(name, [])
        conditions = [conditions] if isinstance(conditions, str) else conditions
        if conditions and all(holds(condition, facts) for condition in conditions):
            return reached
    return NOT_REPRODUCED


def judge(row: Mapping[str, Any], *facts: Facts, names: Sequence[str] = ()) -> Claim:
    """Judge a row of the table by the facts of one architecture or of several with names.

    All of them count: if their verdicts differ, the claim is partly reproduced.
    """
    decisive = known(facts[0])
    found = [row["result"].format(**known(each)) for each in facts]
    named = [f"{name}: {text}" for name, text in zip(names, found, strict=True)] if names else found
    rule = row["rule"].format(**decisive)
    verdicts = [verdict(row, each) for each in facts]
    agreed = verdicts[0] if len(set(verdicts)) == 1 else PARTLY
    if len(set(verdicts)) > 1:
        each = ", ".join(f"{name}: {own}" for name, own in zip(names, verdicts, strict=True))
        rule = f"{rule} ({each})"
    return Claim(
        where=row.get("where", "-"),
        claim=row["claim"].format(**decisive),
        paper=str(row.get("paper", "-")).format(**decisive),
        result="; ".join(named),
        rule=rule,
        verdict=agreed,
        value=row["value"].format(**decisive) if "value" in row else found[0],
        kind=_kind(row, decisive),
        budget=row.get("budget", "-").format(**decisive),
    )


def claims_table(claims: Sequence[Claim]) -> pd.DataFrame:
    """Claims as a table, a row for each."""
    return pd.DataFrame(claims, columns=Claim._fields)
